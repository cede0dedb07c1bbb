-- math.floor, math.ceil, % and // of what moves are events: counted on where they jump.
local tb = require "tribode"
local solvers = { "exact", "erk", "adams", "bdf" }

local function near(found, wanted, tolerance, what)
  assert(math.abs(found - wanted) <= tolerance, string.format("%s: %.17g, not %.17g", what, found, wanted))
end
local function integral(rate, options)
  options = options or {}
  options.system = tb.system { states = { x = options.x or 0 }, parameters = { a = 1 }, der = rate }
  options.duration_s, options.x = options.duration_s or 10.5, nil
  return tb.run_system(options)
end

-- Of the time: stairs up and down, a sawtooth, halves, and of negative numbers, as Lua's own.
for _, solver in ipairs(solvers) do
  local function area(rate) return integral(function(s) return { x = rate(s.t) } end, { solver = solver }).final.x end
  near(area(function(t) return math.floor(t) end), 45 + 5, 1e-6, solver)
  near(area(function(t) return math.floor(-t) end), -(55 + 5.5), 1e-6, solver)
  near(area(function(t) return math.ceil(t) end), 55 + 5.5, 1e-6, solver)
  near(area(function(t) return t % 1 end), 5 + 0.125, 1e-6, solver)
  near(area(function(t) return -t % 1 end), 5 + 0.375, 1e-6, solver)
  near(area(function(t) return t % -2 end), -10 - 0.875, 1e-6, solver)
  near(area(function(t) return t // 0.5 end), 0.5 * (20 * 21 / 2), 1e-6, solver)
  near(area(function(t) return (t - 5) // 3 end), -2 * 2 - 3 + 2.5, 1e-6, solver)
end

-- A wave as a table over its phase: x' = sin of the phase in revolutions is the same as without the remainder.
for _, solver in ipairs { "erk", "adams", "bdf" } do
  local phase = tb.system {
    states = { phi = 0, x = 0 },
    der = function(s) return { phi = 1.3, x = math.sin(2 * math.pi * (s.phi % 1)) } end,
    outputs = function(s) return { turns = s.phi // 1, part = s.phi % 1 } end,
  }
  local run = tb.run_system { system = phase, duration_s = 10, solver = solver }
  near(run.final.x, (1 - math.cos(2 * math.pi * 13)) / (2 * math.pi * 1.3), 1e-6, solver)
  near(run.values.turns[551], 7, 0, solver)
  near(run.values.part[551], 0.15, 1e-9, solver)
end

-- Of a state that goes to and fro: x = 2.9 sin t, y' = floor x. The floor is -3 … 2, its times are arc sines.
local function area_of(steps, to)
  -- Between the instants at which x is whole, by the middle of each piece.
  local times = { 0, to }
  for k = -2, 2 do
    for n = -1, 3 do
      for _, t in ipairs { math.asin(k / 2.9) + 2 * math.pi * n, math.pi - math.asin(k / 2.9) + 2 * math.pi * n } do
        if t > 0 and t < to then times[#times + 1] = t end
      end
    end
  end
  table.sort(times)
  local sum = 0
  for i = 2, #times do
    sum = sum + (times[i] - times[i - 1]) * steps(2.9 * math.sin((times[i] + times[i - 1]) / 2))
  end
  return sum
end
local wave = tb.system {
  states = { x = 0, v = 2.9, y = 0 },
  der = function(s) return { x = s.v, v = -s.x, y = math.floor(s.x) } end,
}
for _, solver in ipairs(solvers) do
  local run = tb.run_system { system = wave, duration_s = 12, solver = solver }
  near(run.final.y, area_of(math.floor, 12), solver == "exact" and 1e-12 or 1e-5, solver)
end

-- Resets and samples that jump by more than one, onto whole numbers and between them: x' = 1, y' = floor(x).
for _, solver in ipairs(solvers) do
  for _, jump in ipairs { 3, 2.5, -4, -0.5, 1 } do
    local system = tb.system {
      states = { x = 0.5, y = 0 },
      der = function(s) return { x = 0 * s.x, y = math.floor(s.x) } end,
      sample = { { period_s = 100, offset_s = 1, set = function() return { x = jump } end } },
    }
    local run = tb.run_system { system = system, duration_s = 2, solver = solver }
    near(run.final.y, math.floor(jump), 1e-9, solver .. jump)
    local event = tb.system {
      states = { x = 0.5, y = 0 },
      der = function(s) return { x = 1, y = math.floor(s.x) } end,
      when = { { crossing = function(s) return 1 - s.t end, set = function() return { x = jump } end } },
    }
    run = tb.run_system { system = event, duration_s = 1.25, solver = solver }
    near(run.final.y, 0.5 + 0.25 * math.floor(jump), 1e-9, solver .. jump)
  end
end

-- In conditions: a `when` at each whole number, none missed; and one that stands on what it counts.
for _, solver in ipairs(solvers) do
  local counting = tb.system {
    states = { x = 0 }, discrete = { n = 0, odd = 0 }, der = function(s) return { x = 7.3 + 0 * s.n } end,
    when = {
      { name = "next", condition = function(s) return tb.less(s.n, math.floor(s.x)) end,
        set = function(s) return { n = s.n + 1 } end },
      { name = "odd", condition = function(s) return tb.greater(math.floor(s.x) % 2, 0.5) end,
        set = function(s) return { odd = s.odd + 1 } end },
    },
  }
  local run = tb.run_system { system = counting, duration_s = 10, solver = solver }
  assert(run.ok and run.final.n == 73 and run.final.odd == 37, solver)
  near(run.events[1].t, 1 / 7.3, 1e-8, solver)
  -- And on from a state.
  local half = tb.run_system { system = counting, duration_s = 5.05, solver = solver }
  local on = tb.run_system { system = counting, resume = half.state, end_time_s = 10, solver = solver }
  assert(on.final.n == 73 and on.final.odd == 37, solver)
end

-- A converter with 64 steps on a decaying voltage: der by steps, each found; by the closed form of each piece.
local steps = integral(function(s) return { x = -math.floor(64 * s.x) / 64 } end, { x = 0.999, duration_s = 3 })
assert(steps.solver == "exact")
local x, t = 0.999, 0
for k = 63, 1, -1 do
  local spent = (x - k / 64) / (k / 64)
  if t + spent > 3 then x = x - (3 - t) * k / 64; t = 3; break end
  t, x = t + spent, k / 64
end
if t < 3 then assert(x == 1 / 64) end
near(steps.final.x, x, 1e-12, "converter")

local function refused(message, make)
  local ok, text = pcall(make)
  assert(not ok and tostring(text):find(message, 1, true), tostring(text))
end
refused("math.fmod", function() return integral(function(s) return { x = math.fmod(s.t, 1) } end) end)

-- Linearized: a remainder has the slope between its jumps, a rounding its mean slope.
local linear = tb.linearize { system = tb.system {
  states = { x = 0.3 }, inputs = { u = 0 },
  der = function(s) return { x = -(s.x % 0.25) - 5 * math.floor(s.x / 0.1) * 0.1 + s.u } end,
} }
near(linear.A[1][1], -1 - 5, 1e-12, "slope")
