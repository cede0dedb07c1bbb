-- Hybrid systems of the textbooks, with references in closed form or by another road (events/oracle.lua): by each
-- method number and order of the events are right, their times and the final states within what is accepted.
--
--   tribode run tests/problems/hybrid.lua [-D problem=relay] [-D solver=erk]
local tb = require "tribode"
local option = tb.options { problem = "", solver = "" }

-- A problem: name, system, duration_s, inputs, events = { { t, name }, ... }, final = { name = value },
-- accepted = { solver = factor }: the largest error of an event time [s] or a final value; by `exact` the error itself,
-- by the others in units of the tolerance; fixed_step_s = a step with which `fixed` finds the same events.
local problems = {}
for _, family in ipairs { "impacts", "switches", "friction", "loops" } do
  for _, problem in ipairs(require("events." .. family)) do problems[#problems + 1] = problem end
end

local worst = {}

local function check(problem, solver, tolerance, accepted)
  local run = tb.run_system { system = problem.system, duration_s = problem.duration_s,
    output_step_s = problem.duration_s / 10, solver = solver, inputs = problem.inputs,
    relative_tolerance = tolerance, absolute_tolerance = tolerance }
  local where = string.format("%s by %s at %g", problem.name, solver, tolerance)
  assert(run.ok, where .. ": " .. run.message)
  local limit = solver == "exact" and 1 or tolerance
  for i, wanted in ipairs(problem.events) do
    local found = run.events[i]
    assert(found, string.format("%s: %d events instead of %d", where, #run.events, #problem.events))
    assert(found.name == wanted[2], string.format("%s: event %d at %.17g is '%s' instead of '%s' at %.17g", where, i,
      found.t, found.name, wanted[2], wanted[1]))
    local off = math.abs(found.t - wanted[1])
    assert(off <= accepted * limit, string.format("%s: event %d '%s' at %.17g instead of %.17g: off by %.3g", where, i,
      found.name, found.t, wanted[1], off / limit))
    worst[#worst + 1] = { problem.name, solver, tolerance, "event", off / limit, accepted }
  end
  local more = run.events[#problem.events + 1]
  assert(not more, more and string.format("%s: %d events instead of %d, one more is '%s' at %.17g", where, #run.events,
    #problem.events, more.name, more.t))
  for name, wanted in pairs(problem.final) do
    local found = run.final[name]
    if type(wanted) == "string" then
      assert(found == wanted, string.format("%s: %s = '%s' instead of '%s'", where, name, found, wanted))
    else
      local off = math.abs(found - wanted)
      assert(off <= accepted * limit, string.format("%s: %s = %.17g instead of %.17g: off by %.3g", where, name, found,
        wanted, off / limit))
      worst[#worst + 1] = { problem.name, solver, tolerance, name, off / limit, accepted }
    end
  end
end

-- With a fixed step an event is handled up to one step late; the first one has no other error.
local function check_fixed(problem)
  local run = tb.run_system { system = problem.system, duration_s = problem.duration_s, inputs = problem.inputs,
    output_step_s = problem.duration_s / 10, solver = "fixed", fixed_step_s = problem.fixed_step_s }
  local where = problem.name .. " by fixed steps"
  assert(run.ok, where .. ": " .. run.message)
  assert(#run.events == #problem.events, string.format("%s: %d events instead of %d", where, #run.events,
    #problem.events))
  for i, wanted in ipairs(problem.events) do assert(run.events[i].name == wanted[2], where) end
  local late = run.events[1].t - problem.events[1][1]
  assert(late > -1e-9 and late <= problem.fixed_step_s, string.format("%s: the first event is %g s late", where, late))
end

-- Bounces that come ever faster: past the point where they accumulate the run ends there and names the event, and all
-- before are right.
local function check_zeno(floor, solver)
  local g, e = 9.81, 0.7
  local system = tb.system {
    states = { h = floor + 1, v = 0 },
    der = function(s) return { h = s.v, v = -g } end,
    when = { { name = "impact", crossing = function(s) return s.h - floor end,
      set = function(s) return { h = floor, v = -e * s.v } end } },
  }
  local run = tb.run_system { system = system, duration_s = 1000, output_step_s = 1000, solver = solver }
  local where = string.format("past the Zeno point by %s, floor at %g", solver, floor)
  assert(not run.ok and run.message:find("impact", 1, true), where .. ": " .. run.message)
  local t, v = math.sqrt(2 / g), math.sqrt(2 * g)
  local point = t * (1 + e) / (1 - e)
  -- At a floor of 1000 the last bounces are of the size of rounding, hundreds of them of 1e-6 s each.
  assert(math.abs(run.t_end - point) < 1e-4 + 1e-6 * floor,
    string.format("%s: ends at %.17g instead of %.17g", where, run.t_end, point))
  assert(math.abs(run.final.h - floor) < 1e-6, where)
  for i = 1, 15 do
    assert(math.abs(run.events[i].t - t) < 1e-6 * (1 + floor), string.format("%s: impact %d at %.17g instead of %.17g",
      where, i, run.events[i].t, t))
    v = e * v
    t = t + 2 * v / g
  end
end
if option.problem == "" or option.problem == "zeno" then
  for _, floor in ipairs { 0, 0.2, 1, 1000 } do
    for _, solver in ipairs(floor == 0 and { "exact", "erk", "adams", "bdf" } or { "exact", "erk" }) do
      check_zeno(floor, solver)
    end
  end
end

local count = option.problem == "zeno" and 1 or 0
for _, problem in ipairs(problems) do
  if option.problem == "" or option.problem == problem.name then
    for _, solver in ipairs { "exact", "erk", "adams", "bdf" } do
      local accepted = problem.accepted[solver]
      for _, tolerance in ipairs(solver == "exact" and { 1e-8 } or { 1e-6, 1e-8, 1e-10 }) do
        if accepted and (option.solver == "" or option.solver == solver) then
          check(problem, solver, tolerance, accepted)
        end
      end
    end
    if problem.fixed_step_s and (option.solver == "" or option.solver == "fixed") then check_fixed(problem) end
    count = count + 1
  end
end
assert(count > 0, "no such problem")

local rows = { "problem,solver,tolerance,what,off_per_tolerance,accepted\n" }
for _, row in ipairs(worst) do rows[#rows + 1] = string.format("%s,%s,%g,%s,%.4g,%g\n", table.unpack(row)) end
tb.write_text { file = "errors.csv", text = table.concat(rows) }
