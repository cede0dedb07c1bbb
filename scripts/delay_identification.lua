-- The delay of the loop read from frequency responses (section IV-B): eq. (18) on FRA-1, its dispersion over the
-- amplitudes (Fig. 10), its bias by friction against amplitude and frequency, and an estimate that takes the friction
-- model into account and has no such bias. Last, the phase error of the Pade approximant, eq. (19), by its order.
--
--   tribode run scripts/delay_identification.lua -D amplitudes=8,15,50 -D delay_order=4
--
-- Results: delay.json, readings.csv, dispersion.csv, pade.csv and the plots readings, dispersion, pade.

local tb = require "tribode"

local option = tb.options {
  machine = { default = "models/linear_motor_table.lua", help = "machine description, .lua or .json" },
  amplitudes = { default = { 15, 20, 30, 50 }, unit = "N", help = "of the excitation" },
  frequencies = { default = tb.quick and 60 or 400, help = "how many in each sweep" },
  f_min = { default = 10, unit = "Hz", help = "lowest frequency" },
  f_max = { default = 200, unit = "Hz", help = "highest frequency" },
  at_hz = { default = { 100, 110, 120, 130, 140, 150, 160, 170, 180, 190 }, unit = "Hz", help = "f_L to read at" },
  half_width = { default = 5, unit = "Hz", help = "band around f_L" },
  delay_s = { default = 1.38e-3, unit = "s", help = "expected delay, and that of the Pade plot" },
  delay_order = { default = 4, help = "of the Pade approximant to look at closer" },
  seed = { default = 0, help = "of the sensor noise" },
}
local machine = tb.machine { file = option.machine, argument = {} }
local amplitudes, two_pi = option.amplitudes, 2 * math.pi

-- The delay that the loop has at a frequency: half a sample of the hold, both dead times and the lag of the thrust.
local function true_delay(f)
  local lag = machine.current_loop_hz and math.atan(f / machine.current_loop_hz) / (two_pi * f) or 0
  return machine.Ts / 2 + (machine.input_delay_s or 0) + (machine.output_delay_s or 0) + lag
end

local sweeps, labels = {}, {}
for i, amplitude in ipairs(amplitudes) do
  sweeps[i] = tb.sweep {
    machine = machine,
    frequency_hz = tb.linspace(option.f_min, option.f_max, option.frequencies),
    amplitude_N = amplitude,
    delay_s = option.delay_s,
    seed = option.seed,
    checkpoint = string.format("sweep_%g.resume.json", amplitude),
  }
  labels[i] = string.format("%g N", amplitude)
  for _, warning in ipairs(sweeps[i].warnings) do print("warning: " .. labels[i] .. ", " .. warning) end
end
local f = sweeps[1].responses["FRA-1"].frequency_hz

-- ---- readings at several f_L -------------------------------------------------------------------------------------

local function paper_reading(sweep, f_L) return tb.phase_delay { response = sweep.responses["FRA-1"], at_hz = f_L } end

local function unbiased(sweep, f_L)
  return tb.estimate_delay {
    fra1 = sweep.responses["FRA-1"], fra2 = sweep.responses["FRA-2"], expected_s = option.delay_s,
    f_min_hz = f_L - option.half_width, f_max_hz = f_L + option.half_width,
  }
end

-- Friction in parts of the force that moves the plant, Fh/(C U - Fh) with the true delay in C, next to f_L: its size,
-- and the angle by which it turns the phase of FRA-1 forward.
local function friction_share(sweep, f_L)
  local nearest = 1
  for i = 1, #f do
    if math.abs(f[i] - f_L) < math.abs(f[nearest] - f_L) then nearest = i end
  end
  local fra1, fra2 = sweep.responses["FRA-1"], sweep.responses["FRA-2"]
  local proposed = tb.proposed_response { fra1 = fra1, fra2 = fra2, delay_s = true_delay(f_L) }
  local late = tb.remove_delay { response = fra1, delay_s = true_delay(f_L) }
  local a, b, c, d = proposed.real[nearest], proposed.imag[nearest], late.real[nearest], late.imag[nearest]
  local size = c ^ 2 + d ^ 2
  local real, imag = (a * c + b * d) / size, (b * c - a * d) / size
  return math.sqrt((real - 1) ^ 2 + imag ^ 2), -math.deg(math.atan(imag, real))
end

print("Delay in ms; in brackets the difference from the delay that the loop has, in us")
print("  f_L [Hz]   true    amplitude   eq. (18)           with friction model   friction share, turns the phase by")
local columns = {
  { name = "frequency_hz", unit = "Hz", values = option.at_hz },
  { name = "true_s", unit = "s", values = {} },
}
local summary, bias_series = { readings = {} }, {}
for i, label in ipairs(labels) do
  local read, found, read_bias, found_bias = {}, {}, {}, {}
  for j, f_L in ipairs(option.at_hz) do
    local truth = true_delay(f_L)
    columns[2].values[j] = truth
    read[j], found[j] = paper_reading(sweeps[i], f_L), unbiased(sweeps[i], f_L).delay_s
    read_bias[j], found_bias[j] = (read[j] - truth) * 1e6, (found[j] - truth) * 1e6
    if f_L == 120 or j == #option.at_hz then
      local share, turned = friction_share(sweeps[i], f_L)
      print(string.format("%8g   %.4f  %8s    %.4f (%+6.1f)    %.4f (%+6.1f) %15.1f %% %12.1f deg", f_L, truth * 1e3,
        label, read[j] * 1e3, read_bias[j], found[j] * 1e3, found_bias[j], 100 * share, turned))
      summary.readings[#summary.readings + 1] = {
        amplitude_N = amplitudes[i], at_hz = f_L, true_s = truth, eq_18_s = read[j], with_friction_model_s = found[j],
      }
    end
  end
  columns[#columns + 1] = { name = string.format("eq_18_%gN_s", amplitudes[i]), unit = "s", values = read }
  columns[#columns + 1] = { name = string.format("with_friction_%gN_s", amplitudes[i]), unit = "s", values = found }
  bias_series[i] = { name = "eq. (18), " .. label, x = option.at_hz, y = read_bias, style = "line_points" }
  bias_series[#labels + i] = {
    name = "with friction model, " .. label, x = option.at_hz, y = found_bias, style = "dashed",
  }
end
tb.write_csv { file = "readings.csv", columns = columns }
tb.plot {
  file = "readings",
  title = "Error of the delay read at one frequency",
  height = 900,
  panels = { {
    x_label = "Frequency f_L [Hz]", y_label = "L - true delay [us]", legend = "bottom right", series = bias_series,
  } },
}

-- ---- a machine that reads as the paper's -------------------------------------------------------------------------

-- 1.38 ms is a reading by eq. (18) at 120 Hz and the smallest amplitude, and short by what friction turns.
-- The dead time with which this machine reads so, by the secant through two trials.
local f_L = math.max(option.f_min, math.min(120, option.f_max))
local function reading_with(extra_s)
  local longer = tb.with_fields(machine, { output_delay_s = (machine.output_delay_s or 0) + extra_s })
  local sweep = tb.sweep {
    machine = longer, frequency_hz = tb.linspace(f_L - option.half_width, f_L + option.half_width, 11),
    amplitude_N = amplitudes[1], delay_s = option.delay_s, seed = option.seed,
  }
  return paper_reading(sweep, f_L)
end
local extra, before, short = 0, nil, nil
for _ = 1, 4 do
  local error_s = option.delay_s - reading_with(extra)
  local slope = before and (short - error_s) / (extra - before) or 1
  before, short = extra, error_s
  extra = extra + error_s / slope
end
local reads = reading_with(extra)
summary.reads_as_in_paper = {
  amplitude_N = amplitudes[1], at_hz = f_L, eq_18_s = reads, true_s = true_delay(f_L) + extra,
}
print(string.format("\nA machine that reads %.3f ms by eq. (18) at %g Hz and %s has a delay of %.3f ms", reads * 1e3,
  f_L, labels[1], (true_delay(f_L) + extra) * 1e3))

-- ---- dispersion over the amplitudes (Fig. 10) --------------------------------------------------------------------

-- FRA-1 reads the phase as it is. The other readings are delays already, at the same frequencies.
local phases, estimates = {}, {}
for i, sweep in ipairs(sweeps) do
  phases[i] = sweep.responses["FRA-1"].phase_deg
  estimates[i] = tb.estimate_delay {
    fra1 = sweep.responses["FRA-1"], fra2 = sweep.responses["FRA-2"], expected_s = option.delay_s,
    f_min_hz = option.f_min, f_max_hz = option.f_max,
  }.delays_s
end

-- The largest distance from the mean of the list's entries at place k, an angle within half a turn.
local function dispersion(lists, k, turn)
  local first, mean, largest = lists[1][k], 0, 0
  local function entry(list)
    local difference = list[k] - first
    return turn and difference - turn * math.floor(difference / turn + 0.5) or difference
  end
  for _, list in ipairs(lists) do mean = mean + entry(list) / #lists end
  for _, list in ipairs(lists) do largest = math.max(largest, math.abs(entry(list) - mean)) end
  return largest
end

local of_phase, of_estimate, sum, sum_estimate, count = {}, {}, 0, 0, 0
for k = 1, #f do
  of_phase[k] = dispersion(phases, k, 360) / (360 * f[k]) * 1e6
  of_estimate[k] = dispersion(estimates, k) * 1e6
  if f[k] > 100 then sum, sum_estimate, count = sum + of_phase[k], sum_estimate + of_estimate[k], count + 1 end
end
local mean, mean_estimate = sum / count, sum_estimate / count
summary.mean_dispersion_above_100_hz_s = { eq_18 = mean * 1e-6, with_friction_model = mean_estimate * 1e-6 }
print(string.format("\nmean dispersion above 100 Hz: %.1f us [paper: 25 us]; with the friction model %.1f us", mean,
  mean_estimate))
tb.write_csv {
  file = "dispersion.csv",
  columns = {
    { name = "frequency_hz", unit = "Hz", values = f },
    { name = "fra1_us", unit = "us", values = of_phase },
    { name = "with_friction_model_us", unit = "us", values = of_estimate },
  },
}
tb.plot {
  file = "dispersion",
  title = "Dispersion of the delay over the amplitudes " .. table.concat(labels, ", ") .. " (Fig. 10)",
  panels = { {
    x_label = "Frequency [Hz]", y_label = "Largest distance from the mean [us]", y_log = true, x_log = true,
    series = { { name = "FRA-1", x = f, y = of_phase }, { name = "with friction model", x = f, y = of_estimate } },
  } },
}

-- ---- the Pade approximant, eq. (19) ------------------------------------------------------------------------------

local pade_columns, pade_series = { { name = "frequency_hz", unit = "Hz", values = f } }, {}
for order = 1, 6 do
  local phase = tb.delay_model_response {
    delay_s = option.delay_s, delay_order = order, sample_time_s = machine.Ts, frequency_hz = f,
  }
  local late = {}
  for k = 1, #f do
    local angle = math.atan(phase.imag[k], phase.real[k]) + two_pi * f[k] * option.delay_s
    late[k] = -math.deg(angle - two_pi * math.floor(angle / two_pi + 0.5))
  end
  pade_columns[order + 1] = { name = "order_" .. order .. "_deg", unit = "deg", values = late }
  local looked_at = order == option.delay_order
  pade_series[order] = { name = "order " .. order, x = f, y = late, width = looked_at and 4 or 1.6 }
  if looked_at then
    print(string.format("\nPade approximant of order %d at %g us: at %.0f Hz %.2f deg too late, %.1f us", order,
      machine.Ts * 1e6, f[#f], late[#f], late[#f] / (360 * f[#f]) * 1e6))
  end
end
tb.write_csv { file = "pade.csv", columns = pade_columns }
tb.plot {
  file = "pade",
  title = string.format("Phase lag of the sampled Pade approximant beyond that of %.2f ms", option.delay_s * 1e3),
  panels = { {
    x_label = "Frequency [Hz]", y_label = "Excess lag [deg]", y_range = { -4, 6 }, legend = "bottom left",
    series = pade_series,
  } },
}
tb.write_json { file = "delay.json", value = summary }
