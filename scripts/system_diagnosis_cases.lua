-- How often a diagnosis of a system is right: random systems of five kinds with a hidden term, with none, or with one
-- that no term of the library is. Records are simulated with noise; the model that is diagnosed has parameters that are
-- off by up to 20 %. Counts right names, false alarms, confident wrong names, and how far the gap shrinks.
--
--   tribode run scripts/system_diagnosis_cases.lua -D count=50 -D seed=1 -o results/system_cases
--
-- Results: cases.csv, score.json, report.html.

local tb = require "tribode"

local option = tb.options {
  count = { default = tb.quick and 5 or 50, help = "how many cases" },
  seed = { default = 1, help = "of all random numbers" },
  budget = { default = 120, help = "seconds for each diagnosis" },
}

local draws = 0
local function random() -- even between 0 and 1
  draws = draws + 1
  local z = tb.standard_normal(math.floor(option.seed), 1, draws)
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
    output = "x",
    der = function(s, hidden) return { x = s.v, v = s.g * s.u - s.d * s.v - hidden } end,
    hidden = {
      { { "quadratic_drag" }, function(s) return s.h * 0.5 * drag(s.v) end },
      { { "spring_force" }, function(s) return s.h * s.x end },
      { { "coulomb_friction" }, function(s) return s.h * 0.4 * tb.tanh(s.v / 0.02) end },
      { { "force_ripple" }, function(s) return s.h * 0.8 * math.sin(5 * s.x) end },
      { { "constant_force" }, function(s) return s.h * 0.3 end },
      { { "unknown" }, function(s) return s.h * math.sin(3 * s.v) * math.cos(2 * s.x) end },
    },
  },
  {
    name = "oscillator", period = 0.05, parameters = { w2 = 9, d = 0.5, g = 5 }, states = { x = 0, v = 0 },
    output = "x",
    der = function(s, hidden) return { x = s.v, v = s.g * s.u - s.d * s.v - s.w2 * s.x - hidden } end,
    hidden = {
      { { "cubic_stiffness" }, function(s) return s.h * 2 * s.x ^ 3 end },
      { { "coulomb_friction" }, function(s) return s.h * 0.5 * tb.tanh(s.v / 0.02) end },
      { { "square" }, function(s) return s.h * 1.5 * s.x * s.x end },
      { { "unknown" }, function(s) return s.h * 2 * s.x * tb.tanh(4 * s.v) end },
    },
  },
  {
    name = "tanks", period = 2, parameters = { a = 0.05, b = 0.06, e = 0.05 }, states = { h1 = 4, h2 = 4 },
    output = "h2",
    der = function(s, hidden)
      return { h1 = s.b * (s.u + 2) - s.a * root(s.h1) - hidden, h2 = s.a * root(s.h1) - s.e * root(s.h2) }
    end,
    hidden = {
      { { "overflow", "overflow_into", "threshold" }, function(s) return s.h * 0.2 * math.max(s.h1 - 7, 0) end },
      { { "linear", "constant" }, function(s) return s.h * 0.01 * s.h1 end },
      { { "unknown" }, function(s) return s.h * 0.03 * math.sin(3 * s.h1) * math.sin(2 * s.h2) end },
    },
  },
  {
    name = "circuit", period = 0.02, parameters = { r = 2, q = 1.5 }, states = { a = 0, b = 0 }, output = "b",
    der = function(s, hidden) return { a = s.r * (s.u - s.a) - hidden, b = s.q * (s.a - s.b) } end,
    hidden = {
      { { "cubic" }, function(s) return s.h * 1.5 * s.a ^ 3 end },
      { { "threshold" }, function(s) return s.h * 4 * math.max(s.a - 0.4, 0) end },
      { { "quadratic" }, function(s) return s.h * 1.5 * drag(s.a) end },
    },
  },
  {
    name = "heater", period = 1, parameters = { c = 0.05, p = 0.3 }, states = { T = 0 }, output = "T",
    der = function(s, hidden) return { T = s.p * (s.u + 1.5) - s.c * s.T - hidden } end,
    hidden = {
      { { "quadratic", "square", "cubic" }, function(s) return s.h * 0.01 * drag(s.T) end },
      { { "periodic_in_time" }, function(s) return s.h * 0.1 * math.sin(0.3 * s.t) end },
      { { "constant" }, function(s) return s.h * 0.1 end },
    },
  },
}

local function system_of(kind, parameters, term)
  return tb.system {
    name = kind.name, parameters = parameters, inputs = { u = 0 }, states = kind.states,
    der = function(s) return kind.der(s, term and term(s) or 0) end,
  }
end

local samples = 400
local function record(kind, system, file, noise, stream)
  local u, tones = {}, {}
  for i = 1, 4 do tones[i] = { between(0.2, 1), between(0.05, 1.2) / (10 * kind.period), between(0, 2 * math.pi) } end
  for k = 1, samples do
    local t = (k - 1) * kind.period
    u[k] = 0
    for _, tone in ipairs(tones) do u[k] = u[k] + tone[1] * math.sin(2 * math.pi * tone[2] / 2 * t + tone[3]) end
  end
  local run = tb.run_system { system = system, duration_s = (samples - 1) * kind.period, output_step_s = kind.period,
    inputs = { u = { sample_time_s = kind.period, values = u } } }
  if not run.ok then error(run.message, 0) end
  local y = run.values[kind.output]
  if noise < 0 then -- relative
    local low, high = math.huge, -math.huge
    for k = 1, samples do low, high = math.min(low, y[k]), math.max(high, y[k]) end
    noise = -noise * (high - low)
  end
  for k = 1, samples do y[k] = y[k] + noise * tb.standard_normal(math.floor(option.seed), stream, k) end
  tb.write_csv { file = file, columns = { { name = "t", unit = "s", values = run.t }, { name = "u", values = u },
    { name = kind.output, values = y } } }
  return noise
end

local rows, score = {}, { cases = 0, named = 0, first_right = 0, none = 0, none_right = 0, unknown = 0,
  unknown_right = 0, confident = 0, confident_wrong = 0, gap_within = 0, seconds = 0 }
for n = 1, math.floor(option.count) do
  local kind = choice(kinds)
  local fate = random()
  local hidden = fate > 0.3 and choice(kind.hidden) or nil
  local true_parameters, nominal = {}, {}
  local names = {}
  for name in pairs(kind.parameters) do names[#names + 1] = name end
  table.sort(names)
  for _, name in ipairs(names) do
    true_parameters[name] = kind.parameters[name] * between(0.8, 1.25)
    nominal[name] = true_parameters[name] * between(0.83, 1.2)
  end
  true_parameters.h = between(0.5, 1.5)
  local truth = system_of(kind, true_parameters, hidden and hidden[2])
  local folder = string.format("case_%03d", n)
  local noise = record(kind, truth, folder .. "_ident.csv", -0.003, 10 * n)
  record(kind, truth, folder .. "_valid.csv", noise, 10 * n + 1)
  local result = tb.diagnose_system { system = system_of(kind, nominal), data = { folder .. "_ident.csv" },
    validate = { folder .. "_valid.csv" }, budget_s = option.budget, folder = folder }
  local first = result.effects[1] and result.effects[1].name or "none"
  local probability = result.effects[1] and result.effects[1].probability or 0
  local accept, answer = hidden and hidden[1] or { "none" }, false
  for _, name in ipairs(accept) do answer = answer or name == first end
  for _, rival in ipairs(result.effects[1] and result.verdict == "undecided" and result.effects[1].rivals or {}) do
    for _, name in ipairs(accept) do answer = answer or rival.name:match "^%S+" == name end
  end
  local gap = result.gap.validate
  score.cases = score.cases + 1
  score.seconds = score.seconds + result.seconds
  if not hidden then
    answer = result.verdict == "nothing_missing"
    score.none, score.none_right = score.none + 1, score.none_right + (answer and 1 or 0)
  elseif accept[1] == "unknown" then
    answer = result.verdict ~= "effect_found" or gap.after < 1.5 * gap.floor
    score.unknown, score.unknown_right = score.unknown + 1, score.unknown_right + (answer and 1 or 0)
  else
    score.named, score.first_right = score.named + 1, score.first_right + (answer and 1 or 0)
    score.gap_within = score.gap_within + (gap.after <= 1.5 * gap.floor and 1 or 0)
  end
  if probability > 0.8 and result.verdict == "effect_found" then
    score.confident = score.confident + 1
    score.confident_wrong = score.confident_wrong + (answer and 0 or 1)
  end
  rows[n] = { n, kind.name, table.concat(accept, " or "), result.verdict, first, probability, gap.before / gap.floor,
    gap.after / gap.floor, result.seconds, answer and 1 or 0 }
  print(string.format("%3d %-10s %-30s %-16s %-24s %.2f  gap %.1f -> %.2f floors, %.0f s%s", n, kind.name, rows[n][3],
    result.verdict, first, probability, rows[n][7], rows[n][8], result.seconds, answer and "" or "  WRONG"))
end

tb.write_json { file = "score.json", value = score }
local columns = { { name = "case", decimals = 0 }, { name = "kind" }, { name = "hidden" }, { name = "verdict" },
  { name = "first name" }, { name = "probability" }, { name = "gap before / noise" }, { name = "after / noise" },
  { name = "seconds" }, { name = "right", decimals = 0 } }
local numbers, after = {}, {}
for n, row in ipairs(rows) do numbers[n], after[n] = n, row[8] end
tb.report {
  file = "report.html", title = "How often the diagnosis of a system is right",
  summary = string.format("Of %d hidden terms %d were named, of %d models that lacked nothing %d were left alone; %d "
    .. "of %d confident names were wrong.", score.named, score.first_right, score.none, score.none_right,
    score.confident_wrong, score.confident),
  sections = { { title = "All cases", content = {
    { plot = { panels = { { x_label = "Case", y_label = "Gap after / noise", y_log = true,
      series = { { name = "all", x = numbers, y = after, style = "points" } } } } } },
    { table = { columns = columns, rows = rows } },
  } } },
}
