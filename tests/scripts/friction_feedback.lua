-- friction_feedback of tb.sweep and tb.simulate, tb.loop_margins with friction, tb.loop_gain.
local tb = require "tribode"

local machine = tb.machine "models/linear_motor_table.lua"

local sweep = tb.sweep { machine = machine, frequency_hz = { 20, 40 }, friction_feedback = 0.8 }
assert(#sweep.responses["Add-on"].real == 2 and #sweep.loop_gain.real == 2)
assert(tb.sweep { machine = machine, frequency_hz = { 20 } }.responses["Add-on"] == nil)

-- A push makes the modeled friction act: with it fed back the table goes farther.
local push = {}
for k = 1, 200 do push[k] = k <= 40 and 12 or 0 end
local function farthest(share)
  return math.max(table.unpack(tb.simulate { machine = machine, exc = push, friction_feedback = share }.x))
end
assert(farthest(0.9) > farthest(0.5) and farthest(0.5) > farthest(0))
assert(farthest(0) == math.max(table.unpack(tb.simulate { machine = machine, exc = push }.x)))

-- Along a slow sine of the reference most of the error is what 5 N of dry friction take, and feedback lowers it.
local dry = tb.with_fields(machine, { ["friction.coulomb"] = 5 })
local slow = {}
for k = 0, 4000 do slow[k + 1] = 5e-4 * (1 - math.cos(2 * math.pi * k * dry.Ts)) end
local function error_along(share)
  local run = tb.simulate { machine = dry, r = slow, friction_feedback = share }
  local sum = 0
  for k = 2001, #slow do sum = sum + (run.r[k] - run.y[k]) ^ 2 end
  return math.sqrt(sum / 2000)
end
assert(error_along(0.5) < 0.7 * error_along(0) and error_along(0.9) < 0.8 * error_along(0.5))

-- Margins: without friction as before, stuck, and with too much fed back.
assert(tb.loop_margins { machine = machine }.stable == nil)
local stuck = tb.loop_margins { machine = machine, friction_feedback = 1, amplitude_m = 0 }
assert(stuck.stable and stuck.critical_feedback > 1 and stuck.critical_feedback < 1.01)
assert(not tb.loop_margins { machine = machine, friction_feedback = 1.2, amplitude_m = 1e-5 }.stable)
local loop = tb.loop_gain {
  machine = machine, friction_feedback = 0.5, frequency_hz = { 5, 10 }, amplitude_m = { 1e-5 },
}
assert(#loop.real == 2)

-- A cascade has margins too: its gain may be larger by the gain margin, and no more. Its loop gain is that of a sweep.
local cascade = tb.with_fields(machine, { friction = { viscous = 20 } })
cascade.controller = { type = "cascade", kp = 40, kv = 700, ki = 15 }
local margin = tb.loop_margins { machine = tb.machine(cascade), amplitude_m = 0 }
assert(margin.stable and margin.gain_margin > 1.5)
local function last_motion(factor)
  local other = tb.with_fields { machine = tb.machine(cascade), scale = { ["controller.kv"] = factor } }
  other.encoder_resolution_m = 0
  local kick = {}
  for k = 1, 1500 do kick[k] = k <= 10 and 1e-3 or 0 end
  local x = tb.simulate { machine = other, exc = kick }.x
  local early, late = 0, 0
  for k = 301, 500 do early, late = math.max(early, math.abs(x[k])), math.max(late, math.abs(x[k + 1000])) end
  return late / early
end
assert(last_motion(0.97 * margin.gain_margin) < 0.5, "smaller than the margin")
assert(last_motion(1.03 * margin.gain_margin) > 2, "beyond the margin")
cascade.friction = machine.friction
cascade = tb.machine(cascade)
local measured = tb.sweep { machine = cascade, frequency_hz = { 20, 40 } }
local response = measured.responses["FRA-1"]
for i, f in ipairs { 20, 40 } do
  -- y = Y/U U, U = A/(1 + L).
  local real, imag = 1 + measured.loop_gain.real[i], measured.loop_gain.imag[i]
  local amplitude = 15 / math.sqrt(real ^ 2 + imag ^ 2) * math.sqrt(response.real[i] ^ 2 + response.imag[i] ^ 2)
  local described = tb.loop_gain { machine = cascade, frequency_hz = { f }, amplitude_m = { amplitude } }
  local error = math.sqrt((described.real[1] + 1 - real) ^ 2 + (described.imag[1] - imag) ^ 2)
  assert(error < 0.05 * math.sqrt(real ^ 2 + imag ^ 2), error)
end
assert(not tb.loop_margins { machine = cascade, friction_feedback = 2, amplitude_m = 1e-5 }.stable)

local function refused(text, call, options)
  local ok, message = pcall(call, options)
  assert(not ok and tostring(message):find(text, 1, true), tostring(message))
end
refused("amplitude_m", tb.loop_margins, { machine = machine, friction_feedback = 1 })
refused("must be one", tb.loop_gain, { machine = machine, frequency_hz = { 5, 10 }, amplitude_m = { 1, 2, 3 } })
refused("friction_feedback", tb.sweep, { machine = machine, frequency_hz = { 20 }, friction_feedback = -1 })
refused("open loop", tb.simulate, { machine = machine, u = push, friction_feedback = 1 })
