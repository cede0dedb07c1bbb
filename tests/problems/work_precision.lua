-- Error against tolerance and time, problem by problem, beside other programs: what they print
-- (benchmarks/conformance) is compared with the same references. ./dev bench runs it:
--
--   tribode run tests/problems/work_precision.lua [--quick] [-D peers=peers.csv] [-D problem="HIRES"]
--
-- Leaves work_precision.csv, table.md and the plots stiff, smooth, grid (png, svg). Times are processor times of a
-- solution, the least of several; recording the equations, once for a system, is not in them.
local tb = require "tribode"
local ivp = require "ivp"
local option = tb.options {
  peers = { default = "", help = "CSV of the other programs: problem,method,tolerance,seconds,steps,values" },
  problem = { default = "", help = "only this one" },
  target = { default = 1e-5, help = "error whose cost the table states" },
}

local problems, by_name = {}, {}
for _, problem in ipairs(ivp.problems()) do
  local wanted = option.problem == problem.name
  if option.problem == "" then wanted = not tb.quick or problem.name == "HIRES" or problem.name == "ARENSTORF" end
  if wanted then
    problems[#problems + 1] = problem
    by_name[problem.name] = problem
  end
end

-- By problem and method, a list of { tolerance, error, seconds, steps }.
local curves, methods = {}, {}
local function add(problem, method, point)
  curves[problem] = curves[problem] or {}
  local curve = curves[problem][method] or {}
  curves[problem][method] = curve
  curve[#curve + 1] = point
  if not methods[method] then
    methods[#methods + 1] = method
    methods[method] = true
  end
end

-- ---- Tribode ----------------------------------------------------------------------------------------------------

local function min_time(solve)
  local least, total, result = math.huge, 0, nil
  for _ = 1, tb.quick and 1 or 5 do
    local begin = os.clock()
    result = solve()
    local seconds = os.clock() - begin
    least, total = math.min(least, seconds), total + seconds
    if total > 0.5 then break end
  end
  return least, result
end

local tolerances = tb.quick and { 1e-4, 1e-6 } or { 1e-4, 1e-5, 1e-6, 1e-7, 1e-8, 1e-9, 1e-10 }

for _, problem in ipairs(problems) do
  local system = ivp.system(problem)
  for solver in pairs(problem.accepted) do
    local few = #problem.start > 1000
    for _, tolerance in ipairs(few and { 1e-4, 1e-6 } or tolerances) do
      local seconds, run = min_time(function()
        return tb.run_system { system = system, duration_s = problem.duration_s, output_step_s = problem.duration_s,
          solver = solver, relative_tolerance = tolerance, absolute_tolerance = tolerance }
      end)
      local off = run.ok and ivp.error(problem, run, tolerance, tolerance) or nil
      add(problem.name, "tribode " .. solver,
        { tolerance = tolerance, error = off, seconds = seconds, steps = run.statistics.steps, message = run.message })
    end
  end
end

-- ---- the others -------------------------------------------------------------------------------------------------

if option.peers ~= "" then
  for line in io.lines(option.peers) do
    local name, method, tolerance, seconds, steps, values = line:match("^([^,]*),([^,]*),([^,]*),([^,]*),([^,]*),(.*)$")
    assert(name, "not a line of the other programs: " .. line)
    local problem = by_name[name]
    if problem then
      local final, i = {}, 0
      for value in values:gmatch("%S+") do
        i = i + 1
        final[ivp.state(i)] = tonumber(value)
      end
      tolerance = tonumber(tolerance)
      local off = values ~= "failed" and ivp.error(problem, { final = final }, tolerance, tolerance) or nil
      add(name, method, { tolerance = tolerance, error = off, seconds = tonumber(seconds), steps = tonumber(steps),
        message = values == "failed" and values or "" })
    end
  end
end

-- ---- table ------------------------------------------------------------------------------------------------------

table.sort(methods, function(a, b)
  local function rank(name)
    if name:find "^tribode" then return "0" .. name end
    return (name:find "by hand" and "1" or "2") .. name
  end
  return rank(a) < rank(b)
end)

-- The time at which the curve comes to an error, between its points and not beyond; nil where it does not.
local function time_to(curve, target)
  for k, point in ipairs(curve) do
    if point.error and point.error <= target then
      local before = curve[k - 1]
      if not before or not before.error or before.error <= point.error then return point.seconds end
      local share = math.log(before.error / target) / math.log(before.error / point.error)
      return math.exp(math.log(before.seconds) + share * math.log(point.seconds / before.seconds))
    end
  end
end

local csv = { "problem,method,tolerance,error,error_per_tolerance,seconds,steps\n" }
for _, problem in ipairs(problems) do
  for _, method in ipairs(methods) do
    for _, point in ipairs(curves[problem.name][method] or {}) do
      csv[#csv + 1] = string.format("%s,%s,%g,%s,%s,%.6g,%d\n", problem.name, method, point.tolerance,
        point.error and string.format("%.4g", point.error) or "failed",
        point.error and string.format("%.4g", point.error / point.tolerance) or "failed", point.seconds, point.steps)
    end
  end
end
tb.write_text { file = "work_precision.csv", text = table.concat(csv) }

local text = {}
local function write_table(title, cell)
  text[#text + 1] = title .. "\n\n| problem |"
  for _, method in ipairs(methods) do text[#text + 1] = " " .. method .. " |" end
  text[#text + 1] = "\n|---|" .. string.rep("---|", #methods) .. "\n"
  for _, problem in ipairs(problems) do
    text[#text + 1] = "| " .. problem.name .. " |"
    for _, method in ipairs(methods) do
      local curve = curves[problem.name][method]
      text[#text + 1] = " " .. (curve and cell(curve) or "") .. " |"
    end
    text[#text + 1] = "\n"
  end
  text[#text + 1] = "\n"
end
local function short(value)
  if value >= 1000 then return string.format("%.0f", value) end
  return (string.format("%.3g", value))
end
write_table(string.format("Processor time in ms to an error of %g", option.target), function(curve)
  local seconds = time_to(curve, option.target)
  return seconds and short(1000 * seconds) or "–"
end)
write_table("Error over tolerance at the tolerance 1e-6", function(curve)
  for _, point in ipairs(curve) do
    if point.tolerance == 1e-6 then return point.error and short(point.error / 1e-6) or "failed" end
  end
  return ""
end)
tb.write_text { file = "table.md", text = table.concat(text) }

-- ---- plots ------------------------------------------------------------------------------------------------------

local colors = { "#0072b2", "#56b4e9", "#cc79a7", "#000000", "#808080", "#e69f00", "#009e73", "#d55e00", "#f0e442",
  "#661100", "#882255" }

local function plot(file, title, names)
  local panels = {}
  for _, name in ipairs(names) do
    if curves[name] then
      local series = {}
      for i, method in ipairs(methods) do
        local x, y = {}, {}
        for _, point in ipairs(curves[name][method] or {}) do
          if point.error then x[#x + 1], y[#y + 1] = point.error, 1000 * point.seconds end
        end
        if #x > 0 then
          series[#series + 1] = { name = method, x = x, y = y, style = "line_points", color = colors[i] }
        end
      end
      panels[#panels + 1] = { x_label = "Error, relative", y_label = name .. ", time [ms]", x_log = true,
        y_log = true, legend = #panels == 0 and "above" or "none", series = series }
    end
  end
  if #panels > 0 then tb.plot { file = file, title = title, height = 250 + 420 * #panels, panels = panels } end
end
plot("stiff", "Stiff problems: processor time against error", { "HIRES", "ROBER", "OREGO", "VDPOL mu=1e5", "POLLU" })
plot("smooth", "Problems that are not stiff: processor time against error", { "ARENSTORF", "PLEIADES" })
plot("grid", "Problems on a grid: processor time against error",
  { "MEDAKZO n=400", "BRUSSELATOR n=400", "BRUSSELATOR n=2000" })

local failed = 0
for _, problem in ipairs(problems) do
  for method, curve in pairs(curves[problem.name]) do
    for _, point in ipairs(curve) do
      if not point.error then
        failed = failed + 1
        print(string.format("%s by %s at %g: %s", problem.name, method, point.tolerance, point.message))
      end
    end
  end
end
print(string.format("%d problems, %d methods, %d runs that ended early", #problems, #methods, failed))
