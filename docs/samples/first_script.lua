-- A table under rolling friction, pushed by a slow sine: the hysteresis loop of its friction.
local tb = require "tribode"

local option = tb.options {
  amplitude = { default = 6, unit = "N", help = "of the thrust" },
}

-- A ready machine, changed: no controller here, the thrust is given.
local machine = tb.machine "models/linear_motor_table.lua"
machine.closed_loop = false

local thrust = {}
for k = 0, 3999 do
  thrust[#thrust + 1] = option.amplitude * math.sin(2 * math.pi * 1.0 * k * machine.Ts)
end

local run = tb.simulate { machine = machine, u = thrust }

local position_um = {}
for i, x in ipairs(run.x) do position_um[i] = x * 1e6 end

tb.plot {
  file = "hysteresis",
  title = string.format("Friction under %g N at 1 Hz", option.amplitude),
  panels = {
    {
      x_label = "Position [um]",
      y_label = "Friction [N]",
      series = { { name = "rolling friction", x = position_um, y = run.f } },
    },
  },
}
tb.write_csv {
  file = "hysteresis.csv",
  columns = {
    { name = "position_m", unit = "m", values = run.x },
    { name = "friction_N", unit = "N", values = run.f },
  },
}
print(string.format("%d stick-slip transitions in %g s", #run.events, #thrust * machine.Ts))
