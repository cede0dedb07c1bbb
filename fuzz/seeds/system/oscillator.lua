local tb = require "tribode"
local s = tb.system { name = "oscillator", parameters = { w = { value = 2, unit = "rad/s" } }, inputs = { u = { unit = "N/kg" } },
  states = { x = { start = 1, unit = "m" }, v = { unit = "m/s" } },
  der = function(s) return { x = s.v, v = s.u - s.w ^ 2 * s.x } end,
  outputs = function(s) return { energy = { (s.v ^ 2 + s.w ^ 2 * s.x ^ 2) / 2, unit = "J/kg" } } end }
tb.run_system { system = s, duration_s = 0.1, output_step_s = 0.05, inputs = { u = math.sin } }
tb.run_system { system = s, duration_s = 0.1, solver = "cvode", parameters = { w = 3 }, start = { x = 2 },
  inputs = { u = { sample_time_s = 0.05, values = { 4, 0 }, interpolation = "linear", offset_s = 0.01 } } }
tb.linearize { system = s, frequency_hz = { 1, 2 }, at = { x = 0 } }
