-- Tutorial, step 2: a move of 10 mm there and back.
local tb = require "tribode"
local axis = require "my_axis"

local reference = {}
for k = 0, math.floor(1 / axis.Ts) - 1 do
  reference[k + 1] = 0.005 * (1 - math.cos(2 * math.pi * 1.0 * k * axis.Ts))
end
local run = tb.simulate { machine = axis, r = reference }

local error_um, largest = {}, 0
for k = 1, #run.t do
  error_um[k] = (run.r[k] - run.y[k]) * 1e6
  largest = math.max(largest, math.abs(error_um[k]))
end
print(string.format("largest following error %.1f um, %d stick-slip transitions", largest, #run.events))

tb.plot {
  file = "move", title = "10 mm there and back",
  panels = {
    { x_label = "Time [s]", y_label = "Position [m]", series = { { name = "measured", x = run.t, y = run.y } } },
    { x_label = "Time [s]", y_label = "Error [um]", series = { { name = "error", x = run.t, y = error_um } } },
    { x_label = "Time [s]", y_label = "Force [N]",
      series = { { name = "thrust", x = run.t, y = run.u }, { name = "friction", x = run.t, y = run.f } } },
  },
}
tb.write_csv {
  file = "move.csv",
  columns = {
    { name = "t", values = run.t }, { name = "r", values = run.r },
    { name = "u", values = run.u }, { name = "y", values = run.y },
  },
}
