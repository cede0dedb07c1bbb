-- The Silverbox [Wigren 2013], a real circuit that behaves as a mass on a hardening spring: from a linear oscillator to
-- the cubic spring and to a quadratic one beside it, fitted by simulation to the first part of the multisine and judged
-- on its last quarter and on the arrow, a noise that grows beyond what the fit has seen. The diagnosis is asked what
-- the linear oscillator lacks.
--
--   tribode run scripts/silverbox.lua -D data=/data/silverbox -o results/silverbox
--
-- The data are not part of Tribode: the folder must hold silverbox.csv with the columns t_s, u_V, y_V. Here volts
-- stand for newtons and meters. Results: silverbox.json, report.html, the plots arrow, restoring, and below diagnosis
-- what the diagnosis writes.

local tb = require "tribode"
local simulation_fit = require "lib.simulation_fit"

local option = tb.options {
  data = { default = "", help = "folder of the measured record" },
  fitted = { default = tb.quick and 2000 or 12000, help = "samples of the multisine that are fitted" },
  diagnose = { default = not tb.quick, help = "whether the diagnosis is asked too; it takes minutes" },
}
if option.data == "" then
  error("-D data= is missing: the folder of the Silverbox benchmark, silverbox.csv with the columns t_s, u_V, y_V; the "
    .. "measurements are those of T. Wigren, J. Schoukens: Three free data sets for development and benchmarking in "
    .. "nonlinear system identification, European Control Conference 2013", 0)
end

local Ts = 2 ^ 14 / 1e7
local record = tb.read_record { file = option.data .. "/silverbox.csv",
  columns = { t = "t_s", u = "u_V", y = "y_V" } }.data

-- A part of the record, from 0-based samples as the benchmark counts them, of which the first 50 are not scored. The
-- run begins 100 samples earlier, so that its start has died away, and goes on 100 beyond for a band-limited input.
local around, unscored = 100, 50
local function part(first, last)
  local function samples(values) return table.move(values, first + 1 - around, last + around, 1, {}) end
  return { u = samples(record.u), y = samples(record.y) }
end
local parts = {
  train = part(40750, 40750 + option.fitted),
  test = part(105712, 127400),
  arrow = part(100, 40575),
  inside = part(100, 32100), -- the arrow without what lies beyond the multisine
}

-- Springs beside the linear one, and a constant force: y'' = g (u + offset - ...) - 2 zeta w y' - w^2 y.
local function machine_of(v)
  local effects = { { name = "constant_force", parameters = { F = v.offset } } }
  if v.cubic then effects[2] = { name = "cubic_stiffness", parameters = { k3 = v.cubic } } end
  if v.quadratic then
    effects[3] = { name = "own_force", parameters = { force = "return -k2 * y * y", constants = { k2 = v.quadratic } } }
  end
  return {
    Ts = Ts,
    modes = { { gain = v.gain, freq_hz = v.frequency, zeta = v.damping } },
    closed_loop = false,
    input = "band_limited",
    initial = "fitted",
    effects = effects,
  }
end

local function simulate(values, signals)
  return tb.simulate { machine = machine_of(values), u = signals.u, y = signals.y, relative_tolerance = 1e-6,
    absolute_tolerance_m = 1e-8 }
end

local function left(values, signals)
  local y = simulate(values, signals).y
  local list = {}
  for k = around + unscored + 1, #y - around do list[#list + 1] = signals.y[k] - y[k] end
  return list
end

local function rms(list)
  local sum = 0
  for _, value in ipairs(list) do sum = sum + value ^ 2 end
  return math.sqrt(sum / #list)
end

-- A start from differences: the equation of motion, term by term.
local function start_of(signals)
  local function rate(values) return tb.derivative { values = values, sample_time_s = Ts } end
  local v = rate(signals.y)
  local a, one = rate(v), {}
  for k = 1, #v do one[k] = 1 end
  local fit = tb.least_squares { columns = { signals.u, v, signals.y, one }, values = a }
  local gain, damping, stiffness, force = table.unpack(fit.coefficients)
  local w = math.sqrt(-stiffness)
  return { gain = gain, frequency = w / (2 * math.pi), damping = -damping / (2 * w), offset = force / gain }
end

-- By the data's README: multisine test and arrow [mV].
local models = {
  { name = "linear", reached = { 6.96, 14.41 }, terms = { "gain", "frequency", "damping", "offset" } },
  { name = "cubic", reached = { 0.349, 0.451 }, terms = { "gain", "frequency", "damping", "offset", "cubic" } },
  { name = "cubic and quadratic", reached = { 0.302, 0.388 },
    terms = { "gain", "frequency", "damping", "offset", "cubic", "quadratic" } },
}
local start = start_of(parts.train)
for i, model in ipairs(models) do
  -- The spring that begins with a tenth of the linear one's stiffness at 0.1 V.
  if i == 2 then start.cubic = (2 * math.pi * start.frequency) ^ 2 / start.gain * 0.1 / 0.1 ^ 2 end
  if i == 3 then start.quadratic = 1e-3 end
  model.fit = simulation_fit(start, model.terms, function(v) return left(v, parts.train) end)
  local values = model.fit.values
  start = {}
  for name, value in pairs(values) do start[name] = value end
  model.errors, model.left = {}, {}
  for name, signals in pairs(parts) do
    model.left[name] = left(values, signals)
    model.errors[name] = 1e3 * rms(model.left[name])
  end
  print(string.format("%-20s multisine test %7.3f mV (%.3f), arrow %7.3f mV (%.3f), of it inside %7.3f mV", model.name,
    model.errors.test, model.reached[1], model.errors.arrow, model.reached[2], model.errors.inside))
end

-- ---- what the diagnosis says --------------------------------------------------------------------------------------

-- It is given the linear oscillator, known to a few percent, and two realizations of the multisine: before and after
-- them the input rests, so that the start is known and a band-limited input has no edge.
local diagnosis
if option.diagnose then
  local function piece(name, first)
    local t, u, y = {}, {}, {}
    for k = 1, 8680 do t[k], u[k], y[k] = (k - 1) * Ts, record.u[first + k], record.y[first + k] end
    tb.write_csv { file = name, columns = { { name = "t", unit = "s", values = t },
      { name = "u", unit = "N", values = u }, { name = "y", unit = "m", values = y } } }
    return name
  end
  local machine = machine_of(models[1].fit.values)
  machine.noise_rms_m = 3e-4
  machine.tolerance = { ["modes.gain"] = 0.05, ["modes.freq_hz"] = 0.05, ["modes.zeta"] = 0.2 }
  diagnosis = tb.diagnose { machine = machine, data = { piece("fitted.csv", 40550) },
    validate = piece("kept_out.csv", 110080), max_effects = 1 }
end

-- ---- showing ------------------------------------------------------------------------------------------------------

local colors = { "#d55e00", "#0072b2", "#009e73" }

-- What is left over time: the largest in each hundred samples.
local function envelope(list)
  local t, mv = {}, {}
  for k = 1, #list - 99, 100 do
    local largest = 0
    for i = k, k + 99 do largest = math.max(largest, math.abs(list[i])) end
    t[#t + 1], mv[#mv + 1] = (k + 49) * Ts, 1e3 * largest
  end
  return t, mv
end

local function arrow_plot()
  local series = {}
  for i, model in ipairs(models) do
    local t, mv = envelope(model.left.arrow)
    series[i] = { name = model.name, x = t, y = mv, color = colors[i] }
  end
  local edge = 32000 * Ts
  series[#series + 1] = { name = "beyond the multisine", x = { edge, edge }, y = { 0.1, 300 }, style = "dashed",
    color = "#000000" }
  return { file = "arrow", title = "Arrow: largest error in each hundred samples", panels = { { x_label = "Time [s]",
    y_label = "Measured - simulated [mV]", y_log = true, y_range = { 0.1, 300 }, series = series } } }
end

local function restoring_plot()
  local series = {}
  for i, model in ipairs(models) do
    local v, x, force = model.fit.values, {}, {}
    local linear = (2 * math.pi * v.frequency) ^ 2 / v.gain
    for k, y in ipairs(tb.linspace(-0.25, 0.25, 201)) do
      x[k], force[k] = y, linear * y + (v.cubic or 0) * y ^ 3 + (v.quadratic or 0) * y ^ 2 - v.offset
    end
    series[i] = { name = model.name, x = x, y = force, color = colors[i], width = i == 3 and 1 or 2.2 }
  end
  return { file = "restoring", title = "The spring as found", height = 500, panels = { { x_label = "Output [V]",
    y_label = "Restoring force [V]", legend = "bottom right", series = series } } }
end

local score_rows, number_rows = {}, {}
for _, model in ipairs(models) do
  score_rows[#score_rows + 1] = { model.name, model.errors.test, model.reached[1], model.errors.arrow, model.reached[2],
    model.errors.inside }
  for _, name in ipairs(model.terms) do
    number_rows[#number_rows + 1] = { model.name, name, model.fit.values[name], model.fit.errors[name] }
  end
end
local said = { "The diagnosis was not asked." }
if diagnosis then
  said = { "Verdict: " .. diagnosis.verdict .. ". " .. diagnosis.where }
  for _, effect in ipairs(diagnosis.effects) do
    said[#said + 1] = string.format("%s, probability %.2f. %s", effect.name, effect.probability, effect.evidence)
  end
  if diagnosis.nearest then said[#said + 1] = "Nearest: " .. diagnosis.nearest.name end
end
for _, line in ipairs(said) do print(line) end
tb.report {
  file = "report.html",
  title = "Silverbox, step by step",
  summary = string.format("With a cubic spring %.3f mV are left on the arrow.", models[2].errors.arrow),
  sections = {
    { title = "Scores", content = {
      { table = { caption = "Root mean square of measured less simulated output; what the README of the data reached",
        rows = score_rows, columns = { { name = "model" }, { name = "multisine test", unit = "mV", decimals = 3 },
          { name = "README", unit = "mV", decimals = 3 }, { name = "arrow", unit = "mV", decimals = 3 },
          { name = "README", unit = "mV", decimals = 3 }, { name = "arrow, inside", unit = "mV", decimals = 3 } } } },
      { plot = arrow_plot() }, { plot = restoring_plot() } } },
    { title = "Numbers", content = { { table = { rows = number_rows, columns = { { name = "model" },
      { name = "number" }, { name = "value" }, { name = "standard error" } } } } } },
    { title = "What the diagnosis says", content = { { list = said } } },
  },
}
local kept = {}
for i, model in ipairs(models) do
  kept[i] = { name = model.name, values = model.fit.values, standard_errors = model.fit.errors, rms_mV = model.errors }
end
tb.write_json { file = "silverbox.json", value = kept }
