-- Sweeps of an axis at rest, at constant velocity, and along a slow sine of the reference, beside the true dynamics.
local tb = require "tribode"

local machine = tb.machine "models/linear_motor_table.lua"
local option = tb.options {
  velocity = { default = 0.03, unit = "m/s", help = "of the constant motion" },
  carrier = { default = 0.01, unit = "m", help = "amplitude of the slow sine of 1 Hz" },
  amplitude = { default = 15, unit = "N", help = "of the excitation" },
}
local frequency_hz = tb.logspace(20, 120, tb.quick and 15 or 60)

local gain, phase = {}, {}
local function show(name, model, response)
  print(string.format("%-14s %9.5f %9.5f %9.3f %9.5f", name, model.k0, model.k1, model.f1_hz, model.zeta1))
  local place = #gain + 1
  gain[place] = { name = name, x = response.frequency_hz, y = response.gain_db }
  phase[place] = { name = name, x = response.frequency_hz, y = response.phase_deg }
end

print(string.format("%-14s %9s %9s %9s %9s", "", "k0", "k1", "f1 [Hz]", "zeta1"))
local truth = tb.plant_parameters { machine = machine }
show("true", truth, tb.model_response { model = truth, frequency_hz = frequency_hz })

local function sweep(name, options)
  options.machine, options.frequency_hz, options.amplitude_N = machine, frequency_hz, option.amplitude
  local response = tb.sweep(options).responses["FRA-1"]
  response = tb.remove_delay { response = response, delay_s = 1.38e-3 }
  show(name, tb.fit_modal { response = response }, response)
end

sweep("at rest", {})
sweep("bias velocity", { bias_velocity_m_per_s = option.velocity })
sweep("carrier", { carrier_amplitude_m = option.carrier, carrier_hz = 1, settle_time_limit_s = 10 })

tb.plot {
  file = "sweeps",
  title = string.format("FRA-1 without delay, excitation %g N", option.amplitude),
  panels = {
    { y_label = "Gain [dB re 1 m/N]", x_log = true, series = gain },
    { x_label = "Frequency [Hz]", y_label = "Phase [deg]", x_log = true, series = phase, legend = "none" },
  },
}
