-- tb.low_pass, tb.decimate, tb.derivative and tb.least_squares on signals of known answer: a mass and its friction come
-- back from position and force.
local tb = require "tribode"

local Ts, mass, viscous, level = 1e-3, 12, 30, 4
local q, force = {}, {}
for k = 1, 4000 do
  local t, w = (k - 1) * Ts, 2 * math.pi * 1.5
  q[k] = 0.05 * math.sin(w * t)
  local v, a = 0.05 * w * math.cos(w * t), -0.05 * w ^ 2 * math.sin(w * t)
  force[k] = mass * a + viscous * v + level * (v > 0 and 1 or -1)
end
local smooth = tb.low_pass { values = q, sample_time_s = Ts, corner_hz = 100 }
local v = tb.derivative { values = smooth, sample_time_s = Ts }
local a = tb.derivative { values = v, sample_time_s = Ts }
local sign = {}
for k = 1, #v do sign[k] = v[k] > 0 and 1 or -1 end
-- Without the ends, where differences are one-sided.
local function every_tenth(values) return tb.decimate { values = table.move(values, 101, 3900, 1, {}) } end
local fit = tb.least_squares {
  columns = { every_tenth(a), every_tenth(v), every_tenth(sign) },
  values = every_tenth(force),
}
assert(#fit.residual == 380)
for i, truth in ipairs { mass, viscous, level } do
  assert(math.abs(fit.coefficients[i] / truth - 1) < 0.01, fit.coefficients[i])
  assert(fit.standard_errors[i] > 0)
end
assert(fit.relative_error < 0.03)

local function refused(message, action, options)
  local ok, problem = pcall(action, options)
  assert(not ok and problem:find(message, 1, true), problem)
end
refused("half the sample rate", tb.low_pass, { values = q, sample_time_s = Ts, corner_hz = 500 })
refused("must be even", tb.low_pass, { values = q, sample_time_s = Ts, corner_hz = 50, order = 5 })
refused("factor", tb.decimate, { values = q, factor = 1 })
refused("two values", tb.derivative, { values = { 1 }, sample_time_s = Ts })
refused("depend on one another", tb.least_squares, { columns = { v, v }, values = force })
refused("columns must be a list of lists", tb.least_squares, { columns = { { "x" } }, values = force })

-- tb.spectrum: the response of a first-order filter, with coherence, and the power of the noise that is added.
local input, output, state = {}, {}, 0
for k = 1, 20000 do
  input[k] = tb.standard_normal(3, 1, k)
  state = 0.7 * state + 0.3 * input[k]
  output[k] = state + 0.1 * tb.standard_normal(3, 2, k)
end
local s = tb.spectrum { output = output, input = input, sample_time_s = Ts, window_samples = 512 }
assert(#s.frequency_hz == 255 and s.windows == 77 and #s.inputs == 1)
local half = s.inputs[1].h1
assert(math.abs(half.gain_db[10]) < 4 * half.std_gain_db[10] + 0.2 and half.std_gain_db[10] < 0.3)
assert(s.coherence[10] > 0.95 and s.coherence[10] > s.coherence_threshold)
assert(math.abs(s.noise_power[100] / (0.01 / 500) - 1) < 0.6)
assert(#tb.spectrum { output = output, sample_time_s = Ts }.inputs == 0)
local two = tb.spectrum { output = output, inputs = { input, output }, sample_time_s = Ts, window_samples = 512 }
assert(math.abs(two.coherence[5] - 1) < 1e-9 and not two.inputs[1].h2)
local ok, message = pcall(tb.spectrum, { output = output, input = input, inputs = { input }, sample_time_s = Ts })
assert(not ok and message:find("inputs must be a list of lists of numbers, in place of input", 1, true), message)
