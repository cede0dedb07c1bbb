-- A multisine for a drive, a log as the drive might leave it, and the frequency response that it holds.
local tb = require "tribode"

local machine = tb.machine "models/linear_motor_table.lua"

-- The excitation: odd lines from 10 to 200 Hz, one in four left out to detect distortion.
-- Add it to the thrust reference.
local excitation = tb.multisine { sample_time_s = machine.Ts, period_s = 2, periods = 4, amplitude_N = 30 }

-- The log. Here a simulated machine makes it.
machine.noise_rms_m = 0.1e-6
local run = tb.simulate { machine = machine, exc = excitation.values }
tb.write_csv {
  file = "log.csv",
  columns = {
    { name = "t", unit = "s", values = run.t },
    { name = "exc", unit = "N", values = excitation.values },
    { name = "u", unit = "N", values = run.u },
    { name = "y", unit = "m", values = run.y },
  },
}

-- The response, with report, in the folder fra.
local log = { exc = excitation.values, u = run.u, y = run.y }
local fra = tb.fra { machine = machine, records = { log }, report = "fra" }
print(fra.text)
