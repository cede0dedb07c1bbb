-- Initial value problems of the literature (folder ivp) against their reference values: by each method that suits them,
-- the error stays within what is accepted at every tolerance and falls with it; fixed steps have their order.
--
--   tribode run tests/problems/initial_values.lua [--quick] [-D problem=HIRES]
--
-- --quick leaves out the tolerances and the problem that take more than a tenth of a second.
local tb = require "tribode"
local ivp = require "ivp"
local option = tb.options { problem = "" }

local quick_tolerances = { 1e-6, 1e-8, 1e-10 }
local all_tolerances = { 1e-5, 1e-6, 1e-7, 1e-8, 1e-9, 1e-10 }
local rows = { "problem,solver,tolerance,error,error_per_tolerance,accepted,steps\n" }

local function solve(problem, system, options)
  options.system, options.duration_s, options.output_step_s = system, problem.duration_s, problem.duration_s
  local run = tb.run_system(options)
  assert(run.ok, string.format("%s by %s at %g: %s", problem.name, options.solver,
    options.relative_tolerance or options.fixed_step_s, run.message))
  if options.solver == "auto" then
    local found = run.stiff_from_s ~= nil
    -- Where erk serves as well, it may be either.
    local is_right = found == (problem.stiff == true) or (problem.stiff and problem.accepted.erk)
    assert(is_right, problem.name .. (found and " was found stiff" or " was not found stiff"))
  end
  return run
end

local function check_tolerances(problem, system, solver, accepted, tolerances)
  local errors = {}
  for k, tolerance in ipairs(tolerances) do
    local run = solve(problem, system,
      { solver = solver, relative_tolerance = tolerance, absolute_tolerance = tolerance })
    local off, state = ivp.error(problem, run, tolerance, tolerance)
    errors[k] = off
    rows[#rows + 1] = string.format("%s,%s,%g,%.4g,%.4g,%g,%d\n", problem.name, solver, tolerance, off, off / tolerance,
      accepted, run.statistics.steps)
    assert(off <= accepted * tolerance, string.format("%s by %s at %g: y%d is off by %.3g tolerances, accepted are %g",
      problem.name, solver, tolerance, state, off / tolerance, accepted))
  end
  -- A tolerance a hundred times smaller makes the error at least ten times smaller, on the average; the first
  -- may be small by luck.
  local first, last = 1, #tolerances
  while last - first > 2 and tolerances[first] > 1.5e-6 do first = first + 1 end
  if first < last then
    local slope = math.log(math.max(errors[first], tolerances[first] / 10) / errors[last])
      / math.log(tolerances[first] / tolerances[last])
    assert(slope > 0.5, string.format("%s by %s: the error goes as tolerance^%.2f", problem.name, solver, slope))
  end
end

local count = 0
for _, problem in ipairs(ivp.problems()) do
  if (option.problem == "" or option.problem == problem.name) and not (tb.quick and problem.long) then
    local system = ivp.system(problem)
    -- `auto` finds out by itself that a problem is stiff.
    problem.accepted.auto = problem.stiff and problem.accepted.bdf or problem.accepted.erk
    for solver, accepted in pairs(problem.accepted) do
      local tolerances = tb.quick and quick_tolerances or all_tolerances
      if #problem.start > 100 then tolerances = tb.quick and { 1e-6 } or { 1e-4, 1e-6, 1e-8 } end
      check_tolerances(problem, system, solver, accepted, tolerances)
      count = count + 1
    end
  end
end
assert(count > 0, "no such problem")

-- Fixed steps, on a problem whose solution is smooth and whose steps need not be short for stability.
if option.problem == "" then
  for _, problem in ipairs(require "ivp.grid") do
    if problem.name == "BRUSSELATOR n=40" then
      local system = ivp.system(problem)
      for solver, order in pairs { fixed = 4, euler = 1 } do
        local coarse, fine = 0.01, 0.005
        local function off(step)
          return (ivp.error(problem, solve(problem, system, { solver = solver, fixed_step_s = step }), 1, 1))
        end
        local found = math.log(off(coarse) / off(fine), 2)
        assert(math.abs(found - order) < 0.15, string.format("%s: order %.3f instead of %d", solver, found, order))
      end
    end
  end
end

tb.write_text { file = "errors.csv", text = table.concat(rows) }
