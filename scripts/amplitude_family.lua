-- What the amplitude of the excitation does to a frequency response: FRA-1 at several amplitudes (Fig. 4), the three
-- analyses at the smallest of them (Fig. 12), and the proposed analysis with a wrong delay (Fig. 14).
--
--   tribode run scripts/amplitude_family.lua -D amplitudes=8,15,50 -D delay_errors_us=25,200
--
-- Results: summary.json, responses.csv, wrong_delay.csv and the plots amplitudes, proposed, analyses, wrong_delay.

local tb = require "tribode"

local option = tb.options {
  machine = { default = "models/linear_motor_table.lua", help = "machine description, .lua or .json" },
  amplitudes = { default = { 15, 20, 30, 50 }, unit = "N", help = "of the excitation, the closer look first" },
  frequencies = { default = tb.quick and 60 or 400, help = "how many in each sweep" },
  f_min = { default = 10, unit = "Hz", help = "lowest frequency" },
  f_max = { default = 200, unit = "Hz", help = "highest frequency" },
  delay_s = { default = 1.38e-3, unit = "s", help = "of the delay model C_dly" },
  delay_errors_us = { default = { 25, 50, 100 }, unit = "us", help = "too little delay in C_dly" },
  seed = { default = 0, help = "of the sensor noise" },
}
local machine = tb.machine { file = option.machine, argument = {} }
local black = "#000000"

local sweeps, labels = {}, {}
for i, amplitude in ipairs(option.amplitudes) do
  labels[i] = string.format("%g N", amplitude)
  sweeps[i] = tb.sweep {
    machine = machine,
    frequency_hz = tb.linspace(option.f_min, option.f_max, option.frequencies),
    amplitude_N = amplitude,
    delay_s = option.delay_s,
    seed = option.seed,
    checkpoint = string.format("sweep_%g.resume.json", amplitude),
  }
  for _, warning in ipairs(sweeps[i].warnings) do print("warning: " .. labels[i] .. ", " .. warning) end
end
local f = sweeps[1].responses["FRA-1"].frequency_hz
local dense = tb.logspace(f[1], f[#f], 4000)
local truth = tb.plant_response { machine = machine, frequency_hz = dense }
local truth_here = tb.plant_response { machine = machine, frequency_hz = f }

-- Gain and phase of several responses above the true plant's.
local function bode(file, title, names, responses)
  local gain, phase = {}, {}
  for i, name in ipairs(names) do
    gain[i] = { name = name, x = f, y = responses[i].gain_db }
    phase[i] = { name = name, x = f, y = responses[i].phase_deg }
  end
  gain[#gain + 1] = { name = "true plant", x = dense, y = truth.gain_db, style = "dashed", color = black }
  phase[#phase + 1] = { name = "true plant", x = dense, y = truth.phase_deg, style = "dashed", color = black }
  tb.plot {
    file = file,
    title = title,
    panels = {
      { y_label = "Gain [dB re 1 m/N]", x_log = true, series = gain },
      { x_label = "Frequency [Hz]", y_label = "Phase [deg]", x_log = true, series = phase, legend = "none" },
    },
  }
end

local function of_all_amplitudes(name)
  local list = {}
  for i, sweep in ipairs(sweeps) do list[i] = sweep.responses[name] end
  return list
end
bode("amplitudes", "FRA-1 at several amplitudes (Fig. 4)", labels, of_all_amplitudes("FRA-1"))
bode("proposed", "The proposed analysis at the same amplitudes", labels, of_all_amplitudes("Proposed"))
local analyses = { "FRA-1", "FRA-2", "Proposed" }
local first = sweeps[1].responses
bode("analyses", "Three analyses at " .. labels[1] .. " (Fig. 12)", analyses,
  { first["FRA-1"], first["FRA-2"], first["Proposed"] })

-- ---- how far the amplitudes lie apart ----------------------------------------------------------------------------

-- Bands that are named in the paper: below 20 Hz and around both resonances; and the rest.
local bands = {
  { "below 20 Hz", 0, 20 }, { "around 34 Hz", 30, 38 }, { "around 82 Hz", 78, 86 }, { "above 100 Hz", 100, math.huge },
}
local summary = { spread_db = {}, distance_from_plant_db = {} }

local function spread(name, low, high)
  local largest = 0
  for k = 1, #f do
    if f[k] >= low and f[k] <= high then
      local least, most = math.huge, -math.huge
      for _, sweep in ipairs(sweeps) do
        local gain = sweep.responses[name].gain_db[k]
        least, most = math.min(least, gain), math.max(most, gain)
      end
      largest = math.max(largest, most - least)
    end
  end
  return largest
end

local function distance(name, low, high)
  local largest = 0
  for k = 1, #f do
    if f[k] >= low and f[k] <= high then
      largest = math.max(largest, math.abs(first[name].gain_db[k] - truth_here.gain_db[k]))
    end
  end
  return largest
end

print("Largest difference of the gains in dB: between the amplitudes; and of " .. labels[1] .. " from the true plant")
print("                    FRA-1   FRA-2   Proposed        FRA-1   FRA-2   Proposed")
for _, band in ipairs(bands) do
  local apart, away = {}, {}
  for i, name in ipairs(analyses) do
    apart[i], away[i] = spread(name, band[2], band[3]), distance(name, band[2], band[3])
  end
  print(string.format("  %-14s %8.2f %7.2f %9.2f     %8.2f %7.2f %9.2f", band[1], apart[1], apart[2], apart[3], away[1],
    away[2], away[3]))
  summary.spread_db[band[1]] = { fra1 = apart[1], fra2 = apart[2], proposed = apart[3] }
  summary.distance_from_plant_db[band[1]] = { fra1 = away[1], fra2 = away[2], proposed = away[3] }
end

-- ---- wrong delay (Fig. 14) ---------------------------------------------------------------------------------------

-- Ratio of two responses: gain in dB and phase in deg, within half a turn.
local function ratio(above, below)
  local gain, phase = {}, {}
  for k = 1, #f do
    gain[k] = above.gain_db[k] - below.gain_db[k]
    local turned = above.phase_deg[k] - below.phase_deg[k]
    phase[k] = turned - 360 * math.floor(turned / 360 + 0.5)
  end
  return gain, phase
end

-- Within 5 % of a resonance or antiresonance of the plant: there thrust and effective thrust differ most.
local function near_resonance(frequency)
  for i = 2, #dense - 1 do
    local before, here, after = truth.gain_db[i - 1], truth.gain_db[i], truth.gain_db[i + 1]
    local extreme = (here > before and here > after) or (here < before and here < after)
    if extreme and math.abs(frequency / dense[i] - 1) <= 0.05 then return true end
  end
  return false
end
local close = {}
for k = 1, #f do close[k] = near_resonance(f[k]) end

-- A pure dead time in place of the Pade approximant: then the sweep at hand holds every delay.
local function proposed(delay_s)
  return tb.proposed_response { fra1 = first["FRA-1"], fra2 = first["FRA-2"], delay_s = delay_s }
end
local right = proposed(option.delay_s)
local names, delay_errors = {}, {}
for i, us in ipairs(option.delay_errors_us) do
  names[i], delay_errors[i] = string.format("%g us too little", us), us * 1e-6
end
names[#names + 1], delay_errors[#delay_errors + 1] = "no delay model (FRA-2)", option.delay_s

local gain_series, phase_series = {}, {}
local columns = { { name = "frequency_hz", unit = "Hz", values = f } }
summary.wrong_delay = {}
print("\nProposed analysis with a wrong delay, as a ratio to the right one at " .. labels[1] ..
  ": largest values outside and inside 5 %")
print("of resonances and antiresonances; phase less 360 f dL, inside less 360 f dL max(1, abs(u/u_e))")
for i, name in ipairs(names) do
  local error_s = delay_errors[i]
  local gain, phase = ratio(proposed(option.delay_s - error_s), right)
  local outside_db, outside_deg, inside_db, inside_deg = 0, -math.huge, 0, -math.huge
  for k = 1, #f do
    local turned = 360 * f[k] * error_s
    -- abs(u/u_e) = abs(right/FRA-1)
    local thrust_ratio = 10 ^ ((right.gain_db[k] - first["FRA-1"].gain_db[k]) / 20)
    if close[k] then
      inside_db = math.max(inside_db, math.abs(gain[k]))
      inside_deg = math.max(inside_deg, math.abs(phase[k]) - turned * math.max(1, thrust_ratio))
    else
      outside_db = math.max(outside_db, math.abs(gain[k]))
      outside_deg = math.max(outside_deg, math.abs(phase[k]) - turned)
    end
  end
  print(string.format("  %-24s outside %6.2f dB %+7.2f deg   inside %6.2f dB %+7.2f deg", name, outside_db, outside_deg,
    inside_db, inside_deg))
  summary.wrong_delay[i] = {
    delay_error_s = error_s, outside_db = outside_db, outside_excess_deg = outside_deg, inside_db = inside_db,
    inside_excess_deg = inside_deg,
  }
  gain_series[i], phase_series[i] = { name = name, x = f, y = gain }, { name = name, x = f, y = phase }
  columns[#columns + 1] = { name = string.format("gain_%.0fus_db", error_s * 1e6), unit = "dB", values = gain }
  columns[#columns + 1] = { name = string.format("phase_%.0fus_deg", error_s * 1e6), unit = "deg", values = phase }
end
tb.write_csv { file = "wrong_delay.csv", columns = columns }
tb.plot {
  file = "wrong_delay",
  title = string.format("Wrong delay in the proposed analysis at %s (Fig. 14)", labels[1]),
  panels = {
    { y_label = "Gain ratio [dB]", x_log = true, series = gain_series },
    {
      x_label = "Frequency [Hz]", y_label = "Phase difference [deg]", x_log = true, series = phase_series,
      legend = "none",
    },
  },
}

-- ---- files -------------------------------------------------------------------------------------------------------

local responses = { { name = "frequency_hz", unit = "Hz", values = f } }
for i, sweep in ipairs(sweeps) do
  for _, name in ipairs(analyses) do
    local response = sweep.responses[name]
    local stem = string.format("%s_%gN", name:lower():gsub("-", ""), option.amplitudes[i])
    responses[#responses + 1] = { name = stem .. "_gain_db", unit = "dB", values = response.gain_db }
    responses[#responses + 1] = { name = stem .. "_phase_deg", unit = "deg", values = response.phase_deg }
  end
end
tb.write_csv { file = "responses.csv", columns = responses }
tb.write_json { file = "summary.json", value = summary }
