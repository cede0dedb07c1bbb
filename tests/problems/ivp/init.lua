-- Initial value problems with reference values, for the scripts beside this folder. A problem is
--
--   name, source      what it is and where it is from
--   start             list of start values
--   der(t, y)         list of derivatives; t and y may be symbols
--   duration_s        the time of the reference
--   reference         { [i] = value } at that time, for all states or some
--   nominal           scale of the absolute tolerance: one number or a list (default 1)
--   breaks            instants at which the right side jumps: a condition of the time in it
--   long              true where the problem takes seconds
--   stiff             true where explicit methods are limited by stability
--   accepted          { solver = factor }: the largest error in units of the tolerance, some four times the worst of
--                     fifteen tolerances from 1e-3 to 1e-11; it grows with what the problem makes of an early error
local tb = require "tribode"

local ivp = {}

function ivp.state(i) return string.format("y%04d", i) end

function ivp.nominal(problem, i)
  local nominal = problem.nominal or 1
  return type(nominal) == "table" and nominal[i] or nominal
end

function ivp.system(problem)
  local states = {}
  for i, value in ipairs(problem.start) do
    states[ivp.state(i)] = { start = value, nominal = ivp.nominal(problem, i) }
  end
  return tb.system {
    name = problem.name,
    states = states,
    der = function(s)
      local y, rates = {}, {}
      for i = 1, #problem.start do y[i] = s[ivp.state(i)] end
      for i, rate in ipairs(problem.der(s.t, y)) do rates[ivp.state(i)] = rate end
      return rates
    end,
  }
end

-- The largest error over the states with a reference, |y - y_ref| / (|y_ref| + atol/rtol): what is allowed for a step
-- is rtol of this measure. Returns it and the state.
function ivp.error(problem, run, relative_tolerance, absolute_tolerance)
  local worst, at = 0, 0
  for i, wanted in pairs(problem.reference) do
    local floor = ivp.nominal(problem, i) * absolute_tolerance / relative_tolerance
    local off = math.abs(run.final[ivp.state(i)] - wanted) / (math.abs(wanted) + floor)
    if off > worst or off ~= off then worst, at = off, i end
  end
  return worst, at
end

-- A list of problems by name.
function ivp.problems()
  local all = {}
  for _, family in ipairs { "stiff", "smooth", "grid" } do
    for _, problem in ipairs(require("ivp." .. family)) do all[#all + 1] = problem end
  end
  return all
end

return ivp
