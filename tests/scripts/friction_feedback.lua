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

-- Margins: without friction as before, stuck, and with too much fed back.
assert(tb.loop_margins { machine = machine }.stable == nil)
local stuck = tb.loop_margins { machine = machine, friction_feedback = 1, amplitude_m = 0 }
assert(stuck.stable and stuck.critical_feedback > 1 and stuck.critical_feedback < 1.01)
assert(not tb.loop_margins { machine = machine, friction_feedback = 1.2, amplitude_m = 1e-5 }.stable)
local loop = tb.loop_gain {
  machine = machine, friction_feedback = 0.5, frequency_hz = { 5, 10 }, amplitude_m = { 1e-5 },
}
assert(#loop.real == 2)

local function refused(text, call, options)
  local ok, message = pcall(call, options)
  assert(not ok and tostring(message):find(text, 1, true), tostring(message))
end
refused("amplitude_m", tb.loop_margins, { machine = machine, friction_feedback = 1 })
refused("must be one", tb.loop_gain, { machine = machine, frequency_hz = { 5, 10 }, amplitude_m = { 1, 2, 3 } })
refused("friction_feedback", tb.sweep, { machine = machine, frequency_hz = { 20 }, friction_feedback = -1 })
refused("open loop", tb.simulate, { machine = machine, u = push, friction_feedback = 1 })
