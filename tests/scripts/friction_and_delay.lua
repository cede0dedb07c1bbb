-- tb.fit_friction, tb.friction_force, tb.estimate_delay, tb.proposed_response and tb.delay_model_response on data in
-- closed form.
local tb = require "tribode"

local function near(found, wanted, tolerance, what)
  assert(math.abs(found - wanted) <= tolerance, string.format("%s: %.12g instead of %.12g", what, found, wanted))
end

-- Elements that slip 4 and 40 um after a reversal, found again from their own loop.
local elements = { { K = 1e6, F = 2 }, { K = 1e5, F = 2, D = 0 } }
local position = {}
for k = 1, 1001 do position[k] = 1e-4 * math.sin(2 * math.pi * (k - 1) / 400) end
local force = tb.friction_force { elements = elements, position = position }
near(force[1], 0, 0, "relaxed at the first sample")
near(force[101], 4, 1e-12, "all slip at the crest") -- rounding
local fit = tb.fit_friction {
  position = position, force = force, elements = 2, shortest_m = 4e-6, longest_m = 40e-6,
}
assert(#fit.elements == 2)
for i, element in ipairs(elements) do
  near(fit.elements[i].K / element.K, 1, 1e-9, "stiffness") -- rounding of squared regressors
  near(fit.elements[i].F / element.F, 1, 1e-9, "level")
end
near(fit.residual_max, 0, 1e-8, "residual")

-- Optimised break points come near them from a wider range.
local wide = { position = position, force = force, elements = 2, shortest_m = 1e-6, longest_m = 1e-4 }
local geometric = tb.fit_friction(wide).residual_rms
wide.break_points = "optimised"
assert(tb.fit_friction(wide).residual_rms < geometric / 4)

-- A mass behind 1 ms of delay, with friction of 10 % of the effective thrust in phase with velocity: U is
-- (1 - 0.1j) exp(jwL) per effective thrust, U - Fh is that less -0.1j.
local f = tb.linspace(100, 140, 21)
local mass = tb.model_response { model = { k0 = 0.1 }, frequency_hz = f }
local function over(thrust_of)
  local response = { frequency_hz = f, real = {}, imag = {} }
  for k = 1, #f do
    local a, b = thrust_of(2 * math.pi * f[k] * 1e-3)
    response.real[k], response.imag[k] = mass.real[k] * a / (a ^ 2 + b ^ 2), -mass.real[k] * b / (a ^ 2 + b ^ 2)
  end
  return response
end
local fra1 = over(function(w) return math.cos(w) + 0.1 * math.sin(w), math.sin(w) - 0.1 * math.cos(w) end)
local fra2 = over(function(w) return math.cos(w) + 0.1 * math.sin(w), math.sin(w) - 0.1 * math.cos(w) + 0.1 end)
local estimate = tb.estimate_delay { fra1 = fra1, fra2 = fra2, f_min_hz = 110, f_max_hz = 130, expected_s = 1e-3 }
near(estimate.delay_s, 1e-3, 1e-12, "delay") -- rounding
assert(#estimate.delays_s == 11 and estimate.frequency_hz[1] == 110 and estimate.spread_s < 1e-12)
local plant = tb.proposed_response { fra1 = fra1, fra2 = fra2, delay_s = 1e-3 }
for k = 1, #f do
  near(plant.real[k] / mass.real[k], 1, 1e-12, "plant")
  near(plant.imag[k] / mass.real[k], 0, 1e-12, "plant")
end

-- The sampled Pade approximant: all-pass, (w Ts)^2/12 of its phase too late by the bilinear transform.
local model = tb.delay_model_response { delay_s = 1.38e-3, sample_time_s = 5e-4, frequency_hz = { 20, 50, 80 } }
for k, frequency in ipairs(model.frequency_hz) do
  local w = 2 * math.pi * frequency
  near(model.gain_db[k], 0, 1e-9, "gain") -- rounding
  -- The next term of the series is (w Ts)^4/80, 5e-5 of the phase at 80 Hz.
  near(math.rad(-model.phase_deg[k]) / (w * 1.38e-3), 1 + (w * 5e-4) ^ 2 / 12, 1e-4, "phase")
end

local function refused(message, action, options)
  local ok, problem = pcall(action, options)
  assert(not ok and problem:find(message, 1, true), problem)
end
refused("1001 positions and 2 forces", tb.fit_friction, { position = position, force = { 1, 2 } })
refused("first_fitted", tb.fit_friction, { position = position, force = force, first_fitted = 1002 })
refused("elements[1].K", tb.friction_force, { elements = { { K = -1, F = 1 } }, position = position })
refused("same frequencies", tb.estimate_delay, {
  fra1 = fra1, f_min_hz = 110, f_max_hz = 130, fra2 = { frequency_hz = { 110 }, real = { 1 }, imag = { 0 } },
})
