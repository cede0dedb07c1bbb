-- Switches: relays, diodes, valves.
local tb = require "tribode"
local oracle = require "events.oracle"

-- x' = u - x, u = +-1 by a relay with hysteresis a: half a period is log((1 + a)/(1 - a)).
local function relay()
  local a, half = 0.1, math.log(1.1 / 0.9)
  local events, t, u = {}, math.log(1 / 0.9), 1
  local duration = 3
  while t < duration do
    events[#events + 1] = { t, u > 0 and "off" or "on" }
    u, t = -u, t + half
  end
  local x = u + (-u * a - u) * math.exp(-(duration - (t - half)))
  return {
    name = "relay", fixed_step_s = 1e-3, duration_s = duration, events = events, final = { x = x, u = u },
    accepted = { exact = 1e-13, erk = 20, adams = 60, bdf = 300 },
    system = tb.system {
      states = { x = 0 }, discrete = { u = 1 },
      der = function(s) return { x = s.u - s.x } end,
      when = {
        { name = "off", crossing = function(s) return s.x - a end, direction = "rising",
          set = function() return { u = -1 } end },
        { name = "on", crossing = function(s) return s.x + a end, set = function() return { u = 1 } end },
      },
    },
  }
end

-- Half-wave rectifier: a sine through a diode and R onto C and a load. In both modes the voltage is a closed form; the
-- instants are those at which it meets the sine.
local function rectifier()
  local w, R, load, C = 100 * math.pi, 1, 1000, 1e-4
  local amplitude, duration = 10, 0.1
  local function source(t) return amplitude * math.sin(w * t) end
  local p = (1 / R + 1 / load) / C
  -- The forced part while the diode conducts: v' = -p v + source/(R C).
  local function forced(at)
    return amplitude / (R * C) * (p * math.sin(w * at) - w * math.cos(w * at)) / (p * p + w * w)
  end
  local events, t, v, on = {}, 0, 0, true
  while true do
    local t0, v0, conducts = t, v, on
    local function voltage(at)
      if conducts then return forced(at) + (v0 - forced(t0)) * math.exp(-p * (at - t0)) end
      return v0 * math.exp(-(at - t0) / (load * C))
    end
    local function guard(at) return conducts and source(at) - voltage(at) or voltage(at) - source(at) end
    -- In steps of 1/200 of a period; at the beginning the guard is zero.
    local low = t + 1e-7
    while low < duration and guard(low + 1e-4) >= 0 do low = low + 1e-4 end
    if low + 1e-4 >= duration then
      v = voltage(duration)
      break
    end
    t = oracle.crossing(guard, low, low + 1e-4)
    v, on = voltage(t), not on
    events[#events + 1] = { t, on and "on" or "off" }
  end
  return {
    name = "rectifier", fixed_step_s = 1e-5,
    duration_s = duration, events = events, final = { v = v, mode = on and "on" or "off" },
    accepted = { erk = 100, adams = 50, bdf = 300 },
    system = tb.system {
      states = { v = 0 },
      modes = {
        off = {
          der = function(s) return { v = -s.v / (load * C) } end,
          when = { { name = "on", crossing = function(s) return s.v - amplitude * math.sin(w * s.t) end,
            mode = "on" } },
        },
        on = {
          der = function(s) return { v = ((amplitude * math.sin(w * s.t) - s.v) / R - s.v / load) / C } end,
          when = { { name = "off", crossing = function(s) return amplitude * math.sin(w * s.t) - s.v end,
            mode = "off" } },
        },
      },
      start_mode = "on",
    },
  }
end

-- Two tanks in series drain by Torricelli's law; a pump into the first is switched by the level of the second, with
-- hysteresis; the first overflows. By the oracle.
local function tanks()
  local A1, A2, a1, a2, pump, low, high, brim = 0.05, 0.1, 4e-4, 4e-4, 1.5e-3, 0.42, 0.46, 0.62
  local root2g, duration = math.sqrt(2 * 9.81), 1000
  local function der(h1, h2, on, overflows)
    local q1, q2 = a1 * root2g * math.sqrt(h1), a2 * root2g * math.sqrt(h2)
    return overflows and 0 or (on * pump - q1) / A1, (q1 - q2) / A2
  end
  local events, t, y, on, full = {}, 0, { 0.1, 0.1 }, 1, false
  while true do
    local crossed
    local function f(_, x) return { der(x[1], x[2], on, full) } end
    local function level(x) return on == 1 and high - x[2] or x[2] - low end
    local function room(x) return full and 1 or brim - x[1] end
    t, y, crossed = oracle.follow(f, function(_, x) return math.min(level(x), room(x)) end, t, y, duration, 1)
    if not crossed then break end
    if room(y) < level(y) then
      full, y = true, { brim, y[2] }
      events[#events + 1] = { t, "overflows" }
    else
      events[#events + 1] = { t, on == 1 and "pump off" or "pump on" }
      on = 1 - on
      if on == 0 and full then
        full = false
        events[#events + 1] = { t, "recedes" }
      end
    end
  end
  local function flow(brimful)
    return function(s)
      local d1, d2 = der(s.h1, s.h2, s.pump, brimful)
      return { h1 = d1, h2 = d2 }
    end
  end
  return {
    name = "two tanks", duration_s = duration, events = events,
    final = { h1 = y[1], h2 = y[2], pump = on, mode = full and "overflow" or "normal" },
    accepted = { erk = 1e4, adams = 1e4, bdf = 1e5 }, -- the instants are of some 1000 s
    system = tb.system {
      states = { h1 = 0.1, h2 = 0.1 }, discrete = { pump = 1 },
      modes = {
        normal = {
          der = flow(false),
          when = { { name = "overflows", crossing = function(s) return s.h1 - brim end, direction = "rising",
            set = function() return { h1 = brim } end, mode = "overflow" } },
        },
        overflow = {
          der = flow(true),
          when = { { name = "recedes", condition = function(s) return tb.less(s.pump, 0.5) end, mode = "normal" } },
        },
      },
      start_mode = "normal",
      when = {
        { name = "pump off", crossing = function(s) return s.h2 - high end, direction = "rising",
          set = function() return { pump = 0 } end },
        { name = "pump on", crossing = function(s) return s.h2 - low end, set = function() return { pump = 1 } end },
      },
    },
  }
end

return { relay(), rectifier(), tanks() }
