-- tb.feedforward, tb.positioning, tb.loop_margins and tb.read_json: what they return and what they refuse.
local tb = require "tribode"

local model = { k0 = 94.28e-3, k1 = 13.08e-3, f1_hz = 33.32, zeta1 = 2.48e-2 }
local feedforward = tb.feedforward { model = model, duration_s = 0.04, horizon_s = 0.1, frequency_hz = { 10, 20 } }
assert(feedforward.method == "deadbeat" and feedforward.distance_m == 5e-4)
assert(#feedforward.reference_m == 201 and #feedforward.thrust_N == 201)
assert(math.abs(feedforward.reference_m[81] - 5e-4) < 1e-15) -- the sample of 40 ms; rounding
assert(#feedforward.response.gain_db == 2)

-- A feedforward of one's own: nothing moves, nothing is missed.
local machine = tb.machine { file = "models/linear_motor_table.lua", argument = { loop_hz = 18 } }
local still = { sample_time_s = 5e-4, distance_m = 1e-3, duration_s = 0.01, reference_m = { 0, 0 },
  thrust_N = { 0, 0 } }
local rest = tb.positioning { machine = machine, feedforward = still, duration_s = 0.05 }
assert(rest.rmse_m == 0 and rest.peak_thrust_N == 0 and rest.within_rating and rest.settling_s == nil)
assert(#rest.t == 101 and #rest.error == 101 and rest.error[1] == -1e-3 and #rest.columns[1].values == 101)

local margins = tb.loop_margins { machine = machine }
assert(margins.phase_margin_deg > 30 and margins.gain_margin > 2 and margins.modulus_margin > 0.5)

tb.write_json { file = "model.json", value = model }
local run_folder = "out/"
local again = tb.read_json { file = run_folder .. "model.json" }
for key, value in pairs(model) do assert(again[key] == value, key) end

local function refused(message, action, options)
  local ok, problem = pcall(action, options)
  assert(not ok and tostring(problem):find(message, 1, true), problem)
end
refused("did you mean \"distance_m\"?", tb.feedforward, { model = model, distance = 1 })
refused("must be one of", tb.feedforward, { model = model, method = "fast" })
refused("must be 4 or more", tb.feedforward, { model = model, duration_s = 1e-3 })
refused("has no controller", tb.positioning, { machine = { rigid_gain_per_kg = 0.1 }, feedforward = feedforward })
machine.Ts = 1e-3
refused("must be the machine's 0.001 s", tb.positioning, { machine = machine, feedforward = feedforward })
refused("/etc/hostname", tb.read_json, { file = "/etc/hostname" })

-- A cascade with dry friction: the feedforward of friction, of Stribeck's and of velocity each lower the error.
local axis = tb.machine "models/ball_screw_axis.lua"
local stage = { k0 = axis.rigid_gain_per_kg }
local move = tb.feedforward {
  model = stage, sample_time_s = axis.Ts, distance_m = 5e-3, duration_s = 0.2, horizon_s = 0.4,
}
local function error_of(moved, options)
  local task = { machine = moved, feedforward = move, duration_s = 0.4, delay_s = 0, rated_thrust_N = 1e3 }
  for name, value in pairs(options) do task[name] = value end
  return tb.positioning(task).rmse_m
end
local both = error_of(axis, {})
assert(both < 0.3 * error_of(axis, { friction_compensation = false }), "friction")
assert(both < 0.3 * error_of(axis, { velocity_feedforward = 0 }), "velocity")
local sticky = tb.with_fields(axis, { ["friction.stribeck"] = { static = 35, velocity = 0.005 } })
local coulomb_only = { friction_model = axis.friction }
assert(error_of(sticky, {}) < 0.8 * error_of(sticky, coulomb_only), "Stribeck")
assert(tb.loop_margins { machine = axis }.phase_margin_deg > 20)
