-- The electro-mechanical positioning system [Janot 2019], a real ball-screw axis: from mass and viscous friction step
-- by step to what is published, by inverse dynamics and by simulation of the closed loop, beside the published values.
-- Then the diagnosis is asked what the first model lacks, and the residual is plotted.
--
--   tribode run scripts/emps.lua -D data=/data/emps -o results/emps
--
-- The data are not part of Tribode: the folder must hold emps_train.csv and emps_test_pulses.csv with the columns
-- t_s, u_V, q_m, qref_m, pulse_V. Results: emps.json, report.html, the plots loop, residual, spectra, and below
-- diagnosis what the diagnosis writes.

local tb = require "tribode"
local simulation_fit = require "lib.simulation_fit"

local option = tb.options {
  data = { default = "", help = "folder of the measured records" },
  diagnose = { default = not tb.quick, help = "whether the diagnosis is asked too" },
}
if option.data == "" then
  error("-D data= is missing: the folder of the EMPS benchmark, emps_train.csv and emps_test_pulses.csv with the "
    .. "columns t_s, u_V, q_m, qref_m, pulse_V; the measurements are those of A. Janot, M. Gautier, M. Brunot: Data "
    .. "Set and Reference Models of EMPS, Workshop on Nonlinear System Identification Benchmarks 2019", 0)
end

local newton_per_volt = 35.15065188248547
local Ts = 1e-3
local names = { t = "t_s", u = "u_V", y = "q_m", r = "qref_m", exc = "pulse_V" }
local factors = { u = newton_per_volt, exc = newton_per_volt }

local function file_of(name) return option.data .. "/emps_" .. name .. ".csv" end

local records = {}
for _, name in ipairs { "train", "test_pulses" } do
  records[name] = tb.read_record { file = file_of(name), columns = names, scale = factors }.data
end

-- ---- inverse dynamics ---------------------------------------------------------------------------------------------

-- The estimator of the publication: position filtered without phase, central differences, the first 49 samples left
-- out, and then force and all regressors decimated alike, the constant too.
local function sign(v) return v > 0 and 1 or v < 0 and -1 or 0 end
local terms = {
  M = function(s, k) return s.a[k] end,
  Fv = function(s, k) return s.v[k] end,
  Fc = function(s, k) return sign(s.v[k]) end,
  offset = function() return 1 end,
  ["Fv+"] = function(s, k) return math.max(s.v[k], 0) end,
  ["Fv-"] = function(s, k) return math.min(s.v[k], 0) end,
  ["Fc+"] = function(s, k) return s.v[k] > 0 and 1 or 0 end,
  ["Fc-"] = function(s, k) return s.v[k] < 0 and -1 or 0 end,
}

local function dynamics(record)
  local function rate(values) return tb.derivative { values = values, sample_time_s = Ts } end
  local q = tb.low_pass { values = record.y, sample_time_s = Ts, corner_hz = 100 }
  local v = rate(q)
  -- Distance since the velocity last turned.
  local since, from = {}, q[1]
  for k = 1, #q do
    if k > 1 and sign(v[k]) ~= sign(v[k - 1]) then from = q[k] end
    since[k] = math.abs(q[k] - from)
  end
  return { t = record.t, q = q, v = v, a = rate(v), since = since, force = record.u }
end

-- A term along a record, as the estimator sees it.
local function column(signals, term)
  local values = {}
  for k = 50, #signals.t do values[#values + 1] = term(signals, k) end
  return tb.decimate { values = values, factor = 10 }
end

local function columns_of(signals, list)
  local columns = {}
  for i, name in ipairs(list) do columns[i] = column(signals, terms[name]) end
  return columns
end

local function norm(values)
  local sum = 0
  for _, value in ipairs(values) do sum = sum + value ^ 2 end
  return math.sqrt(sum)
end

local function minus(a, b)
  local difference = {}
  for k = 1, #a do difference[k] = a[k] - b[k] end
  return difference
end

-- What the publication says of each; errors in percent of the force.
local models = {
  { name = "mass and viscous friction", terms = { "M", "Fv" }, published = {} },
  { name = "+ offset", terms = { "M", "Fv", "offset" }, published = {} },
  { name = "+ Coulomb friction", terms = { "M", "Fv", "Fc" }, published = {} },
  { name = "+ Coulomb friction + offset", terms = { "M", "Fv", "Fc", "offset" }, fitted_too = true,
    published = { M = 95.1089, Fv = 203.5034, Fc = 20.3935, offset = -3.1648, train = 4.0834, pulses = 5.9824 } },
  { name = "friction by direction", terms = { "M", "Fv+", "Fc+", "Fv-", "Fc-" }, fitted_too = true,
    published = { M = 95.1540, ["Fv+"] = 166.7061, ["Fc+"] = 20.1440, ["Fv-"] = 240.4236, ["Fc-"] = 20.6277,
      train = 3.1117 } },
}

local function force(s, k) return s.force[k] end
local train, pulses = dynamics(records.train), dynamics(records.test_pulses)
local train_force, pulses_force = column(train, force), column(pulses, force)

for _, model in ipairs(models) do
  local fit = tb.least_squares { columns = columns_of(train, model.terms), values = train_force }
  model.values, model.errors, model.residual = {}, {}, fit.residual
  local left = pulses_force
  for i, values in ipairs(columns_of(pulses, model.terms)) do
    for k = 1, #values do values[k] = fit.coefficients[i] * values[k] end
    left = minus(left, values)
  end
  for i, name in ipairs(model.terms) do
    model.values[name], model.errors[name] = fit.coefficients[i], fit.standard_errors[i]
  end
  model.train, model.pulses = 100 * fit.relative_error, 100 * norm(left) / norm(pulses_force)
end

-- ---- closed loop --------------------------------------------------------------------------------------------------

-- The rig with the numbers of a model. In the records u follows from r and y of the same row; the publication simulates
-- with a delay of one sample between them.
local function machine_of(values, delay_samples)
  local effects = {}
  local function add(name, parameters) effects[#effects + 1] = { name = name, parameters = parameters } end
  if values.offset then add("constant_force", { F = -values.offset }) end
  if values["Fv+"] then
    add("asymmetric_friction", { dF_pos = values["Fc+"] - values["Fc-"], dD_pos = values["Fv+"] - values["Fv-"] })
  end
  return {
    Ts = Ts,
    rigid_gain_per_kg = 1 / values.M,
    friction = { viscous = values.Fv or values["Fv-"], coulomb = values.Fc or values["Fc-"] or 0 },
    controller = { type = "cascade", kp = 160.18, kv = 243.45 * newton_per_volt, limit = 10 * newton_per_volt,
      delay_samples = delay_samples or 0 },
    initial = "fitted",
    effects = effects,
  }
end

local function simulate(values, record, delay_samples)
  return tb.simulate { machine = machine_of(values, delay_samples), r = record.r, exc = record.exc, y = record.y }
end

-- Force measured less simulated, and its rms.
local function loop_error(values, record)
  local left = minus(record.u, simulate(values, record).u)
  return left, norm(left) / math.sqrt(#left)
end

for _, model in ipairs(models) do
  local _, rms = loop_error(model.values, records.train)
  local _, rms_pulses = loop_error(model.values, records.test_pulses)
  model.loop_train, model.loop_pulses = rms, rms_pulses
  if model.fitted_too then
    model.loop = simulation_fit(model.values, model.terms, function(v) return (loop_error(v, records.train)) end)
    local _, fitted_pulses = loop_error(model.loop.values, records.test_pulses)
    model.loop.pulses = fitted_pulses
  end
end

-- The published score of the simulation: errors of velocity, acceleration and force in percent, of the model with
-- offset, with the published delay. The acceleration is that of the model's equation of motion, where it comes to 8.64;
-- of differences of the simulated velocity it would be 7.5 to 8.3.
local simulated = simulate(models[4].values, records.train, 1)
simulated.a, simulated.force = {}, simulated.u
for k = 1, #simulated.u do
  simulated.a[k] = (simulated.u[k] - simulated.f[k] - models[4].values.offset) / models[4].values.M
end
local scores = { { "velocity", "v", 0.22911 }, { "acceleration", "a", 8.6036 }, { "force", "force", 5.848 } }
for _, score in ipairs(scores) do
  local name = score[2]
  local measured = table.move(train[name], 50, #train[name], 1, {})
  local error_of_it = minus(measured, table.move(simulated[name], 50, #train[name], 1, {}))
  score.ours = 100 * norm(error_of_it) / norm(measured)
end

-- ---- what the diagnosis says --------------------------------------------------------------------------------------

-- It is given mass and viscous friction as they come out alone, known to 5 % and by half.
local diagnosis
if option.diagnose then
  local machine = machine_of(models[1].values)
  machine.encoder_resolution_m = 5e-8
  machine.tolerance = { rigid_gain_per_kg = 0.05, ["friction.viscous"] = 0.5 }
  diagnosis = tb.diagnose {
    machine = machine,
    data = { file_of "train" },
    validate = file_of "test_pulses",
    columns = { t = "t_s", u = "u_V", y = "q_m", r = "qref_m" },
    scale = { u = newton_per_volt },
  }
end

-- ---- the residual --------------------------------------------------------------------------------------------------

-- Terms put beside friction by direction, one at a time: how much of the residual each takes, by inverse dynamics on
-- both records. A pitch is sought over the range of a screw, the way over which friction builds up over that of
-- bearings. A ripple is told from one whose count of periods over the stroke differs by one, so pitches are half a
-- period over the stroke apart.
local last = models[#models]
local function candidate(name, list)
  local columns, other = columns_of(train, last.terms), columns_of(pulses, last.terms)
  for _, term in ipairs(list) do
    columns[#columns + 1], other[#other + 1] = column(train, term), column(pulses, term)
  end
  local fit = tb.least_squares { columns = columns, values = train_force }
  local left = pulses_force
  for i, values in ipairs(other) do
    for k = 1, #values do values[k] = fit.coefficients[i] * values[k] end
    left = minus(left, values)
  end
  return { name = name, train = 100 * fit.relative_error, pulses = 100 * norm(left) / norm(pulses_force),
    coefficient = fit.coefficients[#columns], error = fit.standard_errors[#columns] }
end
local function ripple(pitch, phase)
  return function(s, k) return math.sin(2 * math.pi * s.q[k] / pitch + phase) end
end

local leftovers = {
  candidate("spring over position", { function(s, k) return s.q[k] end }),
  candidate("friction that grows with position", { function(s, k) return s.q[k] * sign(s.v[k]) end }),
  candidate("friction that grows with time", { function(s, k) return s.t[k] * sign(s.v[k]) end }),
  candidate("drag", { function(s, k) return s.v[k] * math.abs(s.v[k]) end }),
  candidate("friction other at low speed (8 mm/s)",
    { function(s, k) return sign(s.v[k]) * math.exp(-math.abs(s.v[k]) / 8e-3) end }),
  candidate("friction with the load", { function(s, k) return math.abs(s.a[k]) * sign(s.v[k]) end }),
}
local positions = column(train, function(s, k) return s.q[k] end)
local stroke = math.max(table.unpack(positions)) - math.min(table.unpack(positions))
local pitches, taken = {}, {}
for count = 2 * stroke / 5e-2, 2 * stroke / 2e-3 do pitches[#pitches + 1] = 2 * stroke / count end
local best, best_pitch
for i, pitch in ipairs(pitches) do
  local one = candidate(string.format("ripple over %.2f mm", 1e3 * pitch),
    { ripple(pitch, 0), ripple(pitch, math.pi / 2) })
  taken[i] = 100 * (1 - (one.train / last.train) ^ 2)
  if not best or one.train < best.train then best, best_pitch = one, pitch end
end
leftovers[#leftovers + 1] = best
-- The origin of the positions may differ between records, and with it the phase: its amplitude in one of them.
local function ripple_amplitude(record)
  local columns = columns_of(record, last.terms)
  for _, phase in ipairs { 0, math.pi / 2 } do columns[#columns + 1] = column(record, ripple(best_pitch, phase)) end
  local c = tb.least_squares { columns = columns, values = column(record, force) }.coefficients
  return math.sqrt(c[#c - 1] ^ 2 + c[#c] ^ 2)
end
local ripple_text = string.format("The ripple over %.2f mm, fitted to each record with its own phase: %.2f N, in the "
  .. "pulses %.2f N.", 1e3 * best_pitch, ripple_amplitude(train), ripple_amplitude(pulses))
local build_up
for _, length in ipairs(tb.logspace(1e-5, 3e-3, tb.quick and 4 or 12)) do
  local one = candidate(string.format("friction that builds up over %.3f mm after a reversal", 1e3 * length),
    { function(s, k) return sign(s.v[k]) * math.exp(-s.since[k] / length) end })
  if not build_up or one.train < build_up.train then build_up = one end
end
leftovers[#leftovers + 1] = build_up

-- ---- showing ------------------------------------------------------------------------------------------------------

local blue, red = "#0072b2", "#d55e00"

-- Means of the residual over a coordinate, apart by direction.
local function means(x, residual, v, bins)
  local low, high = math.huge, -math.huge
  for _, value in ipairs(x) do low, high = math.min(low, value), math.max(high, value) end
  local sums = { {}, {} }
  for k, value in ipairs(x) do
    local bin = math.min(bins, 1 + math.floor((value - low) / (high - low) * bins))
    local side = sums[v[k] > 0 and 1 or 2]
    side[bin] = side[bin] or { 0, 0 }
    side[bin][1], side[bin][2] = side[bin][1] + residual[k], side[bin][2] + 1
  end
  local at, forward, backward = {}, {}, {}
  for i = 1, bins do
    at[i] = low + (i - 0.5) * (high - low) / bins
    for side, list in ipairs { forward, backward } do
      local bin = sums[side][i]
      list[i] = bin and bin[2] >= 3 and bin[1] / bin[2] or 0 / 0
    end
  end
  return at, forward, backward
end

local function residual_panels(residual)
  local v, panels = column(train, terms.Fv), {}
  for _, axis in ipairs { { "q", 1e3, "Position [mm]" }, { "v", 1e3, "Velocity [mm/s]" }, { "t", 1, "Time [s]" } } do
    local x = column(train, function(s, k) return s[axis[1]][k] * axis[2] end)
    local at, forward, backward = means(x, residual, v, 60)
    panels[#panels + 1] = { x_label = axis[3], y_label = "Force [N]", series = {
      { name = "forward", x = at, y = forward, color = blue, style = "line_points" },
      { name = "backward", x = at, y = backward, color = red, style = "line_points" } } }
  end
  return panels
end

local function spectrum(residual, rate_hz)
  local n = #residual
  local frequency, amplitude = {}, {}
  for i = 1, math.floor(2 * n * 45 / rate_hz) do frequency[i] = 0.5 * i * rate_hz / n end
  for i, f in ipairs(frequency) do
    local re, im = 0, 0
    for k, value in ipairs(residual) do
      local window = 1 - math.cos(2 * math.pi * (k - 0.5) / n)
      local angle = 2 * math.pi * f / rate_hz * k
      re, im = re + window * value * math.cos(angle), im + window * value * math.sin(angle)
    end
    amplitude[i] = 2 * math.sqrt(re ^ 2 + im ^ 2) / n
  end
  return frequency, amplitude
end

local function excerpt(values, step)
  local list = {}
  for k = 1, math.min(#values, 8000), step do list[#list + 1] = values[k] end
  return list
end

local function loop_plot()
  local t, panels = excerpt(records.train.t, 4), {}
  for _, i in ipairs { 1, 4, 5 } do
    local error_of_it = loop_error((models[i].loop or models[i]).values, records.train)
    panels[#panels + 1] = { title = models[i].name, x_label = "Time [s]", y_label = "Measured - simulated [N]",
      y_range = { -45, 45 }, legend = "none",
      series = { { name = "force", x = t, y = excerpt(error_of_it, 4), color = i == 1 and red or blue, width = 1 } } }
  end
  return { file = "loop", title = "Force of the closed loop, measured less simulated", panels = panels }
end

local function spectra_plot()
  local frequency, amplitude = spectrum(last.residual, 1 / (10 * Ts))
  local mm = {}
  for i, pitch in ipairs(pitches) do mm[i] = 1e3 * pitch end
  return { file = "spectra", title = "What friction by direction leaves, over frequency and over position", panels = {
    { x_label = "Frequency [Hz]", y_label = "Amplitude [N]", x_log = true, legend = "none",
      series = { { name = "residual", x = frequency, y = amplitude, color = blue } } },
    { x_label = "Pitch of a ripple [mm]", y_label = "Share of the residual it takes [%]", x_log = true, legend = "none",
      series = { { name = "ripple", x = mm, y = taken, color = blue } } } } }
end

local function percent(ours, published) return published and 100 * (ours / published - 1) or 0 / 0 end

local estimates, errors_table, score_rows, leftover_rows, largest = {}, {}, {}, {}, 0
for _, model in ipairs(models) do
  for _, name in ipairs(model.terms) do
    local published = model.published[name]
    if published then largest = math.max(largest, math.abs(percent(model.values[name], published))) end
    estimates[#estimates + 1] = { model.name, name, published or 0 / 0, model.values[name], model.errors[name],
      percent(model.values[name], published), model.loop and model.loop.values[name] or 0 / 0,
      model.loop and model.loop.errors[name] or 0 / 0 }
  end
  for _, record in ipairs { "train", "pulses" } do
    local published = model.published[record]
    if published then largest = math.max(largest, math.abs(percent(model[record], published))) end
    errors_table[#errors_table + 1] = { model.name, record, published or 0 / 0, model[record],
      percent(model[record], published), model["loop_" .. record],
      model.loop and (record == "train" and model.loop.rms or model.loop.pulses) or 0 / 0 }
  end
  print(string.format("%-28s force %7.4f %% (pulses %7.4f %%), closed loop %6.3f N (%6.3f N)", model.name, model.train,
    model.pulses, model.loop_train, model.loop_pulses))
end
for _, score in ipairs(scores) do
  score_rows[#score_rows + 1] = { score[1], score[3], score.ours, percent(score.ours, score[3]) }
end
for _, one in ipairs(leftovers) do
  leftover_rows[#leftover_rows + 1] = { one.name, one.train, one.pulses, one.coefficient / one.error }
  print(string.format("left over, with %-36s %7.4f %% (pulses %7.4f %%)", one.name, one.train, one.pulses))
end
print(ripple_text)
local agreement = string.format("Inverse dynamics gives every published number within %.2f %%.", largest)
print(agreement)

local function diagnosis_text()
  if not diagnosis then return { "The diagnosis was not asked." } end
  local lines = { "Verdict: " .. diagnosis.verdict .. ". " .. diagnosis.where }
  for _, effect in ipairs(diagnosis.effects) do
    local parts = {}
    for key, value in pairs(effect.parameters) do
      if type(value) == "number" then parts[#parts + 1] = string.format("%s = %.5g", key, value) end
    end
    table.sort(parts)
    lines[#lines + 1] = string.format("%s, probability %.2f: %s. %s", effect.name, effect.probability,
      table.concat(parts, ", "), effect.evidence)
  end
  if diagnosis.nearest then lines[#lines + 1] = "Nearest: " .. diagnosis.nearest.name end
  for _, line in ipairs(lines) do print(line) end
  return lines
end

tb.report {
  file = "report.html",
  title = "EMPS, step by step",
  summary = agreement,
  sections = {
    { title = "Estimates", content = {
      { table = { caption = "By inverse dynamics, and by simulation of the closed loop", rows = estimates, columns = {
        { name = "model" }, { name = "number" }, { name = "published", decimals = 4 }, { name = "ours", decimals = 4 },
        { name = "standard error", decimals = 4 }, { name = "off", unit = "%", decimals = 3 },
        { name = "closed loop", decimals = 4 }, { name = "standard error", decimals = 4 } } } },
      { table = { caption = "What they leave", rows = errors_table, columns = {
        { name = "model" }, { name = "record" }, { name = "published", unit = "%", decimals = 4 },
        { name = "ours", unit = "%", decimals = 4 }, { name = "off", unit = "%", decimals = 3 },
        { name = "closed loop, force", unit = "N", decimals = 3 },
        { name = "fitted there", unit = "N", decimals = 3 } } } },
      { table = { caption = "Closed loop with Coulomb friction, offset and the published delay, errors in percent",
        rows = score_rows, columns = { { name = "signal" }, { name = "published", decimals = 4 },
          { name = "ours", decimals = 4 }, { name = "off", unit = "%", decimals = 2 } } } },
      { plot = loop_plot() } } },
    { title = "What the diagnosis says", content = { { list = diagnosis_text() } } },
    { title = "What is left", content = {
      "The residual of friction by direction on the first record, as means over position, velocity and time.",
      { plot = { file = "residual", title = "What friction by direction leaves",
        panels = residual_panels(last.residual) } },
      { plot = spectra_plot() },
      ripple_text,
      { table = { caption = "Terms put beside it, one at a time", rows = leftover_rows, columns = { { name = "term" },
        { name = "first record", unit = "%", decimals = 4 }, { name = "pulses", unit = "%", decimals = 4 },
        { name = "coefficient over its error", decimals = 1 } } } } } },
  },
}
tb.write_json { file = "emps.json", value = { models = models, scores = score_rows, leftovers = leftovers } }
