-- Tutorial, step 3: a sine sweep, and the models that three analyses find in it.
local tb = require "tribode"
local axis = require "my_axis"

local frequency_hz = tb.logspace(20, 180, tb.quick and 40 or 120)
local sweep = tb.sweep { machine = axis, frequency_hz = frequency_hz, amplitude_N = 15, delay_s = 0.95e-3 }

local truth = tb.plant_parameters { machine = axis }
print(string.format("%-9s k0 %.4f  f1 %.2f Hz  zeta1 %.4f", "true", truth.k0, truth.f1_hz, truth.zeta1))
local gain, phase, models = {}, {}, {}
for _, name in ipairs { "FRA-1", "FRA-2", "Proposed" } do
  local response = sweep.responses[name]
  local fit = tb.fit_modal { response = response, f_min_hz = 20, f_max_hz = 180, modes = 1 }
  print(string.format("%-9s k0 %.4f  f1 %.2f Hz  zeta1 %.4f", name, fit.k0, fit.f1_hz, fit.zeta1))
  models[name] = { k0 = fit.k0, k1 = fit.k1, f1_hz = fit.f1_hz, zeta1 = fit.zeta1 }
  gain[#gain + 1] = { name = name, x = frequency_hz, y = response.gain_db }
  phase[#phase + 1] = { name = name, x = frequency_hz, y = response.phase_deg }
end
local plant = tb.plant_response { machine = axis, frequency_hz = frequency_hz }
gain[#gain + 1] = { name = "true", x = frequency_hz, y = plant.gain_db, style = "dashed" }
phase[#phase + 1] = { name = "true", x = frequency_hz, y = plant.phase_deg, style = "dashed" }

tb.plot {
  file = "bode", title = "Thrust to position",
  panels = {
    { x_label = "Frequency [Hz]", y_label = "Gain [dB]", x_log = true, series = gain },
    { x_label = "Frequency [Hz]", y_label = "Phase [deg]", x_log = true, series = phase },
  },
}
tb.write_json { file = "models.json", value = models }
