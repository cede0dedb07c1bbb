-- tb.table1 and tb.table2: values and slopes against formulas of another kind, kinks as events, what is refused.
local tb = require "tribode"

local check = require "lib.check"
local near, refused = check.near, check.refused

-- The points are met, and between them a line is one.
local x, y = { -1, 0, 0.5, 2, 3 }, { 1, -2, 4, 4, 0 }
for _, interpolation in ipairs { "linear", "pchip", "spline", "natural" } do
  local f = tb.table1 { x = x, y = y, interpolation = interpolation }
  for i = 1, #x do near(f(x[i]), y[i], 1e-14, interpolation) end
end
local line = tb.table1 { x = x, y = y, extrapolation = "linear" }
near(line(0.25), 1, 1e-15)
near(line(5), -8, 1e-15)
near(line(-2), 4, 1e-15)
local held = tb.table1 { x = x, y = y, extrapolation = "hold" }
near(held(5), 0, 0)
near(held(-100), 1, 0)

-- A spline through points of a cubic is that cubic; a natural one has no curvature at its ends; both are twice smooth.
local function cubic(u) return 2 - u + 3 * u ^ 2 - 0.7 * u ^ 3 end
local cy = {}
for i, u in ipairs(x) do cy[i] = cubic(u) end
local spline = tb.table1 { x = x, y = cy, interpolation = "spline" }
local natural = tb.table1 { x = x, y = cy, interpolation = "natural" }
for u = -1, 3, 0.125 do near(spline(u), cubic(u), 1e-13) end
local function second(f, u, h) return (f(u + h) - 2 * f(u) + f(u - h)) / h ^ 2 end
local h = 2e-3 -- a cubic's second difference at u is its second derivative there
near(second(natural, -1 + h, h), 0, 0.1)
near(second(natural, 3 - h, h), 0, 0.1)
for i = 2, #x - 1 do near(second(natural, x[i] - h, h), second(natural, x[i] + h, h), 0.2) end
-- Few points: a line, a parabola.
near(tb.table1 { x = { 0, 2 }, y = { 1, 5 }, interpolation = "spline" }(0.5), 2, 1e-15)
near(tb.table1 { x = { 0, 1, 3 }, y = { 0, 1, 9 }, interpolation = "spline" }(2), 4, 1e-14)
-- Values by SciPy 1.17 (CubicSpline and PchipInterpolator). pchip does not leave the range of its neighbors.
for interpolation, values in pairs {
  natural = { -1.4395625, 1.4945961538461532, 7.0060512820512821, 0.36525480769230795 },
  spline = { -4.4456, 1.7569714285714286, 6.864, 0.12228571428571477 },
  pchip = { -0.971, 1.888, 4, 0.5656 },
} do
  local f = tb.table1 { x = x, y = y, interpolation = interpolation }
  for i, u in ipairs { -0.7, 0.3, 1.2, 2.9 } do near(f(u), values[i], 1e-14, interpolation) end
end
local steps = tb.table1 { x = { 0, 1, 2, 3, 4 }, y = { 0, 0, 1, 1, 3 }, interpolation = "pchip" }
for u = 0, 4, 0.01 do assert(steps(u) >= 0 and steps(u) <= 3 and not (u < 1 and steps(u) ~= 0)) end
near(tb.table1 { x = { 0, 1, 3, 4 }, y = { 0, 1, 2, 8 }, interpolation = "pchip" }(2), 1.4183599419448476, 1e-14)

-- Two variables: a bilinear and a bicubic function are met everywhere.
local gx, gy, bilinear, bicubic = { 0, 1, 3, 4, 6 }, { -1, 0, 2, 3 }, {}, {}
local function b1(u, v) return 1 + 2 * u - v + 0.5 * u * v end
local function b3(u, v) return (1 + u - 0.2 * u ^ 3) * (2 - v ^ 2 + 0.3 * v ^ 3) + u * v end
for i, u in ipairs(gx) do
  bilinear[i], bicubic[i] = {}, {}
  for j, v in ipairs(gy) do bilinear[i][j], bicubic[i][j] = b1(u, v), b3(u, v) end
end
local plane = tb.table2 { x = gx, y = gy, z = bilinear, extrapolation = "linear" }
local surface = tb.table2 { x = gx, y = gy, z = bicubic, interpolation = "spline" }
for u = -1, 7, 0.7 do
  for v = -2, 4, 0.7 do
    near(plane(u, v), b1(u, v), 1e-13)
    if u >= 0 and u <= 6 and v >= -1 and v <= 3 then near(surface(u, v), b3(u, v), 1e-12) end
  end
end
near(tb.table2 { x = gx, y = gy, z = bilinear, extrapolation = "hold" }(9, -5), b1(6, -1), 1e-14)

-- In an equation: a spring that is a table with kinks moves as one written out by branches, whose exact solution is
-- known, and keeps its energy. The kinks are events.
local stiffness = { x = { -1, -0.25, 0.5, 1 }, y = { -4, -1, 0.5, 3 }, extrapolation = "linear" }
local spring = tb.table1(stiffness)
local function energy_of_spring(u) -- the integral of the table from 0
  local sum, at, n = 0, 0, 4000
  for _ = 1, n do
    sum = sum + (spring(at) + spring(at + u / n)) / 2 * u / n
    at = at + u / n
  end
  return sum
end
local function swinging(force)
  return tb.system {
    states = { u = 0.9, v = 0 },
    der = function(s) return { u = s.v, v = -force(s.u) } end,
  }
end
local function by_branches(u)
  local function piece(i)
    local rise, run = stiffness.y[i + 1] - stiffness.y[i], stiffness.x[i + 1] - stiffness.x[i]
    return stiffness.y[i] + (u - stiffness.x[i]) * rise / run
  end
  return tb.where(tb.less(u, -0.25), piece(1), tb.where(tb.less(u, 0.5), piece(2), piece(3)))
end
local reference = tb.run_system { system = swinging(by_branches), duration_s = 20 }
assert(reference.solver == "exact")
for _, solver in ipairs { "erk", "adams", "bdf" } do
  local run = tb.run_system { system = swinging(spring), duration_s = 20, solver = solver, relative_tolerance = 1e-10,
    absolute_tolerance = 1e-13 }
  assert(run.ok, run.message)
  near(run.final.u, reference.final.u, 1e-7, solver)
  near(run.final.v, reference.final.v, 1e-7, solver)
end
-- A held kink costs no accuracy: the step ends there. Without events the same tolerance leaves more.
local function error_of(force)
  local run = tb.run_system { system = swinging(force), duration_s = 20, solver = "erk", relative_tolerance = 1e-7 }
  return math.abs(run.final.u - reference.final.u)
end
local with, without = error_of(spring), error_of(function(u) return tb.no_event(spring(u)) end)
assert(with < 1e-6 and without > 2 * with, string.format("%g %g", with, without))
near(energy_of_spring(reference.final.u) + reference.final.v ^ 2 / 2, energy_of_spring(0.9), 1e-6)

-- The Jacobian is exact: slopes in the linear system, of both variables.
local field = tb.system {
  states = { a = 1.3, b = 0.4 },
  der = function(s) return { a = surface(s.a, 2 * s.b), b = spline(s.a * s.b) } end,
}
local linear = tb.linearize { system = field }
local function slope(f, u) return (f(u + 1e-6) - f(u - 1e-6)) / 2e-6 end
near(linear.A[1][1], slope(function(u) return b3(u, 0.8) end, 1.3), 1e-8)
near(linear.A[1][2], 2 * slope(function(v) return b3(1.3, v) end, 0.8), 1e-8)
near(linear.A[2][1], 0.4 * slope(cubic, 0.52), 1e-8)
near(linear.A[2][2], 1.3 * slope(cubic, 0.52), 1e-8)

-- Of the time, of a parameter, and in a condition.
local profile = tb.table1 { name = "profile", x = { 0, 1, 2, 4 }, y = { 0, 3, 3, -1 }, x_unit = "s", y_unit = "m/s" }
local driven = tb.system {
  parameters = { p = 0.5 },
  states = { z = { unit = "m" }, w = 0 },
  discrete = { hits = 0 },
  der = function(s) return { z = profile(s.t), w = line(s.p) } end,
  when = {
    { condition = function(s) return tb.less(profile(s.t), 0) end, set = function(s) return { hits = s.hits + 1 } end },
  },
}
local run = tb.run_system { system = driven, duration_s = 4 }
near(run.final.z, 1.5 + 3 + 2, 1e-8)
near(run.final.w, 16, 1e-9)
assert(run.final.hits == 1)
near(run.events[1].t, 3.5, 1e-12)
-- Beyond the abscissas there is no value: the run ends and says where.
run = tb.run_system { system = driven, duration_s = 5 }
assert(not run.ok and run.message:find("der(z)", 1, true), run.message)
assert(run.message:find("profile has values from 0 to 4", 1, true), run.message)
near(run.t_end, 4, 1e-6)
-- A line for each stretch of time is solved exactly; other tables of the time are not taken for one polynomial.
for _, case in ipairs {
  { "linear", "hold", "exact" }, { "linear", "linear", "exact" }, { "linear", "refuse", "erk" },
  { "spline", "hold", "erk" }, { "spline", "refuse", "erk" }, { "pchip", "linear", "erk" },
} do
  local f = tb.table1 { x = { -1, 1, 2.5, 4 }, y = { 0, 3, -3, -1 }, interpolation = case[1], extrapolation = case[2] }
  local timed = tb.system { states = { z = 0 }, der = function(s) return { z = f(s.t) } end }
  local found = tb.run_system { system = timed, duration_s = case[2] == "refuse" and 4 or 6, output_step_s = 0.5 }
  assert(found.ok and found.solver == case[3], case[1] .. found.solver .. found.message)
  local sum, n = 0, 60000
  for i = 1, n do sum = sum + f((i - 0.5) * found.t_end / n) * found.t_end / n end
  near(found.final.z, sum, 1e-6, case[1] .. case[2])
end
-- Tables belong to the equations: the state of a run with another one is refused.
local function filled(values)
  local f = tb.table1 { x = { 0, 1 }, y = values, extrapolation = "linear" }
  return tb.system { states = { q = 0 }, der = function(s) return { q = f(s.q) } end }
end
local state = tb.run_system { system = filled { 1, 2 }, duration_s = 1 }.state
tb.run_system { system = filled { 1, 2 }, duration_s = 1, resume = state }
refused("of another system", function() tb.run_system { system = filled { 1, 3 }, duration_s = 1, resume = state } end)

-- What is refused.
local function made(options) return function() tb.table1(options) end end
refused("x[3] = 1 stands behind 1, the values of x must increase", made { x = { 0, 1, 1 }, y = { 1, 2, 3 } })
refused("x[2] = -1 stands behind 0", made { x = { 0, -1, 1 }, y = { 1, 2, 3 } })
refused("x has 1 values, must have at least 2", made { x = { 0 }, y = { 1 } })
refused("x has 0 values", made { y = { 1 } })
refused("y has 3 values, must have 2, as x", made { x = { 0, 1 }, y = { 1, 2, 3 } })
refused("y[2]", made { x = { 0, 1 }, y = { 1, 0 / 0 } })
refused("x[1]", made { x = { -math.huge, 1 }, y = { 1, 2 } })
refused("interpolation = \"cubic\"", made { x = { 0, 1 }, y = { 1, 2 }, interpolation = "cubic" })
refused("extrapolation = \"none\"", made { x = { 0, 1 }, y = { 1, 2 }, extrapolation = "none" })
refused("colour is not a known field", made { x = { 0, 1 }, y = { 1, 2 }, colour = 3 })
refused("tb.table1: found a number", function() tb.table1(3) end)
refused("x = 4 lies beyond the abscissas, from 0 to 1", function() tb.table1 { x = { 0, 1 }, y = { 1, 2 } }(4) end)
refused("argument x: found a nil", function() line() end)
refused("argument y: found a nil", function() plane(1) end)
refused("z has 1 rows, must have 2", function() tb.table2 { x = { 0, 1 }, y = { 0, 1 }, z = { { 1, 2 } } } end)
refused("z[2] has 1 values, must have 2", function()
  tb.table2 { x = { 0, 1 }, y = { 0, 1 }, z = { { 1, 2 }, { 3 } } }
end)
refused("pchip\" is for tables of one variable", function()
  tb.table2 { x = { 0, 1 }, y = { 0, 1 }, z = { { 1, 2 }, { 3, 4 } }, interpolation = "pchip" }
end)
refused("profile(v) needs s, but v is in m/s", function()
  tb.system { states = { v = { unit = "m/s" } }, der = function(s) return { v = profile(s.v) } end }
end)
refused("the derivative must be in m/s2, but is in m/s", function()
  tb.system { states = { v = { unit = "m/s" } }, der = function(s) return { v = profile(s.t) } end }
end)
print("ok")
