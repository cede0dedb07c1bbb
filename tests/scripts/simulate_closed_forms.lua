-- tb.simulate against motions that are known in closed form, with every solver.
local tb = require "tribode"

local function near(found, wanted, tolerance)
  assert(math.abs(found - wanted) <= tolerance, string.format("%.17g instead of %.17g", found, wanted))
end

local function constant(value, count)
  local list = {}
  for k = 1, count do list[k] = value end
  return list
end

local function free_mass()
  local machine = tb.machine "models/bare_mass.lua"
  machine.closed_loop = false
  return machine
end

local count, thrust, k0 = 401, 3, 0.1

for _, solver in ipairs { "exact", "erk", "adams", "bdf", "fixed" } do
  -- A free mass: x = k0 u t^2 / 2 = 6 mm at the end. A hundredth of a micrometre is what the default tolerances leave
  -- of it with methods of several steps.
  local run = tb.simulate { machine = free_mass(), u = constant(thrust, count), solver = solver }
  assert(run.ok and run.message == "")
  assert(#run.x == count and #run.events == 0)
  for i, t in ipairs(run.t) do
    near(t, (i - 1) * 5e-4, 1e-15)
    near(run.x[i], k0 * thrust * t ^ 2 / 2, 1e-8)
    near(run.v[i], k0 * thrust * t, 1e-7)
    assert(run.y[i] == run.x[i] and run.u[i] == thrust and run.f[i] == 0)
  end
  assert(run.statistics.samples >= count and run.statistics.steps > 0)

  -- With viscous friction: v = u/D (1 - exp(-k0 D t)), f = D v.
  local damped, D = free_mass(), 50
  damped.friction = { viscous = D }
  run = tb.simulate { machine = damped, u = constant(thrust, count), solver = solver }
  for i, t in ipairs(run.t) do
    near(run.v[i], thrust / D * (1 - math.exp(-k0 * D * t)), 1e-7)
    near(run.f[i], D * run.v[i], 1e-12)
  end

  -- With Coulomb friction: below its level the mass sticks, above it the rest of the thrust acts.
  local sticky = free_mass()
  sticky.friction = { coulomb = 2 }
  run = tb.simulate { machine = sticky, u = constant(1.5, count), solver = solver }
  for i = 2, count do
    assert(run.x[i] == 0 and run.v[i] == 0)
    near(run.f[i], 1.5, 1e-12)
  end
  run = tb.simulate { machine = sticky, u = constant(thrust, count), solver = solver }
  for i, t in ipairs(run.t) do near(run.x[i], k0 * (thrust - 2) * t ^ 2 / 2, 1e-8) end
  assert(#run.events == 1 and run.events[1].element == 0 and run.events[1].kind == "slip_forward")
end

-- The loop of the free mass: position and velocity of a held thrust are a double sum, the controller is the
-- documented difference equation.
local machine = tb.machine "models/bare_mass.lua"
local pid, T = machine.controller, machine.Ts
local run = tb.simulate { machine = machine, r = constant(1e-3, count) }
local x, v, integral, previous = 0, 0, 0, 0
for k = 1, count do
  near(run.x[k], x, 1e-10) -- default tolerances; the motion is a parabola between samples
  local e = 1e-3 - x
  integral = integral + pid.ki * T * e
  local u = pid.kp * e + integral + pid.kd * (e - previous) / T
  previous = e
  near(run.u[k], u, 1e-3) -- kd/T = 1.8e6 N/m times the error of x, of opposite signs in two samples
  x, v = x + T * v + k0 * u * T ^ 2 / 2, v + k0 * u * T
end

-- The input is checked.
local function refused(message, options)
  local ok, text = pcall(tb.simulate, options)
  assert(not ok and text:find(message, 1, true), text)
end
refused("there is no column u", { machine = free_mass() })
refused("amplitude is not a known field", { machine = free_mass(), u = { 1 }, amplitude = 3 })
refused("u[2] = inf", { machine = free_mass(), u = { 1, math.huge } })
refused("solver = \"rk45\"", { machine = free_mass(), u = { 1, 1 }, solver = "rk45" })
refused("machine is missing", { u = { 1, 1 } })
