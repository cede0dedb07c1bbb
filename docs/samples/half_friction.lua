local tb = require "tribode"

-- A ready machine, changed: half the friction.
local machine = tb.machine "models/linear_motor_table.lua"
for _, element in ipairs(machine.friction.elements) do element.F = element.F / 2 end

local sweep = tb.sweep { machine = machine, frequency_hz = tb.linspace(10, 200, 60), amplitude_N = 10 }
local fit = tb.fit_modal { response = sweep.responses["Proposed"] }
print(string.format("first mode at %.2f Hz, damping %.4f", fit.f1_hz, fit.zeta1))
