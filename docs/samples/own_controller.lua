-- The paper's table with a controller of your own: proportional-integral-velocity control with a limited thrust.
local tb = require "tribode"
local servo = require "servo"

local machine = tb.machine "models/linear_motor_table.lua"
local parts = servo.parts(machine)

parts.controller = tb.system {
  name = "PIV controller",
  parameters = {
    kp = { value = 60, unit = "1/s" },
    kv = { value = 700, unit = "N s/m" },
    ki = { value = 20, unit = "1/s" },
    limit = { value = 40, unit = "N" },
    T = { value = machine.Ts, unit = "s" },
  },
  inputs = { r = { unit = "m" }, measured = { unit = "m" } },
  discrete = { thrust = { unit = "N" }, last = { unit = "m" }, integral = { unit = "m/s" } },
  outputs = function(s) return { u = { s.thrust, unit = "N" } } end,
  sample = {
    {
      period_s = machine.Ts,
      set = function(s)
        local velocity = (s.measured - s.last) / s.T
        local velocity_error = s.kp * (s.r - s.measured) - velocity
        local wanted = s.kv * (velocity_error + s.integral)
        local thrust = math.max(-s.limit, math.min(s.limit, wanted))
        -- The integrator rests while the thrust is at its limit.
        local limited = tb.greater(math.abs(wanted), s.limit)
        local integral = s.integral + tb.where(limited, 0, s.ki * s.T * velocity_error)
        return { thrust = thrust, last = s.measured, integral = integral }
      end,
    },
  },
}

local run = tb.run_system {
  system = servo.wire(parts),
  duration_s = 1,
  inputs = { r = function(t) return 0.5e-3 * (1 - math.cos(4 * math.pi * t)) end },
}
assert(run.ok, run.message)
local largest = 0
for i, y in ipairs(run.values["plant.y"]) do
  largest = math.max(largest, math.abs(0.5e-3 * (1 - math.cos(4 * math.pi * run.t[i])) - y))
end
print(string.format("largest following error %.0f um, solver %s", largest * 1e6, run.solver))
tb.write_csv { file = "run.csv", columns = run.columns }
