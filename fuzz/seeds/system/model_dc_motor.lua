local make = function(...)
local tb = require "tribode"

return tb.system {
  name = "motor with pulse-width modulation",
  parameters = {
    L = { value = 1e-3, unit = "H" },
    R = { value = 0.5, unit = "ohm" },
    K = { value = 0.05, unit = "N m/A" },
    J = { value = 1e-4, unit = "kg m2" },
    d = { value = 1e-5, unit = "N m s/rad" },
    U = { value = 24, unit = "V" },
    period = { value = 1e-4, unit = "s" },
    kp = { value = 2, unit = "V/A" },
    ki = { value = 1000, unit = "V/(A s)" },
  },
  inputs = { current = { value = 5, unit = "A" }, load = { unit = "N m" } },
  states = { i = { unit = "A" }, w = { unit = "rad/s" }, saw = 0 },
  discrete = { duty = 0.5, integral = { unit = "V" } },
  -- The bridge is up while the sawtooth is below the duty.
  der = function(s)
    local bridge = tb.where(tb.less(s.saw, s.duty), s.U, -s.U)
    local di = (bridge - s.R * s.i - s.K * s.w) / s.L
    return { i = di, w = (s.K * s.i - s.d * s.w - s.load) / s.J, saw = 1 / s.period }
  end,
  sample = {
    {
      name = "current controller",
      period_s = 1e-4,
      set = function(s)
        local e = s.current - s.i
        local integral = s.integral + s.ki * s.period * e
        local duty = 0.5 + (s.kp * e + integral) / (2 * s.U)
        return { saw = 0, integral = integral, duty = math.max(0, math.min(1, duty)) }
      end,
    },
  },
}
end
local tb = require "tribode"
local s = make()
tb.run_system { system = s, duration_s = 0.5, output_step_s = 0.1 }
tb.linearize { system = s }
