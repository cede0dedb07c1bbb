-- The Reference FMUs of the Modelica Association, version 0.0.41, as systems of equations: against closed forms, and
-- against the result files published with them, which are made with Euler's method at fixed steps, so that `euler` must
-- give the same numbers.
local tb = require "tribode"

local function near(found, wanted, tolerance)
  assert(math.abs(found - wanted) <= tolerance, string.format("%.17g instead of %.17g", found, wanted))
end

-- Rows { t, values } of a result file; the run has them at a grid that meets these instants.
local function check_file(run, names, tolerance, rows)
  assert(run.ok, run.message)
  for _, row in ipairs(rows) do
    local k = math.floor(row[1] / (run.t[2] - run.t[1]) + 1.5)
    near(run.t[k], row[1], 1e-12)
    for i, name in ipairs(names) do
      near(run.values[name][k], row[i + 1], tolerance * (1 + math.abs(row[i + 1])))
    end
  end
end

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
-- BouncingBall_out.csv, steps of 1 ms.
ball = tb.run_system { system = require "systems.bouncing_ball", duration_s = 3, output_step_s = 0.01, solver = "euler",
  fixed_step_s = 1e-3 }
check_file(ball, { "h", "v" }, 1e-11, {
  { 0.25, 0.69466375, -2.4525000000000032 }, { 0.45, 0.008944750000001257, -4.414499999999978 },
  { 0.46, 0.021569246999999892, 3.042080999999985 }, { 1, 0.23664368699999475, -2.255319000000016 },
  { 1.5, 0.07350171929999888, -1.8420237000000108 }, { 2, 0.05488907778900016, -0.3525449129999987 },
  { 2.5, 0.0008060041977116404, 0.17697604942791004 }, { 2.6, 0.0003970596770525458, -0.1004565357803241 },
  { 2.61, 0, 0 }, { 3, 0, 0 },
})

-- Dahlquist: x = e^{-kt}.
local dahlquist = tb.system {
  parameters = { k = 1 },
  states = { x = 1 },
  der = function(s) return { x = -s.k * s.x } end,
}
for _, case in ipairs { { "exact", 1e-14 }, { "erk", 1e-7 }, { "adams", 1e-6 }, { "bdf", 1e-6 } } do
  local run = tb.run_system { system = dahlquist, duration_s = 10, output_step_s = 0.1, solver = case[1] }
  for i, at in ipairs(run.t) do near(run.values.x[i], math.exp(-at), case[2]) end
end

-- Dahlquist_out.csv, steps of 0.1 s.
local steps = tb.run_system { system = dahlquist, duration_s = 10, output_step_s = 0.1, solver = "euler",
  fixed_step_s = 0.1 }
check_file(steps, { "x" }, 1e-14, { { 1, 0.3486784401 }, { 5, 0.005153775207320112 }, { 10, 0.00002656139888758746 } })

-- VanDerPol_out.csv, steps of 10 ms.
steps = tb.run_system { system = require "systems.van_der_pol", duration_s = 20, output_step_s = 0.01, solver = "euler",
  fixed_step_s = 0.01 }
check_file(steps, { "x0", "x1" }, 1e-11, {
  { 1, 1.509668337511498, -0.7809002675117097 }, { 5, -0.8744029139228319, 1.273735873175349 },
  { 10, -2.0263807253798554, -0.067942372949217 }, { 15, 0.9600042556523872, -1.1969029866913161 },
  { 20, 2.0148418861546133, 0.24419470751904407 },
})

-- StateSpace: x' = A x + B u, y = C x + D u, all identities, u = (1, 2, 3): y = e^t u.
local space = tb.system {
  inputs = { u1 = 1, u2 = 2, u3 = 3 },
  states = { x1 = 0, x2 = 0, x3 = 0 },
  der = function(s) return { x1 = s.x1 + s.u1, x2 = s.x2 + s.u2, x3 = s.x3 + s.u3 } end,
  outputs = function(s) return { y1 = s.x1 + s.u1, y2 = s.x2 + s.u2, y3 = s.x3 + s.u3 } end,
}
for _, case in ipairs { { "exact", 1e-13 }, { "erk", 1e-6 }, { "adams", 1e-6 }, { "bdf", 1e-5 } } do
  local run = tb.run_system { system = space, duration_s = 10, output_step_s = 1, solver = case[1] }
  for i, at in ipairs(run.t) do
    for k = 1, 3 do near(run.values["y" .. k][i] / (k * math.exp(at)), 1, case[2]) end
  end
end
-- StateSpace_out.csv, steps of 1 ms.
steps = tb.run_system { system = space, duration_s = 10, output_step_s = 1, solver = "euler", fixed_step_s = 1e-3 }
check_file(steps, { "y1", "y2", "y3" }, 1e-11, {
  { 1, 2.7169239322358925, 5.433847864471785, 8.150771796707678 },
  { 5, 148.04283616264095, 296.0856723252819, 444.12850848792027 },
  { 10, 21916.681339078466, 43833.36267815693, 65750.0440172352 },
})

-- Stair: a counter that goes up each second, and no state. Stair_out.csv has 10 at t = 9.
local stair = tb.system {
  discrete = { counter = 1 },
  sample = { { period_s = 1, offset_s = 1, set = function(s) return { counter = s.counter + 1 } end } },
}
local run = tb.run_system { system = stair, duration_s = 9.5, output_step_s = 0.5 }
assert(run.final.counter == 10)
for i, at in ipairs(run.t) do assert(run.values.counter[i] == math.max(1, math.ceil(at)), at) end

-- Feedthrough: outputs that are functions of inputs, at the same instant. Its integers are numbers here:
-- Feedthrough_in.csv steps from the least to the greatest value at t = 1.
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
for _, range in ipairs { { -128, 127 }, { 0, 255 }, { -32768, 32767 }, { 0, 65535 }, { -2147483648, 2147483647 },
  { 0, 4294967295 } } do
  run = tb.run_system { system = feedthrough, duration_s = 2, output_step_s = 0.25,
    inputs = { u = { sample_time_s = 1, values = range } } }
  for i, at in ipairs(run.t) do assert(run.values.y[i] == range[at <= 1 and 1 or 2], at) end -- left limits
end
