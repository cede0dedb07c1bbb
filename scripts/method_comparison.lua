-- The reference machine under one sine, by every method: variable steps, which locate each stick-slip transition, and
-- fixed steps, as a signal processor would take them. What the fixed ones get wrong is said in words.
--
--   tribode run scripts/method_comparison.lua -D amplitude=30 -D frequency=34 -D loop=open
--
-- Results: comparison.csv, cost.csv (processor times), findings.txt, methods.json and the plots trajectories,
-- differences, hysteresis, work_precision (png, svg).

local tb = require "tribode"

local option = tb.options {
  amplitude = { default = 15, unit = "N", help = "of the thrust, or of what is added to the controller's" },
  frequency = { default = 10, unit = "Hz", help = "of the sine" },
  duration = { default = tb.quick and 0.3 or 2, unit = "s", help = "of the run" },
  loop = { default = "closed", choices = { "closed", "open" }, help = "with the machine's controller or without" },
  machine = { default = "models/linear_motor_table.lua", help = "machine description, .lua or .json" },
  seed = { default = 0, help = "of the sensor noise" },
}

local machine = tb.machine(option.machine)
local sine, rest = {}, {}
for k = 1, math.max(math.floor(option.duration / machine.Ts + 0.5), 1) + 1 do
  sine[k] = option.amplitude * math.sin(2 * math.pi * option.frequency * (k - 1) * machine.Ts)
  rest[k] = 0
end
local closed = option.loop == "closed"

local comparison = tb.compare {
  machine = machine,
  u = not closed and sine or nil,
  r = closed and rest or nil,
  exc = closed and sine or nil,
  divisions = tb.quick and { 1, 10 } or nil,
  tolerances = tb.quick and { 1e-6, 1e-8 } or nil,
  seed = option.seed,
}
tb.write_json { file = "methods.json", value = comparison.methods }

print(string.format("%s under %g N at %g Hz, %s loop, %g s\n", option.machine, option.amplitude, option.frequency,
  option.loop, option.duration))
print(comparison.text)
for _, finding in ipairs(comparison.findings) do print(finding) end
