-- tb.steady_state and start = "steady": against closed forms, and what is refused.
local tb = require "tribode"

local function near(found, wanted, tolerance)
  assert(math.abs(found - wanted) <= tolerance * (1 + math.abs(wanted)),
    string.format("%.17g instead of %.17g", found, wanted))
end

local function refused(message, make)
  local ok, text = pcall(make)
  assert(not ok and text:find(message, 1, true), tostring(text))
end

-- Two tanks in a row, by Torricelli: h = (q/a)^2/(2 g).
local tanks = tb.system {
  name = "tanks",
  parameters = { a1 = { value = 4e-4, unit = "m2" }, a2 = { value = 3e-4, unit = "m2" },
    g = { value = 9.81, unit = "m/s2" }, A = { value = 0.1, unit = "m2" } },
  inputs = { q = { value = 1e-3, unit = "m3/s" } },
  states = { h1 = { start = 0.1, unit = "m" }, h2 = { start = 0.1, unit = "m" } },
  discrete = { alarm = 0 },
  der = function(s)
    local function out(a, h) return a * tb.no_event(math.sqrt(math.max(2 * s.g * h, 0))) end
    return { h1 = (s.q - out(s.a1, s.h1)) / s.A, h2 = (out(s.a1, s.h1) - out(s.a2, s.h2)) / s.A }
  end,
  outputs = function(s) return { total = s.h1 + s.h2 } end,
  when = { { name = "high", condition = function(s) return tb.greater(s.h2, 1) end,
    set = function() return { alarm = 1 } end } },
}
local function level(q, a) return (q / a) ^ 2 / (2 * 9.81) end
local steady = tb.steady_state { system = tanks }
near(steady.start.h1, level(1e-3, 4e-4), 1e-12)
near(steady.start.h2, level(1e-3, 3e-4), 1e-12)
assert(steady.residual < 1e-12 and steady.start.alarm == 0 and steady.inputs.q == 1e-3 and #steady.conditions == 0)
-- The run stays there, until its input changes; the input is as it is at the start.
local function rise(t) return 1e-3 + 1e-4 * math.max(t - 5, 0) end
local run = tb.run_system { system = tanks, start = "steady", duration_s = 5, inputs = { q = rise }, output_step_s = 1 }
for i = 1, #run.t do near(run.values.h2[i], level(1e-3, 3e-4), 1e-9) end
run = tb.run_system { system = tanks, start = "steady", start_time_s = 7, duration_s = 1, inputs = { q = rise } }
near(run.values.h1[1], level(1.2e-3, 4e-4), 1e-10)
run = tb.run_system { system = tanks, start = "steady", duration_s = 1, parameters = { a2 = 4e-4 },
  inputs = { q = { sample_time_s = 2, values = { 8e-4, 0 } } } }
near(run.final.h2, level(8e-4, 4e-4), 1e-9)
run = tb.run_system { system = tanks, start = steady.start, duration_s = 1 }
near(run.final.h2, level(1e-3, 3e-4), 1e-9)

-- An input is found that holds a level, and a parameter.
steady = tb.steady_state { system = tanks, at = { h2 = 0.5 }, free = { "h1", "q" } }
near(steady.inputs.q, 3e-4 * math.sqrt(2 * 9.81 * 0.5), 1e-12)
assert(steady.start.h2 == 0.5)
steady = tb.steady_state { system = tanks, at = { h1 = 0.3, h2 = 0.5 }, free = { "a1", "a2" } }
near(steady.parameters.a1, 1e-3 / math.sqrt(2 * 9.81 * 0.3), 1e-12)

-- From far away, where undamped steps run off: atan(x) = 0 from 20, and a pendulum's equilibrium under a moment.
local far = tb.system { states = { x = 20 }, der = function(s) return { x = -math.atan(s.x) } end }
near(tb.steady_state { system = far }.start.x, 0, 1e-12)
local pendulum = tb.system {
  inputs = { M = 0.5 }, states = { angle = 0, speed = 3 },
  der = function(s) return { angle = s.speed, speed = s.M - math.sin(s.angle) - 0.1 * s.speed } end,
}
steady = tb.steady_state { system = pendulum }
near(steady.start.angle, math.asin(0.5), 1e-12)
near(steady.start.speed, 0, 1e-12)
-- Scales far apart.
local small = tb.system { states = { q = { start = 1e-9, nominal = 1e-9 }, T = { start = 300, nominal = 300 } },
  der = function(s) return { q = 1e-9 - s.q * s.T / 250, T = 10 * (350 - s.T) } end }
steady = tb.steady_state { system = small }
near(steady.start.q * 1e9, 250 / 350, 1e-12)
near(steady.start.T, 350, 1e-12)
-- Modes stay, branches are taken as they lie.
local modes = tb.system { states = { x = 0 }, start_mode = "low", modes = {
  low = { der = function(s) return { x = 1 - s.x } end },
  high = { der = function(s) return { x = 5 - s.x } end } } }
near(tb.steady_state { system = modes }.start.x, 1, 1e-14)
steady = tb.steady_state { system = modes, at = { mode = "high" } }
near(steady.start.x, 5, 1e-14)
assert(steady.start.mode == "high")
near(tb.run_system { system = modes, start = steady.start, duration_s = 1 }.final.x, 5, 1e-12)

-- Without one, or with many: which equation, which variable.
refused("no steady state is found", function() -- with one free variable for two derivatives
  tb.steady_state { system = pendulum, inputs = { M = 2 }, at = { speed = 0 }, free = { "speed" } }
end)
refused("no steady state is found from these values: der(speed) (", function()
  tb.steady_state { system = pendulum, inputs = { M = 2 } }
end)
local free_mass = tb.system { states = { x = 0, v = 1 }, der = function(s) return { x = s.v, v = -s.v } end }
refused("no derivative depends on x there", function() tb.steady_state { system = free_mass } end)
near(tb.steady_state { system = free_mass, free = { "v" } }.start.v, 0, 1e-14)
local ring = tb.system { states = { a = 1, b = 3 }, der = function(s) return { a = s.b - s.a, b = s.a - s.b } end }
refused("the Jacobian is singular there", function() tb.steady_state { system = ring } end)
near(tb.steady_state { system = ring, free = { "a" } }.start.a, 3, 1e-14)
refused("lies beyond the event high", function() tb.steady_state { system = tanks, inputs = { q = 2e-3 } } end)
refused("lies beyond the event high", function()
  tb.run_system { system = tanks, start = "steady", duration_s = 1, inputs = { q = 2e-3 } }
end)
steady = tb.steady_state { system = tanks, inputs = { q = 2e-3 }, at = { h2 = 2, alarm = 1 } }
assert(steady.conditions[1] == "high" and steady.start.alarm == 1)
-- Derivatives that become small without end, or are small everywhere: x' = exp(-x) moves by one in each step of
-- Newton's.
local function only(start, rate)
  return tb.system { states = { x = start }, der = function(s) return { x = rate(s.x) } end }
end
refused("would move x by 1 yet", function()
  tb.steady_state { system = only(1, function(x) return math.exp(-x) end) }
end)
refused("no steady state is found", function()
  tb.run_system { system = only(1, function(x) return math.exp(-x) end), start = "steady", duration_s = 1 }
end)
refused("would move x by", function() tb.steady_state { system = only(1, function(x) return 1 / (1 + x * x) end) } end)
for _, start in ipairs { 298, 299, 300, 310 } do
  refused("no steady state is found", function()
    tb.steady_state { system = only(start, function(x) return 1e-10 * (2 + (x - 299) ^ 2) end) }
  end)
end
local drift = tb.system { states = { x = 0, y = 0 },
  der = function(s) return { x = 1e-10 * (s.x - 5), y = 1e-10 * (s.x - 6) } end }
refused("most of all equations", function() tb.steady_state { system = drift, free = { "x" } } end)
-- Slow ones, stiff ones, and those whose slope vanishes at rest have one.
near(tb.steady_state { system = only(300, function(x) return 1e-10 * ((x - 299) ^ 2 - 4) end) }.start.x, 301, 1e-12)
near(tb.steady_state { system = only(1, function(x) return 1e-10 * (5 - x) end) }.start.x, 5, 1e-12)
near(tb.steady_state { system = only(1, function(x) return 1e12 * (1e3 - x * x * x) end) }.start.x, 10, 1e-12)
near(tb.steady_state { system = only(3, function(x) return -(x - 1) ^ 3 end) }.start.x, 1, 1e-5)
local wall = tb.system { states = { x = 0 }, der = function(s) return { x = 1 / s.x } end }
refused("der(x)", function() tb.steady_state { system = wall } end)
refused("3 variables are free", function() tb.steady_state { system = pendulum, free = { "angle", "speed", "M" } } end)
refused("free names h3, which is neither", function() tb.steady_state { system = tanks, free = { "h3" } } end)
refused("free names h1 twice", function() tb.steady_state { system = tanks, free = { "h1", "h1" } } end)
refused("tb.steady_state: at: h9 is not a known", function() tb.steady_state { system = tanks, at = { h9 = 1 } } end)
refused("system is missing", function() tb.steady_state {} end)

-- A tank that runs empty: the root of a maximum is never asked below zero, and the event at which it is empty is found.
for number, inside in ipairs {
  function(h) return math.sqrt(math.max(h, 0)) end, function(h) return math.sqrt(math.max(0, h)) end,
  function(h) return math.sqrt(-math.min(-h, 0)) end, function(h) return math.max(h, 0) ^ 0.5 end,
} do
  local draining = tb.system { states = { h = 1 }, der = function(s) return { h = -inside(s.h) - 0.25 } end }
  for _, solver in ipairs { "erk", "adams", number < 4 and "bdf" or nil } do
    run = tb.run_system { system = draining, duration_s = 4, solver = solver }
    -- t(h) = 2 (1 - r) - ln(1.25/(r + 0.25))/2 with r = sqrt h; below zero it falls by 1/4 a second.
    local empty = 2 - math.log(5) / 2
    assert(run.ok, run.message)
    near(run.final.h, -(4 - empty) / 4, 1e-6)
  end
end
print("ok")
