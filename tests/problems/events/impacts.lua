-- Impacts: resets of a velocity on a surface.
local tb = require "tribode"
local oracle = require "events.oracle"

-- A ball on a floor at height `floor`, dropped from 1 m above it: impacts after sqrt(2/g), then flights of 2 v/g.
local function ball(floor, set_height, duration)
  local g, e = 9.81, 0.7
  local t, v, events = math.sqrt(2 / g), math.sqrt(2 * g), {}
  local height, speed = floor + 1 - g * duration ^ 2 / 2, -g * duration
  while t < duration do
    events[#events + 1] = { t, "impact" }
    v = e * v
    height, speed = floor + v * (duration - t) - g * (duration - t) ^ 2 / 2, v - g * (duration - t)
    t = t + 2 * v / g
  end
  return {
    name = string.format("ball on a floor at %g%s", floor, set_height and "" or " where only v is set"),
    duration_s = duration, events = events, final = { h = height, v = speed },
    accepted = { exact = 1e-13 * (1 + floor), erk = 100 * (1 + floor), adams = 100 * (1 + floor),
      bdf = 500 * (1 + floor) },
    system = tb.system {
      states = { h = floor + 1, v = 0 },
      der = function(s) return { h = s.v, v = -g } end,
      when = { { name = "impact", crossing = function(s) return s.h - floor end,
        set = function(s) return { h = set_height and floor or s.h, v = -e * s.v } end } },
    },
  }
end

-- The same with drag of the square of the velocity: by the oracle.
local function ball_with_drag(floor)
  local g, e, drag = 9.81, 0.8, 0.1
  local function f(_, y) return { y[2], -g - drag * y[2] * math.abs(y[2]) } end
  local t, y, events = 0, { floor + 1, 0 }, {}
  while true do
    -- Up and down on their own, so that the drag is smooth.
    local rises, crossed = y[2] > 0
    t, y, crossed = oracle.follow(f, function(_, x) return rises and x[2] or x[1] - floor end, t, y, 2.5, 1 / 64)
    if not crossed then break end
    if rises then
      y = { y[1], 0 }
    else
      events[#events + 1] = { t, "impact" }
      y = { floor, -e * y[2] }
    end
  end
  return {
    name = string.format("ball with drag on a floor at %g", floor), duration_s = 2.5, events = events,
    final = { h = y[1], v = y[2] },
    accepted = { erk = 1000, adams = 5000, bdf = 5000 },
    system = tb.system {
      states = { h = floor + 1, v = 0 },
      der = function(s) return { h = s.v, v = -g - drag * s.v * math.abs(s.v) } end,
      when = { { name = "impact", crossing = function(s) return s.h - floor end,
        set = function(s) return { h = floor, v = -e * s.v } end } },
    },
  }
end

-- A pendulum with a stop at its lowest point. After n impacts it swings to phi_n with sin(phi_n/2) = e^n sin(phi_0/2),
-- so that the impacts are 2 K(k_n)/w0 apart, K by the arithmetic-geometric mean.
local function pendulum()
  local w0, e, phi0, count = 3, 0.8, 2, 12
  local function quarter(k)
    local a, b = 1, math.sqrt(1 - k * k)
    for _ = 1, 30 do a, b = (a + b) / 2, math.sqrt(a * b) end
    return math.pi / 2 / a / w0
  end
  local k, events = math.sin(phi0 / 2), {}
  local t = quarter(k)
  for i = 1, count do
    events[i] = { t, "impact" }
    k = e * k
    t = t + 2 * quarter(k)
  end
  -- To the turning point after the last impact.
  return {
    name = "pendulum with stop", fixed_step_s = 1e-3, duration_s = events[count][1] + quarter(k), events = events,
    final = { phi = 2 * math.asin(k), w = 0 }, accepted = { erk = 50, adams = 200, bdf = 1000 },
    system = tb.system {
      states = { phi = phi0, w = 0 },
      der = function(s) return { phi = s.w, w = -w0 ^ 2 * math.sin(s.phi) } end,
      when = { { name = "impact", crossing = function(s) return s.phi end,
        set = function(s) return { phi = 0, w = -e * s.w } end } },
    },
  }
end

return { ball(0, true, 2), ball(0, false, 2), ball(1, true, 2), ball(1000, true, 2), ball_with_drag(0),
  ball_with_drag(2), pendulum() }
