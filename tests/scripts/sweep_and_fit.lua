-- A sweep of the bare mass measures the held double integrator, and the fit recovers its mass.
local tb = require "tribode"

local function relative(found, wanted, tolerance)
  assert(math.abs(found / wanted - 1) <= tolerance, string.format("%.9g instead of %.9g", found, wanted))
end

local machine = tb.machine "models/bare_mass.lua"
local k0, T = machine.rigid_gain_per_kg, machine.Ts
local sweep = tb.sweep { machine = machine, frequency_hz = tb.linspace(20, 200, 10), delay_s = T / 2 }
assert(#sweep.warnings == 0, sweep.warnings[1])

-- Hold and double integrator: H(z) = k0 T^2 (z + 1) / (2 (z - 1)^2) at z = exp(jwT), which is a gain of
-- k0 T^2 cos(wT/2) / (4 sin(wT/2)^2) and the phase -180 deg - wT/2. Settled to 2e-3 means better than that here.
local response = sweep.responses["FRA-1"]
for i, f in ipairs(response.frequency_hz) do
  local half = math.pi * f * T
  local gain = k0 * T ^ 2 * math.cos(half) / (4 * math.sin(half) ^ 2)
  relative(math.sqrt(response.real[i] ^ 2 + response.imag[i] ^ 2), gain, 2e-3)
  relative(response.gain_db[i], 20 * math.log(gain, 10), 2e-3)
  local phase = -180 - math.deg(half)
  assert(math.abs((response.phase_deg[i] - phase + 180) % 360 - 180) < 0.1, response.phase_deg[i])
  -- Without friction its estimate is nothing.
  assert(response.real[i] == sweep.responses["FRA-2"].real[i])
  assert(response.imag[i] == sweep.responses["FRA-2"].imag[i])
end

-- The hold is a delay of T/2: eq. (18) reads it from the phase, and the delay model takes it out but for the bend of
-- the bilinear transform, tan(wT/2) - wT/2.
relative(tb.phase_delay { response = response, at_hz = 120 }, T / 2, 2e-3)
local proposed = sweep.responses["Proposed"]
for i, f in ipairs(proposed.frequency_hz) do
  local bend = math.tan(math.pi * f * T) - math.pi * f * T
  assert(math.abs(proposed.imag[i] / proposed.real[i] - bend) < 2e-3)
end

-- The gain of the held integrator is that of 1/s^2 times cos(x) (x/sin x)^2, x = wT/2: 2 % less at 200 Hz, and the
-- lower frequencies count as much, so within 2 % in all.
local fit = tb.fit_modal { response = proposed, modes = 0 }
relative(fit.k0, k0, 0.02)
assert(fit.k1 == nil and fit.converged)

-- The columns are those of the responses.
local columns = {}
for _, column in ipairs(sweep.columns) do columns[column.name] = column end
assert(columns.frequency_hz.unit == "Hz" and #columns.frequency_hz.values == 10)
assert(columns.fra1_real_m_per_N.values[3] == response.real[3])
for _, settled in ipairs(columns.settled.values) do assert(settled == 1) end

-- One frequency alone: whole periods of the settled signals.
local signals = tb.single_frequency { machine = machine, excitation_hz = 50, periods = 2, delay_s = T / 2 }
for _, name in ipairs { "t", "r", "u", "y", "x", "v", "f", "delayed_thrust", "friction_estimate",
  "effective_thrust" } do
  assert(#signals[name] == #signals.t, name)
end
local span = signals.t[#signals.t] - signals.t[1]
assert(math.abs(span - 2 / 50) <= 2 * T, span)
for i = 1, #signals.t do
  assert(signals.friction_estimate[i] == 0 and signals.effective_thrust[i] == signals.delayed_thrust[i])
end

-- What a sweep refuses.
local function refused(message, options)
  local ok, text = pcall(tb.sweep, options)
  assert(not ok and text:find(message, 1, true), text)
end
refused("at least one frequency", { machine = machine })
refused("0.45 of the sampling rate", { machine = machine, frequency_hz = { 20, 1000 } })
refused("amplitude_N = 0", { machine = machine, frequency_hz = { 20 }, amplitude_N = 0 })
local open = tb.machine "models/bare_mass.lua"
open.controller = nil
refused("controller", { machine = open, frequency_hz = { 20 } })
