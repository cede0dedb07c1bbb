-- Algebraic variables and implicit equations: against closed forms, published values and the same by hand; events,
-- samples, continued runs; what is refused.
local tb = require "tribode"

local function near(found, wanted, tolerance, what)
  assert(math.abs(found - wanted) <= tolerance * (1 + math.abs(wanted)),
    string.format("%s: %.17g instead of %.17g", what or "value", found, wanted))
end

local function refused(message, make, ...)
  local ok, text = pcall(make, ...)
  assert(not ok and text:find(message, 1, true), tostring(text))
  assert(not text:find("\n", 1, true), "more than one line: " .. text)
end

local function run(system, duration_s, options)
  local all = { system = system, duration_s = duration_s }
  for key, value in pairs(options or {}) do all[key] = value end
  local made = tb.run_system(all)
  assert(made.ok, made.message)
  assert(made.solver == "ida")
  return made
end
local sharp = { relative_tolerance = 1e-12, absolute_tolerance = 1e-14 }

-- ---- A linear loop: a = 2 x + b/2, b = 0.3 a, so der(x) = -2/0.85 x -----------------------------------------------

local loop = tb.system { name = "loop", states = { x = 1 }, algebraic = { a = 0, b = 0 },
  der = function(s) return { x = -s.a } end,
  equations = function(s) return { sum = s.a - 2 * s.x - 0.5 * s.b, gain = s.b - 0.3 * s.a } end,
  outputs = function(s) return { twice = 2 * s.b } end }
local made = run(loop, 2, sharp)
for i, t in ipairs(made.t) do
  local x = math.exp(-2 / 0.85 * t)
  near(made.values.x[i], x, 1e-10)
  near(made.values.a[i], 2 / 0.85 * x, 1e-10)
  near(made.values.twice[i], 1.2 / 0.85 * x, 1e-10)
end

-- ---- Implicit derivatives: a double pendulum by its mass matrix, and solved for the accelerations by hand ---------

local function forces(s)
  return -math.sin(s.p - s.q) * s.w ^ 2 - 2 * 9.81 * math.sin(s.p), math.sin(s.p - s.q) * s.v ^ 2 - 9.81 * math.sin(s.q)
end
local start = { p = 1.2, q = -0.4, v = 0, w = 0.5 }
local implicit = tb.system { name = "double pendulum", states = start, algebraic = { dv = 0, dw = 0 },
  der = function(s) return { p = s.v, q = s.w, v = s.dv, w = s.dw } end,
  equations = function(s)
    local f, g = forces(s)
    local c = math.cos(s.p - s.q)
    return { first = 2 * s.dv + c * s.dw - f, second = c * s.dv + s.dw - g }
  end }
local explicit = tb.system { states = start,
  der = function(s)
    local f, g = forces(s)
    local c = math.cos(s.p - s.q)
    local det = 2 - c * c
    return { p = s.v, q = s.w, v = (f - c * g) / det, w = (2 * g - c * f) / det }
  end }
local by_hand = tb.run_system { system = explicit, duration_s = 3, solver = "erk", relative_tolerance = 1e-12,
  absolute_tolerance = 1e-13 }
made = run(implicit, 3, sharp)
for _, name in ipairs { "p", "q", "v", "w" } do near(made.final[name], by_hand.final[name], 1e-8, name) end

-- ---- Problems of the literature -----------------------------------------------------------------------------------

-- Errors over the size of the reference, no more than so many tolerances, and falling with them.
local function published(system, duration_s, reference, tolerances, accepted)
  for _, tolerance in ipairs(tolerances) do
    local result = run(system, duration_s, { relative_tolerance = tolerance, absolute_tolerance = tolerance,
      output_step_s = duration_s })
    for name, wanted in pairs(reference) do
      local off = math.abs(result.final[name] - wanted) / (math.abs(wanted) + 1e-3)
      assert(off <= accepted * tolerance,
        string.format("%s at %g: off by %.3g tolerances", name, tolerance, off / tolerance))
    end
  end
end

-- Robertson's reactions with their mass instead of the third rate [Mazzia 2008].
local robertson = tb.system { name = "robertson", states = { y1 = 1, y2 = { start = 0, nominal = 1e-6 } },
  algebraic = { y3 = 0 },
  der = function(s)
    local r = 0.04 * s.y1 - 1e4 * s.y2 * s.y3
    return { y1 = -r, y2 = r - 3e7 * s.y2 ^ 2 }
  end,
  equations = function(s) return { mass = s.y1 + s.y2 + s.y3 - 1 } end }
for _, tolerance in ipairs { 1e-6, 1e-8, 1e-10 } do
  local result = run(robertson, 1e11, { relative_tolerance = tolerance, absolute_tolerance = tolerance * 1e-6,
    output_step_s = 1e11 })
  near(result.final.y1 / 0.2083340149701255e-07, 1, 1e3 * tolerance)
  near(result.final.y2 / 0.8333360770334713e-13, 1, 1e3 * tolerance)
  near(result.final.y3, 0.9999999791665050, 1e-2 * tolerance)
end

-- Chemical Akzo Nobel problem [Mazzia 2008].
local akzo = tb.system { name = "akzo", states = { y1 = 0.444, y2 = 0.00123, y3 = 0, y4 = 0.007, y5 = 0 },
  algebraic = { y6 = 0 },
  der = function(s)
    local r1, r2, r3 = 18.7 * s.y1 ^ 4 * math.sqrt(s.y2), 0.58 * s.y3 * s.y4, 0.58 / 34.4 * s.y1 * s.y5
    local r4, r5, inflow = 0.09 * s.y1 * s.y4 ^ 2, 0.42 * s.y6 ^ 2 * math.sqrt(s.y2), 3.3 * (0.9 / 737 - s.y2)
    return { y1 = -2 * r1 + r2 - r3 - r4, y2 = -0.5 * r1 - r4 - 0.5 * r5 + inflow, y3 = r1 - r2 + r3,
      y4 = -r2 + r3 - 2 * r4, y5 = r2 - r3 + r5 }
  end,
  equations = function(s) return { equilibrium = 115.83 * s.y1 * s.y4 - s.y6 } end }
published(akzo, 180, { y1 = 0.1150794920661702, y2 = 0.1203831471567715e-2, y3 = 0.1611562887407974,
  y4 = 0.3656156421249283e-3, y5 = 0.1708010885264404e-1, y6 = 0.4873531310307455e-2 }, { 1e-6, 1e-8, 1e-10 }, 300)

-- Transistor amplifier [Mazzia 2008], its capacitors as states and its nodes as algebraic variables.
local amplifier = tb.system { name = "transistor amplifier",
  parameters = { Ub = 6, UF = 0.026, alpha = 0.99, beta = 1e-6, R0 = 1000, R = 9000, C = 1e-6 },
  states = { c1 = 3, u3 = 3, c3 = 3 - 6, u6 = 3, c5 = -6 },
  algebraic = { u1 = 0, u2 = 3, u4 = 6, u5 = 3, u7 = 6, u8 = 0 },
  der = function(s)
    local function g(u) return s.beta * (math.exp(u / s.UF) - 1) end
    return { c1 = (s.u1 - 0.1 * math.sin(200 * math.pi * s.t)) / s.R0 / s.C,
      u3 = (g(s.u2 - s.u3) - s.u3 / s.R) / (2 * s.C),
      c3 = ((s.u4 - s.Ub) / s.R + s.alpha * g(s.u2 - s.u3)) / (3 * s.C),
      u6 = (g(s.u5 - s.u6) - s.u6 / s.R) / (4 * s.C),
      c5 = ((s.u7 - s.Ub) / s.R + s.alpha * g(s.u5 - s.u6)) / (5 * s.C) }
  end,
  equations = function(s)
    local function g(u) return s.beta * (math.exp(u / s.UF) - 1) end
    return { capacitor1 = s.u2 - s.u1 - s.c1, capacitor3 = s.u5 - s.u4 - s.c3, capacitor5 = s.u8 - s.u7 - s.c5,
      base1 = (s.u1 - 0.1 * math.sin(200 * math.pi * s.t)) / s.R0 + (2 * s.u2 - s.Ub) / s.R
        - (s.alpha - 1) * g(s.u2 - s.u3),
      base2 = (s.u4 - s.Ub) / s.R + s.alpha * g(s.u2 - s.u3) + (2 * s.u5 - s.Ub) / s.R
        - (s.alpha - 1) * g(s.u5 - s.u6),
      outlet = (s.u7 - s.Ub) / s.R + s.alpha * g(s.u5 - s.u6) + s.u8 / s.R }
  end }
published(amplifier, 0.2, { u1 = -0.5562145012262709e-2, u2 = 3.006522471903042, u3 = 2.849958788608128,
  u4 = 2.926422536206241, u5 = 2.704617865010554, u6 = 2.761837778393145, u7 = 4.770927631616772,
  u8 = 1.236995868091548 }, { 1e-5, 1e-6, 1e-7 }, 2e3)

-- ---- Ideal diodes -------------------------------------------------------------------------------------------------
-- The place on a diode's curve is c: it has the voltage min(c, 0) and the current max(c, 0). A sine charges a capacitor
-- through R, which a load empties: sine and exponential while it conducts, an exponential while not.

local R, C, load, w = 0.5, 0.2, 4, 2 * math.pi
local function exact_detector(t_end, full_wave)
  local function u(t) return full_wave and math.abs(math.sin(w * t)) or math.sin(w * t) end
  local function zero(f, low, high)
    local below = f(low) < 0
    for _ = 1, 200 do
      local middle = 0.5 * (low + high)
      if (f(middle) < 0) == below then low = middle else high = middle end
    end
    return 0.5 * (low + high)
  end
  -- v' = (u - v)/(R C) - v/(load C), u = sin(w (t - t0)) with u >= 0
  local k = 1 / (R * C) + 1 / (load * C)
  local t, v, events = 0, 0, {}
  local half = full_wave and 0.5 or 1
  for cycle = 0, 1000 do
    local t0, v0, from = cycle * half, v, t
    local function rest(at) return v0 * math.exp(-(at - from) / (load * C)) end
    local on = v0 > 0 and zero(function(at) return u(at) - rest(at) end, t0 + 1e-9, t0 + 0.25) or t0
    if on > t_end then return rest(t_end), events end
    if v0 > 0 then events[#events + 1] = on end
    local function forced(at) -- of the linear equation
      local phase = w * (at - t0)
      return (k * math.sin(phase) - w * math.cos(phase)) / (k * k + w * w) / (R * C)
    end
    local v_on = v0 > 0 and rest(on) or 0
    local function charged(at) return forced(at) + (v_on - forced(on)) * math.exp(-k * (at - on)) end
    local off = zero(function(at) return math.sin(w * (at - t0)) - charged(at) end, on + 1e-3, t0 + 0.5)
    if off > t_end then return charged(t_end), events end
    events[#events + 1] = off
    t, v = off, charged(off)
  end
end

local watch = { { name = "turns", crossing = function(s) return s.c1 end, direction = "both" } }
local half_wave = tb.system { name = "half wave", states = { v = 0 }, algebraic = { c1 = 0 },
  der = function(s) return { v = (math.max(s.c1, 0) - s.v / load) / C } end,
  equations = function(s)
    return { mesh = math.sin(w * s.t) - R * math.max(s.c1, 0) - math.min(s.c1, 0) - s.v }
  end,
  when = watch }
local v_end, instants = exact_detector(5.3, false)
made = run(half_wave, 5.3, { relative_tolerance = 1e-10, absolute_tolerance = 1e-12 })
near(made.final.v, v_end, 1e-8, "half wave")
local turns = {}
for _, event in ipairs(made.events) do if event.t > 1e-6 then turns[#turns + 1] = event.t end end
assert(#turns == #instants, #turns .. " turns instead of " .. #instants)
for i, t in ipairs(turns) do near(t, instants[i], 1e-8, "turn " .. i) end

-- Four of them in a bridge. While none conducts, only a small leakage determines the nodes.
local leak = 1e-10
local bridge = tb.system { name = "bridge", states = { v = 0 },
  algebraic = { c1 = 0, c2 = 0, c3 = 0, c4 = 0, a = 0, b = 0, i = 0 },
  der = function(s) return { v = (math.max(s.c1, 0) + math.max(s.c2, 0) - s.v / load) / C } end,
  equations = function(s)
    local function current(c) return math.max(c, 0) + leak * math.min(c, 0) end
    local function voltage(c) return math.min(c, 0) end
    local plus = s.v + R * (current(s.c1) + current(s.c2))
    return { d1 = s.a - plus - voltage(s.c1), d2 = s.b - plus - voltage(s.c2), d3 = -s.a - voltage(s.c3),
      d4 = -s.b - voltage(s.c4), node_a = s.i + current(s.c3) - current(s.c1),
      node_b = -s.i + current(s.c4) - current(s.c2), source = s.a - s.b - math.sin(w * s.t) }
  end,
  when = watch }
v_end, instants = exact_detector(5.3, true)
made = run(bridge, 5.3, { relative_tolerance = 1e-10, absolute_tolerance = 1e-12 })
near(made.final.v, v_end, 1e-7, "bridge")
turns = {}
for _, event in ipairs(made.events) do if event.t > 1e-6 then turns[#turns + 1] = event.t end end
-- The first diode conducts in every other half wave.
local of_first = { instants[1] }
for i = 4, #instants, 4 do
  of_first[#of_first + 1] = instants[i]
  of_first[#of_first + 1] = instants[i + 1]
end
assert(#turns == #of_first, #turns .. " turns instead of " .. #of_first)
for i, t in ipairs(turns) do near(t, of_first[i], 1e-8, "turn " .. i) end

-- ---- Events and samples -------------------------------------------------------------------------------------------

-- A ball above a floor that is an algebraic variable: 0.2 + 0.1 h_floor, by a loop.
local ball = tb.system { name = "ball", states = { h = 1, v = 0 }, algebraic = { gap = 1, floor = 0 },
  der = function(s) return { h = s.v, v = -9.81 } end,
  equations = function(s) return { gap = s.gap - (s.h - s.floor), floor = s.floor - 0.18 - 0.1 * s.floor } end,
  when = { { name = "impact", crossing = function(s) return s.gap end,
    set = function(s) return { v = -0.7 * s.v } end } } }
made = run(ball, 1.6)
local first = math.sqrt(2 * 0.8 / 9.81)
local t_impact, flight = first, 2 * first
assert(#made.events >= 3)
for _, event in ipairs(made.events) do
  near(event.t, t_impact, 1e-7, "impact")
  flight = flight * 0.7
  t_impact = t_impact + flight
end

-- A sampled controller that writes into the loop: x' = a, a = u - 0.5 a, u = -x at each sample.
local sampled = tb.system { name = "sampled", states = { x = 1 }, algebraic = { a = 0 }, discrete = { u = 0, seen = 0 },
  der = function(s) return { x = s.a } end,
  equations = function(s) return { balance = s.a - s.u + 0.5 * s.a } end,
  sample = { { period_s = 0.1, set = function(s) return { u = -s.x, seen = s.a } end } } }
made = run(sampled, 1, { output_times_s = { 0.55, 1 } })
near(made.values.x[2], (1 - 0.1 / 1.5) ^ 10, 1e-9)
near(made.values.a[1], -(1 - 0.1 / 1.5) ^ 5 / 1.5, 1e-9)
near(made.final.a, -(1 - 0.1 / 1.5) ^ 10 / 1.5, 1e-9)
near(made.final.seen, -(1 - 0.1 / 1.5) ^ 9 / 1.5, 1e-9)

-- Modes with equations of their own.
local clutch = tb.system { name = "clutch", states = { w1 = 2, w2 = 0 }, algebraic = { torque = 0 },
  start_mode = "slips",
  der = function(s) return { w1 = -s.torque / 2, w2 = s.torque } end,
  modes = {
    slips = { equations = function(s) return { clutch = s.torque - 3 } end,
      when = { { crossing = function(s) return s.w1 - s.w2 end, mode = "holds" } } },
    holds = { equations = function(s) return { clutch = s.torque / 2 + s.torque } end },
  } }
made = run(clutch, 1)
near(made.final.w1, 4 / 3, 1e-7)
near(made.final.w2, 4 / 3, 1e-7)
assert(made.final.mode == "holds" and made.final.torque == 0)

-- ---- Parts: their algebraic variables are theirs ------------------------------------------------------------------

local resistor = tb.system { name = "resistor", inputs = { u = 0 }, algebraic = { i = 0 },
  equations = function(s) return { ohm = s.u - 2 * s.i - s.i ^ 3 } end, outputs = function(s) return { out = s.i } end }
local two = tb.system { name = "two", states = { q = 10 }, parts = { r1 = resistor, r2 = resistor },
  der = function(s) return { q = -s.r1.out - s.r2.out } end,
  connect = function(s) return { ["r1.u"] = s.q, ["r2.u"] = 2 * s.q } end }
made = run(two, 0.5)
near(2 * made.final["r1.i"] + made.final["r1.i"] ^ 3, made.final.q, 1e-7)
near(2 * made.final["r2.i"] + made.final["r2.i"] ^ 3, 2 * made.final.q, 1e-7)

-- ---- Vectors: a chain of 200 resistors, sparse --------------------------------------------------------------------

local n = 200
local chain = tb.system { name = "chain", states = { q = { size = n, start = function(k) return k % 2 end } },
  algebraic = { i = { size = n, start = 0 } },
  der = function(s)
    local rate = {}
    for k = 1, n do rate[k] = s.i[k] - (k < n and s.i[k + 1] or 0) end
    return { q = rate }
  end,
  equations = function(s)
    local mesh = {}
    for k = 1, n do
      mesh[k] = (k > 1 and s.q[k - 1] or 0) - s.q[k] - s.i[k] - 0.1 * (k > 1 and s.i[k - 1] or 0)
    end
    return { mesh = mesh }
  end }
made = run(chain, 1)
local loose = run(chain, 1, { relative_tolerance = 1e-5, absolute_tolerance = 1e-7 })
for k = 1, n do near(loose.final.q[k], made.final.q[k], 1e-3) end

-- ---- Stop and continue, steady states, linear systems -------------------------------------------------------------

local whole = run(half_wave, 3)
local half = run(half_wave, 1.4)
local rest = tb.run_system { system = half_wave, resume = half.state, end_time_s = 3 }
assert(rest.ok and rest.solver == "ida")
near(rest.final.v, whole.final.v, 1e-6)
assert(math.abs(#half.events + #rest.events - #whole.events) == 0)
local again = tb.run_system { system = half_wave, start = half.final, start_time_s = half.t_end, end_time_s = 3 }
near(again.final.v, whole.final.v, 1e-6)

local driven = tb.system { name = "driven", states = { x = 0 }, algebraic = { a = 1 }, inputs = { u = 3 },
  der = function(s) return { x = s.a - 2 * s.x } end,
  equations = function(s) return { cube = s.a ^ 3 + s.a - s.u + 0.1 * s.x } end,
  outputs = function(s) return { y = s.a + s.u } end }
local steady = tb.steady_state { system = driven }
near(steady.start.a, 2 * steady.start.x, 1e-12)
near(steady.start.a ^ 3 + steady.start.a + 0.1 * steady.start.x, 3, 1e-12)
near(run(driven, 1, { start = "steady" }).final.x, steady.start.x, 1e-10)
near(tb.steady_state { system = driven, at = { x = 0.5 }, free = { "u" } }.inputs.u, 2.05, 1e-12)
local linear = tb.linearize { system = driven, at = { x = 0 } } -- a = 1.2134..., whatever guess is given
local a = tb.run_system { system = driven, duration_s = 1e-9 }.values.a[1]
local slope = 1 / (3 * a ^ 2 + 1)
near(a ^ 3 + a, 3, 1e-14)
near(linear.A[1][1], -2 - 0.1 * slope, 1e-12)
near(linear.B[1][1], slope, 1e-12)
near(linear.C[1][1], -0.1 * slope, 1e-12)
near(linear.D[1][1], 1 + slope, 1e-12)
assert(#linear.states == 1 and linear.states[1] == "x")
linear = tb.linearize { system = sampled, at = { x = 0 } }
near(linear.poles[#linear.poles].real, 1 - 0.1 / 1.5, 1e-12)
local variables = tb.system_variables { system = driven }
assert(#variables.states == 1 and variables.algebraic[1].name == "a" and variables.algebraic[1].value == 1)

-- ---- What is refused: one sentence --------------------------------------------------------------------------------

local function with(fields)
  local all = { name = "bad", states = { x = 1 }, algebraic = { a = 1 }, der = function(s) return { x = s.a } end,
    equations = function(s) return { one = s.a - s.x } end }
  for key, value in pairs(fields) do all[key] = value end
  return all
end
local function refused_system(message, fields) refused(message, tb.system, with(fields)) end
local function refused_run(message, fields, options)
  local all = { system = tb.system(with(fields)), duration_s = 1 }
  for key, value in pairs(options or {}) do all[key] = value end
  refused(message, tb.run_system, all)
end

refused_system("depends on no algebraic variable, so nothing determines T", {
  states = { x = 1, y = 0, u = 0, v = 0 }, algebraic = { T = 0 },
  der = function(s) return { x = s.u, y = s.v, u = -s.T * s.x, v = -s.T * s.y - 9.81 } end,
  equations = function(s) return { length = s.x ^ 2 + s.y ^ 2 - 1 } end })
refused_system("structurally singular: the equation two (", { algebraic = { a = 0, b = 0, c = 0 },
  equations = function(s) return { one = s.a - s.x, two = s.a + s.x, three = s.a + s.b + s.c } end })
refused_system("there are 1 equations (one) for 2 algebraic variables (a, b), must be as many",
  { algebraic = { a = 0, b = 0 } })
refused_system("there are 2 equations (one, two) for 1 algebraic variables (a)",
  { equations = function(s) return { one = s.a - s.x, two = s.a } end })
refused_system("there are 1 equations (one) for 0 algebraic variables", { algebraic = {},
  der = function() return { x = 1 } end, equations = function(s) return { one = s.x } end })
refused_system("algebraic: a is a number, must be a finite number", { algebraic = { a = 0 / 0 } })
refused_system("algebraic.a: start is a number, must be a finite number", { algebraic = { a = { start = math.huge } } })
refused_system("a is an algebraic variable, whose value follows from the equations",
  { when = { { crossing = function(s) return s.x end, set = function() return { a = 1 } end } } })
refused_system("a is not a state", { der = function(s) return { x = 1, a = s.x } end })
refused_system("must have names", { equations = function(s) return { s.a - s.x } end })
refused_system("modes.m: there is no equation two", { start_mode = "n", algebraic = { a = 0, b = 0 },
  modes = { m = {}, n = { equations = function(s) return { two = s.b } end } } })
refused_system("bad: the name x stands twice", { algebraic = { x = 0 }, der = function() return { x = 1 } end,
  equations = function(s) return { one = s.x - 1 } end })
refused_run("bad: at t = 0 s the algebraic equations do not determine their variables",
  { equations = function(s) return { one = s.a ^ 2 + s.x } end })
refused_run("the equation one (", { equations = function(s) return { one = math.exp(s.a) + s.x } end })
refused_run("is not a finite number", { equations = function(s) return { one = math.log(-s.a) - s.x } end })
refused_run("their Jacobian is singular", { algebraic = { a = 0, b = 0 },
  equations = function(s) return { one = s.a + s.b - s.x, two = 2 * s.a + 2 * s.b - s.x } end })
for _, solver in ipairs { "exact", "collocation", "erk", "adams", "bdf", "fixed", "euler", "zoh" } do
  refused_run(string.format('solver "%s" cannot solve for algebraic variables, of which the system has a', solver), {},
    { solver = solver })
end

refused_system("the ready part f acts on the algebraic variable a, must act on states alone", {
  states = { x = 1, v = 0 }, parts = { f = tb.parts.coulomb { velocity = "v", level = 1 } },
  der = function(s) return { x = s.v, v = s.a } end,
  equations = function(s) return { newton = s.a - 3 + s.f.force } end })
refused_system("a ready part acts on the algebraic variable a, must act on states alone", {
  parts = { b = tb.parts.backlash { distance = "a", gap = 0.1, stiffness = 10, damping = 1 } },
  der = function(s) return { x = -s.b.force } end })

-- A loop whose solution ends in mid-run is an outcome, with the time and the equation.
local function ends(fields, t, message)
  local result = tb.run_system { system = tb.system(with(fields)), duration_s = 10 }
  assert(not result.ok and result.message:find(message, 1, true), result.message)
  near(result.t_end, t, 1e-6)
end
ends({ algebraic = { a = -1.5 }, states = { x = -2 }, der = function() return { x = 1 } end,
  equations = function(s) return { cubic = s.a ^ 3 - s.a - s.x } end }, 2 + 2 / math.sqrt(27), "the equation cubic (")
ends({ der = function() return { x = -1 } end, equations = function(s) return { root = s.a ^ 2 - s.x } end }, 1,
  "the equation root (")
-- An event beyond which there is none.
ends({ discrete = { d = 1 }, der = function() return { x = -1 } end,
  equations = function(s) return { square = s.a ^ 2 + s.a - s.d } end,
  when = { { crossing = function(s) return s.x - 0.5 end, set = function() return { d = -1 } end } } }, 0.5,
  "the equation square (")
