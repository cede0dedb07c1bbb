-- tb.machine: ready machines, arguments of a machine file, and machines that a script has changed.
local tb = require "tribode"

local function near(found, wanted, tolerance)
  assert(math.abs(found - wanted) <= tolerance, string.format("%.17g instead of %.17g", found, wanted))
end

local mass = tb.machine "models/bare_mass.lua"
assert(mass.rigid_gain_per_kg == 0.1)
assert(mass.friction == nil)

-- The argument reaches the file: "printed" takes the friction of Table II as it stands, "halved" half of it.
local file = "models/linear_motor_table.lua"
local halved, printed = tb.machine(file), tb.machine { file = file, argument = { table_ii = "printed" } }
assert(#halved.friction.elements == 20)
for i, element in ipairs(halved.friction.elements) do
  assert(2 * element.F == printed.friction.elements[i].F)
  assert(element.K == printed.friction.elements[i].K)
end
local fast = tb.machine { file = file, argument = { loop_hz = 18 } }
near(fast.controller.kp / halved.controller.kp, (18 / 7) ^ 2, 1e-12) -- rounding

local ok, text = pcall(tb.machine, { file = file, argument = { table_ii = "doubled" } })
assert(not ok and text:find("doubled", 1, true) and text:find("halved", 1, true), text)

-- What the plant is: the parameters of the description, under the names of the paper.
local plant = tb.plant_parameters { machine = halved }
assert(plant.k0 == 94.28e-3 and plant.k1 == 13.08e-3 and plant.f1_hz == 33.32 and plant.zeta1 == 2.48e-2)
assert(plant.k2 == 5.27e-3 and plant.f2_hz == 82.22 and plant.zeta2 == 3.22e-3)
assert(plant.k3 == nil)

-- A changed field counts; the file's machine stays as it is.
mass.rigid_gain_per_kg = 0.2
local response = tb.plant_response { machine = mass, frequency_hz = { 10 } }
local w = 2 * math.pi * 10
near(response.real[1], -0.2 / w ^ 2, 1e-18) -- -k0/w^2 = -5e-5 m/N; rounding
near(response.imag[1], 0, 1e-18)
near(response.gain_db[1], 20 * math.log(0.2 / w ^ 2, 10), 1e-10)
near(math.abs(response.phase_deg[1]), 180, 1e-10)
assert(tb.machine("models/bare_mass.lua").rigid_gain_per_kg == 0.1)

-- A machine need not come from a file, and each is checked where it is used.
local own = { rigid_gain_per_kg = 0, modes = { { gain = 0.1, freq_hz = 20, zeta = 0.1 } }, comment = "a spring" }
assert(tb.plant_parameters({ machine = own }).k1 == 0.1)
own.modes[1].zeta = -0.1
ok, text = pcall(tb.plant_parameters, { machine = own })
assert(not ok and text:find("modes[1].zeta = -0.1", 1, true), text)

-- The mass in place of its inverse.
do
  tb.write_json { file = "mass.json", value = { mass_kg = 12.5, Ts = 1e-3 } }
  for _, machine in ipairs { tb.machine "out/mass.json", tb.machine { mass_kg = 12.5, Ts = 1e-3 } } do
    assert(machine.rigid_gain_per_kg == 0.08 and machine.Ts == 1e-3 and not machine.mass_kg)
  end
  assert(tb.plant_parameters({ machine = { mass_kg = 12.5 } }).k0 == 0.08)
  local function refused(message, machine)
    local went, problem = pcall(tb.simulate, { machine = machine, u = { 0, 1 } })
    assert(not went and tostring(problem):find(message, 1, true), problem)
  end
  refused("must be one of them", { mass_kg = 12.5, rigid_gain_per_kg = 0.08 })
  refused("mass_kg = 0 kg, must be positive", { mass_kg = 0 })
  refused("must be positive", { mass_kg = -3 })
end
