-- Sampled loops and switched converters.
local tb = require "tribode"
local oracle = require "events.oracle"

-- A mass under two clocks of coprime periods, 7 and 11 ms: a slow position loop gives a fast speed loop its set point.
-- Between instants the motion is a parabola, so that the reference is arithmetic at the instants k 7 ms and k 11 ms.
local function two_clocks()
  local fast, slow, duration = 0.007, 0.011, 0.5
  local x, v, u, target, last = 0, 0, 0, 0, 0
  local function move(t)
    local h = t - last
    x, v, last = x + v * h + u * h * h / 2, v + u * h, t
  end
  local i, j = 0, 0
  while math.min(i * fast, j * slow) < duration do
    if j * slow <= i * fast then -- declared first
      move(j * slow)
      target = 8 * (1 - x)
      j = j + 1
    else
      move(i * fast)
      u = 40 * (target - v)
      i = i + 1
    end
  end
  move(duration)
  return {
    name = "two clocks", duration_s = duration, events = {}, final = { x = x, v = v, u = u, target = target },
    accepted = { exact = 1e-13, erk = 1, adams = 2000, bdf = 5000 },
    system = tb.system {
      states = { x = 0, v = 0 }, discrete = { u = 0, target = 0 },
      der = function(s) return { x = s.v, v = s.u } end,
      sample = {
        { period_s = slow, set = function(s) return { target = 8 * (1 - s.x) } end },
        { period_s = fast, set = function(s) return { u = 40 * (s.target - s.v) } end },
      },
    },
  }
end

-- A buck converter: the switch closes with each period, opens when the ramp meets the control voltage
-- bias + gain (reference - v), and the diode conducts until the current has come to zero. By the oracle, mode
-- by mode.
local function converter(name, bias, gain)
  local supply, L, C, R, period, reference = 24, 1e-3, 1e-4, 20, 1e-4, 12
  local duration = 59.5 * period
  local events, t, y, mode, k = {}, 0, { 0, 0 }, "on", 0
  local function ramp(at) return at / period - k end
  local function control(v) return bias + gain * (reference - v) end
  while t < duration do
    local source = mode == "on" and supply or 0
    local function f(_, s)
      if mode == "off" then return { 0, -s[2] / (R * C) } end
      return { (source - s[2]) / L, (s[1] - s[2] / R) / C }
    end
    local function guard(at, s)
      if mode == "on" then return control(s[2]) - ramp(at) end
      return mode == "freewheel" and s[1] or 1
    end
    local stop = math.min((k + 1) * period, duration)
    local crossed
    t, y, crossed = oracle.follow(f, guard, t, y, stop, period / 8)
    if crossed then
      if mode == "on" then
        mode = "freewheel"
        events[#events + 1] = { t, "opens" }
      else
        mode, y = "off", { 0, y[2] }
        events[#events + 1] = { t, "empty" }
      end
    elseif t < duration then
      k = k + 1
      if mode ~= "on" then mode = "on" end
    end
  end
  local function coil(source)
    return function(s) return { i = (source - s.v) / L, v = (s.i - s.v / R) / C } end
  end
  return {
    -- A rounding of the time is 2e-12 of the current.
    name = name, duration_s = duration, events = events, final = { i = y[1], v = y[2], mode = mode },
    accepted = { exact = 3e-11, erk = 30, adams = 100, bdf = 2000 },
    system = tb.system {
      states = { i = 0, v = 0 }, discrete = { k = -1 },
      sample = { { period_s = period, set = function(s) return { k = s.k + 1 } end, mode = "on" } },
      modes = {
        on = { der = coil(supply), when = { { name = "opens", mode = "freewheel",
          condition = function(s) return tb.greater(s.t / period - s.k, bias + gain * (reference - s.v)) end } } },
        freewheel = { der = coil(0), when = { { name = "empty", crossing = function(s) return s.i end,
          set = function() return { i = 0 } end, mode = "off" } } },
        off = { der = function(s) return { i = 0, v = -s.v / (R * C) } end },
      },
      start_mode = "on",
    },
  }
end

return { two_clocks(), converter("converter", 0.4, 0.02), converter("converter that skips pulses", 0, 0.15) }
