-- The linear-motor-driven table of the paper, written as a system: rigid body with two modes, twenty friction elements,
-- amplifier, encoder and PID controller of models/linear_motor_table.lua. The equations stand in models/servo.
--
-- Inputs: r [m], exc [N]. It moves as the built-in machine does.
local tb = require "tribode"
local servo = require "servo"

return servo.wire(servo.parts(tb.machine "models/linear_motor_table.lua"))
