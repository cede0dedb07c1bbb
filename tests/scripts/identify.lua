-- Joint estimation: the parameters of a simulated machine from its log, within three standard errors.
local tb = require "tribode"

local machine = tb.machine {
  Ts = 5e-4, rigid_gain_per_kg = 0.1, input_delay_s = 3e-4, encoder_resolution_m = 1e-7, noise_rms_m = 1e-7,
  modes = { { gain = 0.02, freq_hz = 35, zeta = 0.02 } },
  friction = { viscous = 10, elements = { { K = 2e4, F = 2 } } },
  controller = { type = "pid", kp = 2e4, ki = 1e5, kd = 600 },
}
local excitation = tb.multisine {
  sample_time_s = machine.Ts, period_s = 2, periods = 3, f_max_hz = 100, amplitude_N = 60,
}
local reference = {}
for k = 1, #excitation.values do reference[k] = 5e-3 * math.sin(2 * math.pi * (k - 1) * machine.Ts) end
local run = tb.simulate { machine = machine, r = reference, exc = excitation.values, seed = 1 }

local start = tb.with_fields {
  machine = machine, fields = { encoder_resolution_m = 2e-7 },
  scale = { rigid_gain_per_kg = 1.1, ["modes[1].freq_hz"] = 0.98, ["modes[1].zeta"] = 0.5, ["friction.viscous"] = 2 },
}
local found = tb.identify { machine = start, records = { { u = run.u, y = run.y } } }
assert(found.converged and #found.notes == 0 and found.iterations <= 40)
assert(#found.parameters == 7 and #found.covariance == 7 and #found.covariance[1] == 7)
assert(#found.residuals == 1 and #found.residuals[1] == #run.y and found.residual_rms_m[1] < 2e-6)
local truth = {
  rigid_gain_per_kg = 0.1, ["modes[1].gain"] = 0.02, ["modes[1].freq_hz"] = 35, ["modes[1].zeta"] = 0.02,
  ["friction.viscous"] = 10, ["friction.elements[1]"] = 2, input_delay_s = 3e-4,
}
for i, parameter in ipairs(found.parameters) do
  local wanted, error = truth[parameter.name], parameter.standard_error
  assert(math.abs(parameter.value - wanted) < 3.5 * error, parameter.name)
  assert(error < 0.01 * wanted, parameter.name)
  assert(math.abs(found.covariance[i][i] / error ^ 2 - 1) < 1e-9)
end
assert(found.machine.modes[1].freq_hz == found.parameters[3].value and found.parameters[3].start == 0.98 * 35)
assert(found.machine.encoder_resolution_m == 2e-7)

-- What was found is a start for more; a structure that is right has the lower objective.
local without = tb.with_fields(found.machine, {})
without.modes = nil
local records = { { u = run.u, y = run.y } }
local worse = tb.identify { machine = without, records = records, iterations = 5 }
assert(worse.objective > found.objective + 1000)

local ok, text = pcall(tb.identify, { machine = start, records = records, parameters = { "mode" } })
assert(not ok and text:find("no number of the machine", 1, true), text)

-- Noise that comes with the excitation: nearly all that the record tells of the parameters is in its noisy part.
-- Standard errors that count on the same noise everywhere are half as large.
for k = 2400, #excitation.values do excitation.values[k] = 0 end
local bare = tb.with_fields(machine, { friction = { viscous = 10 }, encoder_resolution_m = 0, noise_rms_m = 0 })
run = tb.simulate { machine = bare, exc = excitation.values }
local state = 7
local function uniform()
  state = state * 48271 % 2147483647
  return state / 2147483647
end
local parameters = { "rigid_gain_per_kg", "modes", "friction.viscous" }
local sum, count = 0, 0
for _ = 1, 20 do
  local y = {}
  for k = 1, #run.y do y[k] = run.y[k] + (uniform() - 0.5) * (k < 2500 and 2e-6 or 1e-7) end
  found = tb.identify { machine = bare, records = { { u = run.u, y = y } }, parameters = parameters }
  for _, parameter in ipairs(found.parameters) do
    sum = sum + ((parameter.value - truth[parameter.name]) / parameter.standard_error) ^ 2
    count = count + 1
  end
end
print(string.format("Errors in standard errors, rms: %.3g", math.sqrt(sum / count)))
assert(count == 100 and math.sqrt(sum / count) < 2.3)
