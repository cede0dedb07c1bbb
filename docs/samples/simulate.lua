local tb = require "tribode"

local machine = tb.machine "models/linear_motor_table.lua"
local reference = {} -- a sine of 1 mm at 2 Hz, for 1 s
for k = 1, 2000 do reference[k] = 1e-3 * math.sin(2 * math.pi * 2 * k * machine.Ts) end

local run = tb.simulate { machine = machine, r = reference }
print(string.format("%d samples, %d stick-slip transitions", #run.t, #run.events))
tb.plot {
  file = "friction",
  panels = { { x_label = "Position [m]", y_label = "Friction [N]", series = { { x = run.x, y = run.f } } } },
}
