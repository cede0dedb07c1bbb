-- Why is a run slow, or why does it end? Counts of the work, and a run that chatters.
local tb = require "tribode"

-- A run and its counts.
local oscillator = require "systems.van_der_pol"
local run = tb.run_system { system = oscillator, duration_s = 20 }
local counts = run.statistics
print(string.format("%s: %d steps, %d rejected, %d evaluations of the derivative, %d of the guards, %d events",
  run.solver, counts.steps, counts.rejected_steps, counts.derivative_evaluations, counts.guard_evaluations,
  counts.events))
tb.write_json { file = "counts.json", value = counts }

-- A relay without hysteresis switches ever faster: the message names what chatters.
local relay = tb.system {
  states = { x = 1 },
  der = function(s) return { x = -tb.where(tb.greater(s.x, 0), 1, -1) } end,
}
print(tb.run_system { system = relay, duration_s = 2 }.message)
