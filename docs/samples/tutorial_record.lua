-- Tutorial, step 4: a recorded CSV file beside the simulation of the same move.
local tb = require "tribode"
local axis = require "my_axis"

require "logged_moves" -- leaves valid.csv in the run folder
local option = tb.options { record = "valid.csv" } -- -D record=FILE reads a file of your own

local record = tb.read_record {
  file = option.record,
  columns = { t = "time_s", r = "demand_mm", u = "force_N", y = "actual_mm" },
  scale = { r = 1e-3, y = 1e-3 },
}
print(string.format("%d samples, %g s apart, %d missing",
  #record.data.t, record.time.sample_time_s, record.time.dropped))

local run = tb.simulate { machine = axis, r = record.data.r }
local difference_um, sum = {}, 0
for k = 1, #run.t do
  difference_um[k] = (record.data.y[k] - run.y[k]) * 1e6
  sum = sum + difference_um[k] ^ 2
end
print(string.format("measured minus simulated position: %.2f um rms", math.sqrt(sum / #run.t)))

tb.plot {
  file = "difference", title = "Measured minus simulated position",
  panels = {
    { x_label = "Measured position [m]", y_label = "Difference [um]",
      series = { { name = option.record, x = record.data.y, y = difference_um } } },
  },
}
