-- How often a diagnosis of a system is right: random systems of seven kinds with a hidden term, with a hidden change of
-- the input's path, with none, or with a term that the library does not have. Records are simulated with noise; the
-- model that is diagnosed has parameters that are off by up to 20 %, and a share of the systems (-D disturbed) is moved
-- by a random force that the model does not have, by as much as the noise of the sensor. Counts right names, false
-- alarms, confident wrong names, how far the gap shrinks, how often answers of a probability are right, and how often
-- standard errors contain the true parameters. Where an answer is undecided the record that it asks for is simulated,
-- and the diagnosis repeated with it.
--
-- A case counts only if what is hidden moves the output by six times the noise on the first record and three times on
-- the second one. Gaps are relative to what the true system leaves of the record: noise, and what the random force
-- does. A force that has no name is a polynomial, a product, a threshold or has memory; it is found if the formula
-- leaves at most twice as much.
--
--   tribode run scripts/system_diagnosis_cases.lua -D count=50 -D seed=1 -o results/system_cases
--
-- The budget is processor time, so that the answers do not depend on what else the computer does. Results: cases.csv,
-- score.json, report.html, and what each diagnosis writes.

local tb = require "tribode"

local option = tb.options {
  count = { default = tb.quick and 5 or 50, help = "how many cases" },
  seed = { default = 1, help = "of all random numbers" },
  only = { default = "all", help = "all, unknown (forces of no name), named or none" },
  disturbed = { default = 0.5, help = "share of the systems with a random force" },
  kind = { default = "", help = "only systems of this kind, e.g. coupling" },
  budget = { default = 120, help = "seconds of processor time for each diagnosis" },
  first = { default = 1, help = "the first case, to go on after an interruption; cases do not depend on each other" },
}

local case, draws = 0, 0
local function random() -- between 0 and 1
  draws = draws + 1
  local z = tb.standard_normal(math.floor(option.seed), 1000000 + case, draws)
  return 0.5 * (1 + z / math.sqrt(1 + z * z))
end
local function between(low, high) return low + (high - low) * random() end
local function choice(list) return list[1 + math.floor(#list * 0.999999 * random())] end

local function root(x) return math.sqrt(math.max(x, 0)) end
local function drag(v) return v * math.abs(v) end

-- A kind: parameters, states, derivatives with what is hidden, hidden terms: { names that are right, the term }.
-- `h` is its size, a parameter of the truth alone.
local kinds = {
  {
    name = "vehicle", period = 0.05, parameters = { d = 0.4, g = 2 }, states = { x = 0, v = 0 },
    of = { "v", "u" }, sizes = { 1, 1 }, force = 0.8,
    output = "x",
    der = function(s, hidden) return { x = s.v, v = s.g * s.u - s.d * s.v - hidden } end,
    hidden = {
      { { "quadratic_drag" }, function(s) return s.h * 0.5 * drag(s.v) end },
      { { "spring_force" }, function(s) return s.h * s.x end },
      { { "coulomb_friction" }, function(s) return s.h * 0.4 * tb.tanh(s.v / 0.02) end },
      { { "force_ripple" }, function(s) return s.h * 0.8 * math.sin(5 * s.x) end },
      -- The same as an offset of the input.
      { { "constant_force", "offset" }, function(s) return s.h * 0.3 end },
    },
  },
  {
    name = "oscillator", period = 0.05, parameters = { w2 = 9, d = 0.5, g = 5 }, states = { x = 0, v = 0 },
    of = { "x", "v" }, sizes = { 1, 2 }, force = 1.5,
    output = "x",
    der = function(s, hidden) return { x = s.v, v = s.g * s.u - s.d * s.v - s.w2 * s.x - hidden } end,
    hidden = {
      { { "cubic_stiffness" }, function(s) return s.h * 2 * s.x ^ 3 end },
      { { "coulomb_friction" }, function(s) return s.h * 0.5 * tb.tanh(s.v / 0.02) end },
      { { "square" }, function(s) return s.h * 1.5 * s.x * s.x end },
    },
  },
  {
    -- Two masses; the load is measured. Hidden is a part of the coupling, or friction of the motor.
    name = "coupling", period = 0.02, parameters = { k = 60, c = 0.6, i = 8, m = 0.7 },
    states = { x1 = 0, v1 = 0, x2 = 0, v2 = 0 }, of = { "v1", "u" }, sizes = { 2, 1 }, force = 2, output = "x2",
    der = function(s, hidden, change)
      local bend = s.x1 - s.x2
      local torque = s.k * (change and change(bend, s) or bend) + s.c * (s.v1 - s.v2)
      return { x1 = s.v1, v1 = s.i * s.u - torque - 0.8 * s.v1 - 2 * s.x1 - hidden, x2 = s.v2, v2 = s.m * torque }
    end,
    hidden = {
      { { "backlash" }, change = function(bend, s)
        return bend - math.min(math.max(bend, -0.02 * s.h), 0.02 * s.h)
      end },
      { { "cubic_stiffness", "cubic" }, change = function(bend, s) return bend + s.h * 150 * bend ^ 3 end },
      { { "coulomb_friction" }, function(s) return s.h * 1.2 * tb.tanh(s.v1 / 0.05) end },
    },
  },
  {
    -- A position loop; the error may be limited before it drives.
    name = "loop", period = 0.02, parameters = { k = 60, d = 8 }, states = { q = 0, v = 0 },
    of = { "q", "v" }, sizes = { 1, 4 }, force = 8, output = "q",
    der = function(s, hidden, change)
      local e = s.u - s.q
      return { q = s.v, v = s.k * (change and change(e, s) or e) - s.d * s.v - hidden }
    end,
    hidden = {
      { { "saturation" }, change = function(e, s) return math.min(math.max(e, -0.4 * s.h), 0.4 * s.h) end },
      { { "dead_zone" }, change = function(e, s) return e - math.min(math.max(e, -0.1 * s.h), 0.1 * s.h) end },
      { { "coulomb_friction" }, function(s) return s.h * 3 * tb.tanh(s.v / 0.03) end },
      { { "gravity", "force_ripple" }, function(s) return s.h * 10 * math.sin(s.q) end },
    },
  },
  {
    name = "tanks", period = 2, parameters = { a = 0.05, b = 0.06, e = 0.05 }, states = { h1 = 4, h2 = 4 },
    of = { "h1", "h2" }, sizes = { 6, 6 }, force = 0.05,
    output = "h2",
    der = function(s, hidden)
      return { h1 = s.b * (s.u + 2) - s.a * root(s.h1) - hidden, h2 = s.a * root(s.h1) - s.e * root(s.h2) }
    end,
    hidden = {
      { { "overflow", "overflow_into", "threshold" }, function(s) return s.h * 0.2 * math.max(s.h1 - 7, 0) end },
      { { "linear", "constant" }, function(s) return s.h * 0.01 * s.h1 end },
    },
  },
  {
    name = "circuit", period = 0.02, parameters = { r = 2, q = 1.5 }, states = { a = 0, b = 0 }, output = "b",
    of = { "a", "b" }, sizes = { 0.8, 0.6 }, force = 0.8,
    der = function(s, hidden) return { a = s.r * (s.u - s.a) - hidden, b = s.q * (s.a - s.b) } end,
    hidden = {
      { { "cubic" }, function(s) return s.h * 1.5 * s.a ^ 3 end },
      -- Of a state in its own rate the library calls it an overflow.
      { { "threshold", "overflow" }, function(s) return s.h * 4 * math.max(s.a - 0.4, 0) end },
      { { "quadratic" }, function(s) return s.h * 1.5 * drag(s.a) end },
    },
  },
  {
    name = "heater", period = 1, parameters = { c = 0.05, p = 0.3 }, states = { T = 0 }, output = "T",
    of = { "T", "u" }, sizes = { 10, 1.5 }, force = 0.2,
    der = function(s, hidden) return { T = s.p * (s.u + 1.5) - s.c * s.T - hidden } end,
    hidden = {
      { { "quadratic", "square", "cubic" }, function(s) return s.h * 0.01 * drag(s.T) end },
      { { "periodic_in_time" }, function(s) return s.h * 0.1 * math.sin(0.3 * s.t) end },
      { { "constant", "offset" }, function(s) return s.h * 0.1 end },
    },
  },
}

-- A force of two variables that has no name, of a size that suits them.
local function nameless()
  local a, b, c = between(-1, 1), between(-1, 1), between(-1, 1)
  local level = between(-0.3, 0.5)
  return choice {
    function(_, x, y) return a * x * x * y + b * x * y * y + c * x * y end,
    function(_, x, y) return (1 + a) * x * math.abs(y) + b * x * x * x end,
    function(_, x, y) return (1 + a) * math.max(x - level, 0) * y end,
    function(_, x, y) return (1 + a) * math.max(x - level, 0) * x + b * x * y end,
    function(_, x, y) return (1 + a) * x * tb.tanh(4 * y) end,
    function(s) return (1 + a) * s.z end, -- memory
  }
end

-- Of the input's path: names that are right, and what becomes of the input.
local paths = {
  { { "dead_zone" }, path = function(s)
    return s.u - math.min(math.max(s.u, -0.4 * s.h), 0.4 * s.h)
  end },
  { { "saturation" }, path = function(s) return math.min(math.max(s.u, -0.9 * s.h), 0.9 * s.h) end },
  { { "delay" }, path = function(s, kind) return tb.delay(s.u, 4 * kind.period * s.h) end },
}

-- What is hidden is a path of the input, a named term, or `force` without a name.
local function system_of(kind, parameters, hidden, disturbed)
  local states = kind.states
  if hidden and hidden.force then
    states = { z = 0 } -- follows the first variable with a lag of ten samples
    for name, start in pairs(kind.states) do states[name] = start end
  end
  local inputs = { u = 0 }
  if disturbed then inputs.n = 0 end
  return tb.system {
    name = kind.name, parameters = parameters, inputs = inputs, states = states,
    der = function(s)
      local force = disturbed and -s.n or 0
      if not hidden then return kind.der(s, force) end
      if hidden.change then return kind.der(s, force, hidden.change) end
      if hidden.force then
        local x, y = s[kind.of[1]] / kind.sizes[1], s[kind.of[2]] / kind.sizes[2]
        local rates = kind.der(s, force + s.h * kind.force * hidden.force(s, x, y))
        rates.z = (x - s.z) / (10 * kind.period)
        return rates
      end
      if not hidden.path then return kind.der(s, force + hidden[2](s)) end
      local u = hidden.path(s, kind)
      return kind.der(setmetatable({}, { __index = function(_, name) return name == "u" and u or s[name] end }), force)
    end,
  }
end

local samples = 400
local function inputs_at_random(kind)
  local u, tones = {}, {}
  for i = 1, 4 do
    tones[i] = { between(0.2, 1), between(0.05, 1.2) / (20 * kind.period), between(0, 2 * math.pi) }
  end
  for k = 1, samples do
    u[k] = 0
    for _, tone in ipairs(tones) do
      u[k] = u[k] + tone[1] * math.sin(2 * math.pi * tone[2] * (k - 1) * kind.period + tone[3])
    end
  end
  return u
end

local function simulated(kind, system, u, n)
  local run = tb.run_system { system = system, duration_s = (#u - 1) * kind.period, output_step_s = kind.period,
    inputs = { u = { sample_time_s = kind.period, values = u },
      n = n and { sample_time_s = kind.period, values = n } } }
  return run.ok and run.values[kind.output] or nil, run
end

local function rms_between(a, b)
  local sum = 0
  for k = 1, #a do sum = sum + (a[k] - b[k]) ^ 2 end
  return math.sqrt(sum / #a)
end

-- Whether the output differs from that of the system without the hidden part by so much of its range, rms, and does
-- not run away.
local function is_visible(kind, truth, without, u, least)
  local y, other = simulated(kind, truth, u), simulated(kind, without, u)
  if not y or not other then return false end
  local low, high = math.huge, -math.huge
  for k = 1, #y do low, high = math.min(low, y[k]), math.max(high, y[k]) end
  return high - low < 1e3 and rms_between(y, other) > least * (high - low)
end

-- A random force with a correlation of twenty samples.
local function random_force(stream, size)
  local n, now = {}, 0
  for k = 1, samples do
    now = 0.95 * now + 0.312 * tb.standard_normal(math.floor(option.seed), 500000 + stream, k)
    n[k] = size * now
  end
  return n
end

-- The size at which the force moves the first record by as much as the noise; nil where the system runs away with it.
local function size_of_force(kind, truth, u)
  local plain = simulated(kind, truth, u[1])
  local low, high = math.huge, -math.huge
  for k = 1, #plain do low, high = math.min(low, plain[k]), math.max(high, plain[k]) end
  local small = 1e-3 * kind.force
  local moved = rms_between(plain, simulated(kind, truth, u[1], random_force(10 * case, small)))
  local size = small * 0.003 * (high - low) / moved
  for i = 1, 2 do
    if not simulated(kind, truth, u[i], random_force(10 * case + i - 1, size)) then return nil end
  end
  return size
end

-- noise: of the output, negative relative to its range. size: of the random force, 0: none. Returns the noise, and what
-- the true system without the random force leaves of the record, rms.
local function record(kind, system, file, noise, stream, u, size)
  local y, run = simulated(kind, system, u, size > 0 and random_force(stream, size) or nil)
  if not y then error(run.message, 0) end
  if noise < 0 then
    local low, high = math.huge, -math.huge
    for k = 1, #u do low, high = math.min(low, y[k]), math.max(high, y[k]) end
    noise = -noise * (high - low)
  end
  for k = 1, #u do y[k] = y[k] + noise * tb.standard_normal(math.floor(option.seed), stream, k) end
  tb.write_csv { file = file, columns = { { name = "t", unit = "s", values = run.t }, { name = "u", values = u },
    { name = kind.output, values = y } } }
  return noise, rms_between(y, (simulated(kind, system, u)))
end

local function names_right(accept, result)
  local first = result.effects[1]
  for _, name in ipairs(accept) do
    if first and first.name == name then return true end
    for _, same in ipairs(first and first.same_as or {}) do
      if same:match "^%S+" == name then return true end
    end
    for _, rival in ipairs(first and result.verdict == "undecided" and first.rivals or {}) do
      if rival.name:match "^%S+" == name then return true end
    end
  end
  return false
end

local rows, score = {}, { cases = 0, named = 0, first_right = 0, none = 0, none_right = 0, unknown = 0,
  unknown_right = 0, unknown_modeled = 0, confident = 0, confident_wrong = 0, gap_within = 0, undecided = 0, asked = 0,
  decided = 0, out_of_time = 0, seconds = 0, parameters = 0, within_1 = 0, within_1_645 = 0, within_3 = 0 }
local bins = {}
for i, low in ipairs { 0, 0.5, 0.8, 0.95 } do
  bins[i] = { low = low, answers = 0, probability = 0, right = 0 }
end
local confusion, truths, answers = {}, {}, {}
for n = math.floor(option.first), math.floor(option.first + option.count) - 1 do
  case, draws = n, 0
  local kind, hidden, true_parameters, nominal, u, truth, disturbed, size
  repeat -- until what is hidden shows
    kind = choice(kinds)
    for _, one in ipairs(kinds) do
      if one.name == option.kind then kind = one end
    end
    disturbed = random() < option.disturbed
    local fate = random()
    if option.only == "unknown" then fate = 0.9 end
    if option.only == "none" then fate = 0 end
    if option.only == "named" then fate = 0.3 + 0.5 * fate end
    if fate > 0.8 then
      hidden = { { "unknown" }, force = nameless() }
    elseif fate > 0.65 then
      hidden = choice(paths)
    elseif fate > 0.3 then
      hidden = choice(kind.hidden)
    else
      hidden = nil
    end
    true_parameters, nominal = {}, {}
    local names = {}
    for name in pairs(kind.parameters) do names[#names + 1] = name end
    table.sort(names)
    for _, name in ipairs(names) do
      true_parameters[name] = kind.parameters[name] * between(0.8, 1.25)
      nominal[name] = true_parameters[name] * between(0.83, 1.2)
    end
    true_parameters.h = between(0.5, 1.5)
    u = { inputs_at_random(kind), inputs_at_random(kind) }
    truth = system_of(kind, true_parameters, hidden, disturbed)
    local without = system_of(kind, true_parameters)
    size = 0
    local shows = not hidden or (is_visible(kind, truth, without, u[1], 6 * 0.003) and
      is_visible(kind, truth, without, u[2], 3 * 0.003))
    if shows and disturbed then size = size_of_force(kind, truth, u) end
  until shows and size
  local folder = string.format("case_%03d", n)
  local noise = record(kind, truth, folder .. "_ident.csv", -0.003, 10 * n, u[1], size)
  local _, left = record(kind, truth, folder .. "_valid.csv", noise, 10 * n + 1, u[2], size)
  local common = { system = system_of(kind, nominal), data = { folder .. "_ident.csv" },
    validate = { folder .. "_valid.csv" }, budget_s = option.budget, folder = folder }
  local result = tb.diagnose_system(common)
  local effect = result.effects[1]
  local first, probability = effect and effect.name or "none", effect and effect.probability or 0
  local accept = hidden and hidden[1] or { "none" }
  local answer
  local gap = result.gap.validate
  left = math.max(left, gap.floor)
  score.cases = score.cases + 1
  score.seconds = score.seconds + result.seconds
  score.out_of_time = score.out_of_time + (result.out_of_time and 1 or 0)
  if not hidden then
    -- A random force is something missing; but it has no name.
    answer = not effect and (disturbed or result.verdict == "nothing_missing")
    score.none, score.none_right = score.none + 1, score.none_right + (answer and 1 or 0)
  elseif accept[1] == "unknown" then
    -- A sum of terms that predicts is a formula, whatever its terms are called; or no answer.
    local predicts = gap.after <= 2 * left
    answer = predicts or result.verdict ~= "effect_found"
    score.unknown, score.unknown_right = score.unknown + 1, score.unknown_right + (answer and 1 or 0)
    score.unknown_modeled = score.unknown_modeled + (predicts and 1 or 0)
  else
    answer = names_right(accept, result)
    score.named, score.first_right = score.named + 1, score.first_right + (answer and 1 or 0)
    score.gap_within = score.gap_within + (gap.after <= 1.5 * left and 1 or 0)
  end
  if effect then
    local right = accept[1] == "unknown" and gap.after <= 2 * left or
      names_right(accept, { verdict = "", effects = result.effects })
    for i = #bins, 1, -1 do
      if probability >= bins[i].low then
        bins[i].answers, bins[i].probability = bins[i].answers + 1, bins[i].probability + probability
        bins[i].right = bins[i].right + (right and 1 or 0)
        break
      end
    end
    if probability > 0.8 then
      score.confident = score.confident + 1
      score.confident_wrong = score.confident_wrong + (right and 0 or 1)
    end
  end
  -- The model's own parameters, where it has become the true one.
  if accept[1] ~= "unknown" and first ~= "term" and result.verdict ~= "undecided" and
    names_right(accept, { verdict = "", effects = effect and result.effects or { { name = "none" } } }) then
    for name, value in pairs(result.free) do
      local off = math.abs(value.value - true_parameters[name]) / value.standard_error
      score.parameters = score.parameters + 1
      score.within_1 = score.within_1 + (off < 1 and 1 or 0)
      score.within_1_645 = score.within_1_645 + (off < 1.645 and 1 or 0)
      score.within_3 = score.within_3 + (off < 3 and 1 or 0)
    end
  end
  if result.verdict == "undecided" then
    score.undecided = score.undecided + 1
    if type(result.next_experiment) == "string" and #result.next_experiment > 0 then
      score.asked = score.asked + 1
      local next_record = tb.read_record { file = folder .. "/next_experiment.csv", columns = { t = "t", u = "u" } }
      local ran, why = pcall(record, kind, truth, folder .. "_next.csv", noise, 10 * n + 2, next_record.data.u, size)
      local outcome = "cannot be made: " .. tostring(why) -- the true system may run away where the models do not
      if ran then
        common.data, common.folder = { folder .. "_ident.csv", folder .. "_next.csv" }, folder .. "_again"
        local again = tb.diagnose_system(common)
        local decided = again.verdict ~= "undecided" and (names_right(accept, again) or
          accept[1] == "unknown" and again.gap.validate.after <= 2 * left)
        score.decided = score.decided + (decided and 1 or 0)
        outcome = again.verdict .. " " .. (again.effects[1] and again.effects[1].name or "none")
      end
      print(string.format("    asked for %s: %s", result.next_experiment, outcome))
    end
  end
  local row = accept[1]
  if not confusion[row] then confusion[row], truths[#truths + 1] = {}, row end
  if not answers[first] then answers[first], answers[#answers + 1] = true, first end
  confusion[row][first] = (confusion[row][first] or 0) + 1
  rows[#rows + 1] = { n, kind.name, table.concat(accept, " or "), result.verdict, first, probability,
    gap.before / left, gap.after / left, result.seconds, answer and 1 or 0 }
  row = rows[#rows]
  print(string.format("%3d %-10s %-30s %-16s %-24s %.2f  gap %.1f -> %.2f, %.0f s%s", n, kind.name, row[3],
    result.verdict, first, probability, row[7], row[8], result.seconds, answer and "" or "  WRONG"))
end
score.reliability = {}
for i, bin in ipairs(bins) do
  score.reliability[i] = { from = bin.low, answers = bin.answers, right = bin.right,
    mean_probability = bin.answers > 0 and bin.probability / bin.answers or 0 }
end
score.confusion = confusion
tb.write_json { file = "score.json", value = score }
local columns = { { name = "case", decimals = 0 }, { name = "kind" }, { name = "hidden" }, { name = "verdict" },
  { name = "first name" }, { name = "probability" }, { name = "gap before / noise" }, { name = "after / noise" },
  { name = "seconds" }, { name = "right", decimals = 0 } }
local numbers, after = {}, {}
for n, row in ipairs(rows) do numbers[n], after[n] = row[1], row[8] end
table.sort(truths)
table.sort(answers)
local confusion_columns, confusion_rows = { { name = "hidden" } }, {}
for _, name in ipairs(answers) do
  confusion_columns[#confusion_columns + 1] = { name = name, decimals = 0 }
end
for i, name in ipairs(truths) do
  confusion_rows[i] = { name }
  for _, answered in ipairs(answers) do
    confusion_rows[i][#confusion_rows[i] + 1] = confusion[name][answered] or ""
  end
end
local reliable = {}
for i, bin in ipairs(score.reliability) do
  reliable[i] = { bin.from, bin.answers, bin.mean_probability, bin.answers > 0 and bin.right / bin.answers or "" }
end
tb.report {
  file = "report.html", title = "How often the diagnosis of a system is right",
  summary = string.format("Of %d hidden terms %d were named, of %d models that lacked nothing %d were left alone, of "
    .. "%d forces without a name %d are predicted by a formula; %d of %d confident names were wrong. Where the model "
    .. "became the true one, %d of %d parameters were within one standard error, %d within 1.645, %d within 3.",
    score.named, score.first_right, score.none, score.none_right, score.unknown, score.unknown_modeled,
    score.confident_wrong, score.confident, score.within_1, score.parameters, score.within_1_645, score.within_3),
  sections = { { title = "All cases", content = {
    { plot = { panels = { { x_label = "Case", y_label = "Gap after / noise", y_log = true,
      series = { { name = "all", x = numbers, y = after, style = "points" } } } } } },
    { table = { columns = columns, rows = rows } },
  } }, { title = "What was hidden and what was named first", content = {
    { table = { columns = confusion_columns, rows = confusion_rows } },
  } }, { title = "How often answers of a probability are right", content = {
    { table = { columns = { { name = "probability from" }, { name = "answers", decimals = 0 },
      { name = "mean probability" }, { name = "share right" } }, rows = reliable } },
  } } },
}
