-- What the settling of a position loop depends on: 200 machines, drawn evenly, and a tornado of what matters.
local tb = require "tribode"
local plots = require "lib.batch_plots"

local machine = tb.machine "models/linear_motor_table.lua"
local design = tb.sobol {
  seed = 1,
  count = tb.quick and 32 or 256,
  factors = {
    { name = "friction.viscous", low = 1.5, high = 3.5 },
    { name = "modes[1].freq_hz", distribution = "normal", mean = 33.32, sd = 1 },
    { name = "output_delay_s", distribution = "triangular", low = 300e-6, mode = 418e-6, high = 600e-6 },
  },
}
local feedforward = tb.feedforward { model = tb.plant_parameters { machine = machine } }

tb.batch {
  seed = 1,
  points = design,
  run = function(point, seed)
    local changed = tb.with_fields(machine, point)
    local result = tb.positioning { machine = changed, feedforward = feedforward, seed = seed }
    return { rmse_um = result.rmse_m * 1e6 }
  end,
  finish = function(merged)
    local values = merged.results.rmse_um
    local s = tb.statistics { values = values, probabilities = { 0.05, 0.95 } }
    print(string.format("rms error %.2f um, from %.2f (5 %%) to %.2f (95 %%)", s.mean, s.quantiles[1].value,
      s.quantiles[2].value))
    plots.tornado {
      file = "tornado",
      title = "Positioning error",
      x_label = "RMS error [um]",
      bars = tb.tornado { factors = plots.factors(merged), values = values, share = 0.2 },
      centre = s.mean,
    }
  end,
}
