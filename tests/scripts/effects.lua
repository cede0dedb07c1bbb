-- Effects in scripts: the list of kinds, a machine with one, and a force written in Lua beside the ready one.
local tb = require "tribode"

local kinds, ripple = tb.effects {}, nil
assert(#kinds >= 24, #kinds)
for _, kind in ipairs(kinds) do
  assert(kind.equation ~= "" and #kind.parameters > 0 and type(kind.affine) == "boolean", kind.name)
  if kind.name == "force_ripple" then ripple = kind end
end
assert(ripple and not ripple.affine and ripple.drawn_against == "position")
assert(ripple.parameters[1].fields[2].unit == "m")

local thrust = {}
for k = 1, 301 do thrust[k] = 20 * math.sin(2 * math.pi * 10 * (k - 1) * 5e-4) end
local function run(effects, solver)
  return tb.simulate { machine = { rigid_gain_per_kg = 0.1, effects = effects }, u = thrust, solver = solver }
end

-- The same force by the same method: only the rounding of the two ways to write it down differs.
local ready = run({ { name = "force_ripple", parameters = { harmonics = { { F = 3, period_m = 1e-3 } } } } }, "erk")
local own = run({ { name = "own_force", parameters = { force = "return F * math.sin(2 * math.pi * y / period)",
  constants = { F = 3, period = 1e-3 } } } }, "erk")
for k = 1, #thrust do assert(math.abs(ready.x[k] - own.x[k]) < 1e-11, k) end

-- A state of its own: flux' = v, so that flux is y and the force a spring.
local spring = run({ { name = "spring_force", parameters = { k = 500 } } }, "erk")
own = run({ { name = "own_force", parameters = { force = "return -500 * flux", states = { "flux" },
  rates = "return v" } } }, "erk")
for k = 1, #thrust do assert(math.abs(spring.x[k] - own.x[k]) < 1e-10, k) end

local function refused(effects, ...)
  local ok, text = pcall(run, effects, "exact")
  assert(not ok)
  for _, part in ipairs { ... } do assert(text:find(part, 1, true), text) end
end
refused({ { name = "own_force", parameters = { force = "return 0" } } }, "exact", "own_force")
refused({ { name = "own_force", parameters = { force = "return nothing.here" } } }, "own_force.force:1:", "nothing")
refused({ { name = "own_force", parameters = { force = "return 'no'" } } }, "must return 1 number")
refused({ { name = "own_force", parameters = { force = "while true do end" } } }, "instructions")
refused({ { name = "own_force", parameters = { force = "return 0", states = { "2x" } } } }, "2x")
refused({ { name = "forse_ripple", parameters = {} } }, "did you mean \"force_ripple\"?")
local play = { name = "backlash", parameters = { gap_m = 1e-5, load_fraction = 0.5, contact_hz = 100,
  contact_zeta = 0.1, sensor = "motor" } }
refused({ play, play }, "backlash can be there only once")
local with_shares = { F = 3, Fs = 4, velocity = 5e-3, attraction = 300,
  elements = { { K = 1e5, share = 0.5 }, { K = 1e4, share = 0.4 } } }
refused({ { name = "gms_friction", parameters = with_shares } },
  "the shares of the elements sum up to 0.9, must sum up to 1")
local leuven = { F = 3, Fs = 4, velocity = 5e-3, elements = { { K = 1e5, F = 2 }, { K = 1e4, F = 1.5 } } }
refused({ { name = "leuven_friction", parameters = leuven } },
  "the levels of the elements sum up to 3.5 N, must reach Fs = 4 N")
leuven.elements[2].F, leuven.transition = 2, 0.5
refused({ { name = "leuven_friction", parameters = leuven } }, "transition = 0.5, must be 1 or more")
