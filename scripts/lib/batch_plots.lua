-- Plots of a merged batch, each from one options table. A script says: local plots = require "lib.batch_plots".
--
--   plots.columns(merged)              parameters and numbers of a merged batch as columns for tb.write_csv
--   plots.factors(merged, names)       the parameters as factors for tb.tornado and tb.regression_sensitivity
--   plots.histogram { file, title, x_label, x_range, series = { { name, values }, ... }, bins }
--   plots.scatter   { file, title, factors, y_label, values, most }
--   plots.tornado   { file, title, x_label, bars, centre }
--   plots.indices   { file, title, indices }

local tb = require "tribode"
local plots = {}

local low_color, high_color = "#0072b2", "#e69f00"

local function sorted_keys(fields)
  local keys = {}
  for key in pairs(fields) do keys[#keys + 1] = key end
  table.sort(keys)
  return keys
end

function plots.columns(merged)
  local columns = { { name = "index", values = merged.index } }
  for _, group in ipairs { merged.parameters, merged.results } do
    for _, name in ipairs(sorted_keys(group)) do
      local is_list = false
      for _, value in ipairs(group[name]) do is_list = is_list or type(value) == "table" end
      if not is_list then
        columns[#columns + 1] = { name = name, unit = merged.units[name] or "", values = group[name] }
      end
    end
  end
  return columns
end

function plots.factors(merged, names)
  local factors = {}
  for i, name in ipairs(names or sorted_keys(merged.parameters)) do
    factors[i] = { name = name, values = merged.parameters[name], unit = merged.units[name] or "" }
  end
  return factors
end

-- Outlines of several distributions as densities, so that bins of different widths compare.
function plots.histogram(o)
  local series = {}
  for i, part in ipairs(o.series) do
    local bins = tb.histogram { values = part.values, bins = o.bins or 0 }
    local total, x, y = 0, {}, {}
    for _, count in ipairs(bins.counts) do total = total + count end
    for k, count in ipairs(bins.counts) do
      local share = 100 * count / total / (bins.edges[k + 1] - bins.edges[k])
      for _, edge in ipairs { bins.edges[k], bins.edges[k + 1] } do x[#x + 1], y[#y + 1] = edge, share end
    end
    if #x > 0 then
      table.insert(x, 1, x[1])
      table.insert(y, 1, 0)
      x[#x + 1], y[#y + 1] = x[#x], 0
    end
    series[i] = { name = part.name, x = x, y = y, width = 2 }
  end
  tb.plot {
    file = o.file,
    title = o.title,
    panels = { { x_label = o.x_label, y_label = "Points [% per unit]", x_range = o.x_range, series = series } },
  }
end

-- One panel for each factor: a dot for each point, and the mean of each tenth of them.
function plots.scatter(o)
  local panels = {}
  local most = o.most or 3000 -- dots in a panel
  for i, factor in ipairs(o.factors) do
    local order = {}
    for k, value in ipairs(o.values) do
      if value == value then order[#order + 1] = k end
    end
    local step = math.max(1, math.ceil(#order / most))
    local x, y = {}, {}
    for k = 1, #order, step do x[#x + 1], y[#y + 1] = factor.values[order[k]], o.values[order[k]] end
    table.sort(order, function(a, b)
      if factor.values[a] ~= factor.values[b] then return factor.values[a] < factor.values[b] end
      return a < b
    end)
    local mean_x, mean_y = {}, {}
    local parts = math.min(10, #order)
    for part = 1, parts do
      local from, to = (part - 1) * #order // parts + 1, part * #order // parts
      local sum_x, sum_y = 0, 0
      for k = from, to do sum_x, sum_y = sum_x + factor.values[order[k]], sum_y + o.values[order[k]] end
      mean_x[part], mean_y[part] = sum_x / (to - from + 1), sum_y / (to - from + 1)
    end
    panels[i] = {
      x_label = factor.name .. ((factor.unit or "") ~= "" and " [" .. factor.unit .. "]" or ""),
      y_label = o.y_label,
      legend = i == 1 and "above" or "none",
      series = {
        { name = "points", x = x, y = y, style = "points", color = "#9ecae1" },
        { name = "mean of each tenth", x = mean_x, y = mean_y, style = "line_points", color = "#d55e00", width = 2.5 },
      },
    }
  end
  tb.plot { file = o.file, title = o.title, height = 140 + 270 * #panels, panels = panels }
end

-- One series for each bar, the first of the list uppermost; only the first is in the legend.
local function add_bars(series, list, offset, style, ends)
  for i, entry in ipairs(list) do
    local from, to = ends(entry)
    local at = #list + 1 - i + offset
    series[#series + 1] =
      { name = i == 1 and style.name or "", x = { from, to }, y = { at, at }, color = style.color, width = style.width }
  end
end

local function add_errors(series, list, offset, ends)
  local style = { name = offset > 0 and "two standard errors" or "", color = "#000000", width = 1.5 }
  add_bars(series, list, offset, style, ends)
end

local function names_upwards(list, name_of)
  local names = {}
  for i, entry in ipairs(list) do names[#list + 1 - i] = name_of(entry, i) end
  return names
end

function plots.tornado(o)
  local least, greatest = o.centre, o.centre
  for _, bar in ipairs(o.bars) do
    least = math.min(least, bar.low - 2 * bar.low_error, bar.high - 2 * bar.high_error)
    greatest = math.max(greatest, bar.low + 2 * bar.low_error, bar.high + 2 * bar.high_error)
  end
  local series = {}
  local low_style = { name = "factor among its lowest", color = low_color, width = 9 }
  local high_style = { name = "factor among its highest", color = high_color, width = 9 }
  add_bars(series, o.bars, 0.16, low_style, function(bar) return o.centre, bar.low end)
  add_bars(series, o.bars, -0.16, high_style, function(bar) return o.centre, bar.high end)
  add_errors(series, o.bars, 0.16, function(bar) return bar.low - 2 * bar.low_error, bar.low + 2 * bar.low_error end)
  add_errors(series, o.bars, -0.16, function(bar)
    return bar.high - 2 * bar.high_error, bar.high + 2 * bar.high_error
  end)
  series[#series + 1] = { x = { o.centre, o.centre }, y = { 0.4, #o.bars + 0.6 }, color = "#000000", width = 1 }
  local margin = 0.04 * math.max(greatest - least, 1e-12)
  tb.plot {
    file = o.file,
    title = o.title,
    height = 220 + 46 * #o.bars,
    panels = {
      {
        x_label = o.x_label,
        x_range = { least - margin, greatest + margin },
        y_range = { 0.4, #o.bars + 0.6 },
        y_names = names_upwards(o.bars, function(bar) return bar.name end),
        series = series,
      },
    },
  }
end

function plots.indices(o)
  local list = {}
  for i, name in ipairs(o.indices.factors) do
    list[i] = {
      name = name,
      first = o.indices.first[i], first_error = o.indices.first_error[i],
      total = o.indices.total[i], total_error = o.indices.total_error[i],
    }
  end
  table.sort(list, function(a, b) return a.total > b.total end)
  local series = {}
  local first_style = { name = "alone (first order)", color = low_color, width = 9 }
  local total_style = { name = "with others (total)", color = high_color, width = 9 }
  add_bars(series, list, 0.16, first_style, function(entry) return 0, entry.first end)
  add_bars(series, list, -0.16, total_style, function(entry) return 0, entry.total end)
  add_errors(series, list, 0.16, function(entry)
    return entry.first - 2 * entry.first_error, entry.first + 2 * entry.first_error
  end)
  add_errors(series, list, -0.16, function(entry)
    return entry.total - 2 * entry.total_error, entry.total + 2 * entry.total_error
  end)
  tb.plot {
    file = o.file,
    title = o.title,
    height = 220 + 56 * #list,
    panels = {
      {
        x_label = "Share of the variance",
        y_range = { 0.4, #list + 0.6 },
        y_names = names_upwards(list, function(entry) return entry.name end),
        series = series,
      },
    },
  }
end

return plots
