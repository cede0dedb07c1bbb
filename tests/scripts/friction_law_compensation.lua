-- Friction laws with states in a drive: feedforward along the reference, and feedback from the detected position.
local tb = require "tribode"

local Ts, mass, omega = 5e-4, 10, 2 * math.pi * 12
local pid = { type = "pid", kp = mass * omega ^ 2, ki = mass * omega ^ 3 / 5, kd = 1.4 * mass * omega }
local laws = {
  dahl_friction = { F = 3, K = 1e5 },
  lugre_friction = { F = 3, Fs = 4, velocity = 5e-3, K = 1e5, D = 30, viscous = 10 },
  bouc_wen_friction = { F = 3, reach = 3e-5, beta = 0.7, exponent = 2 },
  gms_friction = { F = 3, Fs = 4, velocity = 5e-3, attraction = 300,
    elements = { { K = 1e5, share = 0.6 }, { K = 1e4, share = 0.4 } } },
  load_dependent_friction = { share = 0.25, reach = 3e-5 },
  leuven_friction = { F = 3, Fs = 4, velocity = 5e-3, transition = 2, D = 30,
    elements = { { K = 1e5, F = 2 }, { K = 3e4, F = 3 } } },
}
local function machine_with(name, parameters, more)
  local machine = { Ts = Ts, mass_kg = mass, controller = pid, effects = { { name = name, parameters = parameters } } }
  for key, value in pairs(more or {}) do machine[key] = value end
  return machine
end

-- ---- positioning --------------------------------------------------------------------------------------------------

-- A move with the exact feedforward of the mass. What the friction takes is left to the controller, or compensated by
-- the model along the reference, or fed back from the detected position.
local feedforward = tb.feedforward { model = { k0 = 1 / mass }, sample_time_s = Ts, distance_m = 1e-3,
  duration_s = 0.05 }
for name, parameters in pairs(laws) do
  local machine = machine_with(name, parameters)
  local function rmse(options)
    local given = { machine = machine, feedforward = feedforward, delay_s = 0, duration_s = 0.3 }
    for key, value in pairs(options) do given[key] = value end
    local result = tb.positioning(given)
    return result.rmse_m, result
  end
  local without = rmse { friction_compensation = false }
  local with, run = rmse {}
  local fed_back = rmse { friction_feedback = 0.9 }
  print(string.format("%-24s rms error %.2f um, with feedforward %.2f um, 90 %% fed back %.2f um", name, without * 1e6,
    with * 1e6, fed_back * 1e6))
  assert(with < 0.15 * without and fed_back < 0.4 * without, name)
  -- What compensates is what the machine's friction is, but for half a sample.
  local worst, largest = 0, 0
  for k = 20, 90 do
    worst = math.max(worst, math.abs(run.columns[9].values[k] - run.f[k]))
    largest = math.max(largest, math.abs(run.f[k]))
  end
  assert(run.columns[9].name == "friction_compensation_N" and worst < 0.15 * largest, name .. ": " .. worst)
end

-- ---- feedback -----------------------------------------------------------------------------------------------------

-- A share of the model is added to u. Without a law it is not; the difference of the thrusts is the model along the
-- detected position, here by the closed form of Dahl's law over steps of constant velocity.
local exc = {}
for k = 0, 600 do exc[k + 1] = 9 * math.sin(2 * math.pi * 11 * k * Ts) end
local machine = machine_with("dahl_friction", laws.dahl_friction,
  { encoder_resolution_m = 1e-7, output_delay_s = 4e-4 })
local run = tb.simulate { machine = machine, exc = exc, friction_feedback = 0.7 }
assert(run.ok, run.message)
local integral, previous_error, friction, reversals = 0, 0, 0, 0
for k = 1, #exc do
  local e = -run.y[k]
  integral = integral + pid.ki * Ts * e
  local plain = pid.kp * e + integral + pid.kd * (e - previous_error) / Ts + exc[k]
  previous_error = e
  local travel = k > 1 and run.y[k] - run.y[k - 1] or 0
  local side = travel < 0 and -1 or 1
  friction = side * 3 - (side * 3 - friction) * math.exp(-1e5 * math.abs(travel) / 3)
  assert(math.abs(run.u[k] - plain - 0.7 * friction) < 1e-3, string.format("sample %d: %g, %g", k, run.u[k] - plain,
    0.7 * friction))
  if k > 1 and (run.v[k] < 0) ~= (run.v[k - 1] < 0) then reversals = reversals + 1 end
end
assert(reversals > 4)

-- FRA-2 as an add-on, with a law alone: friction fed back leaves nearly the mass.
for _, name in ipairs { "dahl_friction", "lugre_friction", "gms_friction", "leuven_friction" } do
  local sweep = tb.sweep { machine = machine_with(name, laws[name]), frequency_hz = { 40, 70, 110 }, amplitude_N = 15,
    friction_feedback = 0.8, delay_s = Ts / 2 }
  for i, f in ipairs { 40, 70, 110 } do
    local truth = 20 * math.log(1 / (mass * (2 * math.pi * f) ^ 2), 10)
    local plain, add_on = sweep.responses["FRA-1"].gain_db[i], sweep.responses["Add-on"].gain_db[i]
    assert(math.abs(add_on - truth) < 0.6 and math.abs(add_on - truth) < math.abs(plain - truth),
      string.format("%s at %g Hz: %g, %g, %g dB", name, f, plain, add_on, truth))
  end
end

-- The friction model of the options is the one that is fed back.
local rolling = { Ts = Ts, mass_kg = mass, controller = pid, friction = { elements = { { K = 1e5, F = 3 } } } }
local half = { elements = { { K = 5e4, F = 1.5 } } }
local a = tb.positioning { machine = rolling, feedforward = feedforward, delay_s = 0, friction_feedback = 0.4 }
local b = tb.positioning { machine = rolling, feedforward = feedforward, delay_s = 0, friction_feedback = 0.8,
  friction_model = half }
for k = 1, #a.y do assert(math.abs(a.y[k] - b.y[k]) < 1e-12) end

-- Friction that takes all of the motor force cannot be compensated.
local ok, message = pcall(tb.positioning, {
  machine = machine_with("load_dependent_friction", { share = 1.2, reach = 3e-5 }), feedforward = feedforward,
  delay_s = 0, friction_compensation = true,
})
assert(not ok and message:find("of the motor force, must be less than all of it", 1, true), tostring(message))
