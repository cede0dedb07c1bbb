-- tb.compare: a mass under a held sine, where everything is known, and the checks of its input.
local tb = require "tribode"

local mass = { rigid_gain_per_kg = 0.1 }
local u = {}
for k = 1, 400 do u[k] = math.sin(2 * math.pi * 10 * (k - 1) * 5e-4) end

local c = tb.compare { machine = mass, u = u, divisions = { 1, 10 }, tolerances = { 1e-8 } }
local names = {}
for i, method in ipairs(c.methods) do
  names[i] = method.name
  assert(method.ok and method.seconds > 0)
  assert(method.events_found == 0 and method.events_missed == 0 and method.events_extra == 0)
  assert(method.rms_difference <= method.max_difference)
  assert(c.text:find("\n" .. method.name .. " ", 1, true), method.name)
end
assert(table.concat(names, ", ") ==
  "erk 1e-08, adams 1e-08, bdf 1e-08, fixed 500 us, fixed 50 us, euler 500 us, euler 50 us, " ..
  "semi_implicit_euler 500 us, semi_implicit_euler 50 us, zoh 500 us, zoh 50 us", table.concat(names, ", "))

-- Under a constant thrust in each step Euler's velocity is exact, and its position lacks h v/2 in all: half a step.
local run = tb.simulate { machine = mass, u = u }
local function largest_lack(h)
  local largest = 0
  for k = 1, #u do largest = math.max(largest, math.abs(h * run.v[k] / 2)) end
  return largest
end
for i, h in pairs { [6] = 5e-4, [7] = 5e-5, [8] = 5e-4, [9] = 5e-5 } do
  local found = c.methods[i].max_difference
  assert(math.abs(found / largest_lack(h) - 1) < 1e-6, c.methods[i].name .. " " .. found) -- rounding
end
assert(c.methods[10].max_difference < 1e-15) -- the hold is exact here

-- 0.9 deg are half of 500 us at 10 Hz.
local delay_told = false
for _, finding in ipairs(c.findings) do
  delay_told = delay_told or finding:find("euler 500 us turns the position at 10 Hz by -0.900 deg", 1, true) == 1
end
assert(delay_told, table.concat(c.findings, "\n"))

-- The same delay as a number, and the fields beside it.
assert(math.abs(c.excitation_hz - 10) < 1e-6 and c.reference == "exact") -- 1e-6: where the search for it ends
assert(math.abs(c.methods[6].phase_error_deg + 0.9) < 1e-3, c.methods[6].phase_error_deg)
assert(math.abs(c.methods[6].gain_error) < 1e-3, c.methods[6].gain_error) -- half a step of delay is (w h)^2/8 of gain
assert(c.methods[6].steps == #u - 1 and c.methods[6].derivative_evaluations >= #u - 1)
assert(c.methods[6].stable_stiffness < c.methods[7].stable_stiffness)
assert(c.methods[1].stable_stiffness == nil and not c.methods[1].diverged)

-- Its files lie in the run folder; the test runs this script with the run folder `out`.
local first = assert(io.open("out/comparison.csv")):read("l")
assert(first:find("method,tolerance,step_s,completed,max_difference_m", 1, true) == 1, first)
for _, name in ipairs { "cost.csv", "findings.txt", "trajectories.png", "work_precision.svg" } do
  assert(io.open("out/" .. name)):close()
end

-- In closed loop, with no method but the reference.
local none = tb.compare {
  machine = tb.machine "models/bare_mass.lua", r = u, divisions = {}, tolerances = {},
}
assert(#none.methods == 0 and none.excitation_hz and none.text:find("\nexact ", 1, true))

-- The input is checked.
local function refused(message, options)
  local ok, text = pcall(tb.compare, options)
  assert(not ok and text:find(message, 1, true), text)
end
refused("there is no column u", { machine = mass })
refused("need a controller", { machine = mass, r = u })
refused("did you mean \"divisions\"?", { machine = mass, u = u, division = { 1 } })
refused("divisions", { machine = mass, u = u, divisions = { 1.5 } })
refused("tolerances", { machine = mass, u = u, tolerances = { 0 } })
refused("machine is missing", { u = u })
