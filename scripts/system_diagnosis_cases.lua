-- How often a diagnosis of a system is right: random systems of seven kinds with a hidden term, with a hidden change of
-- the input's path, with none, or with a term that the library does not have. Records are simulated with noise; the
-- model that is diagnosed has parameters that are off by up to 20 %, and a share of the systems (-D disturbed) is moved
-- by a random force that the model does not have, by as much as the noise of the sensor. Counts right names, false
-- alarms, confident wrong names, how far the gap shrinks, how often answers of a probability are right, and how often
-- standard errors contain the true parameters. Where an answer asks for a record to decide, that is simulated, and the
-- diagnosis repeated with it.
--
-- A case counts only if what is hidden moves the output by six times the noise on the first record and three times on
-- the second one. Gaps are relative to what the true system leaves of the record: noise, and what the random force
-- does. A force that has no name is a polynomial, a product, a threshold or has memory; it is found if the formula
-- leaves at most twice as much.
--
--   tribode run scripts/system_diagnosis_cases.lua -D count=50 -D seed=1 -o results/system_cases
--
-- The budget is processor time, so that the answers do not depend on what else the computer does. Results: cases.json,
-- score.json, report.html, and what each diagnosis writes.

local tb = require "tribode"
local counting = require "lib.counting"
local share, told = counting.share, counting.told

local option = tb.options {
  count = { default = tb.quick and 5 or 50, help = "how many cases" },
  seed = { default = 1, help = "of all random numbers" },
  only = { default = "all", help = "all, unknown (forces of no name), named or none" },
  disturbed = { default = 0.5, help = "share of the systems with a random force" },
  kind = { default = "", help = "only systems of this kind, e.g. coupling" },
  budget = { default = tb.quick and 10 or 120, help = "seconds of processor time for each diagnosis" },
  first = { default = 1, help = "the first case, to go on after an interruption; cases do not depend on each other" },
  join = { default = "", help = "results of earlier runs, folder,folder: nothing is diagnosed, all are counted" },
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

-- ---- one case -----------------------------------------------------------------------------------------------------

-- A system with something hidden that shows on both records, and its inputs.
local function draw()
  local kind, hidden, true_parameters, nominal, u, truth, disturbed, size
  repeat
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
  return { kind = kind, hidden = hidden, truth = truth, true_parameters = true_parameters, nominal = nominal, u = u,
    disturbed = disturbed, force = size }
end

-- Draws and diagnoses case n. A gap is relative to what the true system leaves.
local function run(n)
  case, draws = n, 0
  local drawn = draw()
  local kind, truth = drawn.kind, drawn.truth
  local folder = string.format("case_%03d", n)
  local noise = record(kind, truth, folder .. "_ident.csv", -0.003, 10 * n, drawn.u[1], drawn.force)
  local _, left = record(kind, truth, folder .. "_valid.csv", noise, 10 * n + 1, drawn.u[2], drawn.force)
  local common = { system = system_of(kind, drawn.nominal), data = { folder .. "_ident.csv" },
    validate = { folder .. "_valid.csv" }, budget_s = option.budget, folder = folder }
  local result = tb.diagnose_system(common)
  local gap = result.gap.validate
  -- null where the model cannot be simulated there
  local before, after = gap.before or math.huge, gap.after or math.huge
  left = math.max(left, gap.floor)
  local effect = result.effects[1]
  local c = { case = n, kind = kind.name, accept = drawn.hidden and drawn.hidden[1] or { "none" },
    disturbed = drawn.disturbed, verdict = result.verdict, first = effect and effect.name or "none", effects = {},
    probability = effect and effect.probability or 0, before = before / left, after = after / left,
    over_noise = after / gap.floor, uncertainty = result.prediction_uncertainty and
      result.prediction_uncertainty / gap.floor or nil,
    seconds = result.seconds, out_of_time = result.out_of_time or false, deviations = {} }
  for i, other in ipairs(result.effects) do c.effects[i] = other.name end
  local predicts = c.after <= 2
  c.first_right = names_right(c.accept, { verdict = "", effects = result.effects })
  if not drawn.hidden then
    -- A random force is something missing; but it has no name.
    c.hides, c.right = "nothing", not effect and (drawn.disturbed or result.verdict == "nothing_missing")
  elseif drawn.hidden.force then
    -- A sum of terms that predicts is a formula, whatever its terms are called; or no answer.
    c.hides, c.right, c.first_right = "force", predicts or result.verdict ~= "effect_found", predicts
  else
    c.hides, c.right = "term", names_right(c.accept, result)
  end
  -- The model's own parameters, where it has become the true one.
  if c.hides ~= "force" and c.first ~= "term" and result.verdict ~= "undecided" and
    (c.first_right or c.hides == "nothing" and not effect) then
    for name, value in pairs(result.free) do
      if value.standard_error then
        c.deviations[#c.deviations + 1] = math.abs(value.value - drawn.true_parameters[name]) / value.standard_error
      end
    end
  end
  print(string.format("%3d %-10s %-30s %-16s %-24s %.2f  gap %.1f -> %.2f, %.0f s%s", n, kind.name,
    table.concat(c.accept, " or "), c.verdict, c.first, c.probability, c.before, c.after, c.seconds,
    c.right and "" or "  WRONG"))
  if type(result.next_experiment) == "string" then
    c.next = { record = result.next_experiment, decided = false }
    local asked = tb.read_record { file = folder .. "/next_experiment.csv", columns = { t = "t", u = "u" } }
    local ran, why = pcall(record, kind, truth, folder .. "_next.csv", noise, 10 * n + 2, asked.data.u, drawn.force)
    if ran then
      common.data, common.folder = { folder .. "_ident.csv", folder .. "_next.csv" }, folder .. "_again"
      common.budget_s = 2 * option.budget -- two records take longer
      local again = tb.diagnose_system(common)
      c.next.verdict, c.next.first = again.verdict, again.effects[1] and again.effects[1].name or "none"
      c.next.after = (again.gap.validate.after or math.huge) / left
      if c.hides == "force" then
        c.next.decided = again.verdict ~= "undecided" and c.next.after <= 2
      elseif c.hides == "term" then
        c.next.decided = again.verdict ~= "undecided" and names_right(c.accept, again)
      else
        c.next.decided = not again.effects[1]
      end
    else
      c.next.verdict = "cannot be made: " .. tostring(why) -- the true system may run away where the models do not
    end
    print(string.format("    asked for %s: %s %s%s", c.next.record, c.next.verdict, c.next.first or "",
      c.next.decided and "" or "  WRONG"))
  end
  return c
end

-- ---- what the cases say together ------------------------------------------------------------------------------------

local function summary_of(cases)
  local function hides(what) return function(c) return c.hides == what end end
  local function right(c) return c.right end
  local parameters = { of = 0, within_1 = 0, within_1_645 = 0, within_3 = 0 }
  local seconds = {}
  for i, c in ipairs(cases) do
    for _, off in ipairs(c.deviations) do
      parameters.of = parameters.of + 1
      for name, limit in pairs { within_1 = 1, within_1_645 = 1.645, within_3 = 3 } do
        parameters[name] = parameters[name] + (off < limit and 1 or 0)
      end
    end
    seconds[i] = c.seconds
  end
  table.sort(seconds)
  local reliability = {}
  local ends = { 0, 0.5, 0.8, 0.95, 1 }
  for i = 1, #ends - 1 do
    local bin = { from = ends[i], answers = 0, right = 0, mean_probability = 0 }
    for _, c in ipairs(cases) do
      if c.first ~= "none" and c.probability >= bin.from and c.probability < ends[i + 1] then
        bin.answers, bin.right = bin.answers + 1, bin.right + (c.first_right and 1 or 0)
        bin.mean_probability = bin.mean_probability + c.probability
      end
    end
    bin.mean_probability = bin.answers > 0 and bin.mean_probability / bin.answers or nil
    reliability[i] = bin
  end
  return {
    cases = #cases,
    named = share(cases, hides "term", right),
    left_alone = share(cases, hides "nothing", right),
    formulas = share(cases, hides "force", function(c) return c.after <= 2 end),
    gap = share(cases, hides "term", function(c) return c.after <= 1.5 end),
    confident_wrong = share(cases, function(c) return c.first ~= "none" and c.probability > 0.8 end,
      function(c) return not c.first_right end),
    undecided = share(cases, function() return true end, function(c) return c.verdict == "undecided" end),
    -- What asks for a record to decide a rest is an answer.
    decided = share(cases, function(c) return c.next and (c.verdict == "undecided" or c.verdict == "partial") end,
      function(c) return c.next.decided end),
    out_of_time = share(cases, function() return true end, function(c) return c.out_of_time end),
    parameters = parameters,
    seconds = { median = seconds[(#seconds + 1) // 2], below_20 = share(cases, function() return true end,
      function(c) return c.seconds < 20 end), longest = seconds[#seconds] },
    reliability = reliability,
  }
end

local function confusion_of(cases)
  local counts, rows, columns = {}, {}, {}
  for _, c in ipairs(cases) do
    local row = c.accept[1]
    if not counts[row] then counts[row], rows[#rows + 1] = {}, row end
    if not columns[c.first] then columns[c.first], columns[#columns + 1] = true, c.first end
    counts[row][c.first] = (counts[row][c.first] or 0) + 1
  end
  table.sort(rows)
  table.sort(columns)
  local heads, lines = { { name = "hidden" } }, {}
  for _, name in ipairs(columns) do heads[#heads + 1] = { name = name, decimals = 0 } end
  for i, name in ipairs(rows) do
    lines[i] = { name }
    for _, answered in ipairs(columns) do lines[i][#lines[i] + 1] = counts[name][answered] or "" end
  end
  return { columns = heads, rows = lines }
end

local function show(cases, s)
  local p = s.parameters
  local lines = {
    "first name right, or among the rivals of an undecided answer: " .. told(s.named),
    "nothing missing, or nothing that has a name, and so answered: " .. told(s.left_alone),
    "force without a name, predicted with at most twice what the true system leaves: " .. told(s.formulas),
    "gap at most 1.5 times that, where a term of the library was hidden: " .. told(s.gap),
    "wrong with a probability above 0.8: " .. told(s.confident_wrong),
    string.format("undecided: %s; right with the record that an answer asked for: %s", told(s.undecided),
      told(s.decided)),
    string.format("parameters of models that became the true ones: %d of %d within one standard error, %d within "
      .. "1.645, %d within 3", p.within_1, p.of, p.within_1_645, p.within_3),
    string.format("time: %.0f s in the median, %.0f s at most, below 20 s in %s; ended by the budget: %s",
      s.seconds.median, s.seconds.longest, told(s.seconds.below_20), told(s.out_of_time)),
  }
  for _, line in ipairs(lines) do print(line) end
  local rows, numbers, after, stated, came, reliable = {}, {}, {}, {}, {}, {}
  for i, c in ipairs(cases) do
    rows[i] = { c.case, c.kind, table.concat(c.accept, " or "), c.verdict, c.first, c.probability, c.before, c.after,
      c.seconds, c.right and "right" or "wrong" }
    numbers[i], after[i] = i, c.after
  end
  for i, bin in ipairs(s.reliability) do
    reliable[i] = { bin.from, bin.answers, bin.mean_probability or "",
      bin.answers > 0 and bin.right / bin.answers or "" }
    if bin.answers > 0 then
      stated[#stated + 1], came[#came + 1] = bin.mean_probability, bin.right / bin.answers
    end
  end
  tb.report {
    file = "report.html", title = "How often the diagnosis of a system is right",
    summary = string.format("%d cases: of hidden terms %s were named.", s.cases, told(s.named)),
    sections = {
      { title = "Figures", content = { { list = lines } } },
      { title = "How often answers of a probability are right", content = {
        { table = { columns = { { name = "probability from" }, { name = "answers", decimals = 0 },
          { name = "mean stated", decimals = 3 }, { name = "right", decimals = 3 } }, rows = reliable } },
        { plot = { file = "calibration", title = "Probabilities as stated and as they came out", height = 500,
          panels = { { x_label = "Probability stated, mean of a group of answers", y_label = "Share that was right",
            x_range = { 0, 1.02 }, y_range = { -0.02, 1.05 }, series = {
              { name = "as it should be", x = { 0, 1 }, y = { 0, 1 }, style = "dashed", color = "#000000" },
              { name = "answers", x = stated, y = came, style = "line_points", color = "#0072b2", width = 2 } } } } } },
      } },
      { title = "What was hidden and what was named first", content = { { table = confusion_of(cases) } } },
      { title = "All cases", content = {
        { plot = { file = "gaps", title = "Gap on the validation record", panels = { { x_label = "Case",
          y_label = "rms error, over what the true system leaves", y_log = true,
          series = { { name = "with what was found", x = numbers, y = after, style = "points" } } } } } },
        { table = { columns = { { name = "case", decimals = 0 }, { name = "kind" }, { name = "hidden" },
          { name = "verdict" }, { name = "first name" }, { name = "probability" }, { name = "gap before / left" },
          { name = "after / left" }, { name = "seconds" }, { name = "answer" } }, rows = rows } },
      } },
    },
  }
end

local function save(cases)
  tb.write_json { file = "cases.json", value = cases }
  local s = summary_of(cases)
  tb.write_json { file = "score.json", value = s }
  return s
end

local cases = {}
if option.join ~= "" then
  for folder in option.join:gmatch "[^,%s]+" do
    for _, c in ipairs(tb.read_json { file = folder .. "/cases.json" }) do cases[#cases + 1] = c end
  end
else
  for n = math.floor(option.first), math.floor(option.first + option.count) - 1 do
    cases[#cases + 1] = run(n)
    save(cases) -- so that an interruption keeps what is done
  end
end
show(cases, save(cases))
