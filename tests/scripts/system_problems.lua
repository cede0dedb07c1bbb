-- Problems whose solution is known, in closed form or from a publication, run as systems of equations.
local tb = require "tribode"

local function near(found, wanted, tolerance)
  assert(math.abs(found - wanted) <= tolerance, string.format("%.17g instead of %.17g", found, wanted))
end

-- ---- Reference FMUs ---------------------------------------------------------------------------------------------

-- BouncingBall: impacts at sqrt(2h/g), then after flights of 2 v/g, v falling by 0.7 until it is below 0.1 m/s.
local ball = tb.run_system { system = require "systems.bouncing_ball", duration_s = 3 }
assert(ball.ok and ball.final.mode == "resting" and ball.final.h == 0 and ball.final.v == 0)
local t, v, impacts = math.sqrt(2 / 9.81), math.sqrt(2 * 9.81), 0
while v >= 0.1 do
  impacts = impacts + 1
  near(ball.events[impacts].t, t, 1e-13)
  v = 0.7 * v
  t = t + 2 * v / 9.81
end
assert(ball.events[impacts + 1].name == "rest" and #ball.events == impacts + 1)

-- Dahlquist: x = e^{-kt}.
local dahlquist = tb.system {
  parameters = { k = 1 },
  states = { x = 1 },
  der = function(s) return { x = -s.k * s.x } end,
}
for _, case in ipairs { { "exact", 1e-14 }, { "erk", 1e-7 }, { "adams", 1e-6 }, { "cvode", 1e-6 } } do
  local run = tb.run_system { system = dahlquist, duration_s = 10, output_step_s = 0.1, solver = case[1] }
  for i, at in ipairs(run.t) do near(run.values.x[i], math.exp(-at), case[2]) end
end

-- Stair: a counter that goes up each second, and no state.
local stair = tb.system {
  discrete = { counter = 0 },
  sample = { { period_s = 1, offset_s = 1, set = function(s) return { counter = s.counter + 1 } end } },
}
local run = tb.run_system { system = stair, duration_s = 9.5, output_step_s = 0.5 }
for i, at in ipairs(run.t) do assert(run.values.counter[i] == math.max(0, math.ceil(at) - 1), at) end

-- Feedthrough: outputs that are functions of inputs, at the same instant.
local feedthrough = tb.system {
  inputs = { u = 0, w = 0 },
  outputs = function(s) return { y = s.u, z = tb.where(tb.less(s.w, 1), -1, 2 * s.w) } end,
}
run = tb.run_system {
  system = feedthrough,
  duration_s = 2,
  output_step_s = 0.25,
  inputs = { u = function(at) return at ^ 2 end, w = function(at) return at end },
}
for i, at in ipairs(run.t) do
  assert(run.values.y[i] == at * at)
  assert(run.values.z[i] == (at < 1 and -1 or 2 * at))
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
run = tb.run_system { system = clocks, duration_s = 2 }
assert(run.final.slow == 7 and run.final.ticks == 4 and run.final.fast == 1 and #run.events == 4)

-- ---- SUNDIALS ----------------------------------------------------------------------------------------------------

-- Robertson. At t = 0.4 and 4 by Taylor series of order 24 and 34 decimal digits, in steps far below the stiffness. At
-- t = 40, and for the roots, what the comment of SUNDIALS' example prints at its tolerance of 1e-4: y1 = 7.158e-01,
-- y3 = 0.01 at t = 0.2639, y1 = 1e-4 at t = 2.079e+07.
local robertson = require "systems.robertson"
run = tb.run_system { system = robertson, duration_s = 40, output_step_s = 0.4, solver = "cvode" }
near(run.values.y1[2], 0.98517211378050380, 1e-6) -- the multistep method leaves a hundredfold of its tolerance, 1e-8
near(run.values.y2[2], 0.00003386395377576, 1e-10)
near(run.values.y3[2], 0.01479402226572042, 1e-6)
near(run.values.y1[11], 0.90551867854902079, 1e-6)
near(run.values.y2[11], 0.00002240475687153664, 1e-10)
near(run.values.y1[101], 0.7158, 1e-4)
for i = 1, #run.t do near(run.values.sum[i], 1, 1e-12) end -- the equations keep it
assert(#run.events == 1 and run.events[1].name == "y3 = 0.01")
near(run.events[1].t, 0.2640, 2e-4)
run = tb.run_system { system = robertson, duration_s = 4e7, solver = "cvode" }
assert(run.ok and #run.events == 2 and run.events[2].name == "y1 = 1e-4", run.message)
near(run.events[2].t / 2.0794e7, 1, 1e-3)

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
for _, case in ipairs { { "auto", 1e-14 }, { "erk", 1e-8 }, { "adams", 1e-7 }, { "cvode", 1e-7 } } do
  local late = tb.run_system { system = rate, duration_s = 2, solver = case[1] }
  near(late.final.y, math.exp(-6), case[2])
  local again = tb.run_system { system = jump, duration_s = 2, solver = case[1] }
  near(again.final.y, math.exp(-1), case[2])
end
