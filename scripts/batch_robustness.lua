-- How robust are the three frequency-response analyses, and positioning, where the machine is not quite what is
-- believed of it? In each point friction, delay, modes and mass of the machine are drawn anew; the friction model, the
-- delay model and the feedforward stay those of the machine description. Each point runs one sweep, the three fits and
-- four positioning runs: with the believed model and with the three that were identified in that point.
--
--   tribode run scripts/batch_robustness.lua -D points=10000 -j 2
--   tribode batch plan scripts/batch_robustness.lua -D points=10000 -o results/robustness     (see docs/batch.md)
--
-- With -D design=saltelli the Sobol indices are found too. Results: points.csv, statistics.json, sensitivity.json,
-- worst_cases.json, worst_*.csv and the plots parameters, positioning, scatter, tornado, worst, with saltelli indices.

local tb = require "tribode"
local plots = require "lib.batch_plots"

local option = tb.options {
  points = { default = tb.quick and 24 or 10000, help = "how many, about" },
  design = { default = "monte_carlo", choices = { "monte_carlo", "latin_hypercube", "sobol", "saltelli" } },
  machine = { default = "models/linear_motor_table.lua", help = "machine description, .lua or .json" },
  frequencies = { default = tb.quick and 16 or 40, help = "of the sweep in each point" },
  f_min = { default = 15, unit = "Hz", help = "lowest frequency" },
  f_max = { default = 200, unit = "Hz", help = "highest frequency" },
  amplitude = { default = 15, unit = "N", help = "of the excitation" },
  delay_s = { default = 1.38e-3, unit = "s", help = "of the delay model C_dly" },
  worst = { default = tb.quick and 1 or 3, help = "cases to run again with all signals" },
  seed = { default = 1, help = "of the points and of the noise" },
}
local analyses = { "FRA-1", "FRA-2", "Proposed" }
local believed = tb.machine { file = option.machine, argument = {} }

-- What is not known, *chosen*: factors on friction, stiffness of the elements, damping, mass and frequencies, and an
-- error of the delay in the output. Friction of one machine scatters by about a tenth from run to run.
local factors = {
  { name = "friction_level", distribution = "lognormal", median = 1, sd_log = 0.1 },
  { name = "friction_stiffness", distribution = "lognormal", median = 1, sd_log = 0.2 },
  { name = "viscous", distribution = "lognormal", median = 1, sd_log = 0.3 },
  { name = "delay_error_us", distribution = "normal", mean = 0, sd = 50, low = -200, high = 200 },
  { name = "rigid_gain", distribution = "normal", mean = 1, sd = 0.03, low = 0.8, high = 1.2 },
  { name = "f1", distribution = "normal", mean = 1, sd = 0.02, low = 0.9, high = 1.1 },
  { name = "f2", distribution = "normal", mean = 1, sd = 0.02, low = 0.9, high = 1.1 },
  { name = "damping", distribution = "lognormal", median = 1, sd_log = 0.3 },
}

local function design()
  if option.design == "saltelli" then
    local groups = math.max(2, option.points // (#factors + 2))
    return tb.saltelli { factors = factors, base_count = groups, seed = option.seed }
  end
  return tb[option.design] { factors = factors, count = option.points, seed = option.seed }
end

local function true_machine(point)
  return tb.with_fields {
    machine = believed,
    fields = { output_delay_s = believed.output_delay_s + point.delay_error_us * 1e-6 },
    scale = {
      ["friction.elements[*].F"] = point.friction_level,
      ["friction.elements[*].K"] = point.friction_stiffness,
      ["friction.viscous"] = point.viscous,
      ["rigid_gain_per_kg"] = point.rigid_gain,
      ["modes[1].freq_hz"] = point.f1,
      ["modes[2].freq_hz"] = point.f2,
      ["modes[*].zeta"] = point.damping,
    },
  }
end

local friction_model = { elements = believed.friction.elements, viscous = believed.friction.viscous }
local believed_model = tb.plant_parameters { machine = believed }
local frequency_hz = tb.linspace(option.f_min, option.f_max, option.frequencies)

-- ---- one point ----------------------------------------------------------------------------------------------------

-- The root of the mean square of the relative distance from the true plant.
local function distance(response, truth)
  local sum = 0
  for i = 1, #response.real do
    local a, b, c, d = response.real[i], response.imag[i], truth.real[i], truth.imag[i]
    sum = sum + ((a - c) ^ 2 + (b - d) ^ 2) / (c ^ 2 + d ^ 2)
  end
  return math.sqrt(sum / #response.real)
end

local function position(machine, model, seed)
  local feedforward = tb.feedforward { model = model, sample_time_s = machine.Ts }
  return tb.positioning {
    machine = machine,
    feedforward = feedforward,
    delay_s = option.delay_s,
    friction_model = friction_model,
    seed = seed,
  }
end

-- The numbers that are kept, and the signals, which only the worst cases keep.
local function run(point, seed)
  local machine = true_machine(point)
  local truth = tb.plant_parameters { machine = machine }
  local kept, signals = {}, { machine = machine, responses = {}, runs = {} }

  local sweep = tb.sweep {
    machine = machine,
    frequency_hz = frequency_hz,
    amplitude_N = option.amplitude,
    delay_s = option.delay_s,
    friction_model = friction_model,
    seed = seed,
  }
  kept.unsettled = #sweep.warnings

  local function keep_positioning(name, model)
    local result = position(machine, model, seed)
    kept[name .. ".rmse_um"] = result.rmse_m * 1e6
    kept[name .. ".max_error_um"] = result.max_error_m * 1e6
    kept[name .. ".settling_ms"] = result.settling_s and result.settling_s * 1e3 or 0 / 0
    signals.runs[name] = result
  end
  keep_positioning("believed", believed_model)

  for _, name in ipairs(analyses) do
    local response = sweep.responses[name]
    if name ~= "Proposed" then -- these know of no delay: it is read at 120 Hz and taken out
      response = tb.remove_delay { response = response, delay_s = tb.phase_delay { response = response, at_hz = 120 } }
    end
    local fit = tb.fit_modal { response = response, modes = #machine.modes }
    for _, key in ipairs { "k0", "f1_hz", "zeta1", "f2_hz" } do
      kept[name .. "." .. key:gsub("_hz", "") .. "_error_pct"] = 100 * (fit[key] / truth[key] - 1)
    end
    kept[name .. ".distance_pct"] =
      100 * distance(response, tb.plant_response { machine = machine, frequency_hz = response.frequency_hz })
    kept[name .. ".converged"] = fit.converged
    signals.responses[name] = response
    keep_positioning(name, fit)
  end
  return kept, signals
end

-- ---- all points ---------------------------------------------------------------------------------------------------

local function statistics_of(merged)
  local all = {}
  for name, values in pairs(merged.results) do all[name] = tb.statistics { values = values } end
  tb.write_json { file = "statistics.json", value = all }
  print(string.format("%d points, %d failed", merged.count, #merged.failures))
  print(string.format("%-26s %9s %9s %9s %9s %9s", "", "mean", "sd", "5 %", "median", "95 %"))
  local function row(name)
    local s = all[name]
    local q = {}
    for _, quantile in ipairs(s.quantiles) do q[quantile.probability] = quantile.value end
    print(string.format("%-26s %9.3f %9.3f %9.3f %9.3f %9.3f", name, s.mean, s.standard_deviation, q[0.05], q[0.5],
      q[0.95]))
  end
  for _, key in ipairs { "f1_error_pct", "zeta1_error_pct", "k0_error_pct", "distance_pct" } do
    for _, name in ipairs(analyses) do row(name .. "." .. key) end
  end
  for _, name in ipairs { "believed", table.unpack(analyses) } do row(name .. ".rmse_um") end
  return all
end

local quantities = { "Proposed.f1_error_pct", "Proposed.distance_pct", "believed.rmse_um", "Proposed.rmse_um" }

local function sensitivity_of(merged, statistics)
  local all_factors, found = plots.factors(merged), {}
  for _, name in ipairs(quantities) do
    local values = merged.results[name]
    found[name] = {
      linear = tb.regression_sensitivity { factors = all_factors, values = values },
      ranks = tb.regression_sensitivity { factors = all_factors, values = values, ranks = true },
      tornado = tb.tornado { factors = all_factors, values = values },
    }
    if option.design == "saltelli" then
      local names = {}
      for i, factor in ipairs(factors) do names[i] = factor.name end
      found[name].sobol = tb.sobol_indices { factors = names, values = values, seed = option.seed }
    end
  end
  tb.write_json { file = "sensitivity.json", value = found }

  local shown = "believed.rmse_um"
  plots.tornado {
    file = "tornado",
    title = "Positioning error with the believed model: means over the lowest and the highest tenth of each factor",
    x_label = "Root mean square of the tracking error [um]",
    bars = found[shown].tornado,
    centre = statistics[shown].mean,
  }
  if option.design == "saltelli" then
    plots.indices {
      file = "indices",
      title = "Positioning error with the believed model: what its variance comes from",
      indices = found[shown].sobol,
    }
  end
end

local function draw(merged)
  local function errors_of(key)
    local series = {}
    for i, name in ipairs(analyses) do series[i] = { name = name, values = merged.results[name .. "." .. key] } end
    return series
  end
  plots.histogram {
    file = "parameters",
    title = string.format("Error of the first mode's frequency, %d points", merged.count),
    x_label = "Error [%]",
    series = errors_of "f1_error_pct",
  }
  local runs = errors_of "rmse_um"
  table.insert(runs, 1, { name = "believed model", values = merged.results["believed.rmse_um"] })
  plots.histogram {
    file = "positioning",
    title = string.format("Tracking error of the positioning, %d points", merged.count),
    x_label = "Root mean square [um]",
    series = runs,
  }
  plots.scatter {
    file = "scatter",
    title = "Positioning error with the believed model over each factor",
    factors = plots.factors(merged),
    y_label = "RMS error [um]",
    values = merged.results["believed.rmse_um"],
  }
end

-- The worst points once more, now with all signals: the same point and seed give the same run.
local function run_worst(merged)
  local worst = tb.worst_cases { values = merged.results["believed.rmse_um"], count = option.worst }
  local cases, errors, responses = {}, {}, {}
  for i, case in ipairs(worst) do
    local point = {}
    for name, values in pairs(merged.parameters) do point[name] = values[case.row] end
    local kept, signals = run(point, merged.seeds[case.row])
    assert(kept["believed.rmse_um"] == case.value, "a worst case run again gave another result")
    cases[i] = { index = merged.index[case.row], seed = merged.seeds[case.row], point = point, results = kept }
    local result = signals.runs.believed
    tb.write_csv { file = string.format("worst_%d.csv", i), columns = result.columns }
    local ms, um = {}, {}
    for k, t in ipairs(result.t) do ms[k], um[k] = t * 1e3, result.tracking_error[k] * 1e6 end
    errors[i] = { name = string.format("point %d: %.1f um rms", cases[i].index, case.value), x = ms, y = um }
    if i == 1 then
      local dense = tb.logspace(option.f_min, option.f_max, 1000)
      local truth = tb.plant_response { machine = signals.machine, frequency_hz = dense }
      for a, name in ipairs(analyses) do
        local response = signals.responses[name]
        responses[a] = { name = name, x = response.frequency_hz, y = response.gain_db, style = "line_points" }
      end
      responses[#responses + 1] =
        { name = "true plant of this point", x = dense, y = truth.gain_db, style = "dashed", color = "#000000" }
    end
  end
  tb.write_json { file = "worst_cases.json", value = cases }
  tb.plot {
    file = "worst",
    title = "The points with the worst positioning, run again; below the analyses in the worst of them",
    panels = {
      { x_label = "Time [ms]", y_label = "Tracking error [um]", series = errors },
      { x_label = "Frequency [Hz]", y_label = "Gain [dB re 1 m/N]", x_log = true, series = responses },
    },
  }
end

tb.batch {
  name = "robustness",
  seed = option.seed,
  points = design(),
  units = { delay_error_us = "us" },
  run = function(point, seed)
    local kept = run(point, seed)
    return kept
  end,
  finish = function(merged)
    tb.write_csv { file = "points.csv", columns = plots.columns(merged) }
    local statistics = statistics_of(merged)
    sensitivity_of(merged, statistics)
    draw(merged)
    run_worst(merged)
  end,
}
