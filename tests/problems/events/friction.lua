-- Dry friction as modes: stick, and slip in either direction.
local tb = require "tribode"
local oracle = require "events.oracle"

-- A block under a force A sin(w t) with dry friction, 1 in slip and `static` in stick. While it slips v is a closed
-- form; it sticks where v comes to zero, and slips when the force is beyond `static`, which may be at once. `inside`
-- takes the force from two states, so that the system is affine.
local function driven_block(A, static, inside)
  local w, F, duration = 2, 1, 20
  local function force(t) return A * math.sin(w * t) end
  local events, t, x, mode = {}, 0, 0, 0
  local v
  while true do
    local t0, x0, side = t, x, mode
    local function speed(at)
      if side == 0 then return 0 end
      return A / w * (math.cos(w * t0) - math.cos(w * at)) - side * F * (at - t0)
    end
    local function place(at)
      if side == 0 then return x0 end
      return x0 + A / w * (math.cos(w * t0) * (at - t0) - (math.sin(w * at) - math.sin(w * t0)) / w)
        - side * F * (at - t0) ^ 2 / 2
    end
    local function guard(at) return side == 0 and static - math.abs(force(at)) or side * speed(at) end
    local step = 0.01
    local low = t + (side == 0 and 1e-9 or step)
    while low < duration and guard(low + step) >= 0 do low = low + step end
    if low + step >= duration then
      v, x = speed(duration), place(duration)
      break
    end
    t = oracle.crossing(guard, low, low + step)
    x = place(t)
    if side == 0 then
      mode = force(t) > 0 and 1 or -1
      events[#events + 1] = { t, mode > 0 and "slips+" or "slips-" }
    else
      mode = 0
      events[#events + 1] = { t, "sticks" }
      -- Already beyond friction: slips on the other way at once.
      if math.abs(force(t)) > static then
        mode = force(t) > 0 and 1 or -1
        events[#events + 1] = { t, mode > 0 and "slips+" or "slips-" }
      end
    end
  end
  local function push(s) return inside and s.push or A * math.sin(w * s.t) end
  local function slip(side)
    return {
      der = function(s) return { x = s.v, v = push(s) - side * F } end,
      when = { { name = "sticks", crossing = function(s) return side * s.v end, set = function() return { v = 0 } end,
        mode = "stick" } },
    }
  end
  local states = { x = 0, v = 0 }
  if inside then states.push, states.other = 0, A end
  return {
    name = string.format("block under %g sin%s", A, inside and " (affine)" or ""), duration_s = duration,
    events = events, final = { x = x, v = v, mode = mode == 0 and "stick" or mode > 0 and "plus" or "minus" },
    accepted = { exact = inside and 1e-13, erk = 100, adams = 4000, bdf = 5000 },
    system = tb.system {
      states = states,
      der = function(s) return inside and { push = w * s.other, other = -w * s.push } or {} end,
      modes = {
        stick = {
          der = function() return { x = 0, v = 0 } end,
          when = {
            { name = "slips+", condition = function(s) return tb.greater(push(s), static) end, mode = "plus" },
            { name = "slips-", condition = function(s) return tb.less(push(s), -static) end, mode = "minus" },
          },
        },
        plus = slip(1), minus = slip(-1),
      },
      start_mode = "stick",
    },
  }
end

-- A clutch between an engine and a load, whose capacity c t grows while it closes. It locks where the speeds meet,
-- slips when the torque of the engine rises to more than it transmits, and locks again: roots of quadratic equations.
local function clutch()
  local J1, J2, load, c, T1, T2, rise, duration = 1, 2, 3, 3, 12, 60, 9, 20
  local before, driven = 30, 0
  -- w1 - w2 = before + p t - q t^2
  local p, q = T1 / J1 + load / J2, c * (1 / J1 + 1 / J2) / 2
  local locks = (p + math.sqrt(p * p + 4 * q * before)) / (2 * q)
  local speed = before + T1 / J1 * locks - c / J1 * locks ^ 2 / 2
  speed = speed + (T1 - load) / (J1 + J2) * (rise - locks)
  local p2 = T2 / J1 + load / J2
  local again = p2 / q - rise
  speed = speed + (c * (again ^ 2 - rise ^ 2) / 2 - load * (again - rise)) / J2
  speed = speed + (T2 - load) / (J1 + J2) * (duration - again)
  return {
    name = "clutch", fixed_step_s = 1e-2, duration_s = duration,
    events = { { locks, "locks" }, { rise, "torque" }, { rise, "slips" }, { again, "locks" } },
    final = { w1 = speed, w2 = speed, mode = "locked" },
    accepted = { exact = 2e-13, erk = 10, adams = 20, bdf = 50 },
    system = tb.system {
      states = { w1 = before, w2 = driven }, discrete = { T = T1 },
      when = { { name = "torque", condition = function(s) return tb.greater_equal(s.t, rise) end,
        set = function() return { T = T2 } end } },
      modes = {
        slipping = {
          der = function(s) return { w1 = (s.T - c * s.t) / J1, w2 = (c * s.t - load) / J2 } end,
          when = { { name = "locks", crossing = function(s) return s.w1 - s.w2 end,
            set = function(s) return { w1 = s.w2 } end, mode = "locked" } },
        },
        locked = {
          der = function(s)
            local rate = (s.T - load) / (J1 + J2)
            return { w1 = rate, w2 = rate }
          end,
          when = { { name = "slips", condition = function(s)
            return tb.greater(s.T - J1 * (s.T - load) / (J1 + J2), c * s.t)
          end, mode = "slipping" } },
        },
      },
      start_mode = "slipping",
    },
  }
end

return { driven_block(3, 1.25, false), driven_block(3, 1.25, true), driven_block(1.5, 1.25, false),
  driven_block(1.5, 1.25, true),
  clutch() }
