-- Tutorial, step 6: a feedforward designed on each of two identified models, run on the axis.
local tb = require "tribode"
local axis = require "my_axis"

local sweep = tb.sweep {
  machine = axis, frequency_hz = tb.logspace(20, 180, tb.quick and 40 or 120), amplitude_N = 15, delay_s = 0.95e-3,
}
local position = {}
for _, name in ipairs { "FRA-1", "Proposed" } do
  local model = tb.fit_modal { response = sweep.responses[name], f_min_hz = 20, f_max_hz = 180, modes = 1 }
  local feedforward = tb.feedforward {
    model = model, sample_time_s = axis.Ts, distance_m = 0.5e-3, duration_s = 0.05, horizon_s = 0.3,
  }
  -- The delay of the loop, less the half sample of the hold that the feedforward already contains.
  local run = tb.positioning { machine = axis, feedforward = feedforward, delay_s = 0.95e-3 - axis.Ts / 2 }
  print(string.format("%-9s rms tracking error %.2f um, settled after %s", name, run.rmse_m * 1e6,
    run.settling_s and string.format("%.1f ms", run.settling_s * 1e3) or "more than 0.3 s"))
  position[#position + 1] = { name = name, x = run.t, y = run.y }
end
tb.plot {
  file = "positioning", title = "0.5 mm in 50 ms",
  panels = { { x_label = "Time [s]", y_label = "Position [m]", series = position } },
}
