-- tb.run_system{ sensitivities = {...} } against differences of whole runs, with parts that stick and rest, tables,
-- inputs and sample clocks. Closed forms are in tests/unit/experiment/system_sensitivities_test.cpp.
local tb = require "tribode"

local refused = require("lib.check").refused

-- Differences of both sides, of order 4. A row within a step of an event of one of these runs is not judged: the event
-- crosses it.
local function check(title, least, system, names, options)
  options.system, options.relative_tolerance, options.absolute_tolerance = system, 1e-12, 1e-14
  local parameters = {}
  for _, kind in pairs(tb.system_variables { system = system }) do
    for _, variable in ipairs(kind) do parameters[variable.name] = variable.value end
  end
  local function run_at(name, offset)
    local changed, state = {}, name:match "^(.*)%.start$"
    for key, value in pairs(options) do changed[key] = value end
    if state then
      changed.start = { [state] = parameters[state] + offset }
    else
      changed.parameters = { [name] = parameters[name] + offset }
    end
    return tb.run_system(changed)
  end
  options.sensitivities = names
  local found = tb.run_system(options)
  options.sensitivities = nil
  assert(found.ok, title .. ": " .. found.message)
  assert(#found.events >= least, title .. ": too few events")
  for _, name in ipairs(names) do
    local h = 5e-5 * math.max(math.abs(parameters[name:gsub("%.start$", "")]), 0.1)
    local runs = {}
    for i, factor in ipairs { 1, -1, 2, -2 } do runs[i] = run_at(name, factor * h) end
    local near = {}
    for k, t in ipairs(found.t) do
      for i, event in ipairs(found.events) do
        local other = 0
        for _, run in ipairs(runs) do
          assert(#run.events == #found.events, title .. ": other events by " .. name)
          other = math.max(other, math.abs(run.events[i].t - event.t))
        end
        if math.abs(event.t - t) <= 1.5 * other then near[k] = true end
      end
    end
    local function compare(column, list, others)
      local off, largest, judged = 0, 0, 0
      for k = 1, #found.t do
        local function at(i) return others[i][k] end
        local wanted = (8 * (at(1) - at(2)) - (at(3) - at(4))) / (12 * h)
        if not near[k] then
          off, judged = math.max(off, math.abs(list[k] - wanted)), judged + 1
          largest = math.max(largest, math.abs(wanted))
        end
      end
      assert(judged > 0.8 * #found.t)
      assert(off <= 1e-7 * largest + 1e-10,
        string.format("%s: d %s/d %s is off by %.2g of %.3g", title, column, name, off, largest))
    end
    for column, list in pairs(found.sensitivities[name]) do
      local function all(element)
        local lists = {}
        for i, run in ipairs(runs) do
          lists[i] = element and run.values[column][element] or run.values[column]
        end
        return lists
      end
      if type(list[1]) == "number" then
        compare(column, list, all())
      else
        for i, own in ipairs(list) do compare(column, own, all(i)) end
      end
    end
  end
  return found
end

check("stick and slip with Stribeck friction", 6, tb.system {
  parameters = { m = 2, mu = 0.3, k = 40, V = 0.2 },
  states = { x = 0, v = 0 },
  parts = {
    friction = tb.parts.coulomb { velocity = "v", level = function(s) return s.mu * s.m * 9.81 end,
      static = function(s) return 1.3 * s.mu * s.m * 9.81 end, stribeck_velocity = 0.05 },
  },
  der = function(s) return { x = s.v, v = (s.k * (s.V * s.t - s.x) - s.friction.force) / s.m } end,
}, { "m", "mu", "k", "V", "x.start" }, { duration_s = 6 })

check("a ball that comes to rest on a table that moves", 4, tb.system {
  parameters = { g = 9.81, A = 0.01, w = 3, e = 0.6 },
  states = { h = 0.4, v = 0 },
  parts = { floor = tb.parts.impact { gap = function(s) return s.h - s.A * math.sin(s.w * s.t) end,
    restitution = function(s) return s.e end, rest_speed = 0.3 } },
  der = function(s) return { h = s.v, v = -s.g + s.floor.force } end,
}, { "g", "A", "w", "e", "h.start" }, { duration_s = 1.8 })

check("two bodies that slip on one another", 6, tb.system {
  parameters = { m1 = 1, m2 = 2, k = 30, mu1 = 2, mu2 = 1.5, F = 6, w = 2.3, K = 10 },
  states = { x1 = 0, v1 = 0, x2 = 0, v2 = 0 },
  parts = {
    ground = tb.parts.coulomb { velocity = "v1", level = "mu1" },
    between = tb.parts.coulomb { velocity = function(s) return s.v2 - s.v1 end, level = "mu2",
      static = function(s) return 1.2 * s.mu2 end },
  },
  der = function(s)
    return { x1 = s.v1, x2 = s.v2, v2 = (-s.between.force - s.K * s.x2) / s.m2,
      v1 = (s.F * math.sin(s.w * s.t) - s.k * s.x1 - s.ground.force + s.between.force) / s.m1 }
  end,
}, { "m1", "m2", "k", "mu1", "mu2", "F", "w" }, { duration_s = 6 })

check("a block with friction between two walls", 4, tb.system {
  parameters = { m = 1, mu = 0.4, gap = 0.5, F = 3, w = 4, e = 0.7 },
  states = { x = 0, v = 0 },
  parts = {
    friction = tb.parts.coulomb { velocity = "v", level = "mu" },
    left = tb.parts.impact { gap = function(s) return s.x + s.gap end, restitution = "e" },
    right = tb.parts.impact { gap = function(s) return s.gap - s.x end, restitution = "e" },
  },
  der = function(s)
    local pushed = s.left.force - s.right.force - s.friction.force
    return { x = s.v, v = (s.F * math.cos(s.w * s.t) + pushed) / s.m }
  end,
}, { "m", "mu", "gap", "F", "w", "e" }, { duration_s = 4 })

check("backlash and Maxwell elements", 3, tb.system {
  parameters = { g = 0.1, K = 200, D = 2, A = 4, w = 3, F = 0.5 },
  states = { x = 0, v = 0, y = 0, u = 0 },
  parts = {
    teeth = tb.parts.backlash { distance = function(s) return s.x - s.y end, gap = "g", stiffness = "K",
      damping = "D" },
    element = tb.parts.maxwell { position = "x", stiffness = function(s) return s.K / 4 end, level = "F" },
  },
  der = function(s)
    return { x = s.v, v = s.A * math.cos(s.w * s.t) - s.teeth.force - s.element.force, y = s.u,
      u = s.teeth.force - s.u - s.y }
  end,
}, { "g", "K", "D", "A", "w", "F" }, { duration_s = 4 })

check("a relay with a delay line, a table and samples of the input", 3, tb.system {
  parameters = { gain = 1.5, low = -0.2, high = 0.3, tau = 0.4 },
  inputs = { u = 0 },
  states = { y = { size = 2, start = 0 }, since = 0 },
  discrete = { on = 1, begun = 0, seen = 0 },
  der = function(s)
    local curve = tb.table1 { x = { -1, 0, 1 }, y = { -2, 0, 1 }, extrapolation = "linear" }
    return { y = { s.gain * s.on + s.u - curve(s.y[1]), (s.y[1] - s.y[2] + 0.1 * s.seen) / s.tau }, since = 1 }
  end,
  when = {
    { name = "off", crossing = function(s) return s.high - s.y[2] end,
      set = function(s) return { on = -1, begun = s.t, since = 0 } end },
    { name = "on", crossing = function(s) return s.y[2] - s.low end,
      set = function() return { on = 1, since = 0 } end },
    { name = "late", crossing = function(s) return s.begun + s.tau - s.t end, set = function(s)
      return { y = { s.y[1] + 0.1 * s.begun, s.y[2] } } end },
  },
  sample = { { period_s = 0.25, set = function(s) return { seen = s.y[1] + s.gain * s.t } end } },
}, { "gain", "low", "high", "tau" }, { duration_s = 4, output_step_s = 0.013,
  inputs = { u = { sample_time_s = 0.1, values = { 0.1, 0.3, -0.2, 0.25, 0 }, interpolation = "linear" } } })

-- By an input that is a number, and of a run that goes on.
local lag = tb.system { parameters = { T = 2 }, inputs = { u = 1 }, states = { x = 0 },
  der = function(s) return { x = (s.u - s.x) / s.T } end }
local whole = tb.run_system { system = lag, duration_s = 2, sensitivities = { "u", "T" }, output_step_s = 1 }
local first = tb.run_system { system = lag, duration_s = 1, sensitivities = { "u", "T" }, output_step_s = 1 }
local second = tb.run_system { system = lag, end_time_s = 2, sensitivities = { "u", "T" }, resume = first.state,
  output_step_s = 1 }
assert(math.abs(whole.sensitivities.u.x[3] - (1 - math.exp(-1))) < 1e-15)
assert(math.abs(whole.sensitivities.T.x[3] + 0.5 * math.exp(-1)) < 1e-15)
assert(math.abs(second.sensitivities.T.x[2] - whole.sensitivities.T.x[3]) < 1e-15)
assert(#whole.columns == 2 and whole.final.x and not whole.final["d x/d T"])

-- Functions at the edge of their domain: an arc of a limited value that comes to the limit or leaves it, a power of
-- zero by its exponent, and a tank that runs empty. Closed forms.
local function derivative(name, off, wanted, options)
  options.sensitivities, options.output_step_s = { name }, options.duration_s
  local run = tb.run_system(options)
  assert(run.ok, run.message)
  local found = run.sensitivities[name].y[2]
  assert(math.abs(found - wanted) <= off, string.format("d y/d %s is %.12g, not %.12g", name, found, wanted))
end
local function of_two(start, rate)
  return tb.system { parameters = { p = 1.5, k = 2 }, states = { x = start, y = 0 }, der = rate }
end
local function limited(x) return math.max(-1, math.min(1, x)) end
-- Of asin(x) over t, where x = 0.5 + t/2 rises to one: the integral of (x - 0.5)/sqrt(1 - x^2) over x, whose last step
-- is steep.
local arc = math.sqrt(0.75) - math.pi / 6
for name, sign in pairs { asin = 1, acos = -1 } do
  local rising = of_two(0.5, function(s) return { x = s.k / 4, y = math[name](limited(s.x)) } end)
  derivative("k", 5e-6, sign * arc, { system = rising, duration_s = 2 })
  local beyond = of_two(2, function(s) return { x = s.k, y = math[name](limited(s.x)) } end)
  derivative("k", 0, 0, { system = beyond, duration_s = 1 })
end
local power = of_two(0, function(s) return { x = s.k, y = math.abs(s.x) ^ s.p } end)
derivative("p", 1e-8, 2 ^ 1.5 / 2.5 * (math.log(2) - 1 / 2.5), { system = power, duration_s = 1 })
derivative("k", 1e-8, 1.5 * 2 ^ 0.5 / 2.5, { system = power, duration_s = 1 })
for _, root in ipairs {
  function(h) return math.sqrt(math.max(h, 0)) end, function(h) return math.max(h, 0) ^ 0.5 end,
} do
  local tank = tb.system { states = { y = 1 }, der = function(s) return { y = -root(s.y) - 0.25 } end }
  -- Empty at T, with d T/d y(0) = 1/1.25, after which it falls by 1/4 a second.
  derivative("y.start", 1e-6, 0.2, { system = tank, duration_s = 4 })
end
-- A branch that jumps on the relation of a magnitude: 4 in place of 1 behind x = 0.
for _, case in ipairs { { math.sqrt, math.sqrt(5) - math.sqrt(2) }, { function(u) return u ^ 3 end, 117 } } do
  local jump = tb.system { states = { x = -1, y = 0 }, der = function(s)
    return { x = 1, y = case[1](math.abs(s.x) + tb.where(tb.less(s.x, 0), 1, 4)) }
  end }
  for _, solver in ipairs { "erk", "adams", "bdf" } do
    derivative("x.start", 1e-6 * case[2], case[2], { system = jump, duration_s = 2, solver = solver })
  end
end

-- The cut of atan(y, x), half a turn from x > 0, and a pole of tan: the integral of f(x(0) + t) has the derivative
-- f(x(0) + 1) - f(x(0)).
for _, solver in ipairs { "erk", "adams", "bdf" } do
  local function angle(x) return math.atan(math.sin(x), math.cos(x)) end
  local function limited_tan(x) return tb.tanh(math.tan(x)) end
  for start, f in pairs { [3] = angle, [1] = limited_tan } do
    local turning = tb.system { states = { x = start, y = 0 }, der = function(s) return { x = 1, y = f(s.x) } end }
    derivative("x.start", 1e-6, f(start + 1) - f(start), { system = turning, duration_s = 1, solver = solver })
    refused("stands below no_event", function()
      local unseen = tb.system { states = { x = start }, der = function(s) return { x = 1 + tb.no_event(f(s.x)) } end }
      tb.run_system { system = unseen, duration_s = 1, sensitivities = { "x.start" } }
    end)
  end
  local run = tb.run_system { system = tb.system { states = { x = 3, y = 0 },
    der = function(s) return { x = 1, y = angle(s.x) } end }, duration_s = 1, solver = solver }
  assert(math.abs(run.final.y - (3.5 - 2 * math.pi * (4 - math.pi))) < 1e-7, solver)
end

refused("sensitivities[1] = \"TT\", must be a parameter", function()
  tb.run_system { system = lag, duration_s = 1, sensitivities = { "TT" } }
end)
refused("start = \"steady\"", function()
  tb.run_system { system = lag, duration_s = 1, sensitivities = { "T" }, start = "steady" }
end)
refused("must be auto, exact, erk", function()
  tb.run_system { system = lag, duration_s = 1, sensitivities = { "T" }, solver = "fixed" }
end)
local delayed = tb.system { parameters = { T = 0.1 }, inputs = { u = 1 }, states = { x = 0 },
  der = function(s) return { x = tb.delay(s.u, s.T) - s.x } end }
refused("no sensitivity to T, on which a delay depends", function()
  tb.run_system { system = delayed, duration_s = 1, sensitivities = { "T" } }
end)
local called = tb.system { parameters = { T = 0.1 }, states = { x = 0 }, discrete = { u = 0 },
  der = function(s) return { x = s.u - s.x } end,
  sample = { { name = "controller", period_s = 0.1, call = function(s) return { u = s.x } end } } }
refused("the function that controller calls reads", function()
  tb.run_system { system = called, duration_s = 1, sensitivities = { "x.start" } }
end)
