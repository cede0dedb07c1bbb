-- tb.system and tb.run_system: what is recorded, what is refused, and runs against closed forms.
local tb = require "tribode"

local function near(found, wanted, tolerance)
  assert(math.abs(found - wanted) <= tolerance, string.format("%.17g instead of %.17g", found, wanted))
end

local function refused(message, make)
  local ok, text = pcall(make)
  assert(not ok and text:find(message, 1, true), tostring(text))
end

-- An oscillator with an input, by every solver: x = cos 2t + (2 sin t - sin 2t)/6 under sin t.
local oscillator = tb.system {
  name = "oscillator",
  parameters = { w = { value = 2, unit = "rad/s" } },
  inputs = { u = { unit = "N/kg" } },
  states = { x = { start = 1, unit = "m" }, v = { unit = "m/s" } },
  der = function(s) return { x = s.v, v = s.u - s.w ^ 2 * s.x } end,
  outputs = function(s) return { energy = { (s.v ^ 2 + s.w ^ 2 * s.x ^ 2) / 2, unit = "J/kg" } } end,
}
local run = tb.run_system { system = oscillator, duration_s = 3, output_step_s = 0.5 }
assert(run.ok and run.message == "" and run.solver == "exact" and #run.t == 7)
for i, t in ipairs(run.t) do
  near(run.values.x[i], math.cos(2 * t), 1e-14)
  near(run.values.energy[i], 2, 1e-14)
end
assert(run.columns[1].name == "t" and run.columns[4].name == "energy" and run.columns[4].unit == "J/kg")
for _, solver in ipairs { "auto", "erk", "adams", "bdf" } do
  run = tb.run_system { system = oscillator, duration_s = 3, solver = solver, inputs = { u = math.sin } }
  near(run.final.x, math.cos(6) + (2 * math.sin(3) - math.sin(6)) / 6, 1e-6)
  assert(run.solver == (solver == "auto" and "erk" or solver))
end

-- Parameters, start values and inputs of a run.
run = tb.run_system { system = oscillator, duration_s = 1, parameters = { w = 3 }, start = { x = 2 } }
near(run.final.x, 2 * math.cos(3), 1e-13)
run = tb.run_system { system = oscillator, duration_s = 1, inputs = { u = 4 } }
near(run.final.x, 1, 1e-14)
-- Samples are held: 4 from the start, 0 from t = 0.5.
run = tb.run_system { system = oscillator, duration_s = 1, inputs = { u = { sample_time_s = 0.5, values = { 4, 0 } } } }
near(run.final.x, math.cos(1), 1e-14)

-- Between samples an input may be a line: x' = u, from 0 at 0.25 s on, over 1 s to 2, then held.
local integrator = tb.system {
  inputs = { u = { value = 7, unit = "m/s" } },
  states = { x = { unit = "m" } },
  der = function(s) return { x = s.u } end,
}
local ramp = { sample_time_s = 1, values = { 0, 2 }, interpolation = "linear", offset_s = 0.25 }
for _, solver in ipairs { "exact", "erk" } do
  run = tb.run_system { system = integrator, duration_s = 2.25, output_step_s = 0.25, inputs = { u = ramp },
    solver = solver }
  near(run.final.x, 7 / 4 + 1 + 2, solver == "exact" and 1e-14 or 1e-7)
  near(run.values.x[4], 7 / 4 + 0.5 ^ 2, solver == "exact" and 1e-14 or 1e-7) -- t = 0.75: 2 (t - 0.25) so far
  near(run.values.u[1], 7, 0)
  near(run.values.u[4], 1, 1e-15)
  near(run.values.u[10], 2, 0)
end
-- Band-limited, a sine is one between its samples, too: to the (w h)^4/384 of a cubic.
local sine = {}
for k = 0, 200 do sine[k + 1] = math.sin(2 * math.pi * k / 6) end
run = tb.run_system { system = integrator, duration_s = 200, output_step_s = 0.5,
  inputs = { u = { sample_time_s = 1, values = sine, interpolation = "band_limited" } } }
for i, t in ipairs(run.t) do
  if t > 50 and t < 150 then near(run.values.u[i], math.sin(2 * math.pi * t / 6), 4e-3) end
end
refused("interpolation = \"spline\"", function()
  tb.run_system { system = integrator, duration_s = 1,
    inputs = { u = { sample_time_s = 1, values = { 1 }, interpolation = "spline" } } }
end)

-- A branch becomes an event: the motion against a stop with a spring, known piece by piece.
local stop = tb.system {
  states = { x = 1, v = 0 },
  der = function(s) return { x = s.v, v = tb.where(tb.less(s.x, 0), -4 * s.x, -1) } end,
}
run = tb.run_system { system = stop, duration_s = 3.5 }
local t0 = math.sqrt(2) -- falls for so long, then half a period pi/2 of the spring, then rises
local rising = 3.5 - t0 - math.pi / 2
near(run.final.x, math.sqrt(2) * rising - rising ^ 2 / 2, 1e-13)
assert(run.solver == "exact")

-- Sampled state feedback, recorded and called, gives the same numbers.
local function loop(kind)
  return tb.system {
    states = { x = 1 },
    discrete = { u = 0 },
    der = function(s) return { x = s.x + s.u } end,
    sample = { { period_s = 0.1, [kind] = function(s) return { u = -3 * s.x } end } },
  }
end
local recorded = tb.run_system { system = loop "set", duration_s = 1 }
local called = tb.run_system { system = loop "call", duration_s = 1 }
assert(recorded.final.x == called.final.x)
local a, b = math.exp(0.1), math.exp(0.1) - 1 -- x[k+1] = a x[k] + b u[k]
near(recorded.final.x, (a - 3 * b) ^ 10, 1e-14)

-- Parts: a motor twice, the second driven by the first.
local lag = tb.system {
  parameters = { T = 1 },
  inputs = { u = 0 },
  states = { y = 0 },
  der = function(s) return { y = (s.u - s.y) / s.T } end,
  outputs = function(s) return { twice = 2 * s.y } end,
}
local gain = tb.system { inputs = { u = 0 }, outputs = function(s) return { y = s.u / 2 } end }
local chain = tb.system {
  parts = { first = lag, second = lag, half = gain },
  inputs = { u = 0 },
  connect = function(s) return { ["second.u"] = s.half.y, ["half.u"] = s.first.twice, ["first.u"] = s.u } end,
  outputs = function(s) return { sum = s.first.y + s.second.y } end,
}
run = tb.run_system { system = chain, duration_s = 1, inputs = { u = 1 } }
local e = math.exp(-1)
near(run.final["first.y"], 1 - e, 1e-14)
near(run.final["second.y"], 1 - 2 * e, 1e-14)
near(run.values.sum[#run.t], 2 - 3 * e, 1e-14)

-- Where clocks of parts meet, what is set is read after: whatever the parts are called, u[k] is made of y[k].
local sensor = tb.system {
  inputs = { y = 0 },
  discrete = { q = 0 },
  sample = { { period_s = 0.1, set = function(s) return { q = math.floor(s.y / 0.25 + 0.5) * 0.25 } end } },
}
local doubler = tb.system {
  inputs = { q = 0 },
  discrete = { u = 0 },
  sample = { { period_s = 0.1, set = function(s) return { u = 2 * s.q } end } },
}
for _, names in ipairs { { "a", "b" }, { "b", "a" } } do
  local from, to = names[1], names[2]
  run = tb.run_system {
    system = tb.system {
      parts = { [from] = sensor, [to] = doubler },
      connect = function(s) return { [from .. ".y"] = s.t, [to .. ".q"] = s[from].q } end,
    },
    duration_s = 1,
  }
  assert(run.final[from .. ".q"] == 1 and run.final[to .. ".u"] == 2)
end
local variables = tb.system_variables { system = doubler }
assert(#variables.states == 0 and variables.discrete[1].name == "u" and variables.inputs[1].value == 0)

-- Outputs of a mode; a condition below no_event is no event, so that a system with it is not affine.
local toggled = tb.system {
  states = { x = 0 },
  der = function() return { x = 1 } end,
  modes = {
    low = {
      outputs = function(s) return { y = s.x } end,
      when = { { crossing = function(s) return 0.5 - s.x end, mode = "high" } },
    },
    high = { outputs = function(s) return { y = -s.x } end },
  },
  start_mode = "low",
  outputs = function(s) return { z = 2 * s.x } end,
}
run = tb.run_system { system = toggled, duration_s = 1, output_step_s = 0.25 }
assert(run.values.y[2] == 0.25 and run.values.y[5] == -1 and run.values.z[5] == 2 and run.solver == "exact")
refused("modes.high: there is no output y", function()
  local low = { outputs = function() return { y = 1 } end }
  tb.system { states = {}, modes = { high = {}, low = low }, start_mode = "low" }
end)
run = tb.run_system {
  system = tb.system {
    states = { x = -0.25 },
    der = function(s) return { x = tb.no_event(tb.where(tb.less(s.x, 0), 1, 2)) } end,
  },
  duration_s = 1,
}
assert(run.solver == "erk")
near(run.final.x, 1.5, 1e-6)

-- Modes, and what a run says at its end.
local thermostat = tb.system {
  states = { T = 18 },
  modes = {
    heating = {
      der = function(s) return { T = 2 - 0.1 * (s.T - 10) } end,
      when = { { name = "warm", crossing = function(s) return s.T - 21 end, direction = "rising", mode = "cooling" } },
    },
    cooling = {
      der = function(s) return { T = -0.1 * (s.T - 10) } end,
      when = { { name = "cold", condition = function(s) return tb.less(s.T, 19) end, mode = "heating" } },
    },
  },
  start_mode = "heating",
}
run = tb.run_system { system = thermostat, duration_s = 6 }
assert(run.solver == "exact" and run.final.mode == "heating" and #run.events == 2)
assert(run.events[1].name == "warm" and run.events[2].name == "cold")
near(run.events[1].t, 10 * math.log(12 / 9), 1e-13)
near(run.events[2].t, 10 * math.log(12 / 9) + 10 * math.log(11 / 9), 1e-13)

run = tb.run_system {
  system = tb.system { states = { x = 1 }, der = function(s) return { x = -1 / math.sqrt(s.x) } end },
  duration_s = 1,
}
assert(not run.ok)
assert(run.message:find "der%(x%) %(.*systems.lua:%d+%) is not a finite number at t = 0.66666", run.message)
assert(run.t_end < 2 / 3 + 1e-6)

-- `exact` begins with steps as short as the fastest decay, however short that is.
for _, k in ipairs { 1e9, 1e10, 1e12 } do
  for _, start in ipairs { 0, 1000 } do
    run = tb.run_system {
      system = tb.system { states = { x = 0, y = 0 },
        der = function(s) return { x = -k * (s.x - 1), y = s.x - s.y } end },
      start_time_s = start,
      duration_s = 1,
    }
    assert(run.ok and run.solver == "exact", run.message)
    assert(math.abs(run.final.x - 1) < 1e-15)
    assert(math.abs(run.final.y - (1 - math.exp(-1) - math.exp(-1) / (k - 1))) < 1e-12)
  end
end

-- Each method names the equation without a value, and where.
for _, solver in ipairs { "erk", "adams", "bdf", "fixed" } do
  run = tb.run_system {
    system = tb.system { states = { x = 1, y = 0 }, der = function(s) return { x = -1, y = math.sqrt(s.x) } end },
    duration_s = 2,
    solver = solver,
  }
  assert(not run.ok and math.abs(run.t_end - 1) < 1e-4)
  assert(run.message:find "der%(y%) %(.*systems.lua:%d+%) is not a finite number at t = 1", run.message)
end

-- Branches that cannot be recorded are refused, at their line.
local function system_of(der) return function() return tb.system { states = { x = 1, y = 0 }, der = der } end end
refused("cannot be compared while equations are recorded", system_of(function(s)
  if s.x < 0 then return { x = 1, y = 0 } end
  return { x = 2, y = 0 }
end))
refused("systems.lua:" .. (debug.traceback():match "systems.lua:(%d+)" + 2) .. ": ", system_of(function(s)
  local slope = 2
  if s.x == 3 then slope = 1 end
  return { x = slope, y = 0 }
end))
refused("takes a branch on the value", system_of(function(s)
  return { x = tb.less(s.x, 0.5) and 1 or 2, y = 0 }
end))
refused("takes a branch on the value", system_of(function(s)
  return { x = not tb.less(s.x, 0.5) and 1 or 2, y = 0 }
end))
-- Both conditions of an `or` and `and` would count, `~=` and a loop decide once, a table is looked up once.
for _, der in ipairs {
  function(s) return { x = tb.where(tb.less(s.x, 0) or tb.less(s.y, 0), 1, 2), y = 0 } end,
  function(s) return { x = tb.where(tb.less(s.x, 0) and tb.less(s.y, 0), 1, 2), y = 0 } end,
  function(s) return { x = s.x ~= 0 and s.y or 7, y = 0 } end,
  function(s)
    local n = 0
    while tb.less(s.x, 0) and n < 3 do n = n + 1 end
    return { x = n, y = 0 }
  end,
  function(s) return { x = ({ [1] = 5 })[s.x] or 0, y = 0 } end,
  function(s) return { x = s.x + s.y == 2.5 and 1 or 2, y = 0 } end,
  function(s) return { x = 3 * s.x - 0.75 == 1.5 and 1 or 2, y = 0 } end,
  function(s) return { x = s.x ^ 2 == 6.25 and 1 or 2, y = 0 } end,
} do
  local ok, text = pcall(system_of(der))
  assert(not ok and text:find "systems.lua:%d+: tb.system: der takes a branch on the value", text)
end
-- Functions of the script that decide, constants of the script by their names, and tables without a key of 0 or 1.
local constants, REVERSE <const>, held = { REVERSE = 4.5 }, 5.5, 6.5
local function ratio(gear)
  if gear == 3 then return 1 elseif gear == 2 then return 2 end
  return 4
end
local ratios = { [2] = 5, [7] = 6 }
for _, der in ipairs {
  function(s) return { x = ratio(s.x), y = 0 } end,
  function(s) return { x = 2 * math.max(ratio(s.y), s.x), y = 0 } end,
  function(s) return { x = s.x == constants.REVERSE and 1 or 2, y = 0 } end,
  function(s) return { x = s.x == REVERSE and 1 or 2, y = 0 } end,
  function(s) return { x = s.x == held and 1 or 2, y = 0 } end,
  function(s) return { x = s.x == 1 and s.y == 2 and 1 or 2, y = 0 } end,
  function(s) return { x = ratios[s.x] or 7, y = 0 } end,
  function(s) return { x = ({ [3] = 5, [4] = 6 })[s.x] or 7, y = 0 } end,
} do
  local ok, text = pcall(system_of(der))
  assert(not ok and text:find "systems.lua:%d+: tb.system: der takes a branch on the value", text)
end
local helper_line = debug.traceback():match "systems.lua:(%d+)" - 17
refused("systems.lua:" .. helper_line .. ": tb.system: der takes a branch", system_of(function(s)
  return { x = ratio(s.x), y = 0 }
end))
-- So is an input that is a function of the time.
local driven = tb.system { inputs = { u = 0 }, states = { x = 0 }, der = function(s) return { x = s.u } end }
local function driven_by(u) return tb.run_system { system = driven, duration_s = 10, inputs = { u = u } } end
for _, u in ipairs {
  function(t) return math.floor(t) % 2 == 0 and 1 or -1 end,
  function(t) if math.floor(t) == 3 then return 100 end return 0 end,
  function(t) return ratios[math.floor(t)] or 0 end,
  function(t) return ratio(t) end,
} do
  refused("tb.run_system: inputs.u takes a branch on the value", function() driven_by(u) end)
end
assert(math.abs(driven_by(function(t) return 1 - 2 * (math.floor(t) % 2) end).final.x) < 1e-9)
assert(math.abs(driven_by(math.sin).final.x - (1 - math.cos(10))) < 1e-7)
assert(driven_by(function() return ratio(3) end).final.x == 10)
-- A variable by itself is true in Lua, whatever its value, in a run as while it is recorded.
assert(tb.run_system { system = system_of(function(s) return { x = s.x and 3 or 4, y = 0 } end)(),
  duration_s = 1 }.final.x == 4)
refused("== while equations are recorded", system_of(function(s)
  return { x = s.x == s.y and 1 or 2, y = 0 }
end))
refused("must be a value; tb.where makes one of it", system_of(function(s)
  return { x = tb.less(s.x, 0) * 2, y = 0 }
end))
refused("math.fmod", system_of(function(s) return { x = math.fmod(s.x, 2), y = 0 } end))

-- So are wrong equations.
refused("z is not a variable of the system", system_of(function(s) return { x = s.z, y = 0 } end))
refused("no equation for the state y; 2 states need 2 equations", system_of(function() return { x = 0 } end))
refused("z is not a state", system_of(function() return { x = 0, y = 0, z = 0 } end))
refused("variables of a system cannot be set here", system_of(function(s) s.x = 2 end))
refused("returns a number, must return a table", system_of(function() return 3 end))
refused("a.u needs b.y needs b.u needs a.y needs a.u", function()
  tb.system {
    parts = { a = gain, b = gain },
    connect = function(s) return { ["a.u"] = s.b.y, ["b.u"] = s.a.y } end,
  }
end)
refused("a.v is not an input of a part (did you mean \"a.u\"?)", function()
  tb.system { parts = { a = gain }, connect = function() return { ["a.v"] = 1 } end }
end)
refused("second.u is in V, first.F in N, must be in the same unit", function()
  local force = tb.system { outputs = function() return { F = { 2, unit = "N" } } end }
  local amplifier = tb.system { inputs = { u = { unit = "V" } } }
  tb.system {
    parts = { first = force, second = amplifier },
    connect = function(s) return { ["second.u"] = s.first.F } end,
  }
end)
-- Units, where all are given.
local function mass_with(der, more)
  local system = {
    parameters = { m = { value = 2, unit = "kg" }, k = { value = 8, unit = "N/m" } },
    inputs = { F = { unit = "N" } },
    states = { x = { start = 1, unit = "m" }, v = { start = 0, unit = "m/s" } },
    der = der,
  }
  for name, value in pairs(more or {}) do system[name] = value end
  return function() return tb.system(system) end
end
local function newton(s) return { x = s.v, v = (s.F - s.k * s.x) / s.m } end
mass_with(newton, { outputs = function(s) return { E = { s.k * s.x ^ 2 + s.m * s.v ^ 2, unit = "J" } } end })()
refused("systems.lua:" .. (debug.traceback():match "systems.lua:(%d+)" + 1) .. ": tb.system: der: v: the derivative " ..
  "must be in m/s2, but is in kg m/s2", mass_with(function(s) return { x = s.v, v = s.F - s.k * s.x } end))
refused("der: v: F - v subtracts between kg m/s2 and m/s", mass_with(function(s)
  return { x = s.v, v = (s.F - s.v) / s.m }
end))
refused("sin(x) needs a plain number, but x is in m", mass_with(function(s)
  return { x = s.v, v = math.sin(s.x) }
end))
refused("v: the derivative must be in m/s2, but is in m; the number -4 is a plain factor, a parameter can have a unit",
  mass_with(function(s) return { x = s.v, v = -4 * s.x } end))
refused("outputs: E: it must be in kg m2/s2, but is in kg m/s2", mass_with(newton, {
  outputs = function(s) return { E = { s.k * s.x, unit = "J" } } end,
}))
refused("when[1].set: v: the new value must be in m/s, but is in m", mass_with(newton, {
  when = { { crossing = function(s) return s.x end, set = function(s) return { v = s.x } end } },
}))

refused("states is a number", function() tb.system { states = 3 } end)
refused("state is not a known field (did you mean \"states\"?)", function() tb.system { state = {} } end)
refused("when[1]: must have either a condition or a crossing", function()
  tb.system { states = { x = 0 }, der = function() return { x = 1 } end, when = { { set = function() return {} end } } }
end)
refused("\"running\" is not a mode", function()
  tb.system { states = {}, modes = { a = {}, b = {} }, start_mode = "running" }
end)
refused("duration_s is missing", function() tb.run_system { system = stop } end)
refused("system is a table, must be a system", function() tb.run_system { system = {}, duration_s = 1 } end)
refused("inputs: v is not an input of the system", function()
  tb.run_system { system = oscillator, duration_s = 1, inputs = { v = 1 } }
end)
refused("der(v) is not linear in x", function()
  local pendulum = tb.system { states = { x = 1, v = 0 }, der = function(s) return { x = s.v, v = -math.sin(s.x) } end }
  tb.run_system { system = pendulum, duration_s = 1, solver = "exact" }
end)

-- Linear systems: the oscillator's poles and response, and a sampled loop's poles in z.
local linear = tb.linearize { system = oscillator, frequency_hz = { 0.1, 1 } }
assert(linear.sample_time_s == 0 and #linear.poles == 2 and linear.rate_left == 4 and not linear.stable)
near(linear.poles[1].imag, -2, 1e-14)
local w2 = (2 * math.pi) ^ 2
assert(linear.outputs[1] == "energy" and linear.A[2][1] == 1 or linear.A[1][2] == 1)
near(tb.linearize { system = oscillator, at = { x = 0 } }.rate_left, 0, 0)
local plain = tb.system {
  inputs = { u = 0 },
  states = { x = 0, v = 0 },
  der = function(s) return { x = s.v, v = s.u - 4 * s.x } end,
  outputs = function(s) return { y = s.x } end,
}
linear = tb.linearize { system = plain, frequency_hz = { 0.1, 1 } }
near(linear.response.real[2], 1 / (4 - w2), 1e-15)
assert(linear.margins.modulus_margin > 0)
for _, kind in ipairs { "set", "call" } do
  linear = tb.linearize { system = loop(kind), at = { x = 0 } }
  near(linear.poles[2].real, a - 3 * b, 1e-9)
  assert(linear.sample_time_s == 0.1 and linear.stable and linear.jump_left == 0)
end
refused("at: z is not a known field", function() tb.linearize { system = plain, at = { z = 1 } } end)
