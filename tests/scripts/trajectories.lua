-- tb.trajectory: moves from limits, against closed forms and by integration of what it returns.
local tb = require "tribode"

local function close(value, expected, within, what)
  assert(math.abs(value - expected) <= within, string.format("%s: %.17g instead of %.17g", what, value, expected))
end

-- Limits are kept and used, positions, velocities and accelerations belong together, each move ends where it should.
local function check(what, options)
  local made = tb.trajectory(options)
  local ts, y, v, a = options.sample_time_s, made.values, made.velocity, made.acceleration
  assert(#y == #v and #y == #a)
  local points = options.points_m
  assert(y[1] == points[1] and y[#y] == points[#points] and v[#v] == 0 and a[#a] == 0)
  local top, steepest, jerkiest = 0, 0, 0
  for k = 1, #y do
    top, steepest = math.max(top, math.abs(v[k])), math.max(steepest, math.abs(a[k]))
    if k < #y then
      -- The trapezoidal rule, whose error is a jerk or a jump of the acceleration within a step.
      local worst = options.max_jerk and options.max_jerk * ts ^ 2 or 2 * options.max_acceleration * ts
      close(v[k + 1] - v[k], (a[k] + a[k + 1]) / 2 * ts, worst, what .. ", velocity")
      close(y[k + 1] - y[k], (v[k] + v[k + 1]) / 2 * ts, worst * ts, what .. ", position")
      jerkiest = math.max(jerkiest, math.abs(a[k + 1] - a[k]) / ts)
    end
  end
  assert(top <= options.max_velocity * (1 + 1e-12) and steepest <= options.max_acceleration * (1 + 1e-12))
  if options.max_jerk then assert(jerkiest <= options.max_jerk * (1 + 1e-6), what .. ": jerk " .. jerkiest) end
  return made, top, steepest
end

-- The duration of the fastest move, in each of the cases that there are.
local ts = 1e-3
for _, case in ipairs {
  { "trapezoid", 0.2, 0.1, 1, nil, 0.2 / 0.1 + 0.1 / 1 },
  { "triangle", 0.001, 0.1, 1, nil, 2 * math.sqrt(0.001 / 1) },
  { "all limits", 0.2, 0.1, 1, 20, 0.2 / 0.1 + 0.1 / 1 + 1 / 20 },
  { "no limit of acceleration reached", 0.2, 0.01, 1, 20, 0.2 / 0.01 + 2 * math.sqrt(0.01 / 20) },
  { "no limit of velocity reached", 0.02, 10, 1, 20, 1 / 20 + math.sqrt((1 / 20) ^ 2 + 4 * 0.02) },
  { "jerk alone", 1e-5, 10, 1, 20, 4 * (1e-5 / (2 * 20)) ^ (1 / 3) },
} do
  local what, distance, velocity, acceleration, jerk, duration = table.unpack(case, 1, 6)
  for _, way in ipairs { 1, -1 } do
    local made, top, steepest = check(what, { sample_time_s = ts, points_m = { 0.3, 0.3 + way * distance },
      max_velocity = velocity, max_acceleration = acceleration, max_jerk = jerk, dwell_s = 0 })
    close(made.arrival_s[1], duration, 1e-12, what)
    assert(#made.values == math.ceil(duration / ts * (1 - 1e-12)) + 1)
    if what == "all limits" then assert(top == velocity and steepest == acceleration) end
  end
end

-- Several points with a rest at each; a point twice is no move.
local made = check("points", { sample_time_s = ts, points_m = { 0, 0.01, 0.01, -0.02 }, max_velocity = 0.1,
  max_acceleration = 2, max_jerk = 100, dwell_s = 0.05 })
local first = math.ceil(made.arrival_s[1] / ts)
for k = first + 1, first + 100 do assert(made.values[k] == 0.01 and made.velocity[k] == 0) end
assert(#made.arrival_s == 3 and made.arrival_s[2] > made.arrival_s[1] + 0.049)

-- Random limits.
for seed = 1, 200 do
  local function random(i) return math.exp(tb.standard_normal(seed, 7, i)) end
  check("random " .. seed, { sample_time_s = ts, points_m = { 0, 0.05 * random(1), -0.01 * random(2) },
    max_velocity = 0.1 * random(3), max_acceleration = random(4), max_jerk = seed % 3 > 0 and 30 * random(5) or nil,
    dwell_s = 0.01 })
end

-- A reference of a P-PI cascade, with feedforward by hand: mass times acceleration, and what its velocity loop brakes
-- the reference by, integrator included.
local machine = { Ts = 5e-4, mass_kg = 10, controller = { type = "cascade", kp = 40, kv = 2000, ki = 60 } }
local path = tb.trajectory { points_m = { 0, 0.02, 0 }, max_velocity = 0.1, max_acceleration = 2, max_jerk = 60 }
local thrust = {}
for k, a in ipairs(path.acceleration) do thrust[k] = 10 * a + 2000 * (path.velocity[k] + 60 * path.values[k]) end
local run = tb.simulate { machine = machine, r = path.values, exc = thrust }
local plain = tb.simulate { machine = machine, r = path.values }
local with, without = 0, 0
for k = 1, #path.values do
  with = math.max(with, math.abs(run.y[k] - path.values[k]))
  without = math.max(without, math.abs(plain.y[k] - path.values[k]))
end
print(string.format("largest error of a P-PI cascade: %.2g m, with feedforward %.2g m", without, with))
assert(with < 0.1 * without)

-- Bad input.
local function refused(message, options)
  local ok, text = pcall(tb.trajectory, options)
  assert(not ok and text:find(message, 1, true), tostring(text))
end
refused("points_m has 1 entries, must have two or more", { points_m = { 1 } })
refused("max_jerk", { points_m = { 0, 1 }, max_jerk = 0 })
refused("more than 1e8 samples", { points_m = { 0, 1e9 }, max_velocity = 1e-3 })
