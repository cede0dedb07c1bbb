-- The paper's table with a friction law and a controller of one's own in the place of two of its parts.
local tb = require "tribode"
local servo = require "servo"

local machine = tb.machine "models/linear_motor_table.lua"
local parts = servo.parts(machine)

-- Bristles that yield, in place of the twenty elements: it gives friction, as the part that it replaces.
parts.friction = tb.system {
  name = "bristles",
  parameters = {
    stiffness = { value = 5e5, unit = "N/m" },
    level = { value = 7.7, unit = "N" },
    viscous = { value = 2.35, unit = "N s/m" },
  },
  inputs = { v = { unit = "m/s" } },
  states = { bristle = { unit = "N", nominal = 1e6 } },
  der = function(s) return { bristle = s.stiffness * (s.v - math.abs(s.v) * s.bristle / s.level) } end,
  outputs = function(s) return { friction = { s.bristle + s.viscous * s.v, unit = "N" } } end,
}

-- Proportional, with the velocity from the last two samples.
parts.controller = tb.system {
  name = "PD controller",
  parameters = {
    kp = { value = 2e4, unit = "N/m" }, kd = { value = 650, unit = "N s/m" }, T = { value = machine.Ts, unit = "s" },
  },
  inputs = { r = { unit = "m" }, measured = { unit = "m" }, exc = { unit = "N" } },
  discrete = { commanded = { unit = "N" }, last = { unit = "m" } },
  outputs = function(s) return { u = { s.commanded, unit = "N" } } end,
  sample = {
    {
      period_s = machine.Ts,
      set = function(s)
        local speed = (s.measured - s.last) / s.T
        return { commanded = s.kp * (s.r - s.measured) - s.kd * speed + s.exc, last = s.measured }
      end,
    },
  },
}

local run = tb.run_system {
  system = servo.wire(parts),
  duration_s = 0.3,
  inputs = { exc = function(t) return 15 * math.sin(20 * math.pi * t) end },
}
assert(run.ok, run.message)
local largest = 0
for i, y in ipairs(run.values["plant.y"]) do
  if run.t[i] > 0.1 then largest = math.max(largest, math.abs(y)) end
end
print(string.format("by %s, %d events, amplitude %.1f um", run.solver, #run.events, 1e6 * largest))
