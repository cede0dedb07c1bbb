-- How good is tb.diagnose? Runs it on a folder of cases whose answer is known, and counts. A case is a folder
-- NNN with nominal.json (the machine as its user believes it to be), ident.csv.gz and valid.csv.gz (records of the real
-- one; more to fit in ident_2.csv.gz and so on) and truth.json (what it has besides, and in `accept` the names that
-- physics cannot tell from it).
--
--   tribode run scripts/diagnosis_cases.lua -o results/cases -D count=60 -D seed=7
--   tribode run scripts/diagnosis_score.lua -o results/score -D cases=results/cases/cases
--   tribode run scripts/diagnosis_score.lua -o results/half -D cases=/data/practice -D every=2 -D first=2
--   tribode run scripts/diagnosis_score.lua -o results/all -D join=results/score,results/half
--
-- Cases run beside one another, each on one thread (-j: how many). An interrupted score goes on with the cases that are
-- missing. Without -D cases a few are made first. Where an answer asks for a record to decide, that record is
-- simulated, and the diagnosis repeated with it. Results: cases.csv, score.json, report.html, the plots confusion,
-- calibration, gaps, seconds, and below batch/cases all that each diagnosis has written.

local tb = require "tribode"
local counting = require "lib.counting"
local share, told = counting.share, counting.told

local option = tb.options {
  cases = { default = "", help = "folder of cases; without it some are made" },
  every = { default = 1, help = "every second case: 2" },
  first = { default = 1, help = "place of the first one in the folder" },
  most = { default = 100000, help = "at most so many" },
  only = { default = "", help = "names of cases, e.g. 003,017" },
  max_effects = { default = 3, help = "as for tb.diagnose" },
  join = { default = "",
    help = "results of earlier scores, folder,folder: nothing is diagnosed, all their cases are counted" },
}

local folder = option.cases
if folder == "" and option.join == "" then
  local made = tb.run {
    script = "scripts/diagnosis_cases.lua",
    folder = "own",
    options = { count = tb.quick and 2 or 36, seed = 2, effects = tb.quick and "none,encoder_quantization" or "" },
  }
  folder = made.folder .. "/cases"
end

local function selected()
  if option.first < 1 or option.every < 1 then error("-D first, -D every: must be 1 and more", 0) end
  local names, wanted, points = {}, {}, {}
  for name in option.only:gmatch "[^,%s]+" do wanted[name] = true end
  for _, name in ipairs(tb.list_folder { folder = folder }) do
    if pcall(tb.read_json, { file = folder .. "/" .. name .. "/truth.json" }) then names[#names + 1] = name end
  end
  if #names == 0 then error(folder .. ": holds no case (a folder with a truth.json)", 0) end
  for i = option.first, #names, option.every do
    if not next(wanted) or wanted[names[i]] then points[#points + 1] = { case = names[i] } end
    if #points == option.most then break end
  end
  if #points == 0 then error(folder .. ": none of its " .. #names .. " cases is selected", 0) end
  return points
end

local function diagnosis_of(name) return "batch/cases/" .. name end
local function again_of(name) return "batch/again/" .. name end

-- The record that a diagnosis asks for, of the true machine; nil where none is asked for, or the truth is no machine
-- with effects of the library.
local function record_asked_for(name, machine, file)
  local truth = tb.read_json { file = folder .. "/" .. name .. "/truth.json" }
  local asked, next_record = pcall(tb.read_record, { file = diagnosis_of(name) .. "/next_experiment.csv" })
  if not asked then return end
  if machine.tolerance and not truth.machine then return end
  local input = next_record.data
  local real = truth.machine or tb.read_json { file = folder .. "/" .. name .. "/nominal.json" } -- to be changed
  real.effects = real.effects or {}
  for _, effect in ipairs(truth.effects) do
    if effect.name == "unknown" then return end
    if effect.name ~= "none" then
      real.effects[#real.effects + 1] = { name = effect.name, parameters = effect.params }
    end
  end
  local made = tb.simulate { machine = real, r = input.r, exc = input.exc, u = input.u, seed = 1 }
  if not made.ok then return end
  local columns = { { name = "t", unit = "s", values = made.t }, { name = "u", unit = "N", values = made.u },
    { name = "y", unit = "m", values = made.y } }
  if input.r then columns[4] = { name = "r", unit = "m", values = made.r } end
  tb.write_csv { file = file, columns = columns }
  return file
end

local function run(point)
  local case, data = folder .. "/" .. point.case, {}
  for _, file in ipairs(tb.list_folder { folder = case }) do
    if file:find "^ident.*%.csv%.gz$" then data[#data + 1] = case .. "/" .. file end
  end
  local records = #data
  local machine = tb.read_json { file = case .. "/nominal.json" }
  local function diagnosed(result)
    return tb.diagnose { machine = machine, data = data, validate = case .. "/valid.csv.gz",
      max_effects = option.max_effects, folder = result }
  end
  local found = diagnosed(diagnosis_of(point.case))
  data[#data + 1] = record_asked_for(point.case, machine, again_of(point.case) .. "_record.csv")
  if #data > records then diagnosed(again_of(point.case)) end
  return { effects = #found.effects, gap_before_m = found.gap.validate.before, gap_after_m = found.gap.validate.after }
end

-- ---- parameters ---------------------------------------------------------------------------------------------------

-- An amplitude below zero is one above it, half a turn on. Of a ramp only a/T shows: a is given for a ramp of one
-- second.
local function canonical(parameters, ramp_s)
  local copy = {}
  for key, value in pairs(parameters) do copy[key] = value end
  for amplitude, phase in pairs { a = "phase", F = "phase", A = "phase", A2 = "phase2" } do
    if type(copy[amplitude]) == "number" and copy[amplitude] < 0 and copy[phase] then
      copy[amplitude], copy[phase] = -copy[amplitude], copy[phase] + math.pi
    end
  end
  if ramp_s then copy.a, copy.T = copy.a and copy.a / ramp_s, nil end
  return copy
end

-- Deviations in standard errors, one for each number. What was not fitted must be exact, or it counts as infinite.
local function deviations(truth, found, errors, list)
  local function ramp(parameters) return parameters.kind == "ramp" and parameters.T or nil end
  errors = canonical(errors or {}, ramp(found))
  truth, found = canonical(truth, ramp(truth)), canonical(found, ramp(found))
  for key, value in pairs(truth) do
    local answer, spread = found[key], errors[key]
    if type(value) == "number" and type(answer) == "number" then
      local d = answer - value
      if key == "phase" or key == "phase2" then d = (d + math.pi) % (2 * math.pi) - math.pi end
      if type(spread) == "number" and spread > 0 then
        list[#list + 1] = math.abs(d) / spread
      elseif math.abs(d) <= 1e-6 * math.abs(value) then
        if value ~= 0 then list[#list + 1] = 0 end
      else
        list[#list + 1] = math.huge
      end
    elseif type(value) == "string" and value ~= answer then
      list[#list + 1] = math.huge
    elseif key == "harmonics" and type(answer) == "table" then -- elements are a curve and are not compared
      for _, harmonic in ipairs(value) do
        local nearest, at
        for i, other in ipairs(answer) do
          local d = math.abs(other.period_m / harmonic.period_m - 1)
          if not nearest or d < nearest then nearest, at = d, i end
        end
        deviations(harmonic, answer[at] or {}, (spread or {})[at], list)
      end
    end
  end
  return list
end

-- ---- one case -----------------------------------------------------------------------------------------------------

local function contains(list, wanted)
  for _, value in ipairs(list) do
    if value == wanted then return true end
  end
  return false
end

-- case: its folder; diagnosis: what was written for it.
local function judge(name, case, diagnosis, failure)
  local truth = tb.read_json { file = case .. "/truth.json" }
  local c = { case = name, truth = {}, accept = truth.accept, named = {}, rivals = {}, deviations = {} }
  for i, effect in ipairs(truth.effects) do c.truth[i] = effect.name end
  -- Whether the description is wrong besides: friction of another structure, fields off, forces that are noise.
  local nominal = tb.read_json { file = case .. "/nominal.json" }
  c.model_error = truth.model_error ~= nil or nominal.tolerance ~= nil or (nominal.process_noise_rms_N or 0) > 0
  c.known = c.truth[1] ~= "none" and c.truth[1] ~= "unknown"
  if failure then
    c.verdict, c.probability, c.right, c.failure = "refused", 0, false, failure
    c.answer = c.verdict
    return c
  end
  local d = tb.read_json { file = diagnosis .. "/diagnosis.json" }
  c.verdict, c.seconds = d.verdict, d.seconds
  local gap = d.gap.validate
  c.before, c.after = gap.before / gap.floor, gap.after / gap.floor
  for i, effect in ipairs(d.effects) do
    c.named[i] = effect.name
    if i == 1 then
      for _, rival in ipairs(effect.rivals) do c.rivals[#c.rivals + 1] = rival.name end
    end
  end
  -- Friction of another structure is missing, too: who names it beside the hidden effect is right. So the first name is
  -- the first that is not of that.
  local besides = {}
  for _, effect in ipairs(truth.machine and truth.machine.effects or {}) do
    if not contains(truth.accept or {}, effect.name) then besides[#besides + 1] = effect.name end
  end
  local function first_of(effects)
    for _, effect in ipairs(effects) do
      if not contains(besides, effect.name) then return effect end
    end
    return effects[1]
  end
  local first = first_of(d.effects)
  c.probability = first and first.probability or 0
  c.answer = first and first.name or d.verdict == "nothing_missing" and "none" or "unknown"
  if c.known then
    c.right = contains(c.accept, c.answer)
    if d.verdict == "undecided" then
      for _, rival in ipairs(c.rivals) do c.right = c.right or contains(c.accept, rival) end
    end
  elseif c.truth[1] == "none" then
    c.right = d.verdict == "nothing_missing"
  else
    c.right = d.verdict == "unknown_effect" or d.verdict == "undecided"
      or first ~= nil and contains(c.accept, first.name)
  end
  c.wrong_and_sure = not contains(c.accept, c.answer) and not contains(besides, c.answer) and first ~= nil
    and c.probability > 0.8 and not c.right
  local folder_again = diagnosis:gsub("batch/cases", "batch/again")
  local repeated, again = pcall(tb.read_json, { file = folder_again .. "/diagnosis.json" })
  if repeated then
    local named = first_of(again.effects)
    c.decided = again.verdict ~= "undecided"
      and (c.known and named ~= nil and contains(c.accept, named.name) or not c.known and named == nil)
    c.asked = { verdict = again.verdict, answer = named and named.name or "nothing" }
  end
  if #c.truth == 2 then
    c.both = true
    for _, effect in ipairs(truth.effects) do
      c.both = c.both and (contains(c.named, effect.name) or contains(c.named, effect.alike))
    end
  end
  for _, effect in ipairs(truth.effects) do
    for _, found in ipairs(d.effects) do
      if found.name == effect.name then
        deviations(effect.params, found.parameters, found.standard_errors, c.deviations)
      end
    end
  end
  -- Its row in the confusion matrix: of two effects the one that was named first.
  c.row = contains(c.truth, c.answer) and c.answer or c.truth[1]
  return c
end

-- ---- all cases ----------------------------------------------------------------------------------------------------

local function summary_of(cases)
  local function named(c) return c.known and #c.named > 0 end
  local numbers, within, largest, covered = 0, 0, {}, { 0, 0 }
  local seconds = {}
  for _, c in ipairs(cases) do
    for _, z in ipairs(c.deviations) do
      numbers = numbers + 1
      if z <= 3 then within = within + 1 end
      if z <= 1 then covered[1] = covered[1] + 1 end
      if z <= 1.645 then covered[2] = covered[2] + 1 end
      if not largest[c] or z > largest[c] then largest[c] = z end
    end
    seconds[#seconds + 1] = c.seconds
  end
  table.sort(seconds)
  return {
    cases = #cases,
    right = share(cases, function(c) return c.known end, function(c) return c.right end),
    nothing_missing = share(cases, function(c) return c.truth[1] == "none" end, function(c) return c.right end),
    unknown = share(cases, function(c) return c.truth[1] == "unknown" end, function(c) return c.right end),
    confident_wrong = share(cases, function() return true end, function(c) return c.wrong_and_sure end),
    -- All kinds of answers, by whether the model is wrong besides.
    exact_models = share(cases, function(c) return not c.model_error end, function(c) return c.right end),
    wrong_models = share(cases, function(c) return c.model_error end, function(c) return c.right end),
    both = share(cases, function(c) return #c.truth == 2 end, function(c) return c.both end),
    undecided = share(cases, function() return true end, function(c) return c.verdict == "undecided" end),
    -- What asks for a record to decide what is missing besides is an answer.
    decided = share(cases, function(c) return c.asked and c.verdict ~= "effect_found" end,
      function(c) return c.decided end),
    gap = share(cases, named, function(c) return c.after <= 1.5 end),
    parameters = { count = within, of = numbers, share = numbers > 0 and within / numbers or nil },
    -- Of normal errors 0.68 lie within one standard error and 0.90 within 1.645.
    coverage = { of = numbers, one = numbers > 0 and covered[1] / numbers or nil,
      ninety = numbers > 0 and covered[2] / numbers or nil },
    all_parameters = share(cases, function(c) return largest[c] end, function(c) return largest[c] <= 3 end),
    seconds = { median = seconds[(#seconds + 1) // 2], longest = seconds[#seconds],
      below_60 = share(cases, function(c) return c.seconds end, function(c) return c.seconds < 60 end) },
  }
end

local ends = { 0, 0.5, 0.8, 0.9, 0.97, 1.0001 }

local function calibration_of(cases)
  local bins = {}
  for i = 1, #ends - 1 do
    local sum, n, right = 0, 0, 0
    for _, c in ipairs(cases) do
      if #c.named > 0 and c.probability >= ends[i] and c.probability < ends[i + 1] then
        sum, n = sum + c.probability, n + 1
        if contains(c.accept, c.answer) then right = right + 1 end
      end
    end
    bins[i] = { from = ends[i], to = math.min(1, ends[i + 1]), answers = n }
    if n > 0 then bins[i].stated, bins[i].right = sum / n, right / n end
  end
  return bins
end

-- ---- showing ------------------------------------------------------------------------------------------------------

local function table_text(cases)
  local lines = { "case,truth,verdict,named,probability,rivals,right,before_over_floor,after_over_floor,"
    .. "numbers,within_3_standard_errors,seconds" }
  for _, c in ipairs(cases) do
    local within = 0
    for _, z in ipairs(c.deviations) do within = within + (z <= 3 and 1 or 0) end
    local function number(value) return value and string.format("%.6g", value) or "" end
    lines[#lines + 1] = table.concat({ c.case, table.concat(c.truth, "+"), c.verdict, table.concat(c.named, "+"),
      number(c.probability), table.concat(c.rivals, "+"), c.right and 1 or 0, number(c.before), number(c.after),
      #c.deviations, within, number(c.seconds) }, ",")
  end
  return table.concat(lines, "\n") .. "\n"
end

local places = { 0, 0.18, -0.18, 0.36, -0.36 } -- of dots in a cell
local blue, red, black = "#0072b2", "#d55e00", "#000000"

-- One dot for each case, side by side in its cell: the right ones lie on the diagonal or are accepted beside it.
local function confusion_plot(cases)
  local names = { "none", "unknown" }
  for _, kind in ipairs(tb.effects {}) do
    if kind.name ~= "own_force" then table.insert(names, #names - 1, kind.name) end
  end
  names[#names + 1] = "refused"
  local place, labels = {}, {}
  for i, name in ipairs(names) do place[name], labels[i] = i, string.format("%s %d", name, i) end
  local cells, right, wrong = {}, { x = {}, y = {} }, { x = {}, y = {} }
  for _, c in ipairs(cases) do
    local row, column = place[c.row or c.truth[1]], place[c.answer]
    local key = row * 1000 + column
    local k = cells[key] or 0
    cells[key] = k + 1
    local dots = c.right and right or wrong
    dots.x[#dots.x + 1], dots.y[#dots.y + 1] = column + places[k % 5 + 1], row + places[k // 5 % 5 + 1]
  end
  return {
    file = "confusion", title = "What was hidden and what was answered first, a dot for each case", height = 900,
    panels = { {
      x_label = "Answer, by the number of its name", y_label = "", y_names = labels,
      x_range = { 0, #names + 1 }, y_range = { 0, #names + 1 },
      series = {
        { name = "", x = { 0, #names + 1 }, y = { 0, #names + 1 }, color = "#bbbbbb", width = 1 },
        { name = "right", x = right.x, y = right.y, style = "points", color = blue, width = 2 },
        { name = "wrong", x = wrong.x, y = wrong.y, style = "points", color = red, width = 2 },
      },
    } },
  }
end

local function calibration_plot(bins)
  local x, y = {}, {}
  for _, bin in ipairs(bins) do
    if bin.stated then x[#x + 1], y[#y + 1] = bin.stated, bin.right end
  end
  return {
    file = "calibration", title = "Probabilities as stated and as they came out", height = 500,
    panels = { {
      x_label = "Probability stated, mean of a group of answers", y_label = "Share that was right",
      x_range = { 0, 1.02 }, y_range = { -0.02, 1.05 },
      series = {
        { name = "as it should be", x = { 0, 1 }, y = { 0, 1 }, style = "dashed", color = black },
        { name = "answers", x = x, y = y, style = "line_points", color = blue, width = 2 },
      },
    } },
  }
end

-- Values in ascending order over the share of the cases below them.
local function ascending(file, title, label, lists, limit)
  local series, low, high = {}, math.huge, 0
  for i, list in ipairs(lists) do
    table.sort(list.values)
    local x, y = {}, {}
    for k, value in ipairs(list.values) do
      x[k], y[k] = value, 100 * (k - 0.5) / #list.values
      low, high = math.min(low, value), math.max(high, value)
    end
    series[i] = { name = list.name, x = x, y = y, style = "line_points", color = list.color }
  end
  series[#series + 1] = { name = limit.name, x = { limit.at, limit.at }, y = { 0, 100 }, style = "dashed",
    color = black }
  low, high = math.min(low, limit.at) / 1.5, math.max(high, limit.at) * 1.5
  return { file = file, title = title, height = 500, panels = { { x_label = label, y_label = "Cases [%]", x_log = true,
    x_range = { low, high }, y_range = { 0, 100 }, series = series } } }
end

local function show(cases, summary, bins)
  local before, after, seconds = {}, {}, {}
  for _, c in ipairs(cases) do
    if c.known and #c.named > 0 then
      before[#before + 1], after[#after + 1] = c.before, c.after
    end
    seconds[#seconds + 1] = c.seconds
  end
  local lines = {
    "first name right, or among the rivals of an undecided answer: " .. told(summary.right),
    "nothing missing, and said so: " .. told(summary.nothing_missing),
    "none of the known effects, and not named with one: " .. told(summary.unknown),
    "wrong name with a probability above 0.8: " .. told(summary.confident_wrong),
    "right answers where the model is exact: " .. told(summary.exact_models) .. "; where it is wrong besides: "
      .. told(summary.wrong_models),
    "both of two effects named: " .. told(summary.both),
    "undecided: " .. told(summary.undecided) .. "; right with the record that an answer asked for: "
      .. told(summary.decided),
    "gap at most 1.5 times the floor on the validation record, where an effect was named: " .. told(summary.gap),
    "parameters within three standard errors: " .. told(summary.parameters) .. "; all those of a case: "
      .. told(summary.all_parameters),
    summary.coverage.of == 0 and "standard errors: none to count" or string.format(
      "of %d parameters %.0f %% within one standard error (of normal errors 68), %.0f %% within 1.645 (90)",
      summary.coverage.of, 100 * summary.coverage.one, 100 * summary.coverage.ninety),
    string.format("time on one thread: %.0f s in the median, %.0f s at most; below a minute: %s",
      summary.seconds.median or 0 / 0, summary.seconds.longest or 0 / 0, told(summary.seconds.below_60)),
  }
  for _, line in ipairs(lines) do print(line) end
  local rows, stated = {}, {}
  for _, c in ipairs(cases) do
    rows[#rows + 1] = { c.case, table.concat(c.truth, " + "), c.right and "right" or "wrong",
      #c.named > 0 and table.concat(c.named, " + ") or c.verdict, c.probability,
      #c.rivals > 0 and table.concat(c.rivals, ", ") or "-", c.before or 0 / 0, c.after or 0 / 0, c.seconds or 0 / 0 }
    if c.asked then
      print(string.format("%s: %s, %s, with the record that it asked for %s (%s)", c.case,
        table.concat(c.truth, " + "), c.verdict, c.asked.answer, c.asked.verdict))
    end
    if not c.right then
      print(string.format("%s: %s, answered %s (%s) %.2f%s", c.case, table.concat(c.truth, " + "),
        #c.named > 0 and table.concat(c.named, " + ") or "nothing", c.verdict, c.probability,
        c.failure and ", " .. c.failure or ""))
    end
  end
  for _, bin in ipairs(bins) do
    stated[#stated + 1] = { string.format("%.2f to %.2f", bin.from, bin.to), bin.answers, bin.stated or 0 / 0,
      bin.right or 0 / 0 }
  end
  tb.report {
    file = "report.html",
    title = "How good the diagnosis is",
    summary = string.format("%d cases: the first name is right in %s.", summary.cases, told(summary.right)),
    sections = {
      { title = "Figures", content = { { list = lines },
        { table = { caption = "Answers with a name, by the probability stated", rows = stated, columns = {
          { name = "probability" }, { name = "answers", decimals = 0 }, { name = "mean stated", decimals = 3 },
          { name = "right", decimals = 3 } } } } } },
      { title = "Plots", content = {
        { plot = confusion_plot(cases) }, { plot = calibration_plot(bins) },
        { plot = ascending("gaps", "Gap on the validation record, where an effect was named",
          "rms of measured less simulated position, over that of noise alone",
          { { name = "before", values = before, color = red }, { name = "after", values = after, color = blue } },
          { name = "1.5", at = 1.5 }) },
        { plot = ascending("seconds", "Time of a diagnosis on one thread", "Time [s]",
          { { name = "cases", values = seconds, color = blue } }, { name = "one minute", at = 60 }) } } },
      { title = "Cases", content = { { table = { rows = rows, columns = {
        { name = "case" }, { name = "hidden" }, { name = "first name" }, { name = "answer" },
        { name = "probability", decimals = 2 }, { name = "rivals" }, { name = "gap before / floor" },
        { name = "after / floor" }, { name = "time", unit = "s", decimals = 1 } } } } } },
    },
  }
end

local function conclude(cases)
  local summary, bins = summary_of(cases), calibration_of(cases)
  summary.calibration, summary.folder = bins, folder
  tb.write_text { file = "cases.csv", text = table_text(cases) }
  tb.write_json { file = "score.json", value = summary }
  show(cases, summary, bins)
end

if option.join ~= "" then
  local cases = {}
  for scored in option.join:gmatch "[^,%s]+" do
    local made = tb.read_json { file = scored .. "/score.json" }.folder
    for _, name in ipairs(tb.list_folder { folder = scored .. "/batch/cases" }) do
      cases[#cases + 1] = judge(scored:match "[^/]+$" .. "/" .. name, made .. "/" .. name,
        scored .. "/batch/cases/" .. name)
    end
  end
  conclude(cases)
  return
end

tb.batch {
  name = "diagnosis score",
  points = selected(),
  run = run,
  finish = function(merged)
    local points, failures, cases = selected(), {}, {}
    for _, failure in ipairs(merged.failures) do failures[failure.index] = failure.reason end
    for i, point in ipairs(points) do
      cases[i] = judge(point.case, folder .. "/" .. point.case, diagnosis_of(point.case), failures[i])
    end
    conclude(cases)
  end,
}
