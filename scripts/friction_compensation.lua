-- FRA-2 in its add-on form (Fig. 6): the modeled friction is really fed back into the thrust. What it does to the
-- frequency response, what it costs in stability, and where the axis begins to oscillate.
--
--   tribode run scripts/friction_compensation.lua -D feedback=0,0.9,1,1.1 -D amplitude=30
--
-- Results: results.json, responses.csv, loop_gain.csv, margins.csv, limit_cycle.csv, time.csv and the plots bode,
-- loop_gain_small, loop_gain_large, margins, limit_cycle, delay, time (png, svg).

local tb = require "tribode"

local option = tb.options {
  machine = { default = "models/linear_motor_table.lua", help = "machine description with a PID controller" },
  feedback = { default = { 0, 0.5, 0.8, 1, 1.2 }, help = "shares of the modeled friction that are fed back" },
  amplitude = { default = 15, unit = "N", help = "of the excitation, for responses and the loop gain in motion" },
  small_amplitude = { default = 0.5, unit = "N", help = "of the excitation, for the loop gain nearly stuck" },
  frequencies = { default = tb.quick and 16 or 160, help = "how many in each sweep" },
  f_min = { default = 10, unit = "Hz", help = "lowest frequency" },
  f_max = { default = 200, unit = "Hz", help = "highest frequency" },
  delays_ms = { default = tb.quick and { 0.5, 3 } or { 0.5, 1.5, 3, 5 }, unit = "ms", help = "input delays" },
  seed = { default = 0, help = "of the sensor noise" },
}

-- A copy of the machine with some fields changed.
local function machine_with(changes)
  local machine = tb.machine { file = option.machine, argument = {} }
  for key, value in pairs(changes or {}) do machine[key] = value end
  return machine
end
local machine = machine_with()
local black = "#000000"
local results = { amplitude_N = option.amplitude }

local function percent(share) return string.format("%g %%", 100 * share) end

-- ---- the response with friction fed back -------------------------------------------------------------------------

local frequency_hz = tb.linspace(option.f_min, option.f_max, option.frequencies)

local function sweep_at(share, amplitude, on, name)
  local sweep = tb.sweep {
    machine = on,
    frequency_hz = frequency_hz,
    amplitude_N = amplitude,
    friction_feedback = share,
    seed = option.seed,
    checkpoint = string.format("%s_%g.resume.json", name, share),
  }
  local column = {}
  for _, entry in ipairs(sweep.columns) do column[entry.name] = entry.values end
  local unsettled = #sweep.warnings
  return { share = share, sweep = sweep, column = column, unsettled = unsettled,
    usable = unsettled <= option.frequencies / 10 }
end

local moving = {}
for i, share in ipairs(option.feedback) do moving[i] = sweep_at(share, option.amplitude, machine, "moving") end
local calculated = moving[1]
if calculated.share ~= 0 then calculated = sweep_at(0, option.amplitude, machine, "moving") end

-- Delay as eq. (18) reads it taken out, then the fit. A sweep that does not settle has no response worth one.
local can_fit = option.frequencies >= 8 and option.f_min <= 120 and option.f_max >= 120
local function identified(response, compensate)
  if compensate then
    response = tb.remove_delay { response = response, delay_s = tb.phase_delay { response = response, at_hz = 120 } }
  end
  return tb.fit_modal { response = response, modes = #(machine.modes or {}) }
end

local keys = {
  { "k0", 1e3 }, { "k1", 1e3 }, { "f1_hz", 1 }, { "zeta1", 1e2 }, { "k2", 1e3 }, { "f2_hz", 1 }, { "zeta2", 1e3 },
}
local function print_fit(name, model)
  local cells = {}
  for i, key in ipairs(keys) do
    cells[i] = model[key[1]] and string.format("%8.2f", model[key[1]] * key[2]) or "       -"
  end
  print(string.format("  %-26s %s", name, table.concat(cells)))
end

results.identified = { truth = tb.plant_parameters { machine = machine } }
print(string.format("Identified at %g N; k in mm/(N s^2), f in Hz, zeta1 in 1e-2, zeta2 in 1e-3", option.amplitude))
print("                                  k0      k1      f1   zeta1      k2      f2   zeta2")
print_fit("truth", results.identified.truth)
if can_fit then
  for name, delayed in pairs { ["Proposed"] = false, ["FRA-2"] = true, ["FRA-1"] = true } do
    results.identified[name] = identified(calculated.sweep.responses[name], delayed)
  end
  print_fit("Proposed, nothing fed back", results.identified["Proposed"])
  print_fit("FRA-2, calculated", results.identified["FRA-2"])
  print_fit("FRA-1 (0 % fed back)", results.identified["FRA-1"])
end
results.add_on = {}
for i, run in ipairs(moving) do
  local entry = { feedback = run.share, unsettled = run.unsettled, frequencies = option.frequencies }
  if run.share > 0 then
    if not can_fit or not run.usable then
      print(string.format("  FRA-2, %s fed back: %d of %d frequencies did not settle%s", percent(run.share),
        run.unsettled, option.frequencies, can_fit and ", no fit" or ""))
    else
      entry.model = identified(run.sweep.responses["Add-on"], true)
      print_fit(string.format("FRA-2, %s fed back", percent(run.share)), entry.model)
    end
  end
  results.add_on[i] = entry
end

local dense = tb.logspace(option.f_min, option.f_max, 2000)
local truth = tb.plant_response { machine = machine, frequency_hz = dense }
local gain, phase, columns = {}, {}, { { name = "frequency_hz", unit = "Hz", values = frequency_hz } }
local function show(name, stem, response, style)
  local f = response.frequency_hz
  gain[#gain + 1] = { name = name, x = f, y = response.gain_db, style = style }
  phase[#phase + 1] = { name = name, x = f, y = response.phase_deg, style = style }
  if #f == #frequency_hz then
    columns[#columns + 1] = { name = stem .. "_gain_db", unit = "dB", values = response.gain_db }
    columns[#columns + 1] = { name = stem .. "_phase_deg", unit = "deg", values = response.phase_deg }
  end
end
show("FRA-1", "fra1", calculated.sweep.responses["FRA-1"])
for _, run in ipairs(moving) do
  if run.share > 0 then
    local response = run.sweep.responses["Add-on"]
    if not run.usable then
      -- Frequencies that did not settle are left out; unwrapping across them means nothing.
      for k = 1, #response.frequency_hz do
        local turns = math.ceil(response.phase_deg[k] / 360)
        response.phase_deg[k] = response.phase_deg[k] - 360 * turns
        if run.column.settled[k] ~= 1 then response.gain_db[k], response.phase_deg[k] = 0 / 0, 0 / 0 end
      end
    end
    show(percent(run.share) .. " fed back", string.format("add_on_%g", 100 * run.share), response,
      not run.usable and "points" or nil)
  end
end
show("FRA-2, calculated", "fra2", calculated.sweep.responses["FRA-2"], "dashed")
show("Proposed", "proposed", calculated.sweep.responses["Proposed"])
gain[#gain + 1] = { name = "true plant", x = dense, y = truth.gain_db, style = "dashed", color = black }
phase[#phase + 1] = { name = "true plant", x = dense, y = truth.phase_deg, style = "dashed", color = black }
tb.write_csv { file = "responses.csv", columns = columns }
tb.plot {
  file = "bode",
  title = string.format("FRA-2 with friction fed back (Fig. 6), excitation %g N", option.amplitude),
  panels = {
    { y_label = "Gain [dB re 1 m/N]", x_log = true, series = gain },
    { x_label = "Frequency [Hz]", y_label = "Phase [deg]", x_log = true, series = phase, legend = "none" },
  },
}

-- ---- the loop gain, simulated and by describing function ---------------------------------------------------------

-- Rounding of the encoder would hide a motion of a few hundredths of a micrometre: the small sweep is without.
local exact_encoder = machine_with { encoder_resolution_m = 0 }
local columns_of_loop = { { name = "frequency_hz", unit = "Hz", values = frequency_hz } }
results.loop_gain = {}

-- Largest distance of both loop gains, relative to 1 + L, and what is drawn.
local function loop_gain(file, title, runs, on)
  local above, below, entry = {}, {}, {}
  for _, run in ipairs(runs) do
    local seen = run.sweep.loop_gain
    if run.usable and #seen.real == #frequency_hz then
      local made = tb.loop_gain {
        machine = on, friction_feedback = run.share, frequency_hz = frequency_hz,
        amplitude_m = run.column.y_amplitude_m,
      }
      local largest = 0
      for k = 1, #frequency_hz do
        local distance = (seen.real[k] - made.real[k]) ^ 2 + (seen.imag[k] - made.imag[k]) ^ 2
        largest = math.max(largest, math.sqrt(distance / ((1 + made.real[k]) ^ 2 + made.imag[k] ^ 2)))
      end
      entry[#entry + 1] = { feedback = run.share, largest_difference = largest }
      local name = percent(run.share)
      above[#above + 1] = { name = name, x = frequency_hz, y = seen.gain_db }
      below[#below + 1] = { name = name, x = frequency_hz, y = seen.phase_deg }
      above[#above + 1] = { name = name .. ", desc. function", x = frequency_hz, y = made.gain_db, style = "dashed" }
      below[#below + 1] = { name = name, x = frequency_hz, y = made.phase_deg, style = "dashed" }
      local function add(part, response)
        local stem = string.format("%s_%g_%s", (file:gsub("loop_gain_", "")), 100 * run.share, part)
        columns_of_loop[#columns_of_loop + 1] = { name = stem .. "_real", unit = "", values = response.real }
        columns_of_loop[#columns_of_loop + 1] = { name = stem .. "_imag", unit = "", values = response.imag }
      end
      add("simulated", seen)
      add("described", made)
    end
  end
  if #above > 0 then
    tb.plot {
      file = file,
      title = title,
      panels = {
        { y_label = "Loop gain [dB]", x_log = true, series = above },
        { x_label = "Frequency [Hz]", y_label = "Phase [deg]", x_log = true, series = below, legend = "none" },
      },
    }
  end
  return entry
end

local still = {}
for _, share in ipairs(option.feedback) do
  if share <= 1 then still[#still + 1] = sweep_at(share, option.small_amplitude, exact_encoder, "still") end
end
results.loop_gain.small = loop_gain("loop_gain_small",
  string.format("Loop gain, excitation %g N: nearly stuck", option.small_amplitude), still, exact_encoder)
results.loop_gain.large = loop_gain("loop_gain_large",
  string.format("Loop gain, excitation %g N", option.amplitude), moving, machine)
tb.write_csv { file = "loop_gain.csv", columns = columns_of_loop }
print("\nLoop gain, simulated against describing function: largest abs(L - L')/abs(1 + L')")
for _, size in ipairs { "small", "large" } do
  local cells = {}
  for i, entry in ipairs(results.loop_gain[size]) do
    cells[i] = string.format("%s: %.3f", percent(entry.feedback), entry.largest_difference)
  end
  print(string.format("  %5g N   %s", size == "small" and option.small_amplitude or option.amplitude,
    table.concat(cells, "   ")))
end

-- ---- margins -----------------------------------------------------------------------------------------------------

local motions = { { "stuck", 0 }, { "1 um", 1e-6 }, { "10 um", 1e-5 }, { "100 um", 1e-4 }, { "1 mm", 1e-3 } }
local list = { amplitude_m = {}, feedback = {}, gain_margin = {}, phase_margin_deg = {}, modulus_margin = {},
  stable = {}, critical_feedback = {} }
results.margins = {}
local nan = 0 / 0
print("\nMargins of the loop: gain margin, phase margin [deg], least distance from -1; and the share that is critical")
print("  motion   " .. table.concat((function()
  local heads = {}
  for i, share in ipairs(option.feedback) do heads[i] = string.format("%17s    ", percent(share)) end
  return heads
end)()) .. "critical")
local margin_series = {}
for i, share in ipairs(option.feedback) do margin_series[i] = { name = percent(share), x = {}, y = {} } end
for _, motion in ipairs(motions) do
  local cells, critical = {}, nan
  for i, share in ipairs(option.feedback) do
    local m = tb.loop_margins { machine = machine, friction_feedback = share, amplitude_m = motion[2] }
    critical = m.critical_feedback or nan
    cells[i] = m.stable and string.format("%6.2f %6s %6.3f ", m.gain_margin or math.huge,
      m.phase_margin_deg and string.format("%.1f", m.phase_margin_deg) or "-", m.modulus_margin)
      or "            unstable "
    local row = {
      amplitude_m = motion[2], feedback = share, gain_margin = m.stable and m.gain_margin or nil,
      phase_margin_deg = m.stable and m.phase_margin_deg or nil, modulus_margin = m.modulus_margin, stable = m.stable,
      critical_feedback = m.critical_feedback, critical_hz = m.critical_hz,
    }
    results.margins[#results.margins + 1] = row
    for key, values in pairs(list) do
      local value = row[key]
      if type(value) == "boolean" then value = value and 1 or 0 end
      values[#values + 1] = value or nan
    end
    if motion[2] > 0 then
      local series = margin_series[i]
      series.x[#series.x + 1] = motion[2] * 1e6
      series.y[#series.y + 1] = m.stable and m.modulus_margin or nan
    end
  end
  print(string.format("  %-7s  %s  %6.3f", motion[1], table.concat(cells), critical))
end
local margin_columns = {}
for _, key in ipairs { "amplitude_m", "feedback", "stable", "gain_margin", "phase_margin_deg", "modulus_margin",
  "critical_feedback" } do
  margin_columns[#margin_columns + 1] = { name = key, unit = "", values = list[key] }
end
tb.write_csv { file = "margins.csv", columns = margin_columns }
tb.plot {
  file = "margins",
  title = "Least distance of the loop gain from -1, where the loop is stable",
  panels = {
    {
      x_label = "Amplitude of the motion [um]", y_label = "Modulus margin [-]", x_log = true, series = margin_series,
    },
  },
}

-- ---- onset of the oscillation ------------------------------------------------------------------------------------

-- A push of 20 ms, then half the range of the true position in the last half second of three.
local ts = machine.Ts
local samples, window = math.floor(3 / ts + 0.5), math.floor(0.5 / ts + 0.5)
local push = {}
for k = 1, samples do push[k] = k * ts <= 0.02 and option.amplitude or 0 end
local function run_after_push(delay_ms, share)
  return tb.simulate {
    machine = machine_with { input_delay_s = delay_ms * 1e-3 },
    exc = push,
    friction_feedback = share,
    seed = option.seed,
  }
end
local function remaining(run)
  local least, most = math.huge, -math.huge
  for k = #run.x - window + 1, #run.x do least, most = math.min(least, run.x[k]), math.max(most, run.x[k]) end
  return (most - least) / 2
end

local shares = tb.quick and { 0, 0.9, 1, 1.1, 1.3 }
  or { 0, 0.5, 0.8, 0.9, 0.95, 1, 1.02, 1.05, 1.1, 1.15, 1.2, 1.3, 1.4, 1.5 }
local grid = tb.logspace(1e-6, 1e-3, tb.quick and 5 or 16)
local cycle_series, cycle_columns = {}, {}
local palette = { "#0072b2", "#d55e00", "#009e73", "#cc79a7", "#e69f00", "#56b4e9" }
results.limit_cycle = {}
print("\nOscillation that remains after a push [um], simulated; in brackets by describing function")
for i, delay_ms in ipairs(option.delays_ms) do
  local critical, amplitude_um, color = {}, {}, palette[(i - 1) % #palette + 1]
  for k, a in ipairs(grid) do
    local m = tb.loop_margins { machine = machine_with { input_delay_s = delay_ms * 1e-3 }, amplitude_m = a }
    critical[k], amplitude_um[k] = m.critical_feedback or nan, a * 1e6
  end
  -- The amplitude at which the critical share is the one fed back.
  local function predicted(share)
    for k = 2, #grid do
      if critical[k - 1] <= share and share < critical[k] then
        local part = (share - critical[k - 1]) / (critical[k] - critical[k - 1])
        return grid[k - 1] * (grid[k] / grid[k - 1]) ^ part
      end
    end
  end
  local found, cells, row = {}, {}, { delay_s = delay_ms * 1e-3, feedback = shares, simulated_m = {}, predicted_m = {} }
  for k, share in ipairs(shares) do
    local size, expected = remaining(run_after_push(delay_ms, share)), predicted(share)
    found[k] = size * 1e6
    row.simulated_m[k], row.predicted_m[k] = size, expected or 0
    cells[k] = string.format("%g%%: %.3g [%.3g]", 100 * share, size * 1e6, (expected or 0) * 1e6)
  end
  results.limit_cycle[i] = row
  print(string.format("  %g ms   %s", delay_ms, table.concat(cells, "  ")))
  row.amplitude_m, row.critical_feedback = grid, critical
  local name = string.format("%g ms", delay_ms)
  cycle_series[#cycle_series + 1] = { name = name, x = critical, y = amplitude_um, style = "dashed", color = color }
  cycle_series[#cycle_series + 1] = {
    name = name .. ", simulated", x = shares, y = found, style = "points", color = color,
  }
  if i == 1 then cycle_columns[1] = { name = "feedback", unit = "", values = shares } end
  cycle_columns[#cycle_columns + 1] = {
    name = string.format("simulated_%gms_m", delay_ms), unit = "m", values = row.simulated_m,
  }
  cycle_columns[#cycle_columns + 1] = {
    name = string.format("described_%gms_m", delay_ms), unit = "m", values = row.predicted_m,
  }
end
tb.write_csv { file = "limit_cycle.csv", columns = cycle_columns }
tb.plot {
  file = "limit_cycle",
  title = "Oscillation that remains at several input delays: simulated, and by describing function (dashed)",
  height = 700,
  panels = {
    {
      x_label = "Share of the modeled friction fed back [-]", y_label = "Amplitude [um]", y_log = true,
      x_range = { 0.85, 1.55 }, y_range = { 0.1, 1000 }, series = cycle_series,
    },
  },
}

-- The same over the delay of the loop.
local growing = tb.linspace(0.5, 8, tb.quick and 4 or 16)
local delay_series = {}
results.delay = { delay_ms = growing, feedback = {} }
for i, share in ipairs(option.feedback) do
  local size = {}
  for k, delay_ms in ipairs(growing) do size[k] = remaining(run_after_push(delay_ms, share)) * 1e6 end
  delay_series[i] = { name = percent(share), x = growing, y = size, style = "line_points" }
  results.delay.feedback[i] = { feedback = share, amplitude_um = size }
end
tb.plot {
  file = "delay",
  title = "Oscillation that remains when the input delay grows",
  panels = {
    {
      x_label = "Input delay [ms]", y_label = "Amplitude [um]", y_log = true, y_range = { 1e-3, 1e3 },
      series = delay_series,
    },
  },
}

-- Over time, with the machine's own delay.
local time_series, thrust_series, time_columns, time_ms = {}, {}, {}, {}
local own_delay_ms = (machine.input_delay_s or 0) * 1e3
for k = 1, samples do time_ms[k] = (k - 1) * ts * 1e3 end
time_columns[1] = { name = "t_ms", unit = "ms", values = time_ms }
for i, share in ipairs(option.feedback) do
  local run, um = run_after_push(own_delay_ms, share), {}
  for k = 1, samples do um[k] = run.x[k] * 1e6 end
  time_series[i] = { name = percent(share), x = time_ms, y = um }
  thrust_series[i] = { name = percent(share), x = time_ms, y = run.u }
  time_columns[#time_columns + 1] = { name = string.format("x_%g_um", 100 * share), unit = "um", values = um }
  time_columns[#time_columns + 1] = { name = string.format("u_%g_N", 100 * share), unit = "N", values = run.u }
end
tb.write_csv { file = "time.csv", columns = time_columns }
tb.plot {
  file = "time",
  title = string.format("After a push of %g N and 20 ms, shares of the modeled friction fed back", option.amplitude),
  panels = {
    { y_label = "Position [um]", x_range = { 0, 1500 }, series = time_series },
    { x_label = "Time [ms]", y_label = "Thrust [N]", x_range = { 0, 1500 }, series = thrust_series, legend = "none" },
  },
}

tb.write_json { file = "results.json", value = results }
