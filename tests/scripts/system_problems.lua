-- Problems whose solution is known, in closed form or from a publication, run as systems of equations.
local tb = require "tribode"

local function near(found, wanted, tolerance)
  assert(math.abs(found - wanted) <= tolerance, string.format("%.17g instead of %.17g", found, wanted))
end

-- VanDerPol with mu = 1, at t = 20: by Taylor series of order 34 in steps of 0.02 and 34 decimal digits.
local vdp = require "systems.van_der_pol"
local tight = tb.run_system { system = vdp, duration_s = 20, relative_tolerance = 1e-13, absolute_tolerance = 1e-14 }
near(tight.final.x0, 2.0081497621749485920, 1e-11)
near(tight.final.x1, -0.0425088752732021470, 1e-11)

-- Clocks: several periods, and an event clock that one of them ticks.
local clocks = tb.system {
  discrete = { slow = 0, fast = 0, ticks = 0 },
  sample = {
    { period_s = 0.1, set = function(s) return { fast = s.fast + 1 } end },
    { period_s = 0.3, offset_s = 0.2, set = function(s) return { slow = s.slow + 1 } end },
  },
  when = {
    { condition = function(s) return tb.greater_equal(s.fast, 5) end, set = function(s)
      return { fast = 0, ticks = s.ticks + 1 }
    end },
  },
}
local run = tb.run_system { system = clocks, duration_s = 2 }
assert(run.final.slow == 7 and run.final.ticks == 4 and run.final.fast == 1 and #run.events == 4)

-- ---- SUNDIALS ----------------------------------------------------------------------------------------------------

-- Robertson at t = 0.4, 4 ... 4e10, from tests/problems/robertson.py: collocation at twelve Radau points in 40 digits.
-- The table in SUNDIALS' example is that of a tolerance of 1e-4 and agrees with it so far, as do the roots that it
-- prints, t = 0.2639 and 2.079e+07. At t = 1e11 the value of the Test Set for Initial Value Problem Solvers
-- [Mazzia 2008].
local robertson = require "systems.robertson"
local reactions = {
  { 0.98517211386098986242, 0.000033863953789749041364, 0.014794022185220388544 },
  { 0.90551867858425391188, 0.00002240475687560200911, 0.094458916658870486115 },
  { 0.71582706871940509047, 9.1855347645577639037e-6, 0.28416374574583035176 },
  { 0.45051866847110242448, 3.2229014416746113033e-6, 0.54947810862745590091 },
  { 0.1832022577767093113, 8.9423712527759092599e-7, 0.81679684798616541111 },
  { 0.03898337708548285248, 1.6217683159096824239e-7, 0.96101646073768555655 },
  { 0.0049382745209798155602, 1.984994087954375437e-8, 0.9950617056290793049 },
  { 0.00051680960149243841552, 2.0682944912244535543e-9, 0.99948318833021307036 },
  { 0.000052030718441205473609, 2.081335731892532716e-10, 0.99994796907342522134 },
  { 5.207702103573172518e-6, 2.0830915594153649831e-11, 0.99999479227706551123 },
  { 5.2082766114359350569e-7, 2.0833117166045719591e-12, 0.99999947917025554469 },
  { 5.2083451767992391988e-8, 2.083338177925489035e-13, 0.99999994791633989819 },
}
for decade, wanted in ipairs(reactions) do
  local reaction = tb.run_system { system = robertson, duration_s = 0.4 * 10 ^ (decade - 1), solver = "bdf" }
  assert(reaction.ok, reaction.message)
  for i, value in ipairs(wanted) do
    -- The multistep method leaves hundreds of its tolerance, 1e-8, and of that of y2, 1e-18.
    near(reaction.final["y" .. i] / value, 1, 2e-5)
  end
  near(reaction.values.sum[#reaction.t], 1, 1e-12) -- the equations keep it
  local roots = decade > 8 and 2 or 1
  assert(#reaction.events == roots and reaction.events[1].name == "y3 = 0.01")
  near(reaction.events[1].t, 0.26401907818763256315, 1e-7)
  if roots == 2 then
    assert(reaction.events[2].name == "y1 = 1e-4")
    near(reaction.events[2].t / 20795496.883026623256, 1, 1e-6)
  end
end
run = tb.run_system { system = robertson, duration_s = 1e11, solver = "bdf", relative_tolerance = 1e-10,
  absolute_tolerance = 1e-18 }
near(run.final.y1 / 0.2083340149701255e-7, 1, 1e-6)
near(run.final.y2 / 0.8333360770334713e-13, 1, 1e-6)

-- Stiff van der Pol, mu = 1000, at t = 2000: the same test set, in its scale of time, epsilon = 1e-6 and t = 2.
local stiff = tb.system {
  states = { y = 2, z = 0 },
  der = function(s) return { y = s.z, z = ((1 - s.y ^ 2) * s.z - s.y) / 1e-6 } end,
}
run = tb.run_system { system = stiff, duration_s = 2, solver = "bdf", relative_tolerance = 1e-11,
  absolute_tolerance = 1e-13 }
near(run.final.y, 0.1706167732170483e1, 1e-7)
near(run.final.z, -0.8928097010247975, 1e-7)

-- The discontinuous example cvDisc_dns: y' = -y from y(0) = 1; at t = 1 either the right side becomes -5 y, or y is set
-- to 1.
local rate = tb.system {
  states = { y = 1 },
  discrete = { k = 1 },
  der = function(s) return { y = -s.k * s.y } end,
  when = { { condition = function(s) return tb.greater_equal(s.t, 1) end, set = function() return { k = 5 } end } },
}
local jump = tb.system {
  states = { y = 1 },
  der = function(s) return { y = -s.y } end,
  when = { { condition = function(s) return tb.greater_equal(s.t, 1) end, set = function() return { y = 1 } end } },
}
for _, case in ipairs { { "auto", 1e-14 }, { "erk", 1e-8 }, { "adams", 1e-7 }, { "bdf", 1e-7 } } do
  local late = tb.run_system { system = rate, duration_s = 2, solver = case[1] }
  near(late.final.y, math.exp(-6), case[2])
  local again = tb.run_system { system = jump, duration_s = 2, solver = case[1] }
  near(again.final.y, math.exp(-1), case[2])
end
