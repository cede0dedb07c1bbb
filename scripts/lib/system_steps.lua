-- Models of a measured system one after another: each is fitted to the records and simulated on others, beside
-- published figures; then the diagnosis is asked what the first one lacks.

local tb = require "tribode"

local steps = {}

-- Those of each script. data: the measured records, their files and where they come from, for a missing folder.
function steps.options(data)
  local option = tb.options {
    data = { default = "", help = "folder of the measured records" },
    budget = { default = 300, help = "seconds for the diagnosis" },
  }
  if option.data == "" then error("-D data= is missing: the folder of " .. data, 0) end
  return option
end

-- common: options of tb.diagnose_system. models: a list of { name =, system =, published = { ident, validate } }.
-- Returns rows of name, gap on the fitted and on the validation records, and the published ones.
function steps.fit(common, models)
  local rows = {}
  for i, model in ipairs(models) do
    local options = { system = model.system, max_effects = 0, folder = "step_" .. i }
    for key, value in pairs(common) do options[key] = value end
    options.budget_s = nil -- of the diagnosis; a fit is to come to its end
    local result = tb.diagnose_system(options)
    if result.out_of_time then print("the fit did not come to its end:") end
    local published = model.published or {}
    local gap = result.gap
    rows[i] = { model.name, gap.ident.before, published[1] or "", gap.validate.before, published[2] or "" }
    print(string.format("%-50s fitted %.4g (%s)  validation %.4g (%s)", model.name, rows[i][2], tostring(rows[i][3]),
      rows[i][4], tostring(rows[i][5])))
  end
  return rows
end

-- What the first model lacks, in a few lines.
function steps.diagnose(common, system)
  local options = { system = system, folder = "diagnosis" }
  for key, value in pairs(common) do options[key] = value end
  local result = tb.diagnose_system(options)
  print(result.verdict)
  for _, effect in ipairs(result.effects) do
    print(string.format("  %s in %s, probability %.2f: %s", effect.name, effect.equation, effect.probability,
      effect.expression))
  end
  print(string.format("  validation %.4g before, %.4g after, %.0f s", result.gap.validate.before,
    result.gap.validate.after, result.seconds))
  return result
end

-- The gap of each model on the validation records beside the published one, and, in the top row, what the diagnosis
-- makes of the first model.
local function plot_of(title, unit, rows, result)
  local names = {}
  local own, published = { x = {}, y = {} }, { x = {}, y = {} }
  for i, row in ipairs(rows) do
    names[i], own.x[i], own.y[i] = row[1], row[4], i
    if row[5] ~= "" then published.x[#published.x + 1], published.y[#published.y + 1] = row[5], i + 0.15 end
  end
  names[#rows + 1] = "diagnosis of the first model"
  local low, high = math.huge, 0
  for _, x in ipairs { result.gap.validate.after, table.unpack(own.x) } do
    low, high = math.min(low, x), math.max(high, x)
  end
  local wide = high > 10 * low
  return { file = "steps", title = title .. ": error on the validation records", panels = { {
    x_label = "rms of measured minus simulated [" .. unit .. "]", x_log = wide,
    x_range = { wide and low / 1.5 or 0, high * (wide and 1.5 or 1.1) },
    y_names = names, y_range = { 0.5, #names + 0.5 }, series = {
      { name = "fitted with this model", x = own.x, y = own.y, style = "points" },
      { name = "published", x = published.x, y = published.y, style = "points" },
      { name = "found by the diagnosis", x = { result.gap.validate.after }, y = { #names }, style = "points" } } } } }
end

-- A report of both, with the plot "steps". unit: of the gaps.
function steps.report(title, unit, rows, result)
  local list = {}
  for _, effect in ipairs(result.effects) do
    list[#list + 1] = string.format("%s in %s: %s", effect.name, effect.equation, effect.expression)
  end
  tb.write_json { file = "steps.json", value = { steps = rows, verdict = result.verdict, effects = list,
    validate = result.gap.validate, seconds = result.seconds } }
  tb.report { file = "report.html", title = title,
    summary = string.format("The diagnosis of the first model says %s", result.verdict) .. (#list == 0 and "."
      or string.format("; on the validation records the gap decreases from %.3g to %.3g %s.",
        result.gap.validate.before, result.gap.validate.after, unit)),
    sections = {
      { title = "Models one after another", content = { { table = {
        caption = "rms of measured minus simulated [" .. unit .. "], beside an independent fit",
        columns = { { name = "model" }, { name = "fitted" }, { name = "published" }, { name = "validation" },
          { name = "published" } }, rows = rows } }, { plot = plot_of(title, unit, rows, result) } } },
      { title = "What the diagnosis finds",
        content = #list > 0 and list or { "Nothing that predicts better." } },
    } }
end

return steps
