-- What an event is: resets onto surfaces, conditions at t = 0, the order of one instant, and how a run ends.
local tb = require "tribode"
local solvers = { "exact", "erk", "adams", "bdf" }

local function near(found, wanted, tolerance, what)
  assert(math.abs(found - wanted) <= tolerance, string.format("%s: %.17g, not %.17g", what, found, wanted))
end

local function names(run)
  local list = {}
  for i, event in ipairs(run.events) do list[i] = event.name end
  return table.concat(list, " ")
end

-- A ball bounces to its Zeno point at any height of the floor, and with any duration: sqrt(2/g) (1 + e)/(1 - e).
for _, floor in ipairs { 0, 0.2, 1, 1000 } do
  for _, solver in ipairs(solvers) do
    for _, sets in ipairs { true, false } do
      local ball = tb.system {
        states = { x = floor + 1, v = 0 },
        der = function(s) return { x = s.v, v = -9.81 } end,
        when = { { name = "impact", crossing = function(s) return s.x - floor end,
          set = function(s) return { x = sets and floor or nil, v = -0.8 * s.v } end } },
      }
      local run = tb.run_system { system = ball, duration_s = 500, output_step_s = 0.01, solver = solver }
      local what = string.format("floor %g by %s", floor, solver)
      assert(not run.ok and run.message:find "x.* < 0 %(impact%) is chattering", what .. run.message)
      -- At a height of 1000, bounces of 1e-5 are within the tolerance: the last of them take some 0.01 s.
      near(run.t_end, 9 * math.sqrt(2 / 9.81), 0.05, what)
      for _, x in ipairs(run.values.x) do assert(x >= floor - 1e-12 * floor, what) end
      assert(#run.events < 1500, what)
    end
  end
end

-- A square wave whose sine is zero at the start, and other conditions that become true right then: x' = sign - x.
local function lag(square)
  return tb.system { states = { x = 0 }, der = function(s) return { x = square(s) - s.x } end }
end
local forms = {
  function(s) return tb.where(tb.greater(math.sin(s.t), 0), 1, -1) end,
  function(s) return tb.where(tb.greater_equal(math.sin(s.t), 0), 1, -1) end,
}
local wave = 0 -- x at t = 10, from one half wave to the next
for half = 0, 3 do
  local stop = math.min((half + 1) * math.pi, 10)
  local level = half % 2 == 0 and 1 or -1
  wave = level + (wave - level) * math.exp(half * math.pi - stop)
end
for _, solver in ipairs { "erk", "adams", "bdf" } do
  for _, form in ipairs(forms) do
    near(tb.run_system { system = lag(form), duration_s = 10, solver = solver }.final.x, wave, 1e-6, solver)
  end
  local ramp = lag(function(s) return tb.where(tb.greater(s.t, 0), 1, -1) end)
  near(tb.run_system { system = ramp, duration_s = 2, solver = solver }.final.x, 1 - math.exp(-2), 1e-6, solver)
  -- Half-wave rectified: zero at both ends of a half wave, where a step that spans it would see nothing.
  local bump = (1 + math.exp(-math.pi)) / 2
  local rectified = lag(function(s) return math.max(0, math.sin(s.t)) end)
  near(tb.run_system { system = rectified, duration_s = 10, solver = solver }.final.x,
    (bump * math.exp(-2 * math.pi) + bump) * math.exp(3 * math.pi - 10), 1e-6, solver)
end

-- An ideal diode as two modes: five times it opens, five it closes but for the last.
local w = 100 * math.pi
local function source(s) return 10 * math.sin(w * s.t) end
local rectifier = tb.system {
  states = { v = 0 },
  parameters = { R = 1, RL = 1000, C = 1e-4 },
  der = function(s) return { v = -s.v / s.RL / s.C } end,
  modes = {
    off = { when = { { name = "on", condition = function(s) return tb.greater(source(s), s.v) end, mode = "on" } } },
    on = {
      der = function(s) return { v = ((source(s) - s.v) / s.R - s.v / s.RL) / s.C } end,
      when = { { name = "off", condition = function(s) return tb.less(source(s), s.v) end, mode = "off" } },
    },
  },
  start_mode = "on",
}
for _, solver in ipairs { "auto", "adams", "bdf" } do
  local run = tb.run_system { system = rectifier, duration_s = 0.1, solver = solver }
  assert(run.ok and names(run) == "off on off on off on off on off", solver .. names(run))
  near(run.final.v, 8.60719545, 1e-6, solver) -- of three solvers at tolerances down to 1e-12
end

-- The order of one instant: an event that an earlier one took away does not happen, however its condition is written.
local function both(first, second)
  return tb.system {
    states = { x = 0, y = 0 },
    discrete = { n = 0 },
    der = function() return { x = 1, y = 2 } end,
    modes = {
      A = { when = {
        { name = "first", condition = first, mode = "B" },
        { name = "second", condition = second, mode = "C", set = function() return { n = 7 } end },
      } },
      B = {}, C = {},
    },
    start_mode = "A",
  }
end
local function reaches(s) return tb.greater_equal(s.x, 1) end
for _, second in ipairs { reaches, function(s) return tb.greater_equal(s.y, 2) end,
  function(s) return tb.greater(2 * s.x, s.y - s.y + 2) end } do
  for _, solver in ipairs(solvers) do
    local run = tb.run_system { system = both(reaches, second), duration_s = 2, solver = solver }
    assert(run.final.mode == "B" and run.final.n == 0 and names(run) == "first", solver .. names(run))
  end
end

-- A block that stops under a force already beyond friction slides back at once: v = 2 + t - t^2/2 to t = 1 + sqrt 5,
-- then v' = 3 - t. By a mode in between, directly, and with conditions of either kind.
local function force(s) return 2 - s.t end
local stop = 1 + math.sqrt(5)
for _, back in ipairs {
  { crossing = function(s) return s.v end, direction = "rising" },
  { crossing = function(s) return -s.v end },
  { condition = function(s) return tb.greater(s.v, 0) end },
} do
  for _, to in ipairs { "stick", "minus" } do
    back.name, back.set, back.mode = "stop-", function() return { v = 0 } end, "stick"
    local block = tb.system {
      states = { v = 2, x = 0 },
      parameters = { Fc = 1 },
      modes = {
        stick = { der = function() return { x = 0, v = 0 } end, when = {
          { name = "slip+", condition = function(s) return tb.greater(force(s), s.Fc) end, mode = "plus" },
          { name = "slip-", condition = function(s) return tb.less(force(s), -s.Fc) end, mode = "minus" } } },
        plus = { der = function(s) return { x = s.v, v = force(s) - s.Fc } end,
          when = { { name = "stop", crossing = function(s) return s.v end, set = function() return { v = 0 } end,
            mode = to } } },
        minus = { der = function(s) return { x = s.v, v = force(s) + s.Fc } end, when = { back } },
      },
      start_mode = "plus",
    }
    for _, solver in ipairs(solvers) do
      local run = tb.run_system { system = block, duration_s = 5, solver = solver }
      assert(run.ok and names(run) == (to == "stick" and "stop slip-" or "stop"), solver .. names(run) .. run.message)
      near(run.final.v, 3 * 5 - 12.5 - (3 * stop - stop ^ 2 / 2), 1e-6, solver)
    end
  end
end

-- How runs end: each with what it is about.
local function ends(system, message, options)
  options = options or {}
  options.system, options.duration_s = tb.system(system), options.duration_s or 2
  local run = tb.run_system(options)
  assert(not run.ok and run.message:find(message), run.message)
  return run
end
local relay = { states = { x = 1 },
  der = function(s) return { x = -tb.where(tb.greater(s.x, 0), 1, -1) } end }
for _, solver in ipairs(solvers) do
  near(ends(relay, "the relation 0 < x is chattering at t = 1 s", { solver = solver }).t_end, 1, 1e-6, solver)
end
-- Here the instants of `exact` are more than four roundings of the time apart.
for _, solver in ipairs(solvers) do
  ends({ states = { x = -0.128 }, inputs = { w = 0 }, der = function(s)
    return { x = -2.38 * s.x + 1.139 * (0.068 + tb.where(tb.less(s.x, 0.004), -0.422 * s.x, s.x - 0.45)) }
  end }, "chattering",
    { solver = solver, max_steps = 10000, inputs = { w = { sample_time_s = 0.055, values = { 1, 2 } } } })
end
ends({ states = { x = 1 }, der = function(s) return { x = -1 / s.x } end }, "x = .* changes by")
ends({ states = { x = 1 }, der = function(s) return { x = s.x ^ 2 } end }, "x = .* changes by")
ends({ states = { x = 1 }, der = function(s) return { x = 100 * s.x } end }, "the solution diverges: x = ",
  { duration_s = 5 })
-- Steps without end, of a method that does not suit: the work between two results is bounded.
for _, solver in ipairs { "erk", "adams" } do
  ends({ states = { x = 1 }, der = function(s) return { x = -1e7 * (s.x - math.cos(s.t)) } end },
    "^1000 steps from t = .* s have come to t = .* s only; the problem may be stiff",
    { solver = solver, max_steps = 1000 })
end
ends({ states = { x = 0 }, discrete = { a = 0 }, der = function() return { x = 1 } end, when = {
  { name = "up", condition = function(s) return tb.all(tb.greater_equal(s.x, 1), tb.less(s.a, 0.5)) end,
    set = function() return { a = 1 } end },
  { name = "down", condition = function(s) return tb.all(tb.greater_equal(s.x, 1), tb.greater(s.a, 0.5)) end,
    set = function() return { a = 0 } end } } }, "the cascade of events %(down, up, down%) at one instant")

-- Steps of a few roundings of the time, where a solution needs them: van der Pol's with mu = 1e6.
local vdp = tb.system {
  parameters = { mu = 1e6 },
  states = { y1 = 2, y2 = 0 },
  der = function(s) return { y1 = s.y2, y2 = s.mu * (1 - s.y1 ^ 2) * s.y2 - s.y1 } end,
}
local jump = tb.run_system { system = vdp, duration_s = 2e6, output_step_s = 2e6, solver = "bdf",
  relative_tolerance = 1e-9, absolute_tolerance = 1e-15 }
assert(jump.ok, jump.message)
near(jump.final.y1, 1.7055462, 1e-5, "van der Pol")

-- The largest step: a bump outside all conditions is seen with a shorter one.
local bump = tb.system { states = { x = 0 }, der = function(s) return { x = math.exp(-((s.t - 50.3) / 0.01) ^ 2) } end }
local seen = tb.run_system { system = bump, duration_s = 100, max_step_s = 0.02 }
near(seen.final.x, 0.01 * math.sqrt(math.pi), 1e-8, "bump")
assert(seen.statistics.steps >= 5000)
local ok, text = pcall(tb.run_system, { system = bump, duration_s = 1, max_step_s = -1 })
assert(not ok and text:find "max_step_s", text)
