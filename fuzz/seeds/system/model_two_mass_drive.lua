local make = function(...)
local tb = require "tribode"

local function torque(side)
  return function(s) return s.k * (s.phi - side * s.gap / 2) + s.d * (s.w1 - s.w2) end
end

local function mode(side, exits)
  local shaft = side == 0 and function() return 0 end or torque(side)
  return {
    der = function(s)
      local M = shaft(s)
      return { w1 = (s.u - M - s.d1 * s.w1) / s.J1, w2 = (M - s.d2 * s.w2 - s.load) / s.J2, phi = s.w1 - s.w2 }
    end,
    when = exits,
  }
end

return tb.system {
  name = "two-mass drive",
  parameters = {
    J1 = { value = 1e-3, unit = "kg m2" },
    J2 = { value = 2e-3, unit = "kg m2" },
    k = { value = 200, unit = "N m/rad" },
    d = { value = 0.02, unit = "N m s/rad" },
    d1 = { value = 1e-3, unit = "N m s/rad" },
    d2 = { value = 1e-3, unit = "N m s/rad" },
    gap = { value = 0.01, unit = "rad" },
    kp = { value = 0.2, unit = "N m s/rad" },
    ki = { value = 2, unit = "N m/rad" },
    period = { value = 1e-3, unit = "s" },
  },
  inputs = { speed = { value = 10, unit = "rad/s" }, load = { value = 0, unit = "N m" } },
  states = { phi = { unit = "rad" }, w1 = { unit = "rad/s" }, w2 = { unit = "rad/s" } },
  discrete = { u = { unit = "N m" }, integral = { unit = "N m" } },
  modes = {
    free = mode(0, {
      -- The damping lets go before the spring does: it touches where it is closed and would push.
      {
        name = "touches ahead",
        condition = function(s) return tb.all(tb.greater(s.phi, s.gap / 2), tb.greater(torque(1)(s), 0)) end,
        mode = "ahead",
      },
      {
        name = "touches behind",
        condition = function(s) return tb.all(tb.less(s.phi, -s.gap / 2), tb.less(torque(-1)(s), 0)) end,
        mode = "behind",
      },
    }),
    ahead = mode(1, { { name = "leaves", crossing = torque(1), mode = "free" } }),
    behind = mode(-1, { { name = "leaves", crossing = torque(-1), direction = "rising", mode = "free" } }),
  },
  start_mode = "free",
  sample = {
    {
      name = "speed controller",
      period_s = 1e-3,
      set = function(s)
        local e = s.speed - s.w1
        local integral = s.integral + s.ki * s.period * e
        return { integral = integral, u = s.kp * e + integral }
      end,
    },
  },
}
end
local tb = require "tribode"
local s = make()
tb.run_system { system = s, duration_s = 0.5, output_step_s = 0.1 }
tb.linearize { system = s }
