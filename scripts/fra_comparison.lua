-- Three frequency-response analyses of a table with rolling friction, from one sine sweep in closed loop, and the
-- models fitted to them beside the truth and the paper's Table III (Figs. 11-13).
--
--   tribode run scripts/fra_comparison.lua -D amplitude=30 -D frequencies=100
--
-- Results: responses.csv, responses.h5, identified.json, signals.csv and the plots bode, error, signals (png, svg).

local tb = require "tribode"

local option = tb.options {
  amplitude = { default = 15, unit = "N", help = "of the excitation" },
  frequencies = { default = tb.quick and "40" or "400", help = "how many, or a list such as 10,15,20" },
  f_min = { default = 10, unit = "Hz", help = "lowest frequency" },
  f_max = { default = 200, unit = "Hz", help = "highest frequency" },
  solver = { default = "auto", help = "as of tb.simulate" },
  machine = { default = "models/linear_motor_table.lua", help = "machine description, .lua or .json" },
  loop_hz = { default = 7, unit = "Hz", help = "crossover of the position loop of the ready machine" },
  reading = { default = "halved", choices = { "halved", "printed" }, help = "of Table II" },
  delay_s = { default = 1.38e-3, unit = "s", help = "of the delay model C_dly" },
  seed = { default = 0, help = "of the sensor noise" },
}

local function frequency_list()
  local count = tonumber(option.frequencies)
  if count then return tb.linspace(option.f_min, option.f_max, count) end
  local list = {}
  for text in option.frequencies:gmatch("[^,]+") do
    list[#list + 1] = tonumber(text) or error("-D frequencies: \"" .. text .. "\" is not a number", 0)
  end
  return list
end

local machine = tb.machine { file = option.machine, argument = { table_ii = option.reading, loop_hz = option.loop_hz } }

-- The sweep: all three analyses from the same signals.
local sweep = tb.sweep {
  machine = machine,
  frequency_hz = frequency_list(),
  amplitude_N = option.amplitude,
  delay_s = option.delay_s,
  solver = option.solver,
  seed = option.seed,
}
for _, warning in ipairs(sweep.warnings) do print("warning: " .. warning) end

-- The fits. FRA-1 and FRA-2 know of no delay: before the fit it is read from their phase at 120 Hz, eq. (18), and
-- taken out, as in section V-A.
local analyses = { "FRA-1", "FRA-2", "Proposed" }
local measured = sweep.responses["FRA-1"].frequency_hz
local frequencies = #measured
local delay_frequency = math.max(math.min(120, measured[frequencies]), measured[1])
local responses, identified, delays = {}, {}, {}
local can_fit = frequencies >= 8 and measured[frequencies] > 20
for _, name in ipairs(analyses) do
  local response = sweep.responses[name]
  if name ~= "Proposed" then
    delays[name] = tb.phase_delay { response = response, at_hz = delay_frequency }
    response = tb.remove_delay { response = response, delay_s = delays[name] }
  end
  responses[name] = response
  if can_fit then identified[name] = tb.fit_modal { response = response, modes = #(machine.modes or {}) } end
end
identified.truth = tb.plant_parameters { machine = machine }

-- Files.
tb.write_json { file = "identified.json", value = identified }
tb.write_csv { file = "responses.csv", columns = sweep.columns }
tb.write_hdf5 {
  file = "responses.h5",
  tables = { { name = "sweep", columns = sweep.columns } },
  attributes = { amplitude_N = option.amplitude, delay_s = option.delay_s, machine = option.machine },
}

-- Bode plot of the three with the true plant, and their relative distance from it.
local dense = tb.logspace(measured[1], measured[frequencies], 2000)
local truth = tb.plant_response { machine = machine, frequency_hz = dense }
local truth_here = tb.plant_response { machine = machine, frequency_hz = measured }

local function distance(response)
  local list = {}
  for i = 1, frequencies do
    local a, b = response.real[i], response.imag[i]
    local c, d = truth_here.real[i], truth_here.imag[i]
    list[i] = math.sqrt(((a - c) ^ 2 + (b - d) ^ 2) / (c ^ 2 + d ^ 2))
  end
  return list
end

local gain, phase, error_series = {}, {}, {}
for _, name in ipairs(analyses) do
  local response = responses[name]
  local label = delays[name] and string.format("%s, delay %.2f ms removed", name, delays[name] * 1e3) or name
  local width = name == "Proposed" and 3 or 1.6 -- it lies under the true plant
  gain[#gain + 1] = { name = label, x = measured, y = response.gain_db, width = width }
  phase[#phase + 1] = { name = label, x = measured, y = response.phase_deg, width = width }
  error_series[#error_series + 1] = { name = label, x = measured, y = distance(response) }
end
local black = "#000000"
gain[#gain + 1] = { name = "true plant", x = dense, y = truth.gain_db, style = "dashed", color = black }
phase[#phase + 1] = { name = "true plant", x = dense, y = truth.phase_deg, style = "dashed", color = black }

local title = string.format("Frequency response of the table, excitation %g N", option.amplitude)
tb.plot {
  file = "bode",
  title = title,
  panels = {
    { y_label = "Gain [dB re 1 m/N]", x_log = true, series = gain },
    { x_label = "Frequency [Hz]", y_label = "Phase [deg]", x_log = true, series = phase, legend = "none" },
  },
}
tb.plot {
  file = "error",
  title = string.format("Distance from the true plant, excitation %g N", option.amplitude),
  panels = {
    { x_label = "Frequency [Hz]", y_label = "abs(H/P - 1) [-]", x_log = true, y_log = true, series = error_series },
  },
}

-- Time signals at the lowest frequency (Fig. 11).
local signals = tb.single_frequency {
  machine = machine,
  excitation_hz = measured[1],
  periods = 3,
  amplitude_N = option.amplitude,
  delay_s = option.delay_s,
  solver = option.solver,
  seed = option.seed,
}
local start, ms, um = signals.t[1], {}, {}
for i, t in ipairs(signals.t) do
  ms[i] = (t - start) * 1e3
  um[i] = signals.y[i] * 1e6
end
tb.plot {
  file = "signals",
  title = string.format("Signals at %g Hz, excitation %g N", measured[1], option.amplitude),
  panels = {
    { y_label = "Position [um]", series = { { name = "y_dly, detected", x = ms, y = um } } },
    {
      y_label = "Force [N]",
      series = {
        { name = "u, thrust reference", x = ms, y = signals.u },
        { name = "C_dly u, delayed thrust", x = ms, y = signals.delayed_thrust },
        { name = "u_e, effective thrust", x = ms, y = signals.effective_thrust },
      },
    },
    {
      x_label = "Time [ms]",
      y_label = "Friction [N]",
      series = {
        { name = "friction model", x = ms, y = signals.friction_estimate },
        { name = "true friction", x = ms, y = signals.f, style = "dashed", color = black },
      },
    },
  },
}
tb.write_csv {
  file = "signals.csv",
  columns = {
    { name = "t_s", unit = "s", values = signals.t },
    { name = "y_m", unit = "m", values = signals.y },
    { name = "u_N", unit = "N", values = signals.u },
    { name = "delayed_thrust_N", unit = "N", values = signals.delayed_thrust },
    { name = "effective_thrust_N", unit = "N", values = signals.effective_thrust },
    { name = "friction_estimate_N", unit = "N", values = signals.friction_estimate },
    { name = "friction_N", unit = "N", values = signals.f },
  },
}

-- The table beside the paper's.
local paper = {
  ["FRA-1"] = { k0 = 99.74, k1 = 23.90, f1_hz = 35.68, zeta1 = 6.01, k2 = 3.60, f2_hz = 82.20, zeta2 = 4.17 },
  ["FRA-2"] = { k0 = 83.32, k1 = 9.07, f1_hz = 33.45, zeta1 = 2.96, k2 = 3.46, f2_hz = 81.85, zeta2 = 5.22 },
  ["Proposed"] = { k0 = 94.28, k1 = 13.08, f1_hz = 33.32, zeta1 = 2.48, k2 = 5.27, f2_hz = 82.22, zeta2 = 3.22 },
}
local rows = {
  { "k0", "mm/(N s^2)", 1e3 }, { "k1", "mm/(N s^2)", 1e3 }, { "f1_hz", "Hz", 1 }, { "zeta1", "1e-2", 1e2 },
  { "k2", "mm/(N s^2)", 1e3 }, { "f2_hz", "Hz", 1 }, { "zeta2", "1e-3", 1e3 },
}
if can_fit and #(machine.modes or {}) == 2 then
  print(string.format("\nIdentified at %g N from %d frequencies; in brackets the paper's Table III", option.amplitude,
    frequencies))
  print(string.format("%-6s %-11s %8s   %-18s %-18s %-18s", "", "unit", "truth", "FRA-1", "FRA-2", "Proposed"))
  for _, row in ipairs(rows) do
    local key, unit, factor = row[1], row[2], row[3]
    local cells = {}
    for _, name in ipairs(analyses) do
      cells[#cells + 1] = string.format("%8.2f [%6.2f]  ", identified[name][key] * factor, paper[name][key])
    end
    print(string.format("%-6s %-11s %8.2f   %s", key:gsub("_hz", ""), unit, identified.truth[key] * factor,
      table.concat(cells, " ")))
  end
end
