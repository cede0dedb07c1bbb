-- tb.fra on the log of another program: a drive, its loop and its machine integrated here, by the classical Runge-Kutta
-- method with small steps, and written as a CSV file. The response is that of the plant to what noise and rounding
-- allow, with friction from the machine file; tb.identify finds the parameters.
local tb = require "tribode"

local Ts, delay, steps = 5e-4, 7.5e-4, 40 -- the delay of the thrust: one and a half samples
local k0, k1, omega, zeta = 0.1, 0.03, 2 * math.pi * 60, 0.02
local K, F, viscous = 2e5, 3, 12
local resolution, noise = 2e-8, 1e-8

-- Random numbers of its own (Park and Miller), uniform; twelve of them are nearly normal.
local state = 12345
local function uniform()
  state = state * 48271 % 2147483647
  return state / 2147483647
end
local function normal()
  local sum = -6
  for _ = 1, 12 do sum = sum + uniform() end
  return sum
end

-- Odd lines from 9 to 151 Hz with random phases, some left out, periods of one second.
local period, periods = math.floor(1 / Ts + 0.5), 5
local lines = {}
for line = 9, 151, 2 do
  if line % 8 ~= 3 then lines[#lines + 1] = { line = line, phase = 2 * math.pi * uniform() } end
end
local exc = {}
for k = 1, period * periods do
  local sum = 0
  for _, one in ipairs(lines) do sum = sum + math.cos(2 * math.pi * one.line * (k - 1) / period + one.phase) end
  exc[k] = 6 * sum
end

-- State: position and velocity of the rigid body and of the mode, deflection of the element (a spring that slips).
local s = { 0, 0, 0, 0, 0 }
local function rates(at, thrust)
  local v = at[2] + at[4]
  local z = at[5]
  local sticks = math.abs(K * z) < F or K * z * v < 0
  local force = thrust - math.max(-F, math.min(F, K * z)) - viscous * v
  return { at[2], k0 * force, at[4], k1 * force - 2 * zeta * omega * at[4] - omega ^ 2 * at[3], sticks and v or 0 }
end
local h = Ts / steps
local function step(thrust)
  local sum, at = { 0, 0, 0, 0, 0 }, s
  for stage, weight in ipairs { 1, 2, 2, 1 } do
    local d = rates(at, thrust)
    local reach = ({ 0.5, 0.5, 1, 0 })[stage] * h
    at = {}
    for i = 1, 5 do
      sum[i] = sum[i] + weight * d[i]
      at[i] = s[i] + reach * d[i]
    end
  end
  local next_state = {}
  for i = 1, 5 do next_state[i] = s[i] + h / 6 * sum[i] end
  next_state[5] = math.max(-F / K, math.min(F / K, next_state[5]))
  s = next_state
end

-- The loop: a slow sine as the reference, proportional and by the difference of two positions.
local t, r, u, y = {}, {}, {}, {}
for k = 1, #exc do
  t[k], r[k] = (k - 1) * Ts, 4e-3 * math.sin(2 * math.pi * (k - 1) * Ts)
  y[k] = math.floor((s[1] + s[3] + noise * normal()) / resolution + 0.5) * resolution
  u[k] = 4e3 * (r[k] - y[k]) - 400 * (y[k] - (y[k - 1] or y[k])) / Ts + exc[k]
  for i = 1, steps do
    local arrived = k - 1 + (i - 0.5) / steps - delay / Ts -- in samples
    step(arrived < 0 and 0 or u[math.floor(arrived) + 1])
  end
end
tb.write_csv {
  file = "log.csv",
  columns = {
    { name = "t", unit = "s", values = t }, { name = "exc", unit = "N", values = exc },
    { name = "u", unit = "N", values = u }, { name = "y", unit = "m", values = y },
  },
}

local machine = tb.machine {
  Ts = Ts, rigid_gain_per_kg = k0, input_delay_s = delay, encoder_resolution_m = resolution,
  modes = { { gain = k1, freq_hz = 60, zeta = zeta } },
  friction = { viscous = viscous, elements = { { K = K, F = F } } },
}
local fra = tb.fra { machine = machine, records = { "log.csv" }, fit_min_hz = 9, fit_max_hz = 151 }
local response = fra.responses.improved
local plant = tb.plant_response { machine = machine, frequency_hz = response.frequency_hz }
assert(#response.frequency_hz == #lines)
local within, largest, plain = 0, 0, 0
for i = 1, #response.frequency_hz do
  local function distance(other)
    local re, im, pr, pi = other.real[i], other.imag[i], plant.real[i], plant.imag[i]
    return math.sqrt(((re - pr) ^ 2 + (im - pi) ^ 2) / (pr ^ 2 + pi ^ 2))
  end
  local own = distance(response)
  -- Gain and phase have each the half of the variance.
  local error = response.std_gain_db[i] * math.log(10) / 20 * math.sqrt(2)
  largest, plain = math.max(largest, own), math.max(plain, distance(fra.responses.fra1))
  if own < 2 * error then within = within + 1 end
  assert(own < 5 * error + 1e-3, string.format("%g Hz: %g, %g", response.frequency_hz[i], own, error))
end
print(string.format("%d of %d frequencies within two standard errors; largest distance %.2g %%, of FRA-1 %.2g %%",
  within, #lines, 100 * largest, 100 * plain))
assert(within >= 0.8 * #lines and largest < 0.02 and plain > 0.1)
local fit = fra.fits.improved
for _, one in ipairs {
  { fit.k0, fit.standard_errors.k0, k0 }, { fit.modes[1].gain, fit.standard_errors.modes[1].gain, k1 },
  { fit.modes[1].freq_hz, fit.standard_errors.modes[1].freq_hz, 60 },
  { fit.modes[1].zeta, fit.standard_errors.modes[1].zeta, zeta },
} do
  print(string.format("%.6g, truth %.6g, %.1f standard errors", one[1], one[3], (one[1] - one[3]) / one[2]))
  assert(math.abs(one[1] - one[3]) < 4 * one[2] and math.abs(one[1] / one[3] - 1) < 0.01)
end

-- All parameters at once, from a start that is wrong.
local start = tb.with_fields {
  machine = machine,
  scale = {
    rigid_gain_per_kg = 1.1, ["modes[1].freq_hz"] = 0.97, ["modes[1].zeta"] = 2, ["friction.elements[1].F"] = 1.2,
    ["friction.viscous"] = 0.6, input_delay_s = 0.8,
  },
}
local found = tb.identify {
  machine = start, records = { "log.csv" },
  parameters = { "rigid_gain_per_kg", "modes", "friction.viscous", "friction.elements[1].F", "friction.elements[1].K",
    "input_delay_s" },
}
local truth = {
  rigid_gain_per_kg = k0, ["modes[1].gain"] = k1, ["modes[1].freq_hz"] = 60, ["modes[1].zeta"] = zeta,
  ["friction.viscous"] = viscous, ["friction.elements[1].F"] = F, ["friction.elements[1].K"] = K, input_delay_s = delay,
}
for _, one in ipairs(found.parameters) do
  local wanted = truth[one.name]
  print(string.format("%-24s %.6g, truth %.6g, %.1f standard errors", one.name, one.value, wanted,
    (one.value - wanted) / one.standard_error))
  assert(math.abs(one.value - wanted) < 4 * one.standard_error and one.standard_error < 0.02 * wanted, one.name)
end
