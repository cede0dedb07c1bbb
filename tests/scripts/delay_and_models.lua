-- tb.model_response, tb.remove_delay, tb.phase_delay and tb.fit_modal undo one another on responses in closed form.
local tb = require "tribode"

local function relative(found, wanted, tolerance)
  assert(math.abs(found / wanted - 1) <= tolerance, string.format("%.12g instead of %.12g", found, wanted))
end

local model = { k0 = 0.09, k1 = 0.013, f1_hz = 33, zeta1 = 0.025, k2 = 0.005, f2_hz = 82, zeta2 = 0.004 }
local frequencies = tb.linspace(20, 200, 181)
local response = tb.model_response { model = model, frequency_hz = frequencies }

-- k0/s^2 + sum k_j/(s^2 + 2 zeta_j w_j s + w_j^2), by hand at one frequency.
local w = 2 * math.pi * frequencies[31]
local real, imag = -model.k0 / w ^ 2, 0
for j = 1, 2 do
  local wj = 2 * math.pi * model["f" .. j .. "_hz"]
  local a, b = wj ^ 2 - w ^ 2, 2 * model["zeta" .. j] * wj * w
  real = real + model["k" .. j] * a / (a ^ 2 + b ^ 2)
  imag = imag - model["k" .. j] * b / (a ^ 2 + b ^ 2)
end
relative(response.real[31], real, 1e-12) -- rounding
relative(response.imag[31], imag, 1e-12)
relative(response.gain_db[31], 10 * math.log(real ^ 2 + imag ^ 2, 10), 1e-12)

-- A delay put in and taken out again leaves the response.
local delayed = tb.remove_delay { response = response, delay_s = -1.38e-3 }
local back = tb.remove_delay { response = delayed, delay_s = 1.38e-3 }
for i = 1, #frequencies do
  local size = math.sqrt(response.real[i] ^ 2 + response.imag[i] ^ 2)
  assert(math.abs(back.real[i] - response.real[i]) <= 1e-12 * size)
  assert(math.abs(back.imag[i] - response.imag[i]) <= 1e-12 * size)
end

-- The phase of a free mass is -180 degrees, so that eq. (18) reads a delay exactly, also between the frequencies.
local mass = tb.model_response { model = { k0 = 0.1 }, frequency_hz = frequencies }
local late = tb.remove_delay { response = mass, delay_s = -1e-3 }
for _, f in ipairs { 20, 99.5, 120, 200 } do
  relative(tb.phase_delay { response = late, at_hz = f }, 1e-3, 1e-9) -- rounding of unwrapped angles
end

-- The fit finds the model that made the response.
local fit = tb.fit_modal { response = response, modes = 2 }
assert(fit.converged, fit.message)
for name, value in pairs(model) do
  relative(fit[name], value, 1e-6) -- no noise: the error is where the iteration stops
  assert(fit.standard_errors[name] >= 0)
end

-- Gain and phase may be missing where a response is asked for; frequencies may not.
local bare = { frequency_hz = { 50, 100 }, real = { -1, -1 }, imag = { 0, 0 } }
assert(tb.remove_delay({ response = bare, delay_s = 0 }).real[2] == -1)
bare.frequency_hz[3] = 150
local ok, text = pcall(tb.remove_delay, { response = bare, delay_s = 0 })
assert(not ok and text:find("3 frequencies, 2 real", 1, true), text)
