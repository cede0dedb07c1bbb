-- A drive with two controllers at two rates, each a clock of its own, and the motor between their samples: the current
-- controller at 8 kHz, the speed controller at 1 kHz, half a fast period later.
local tb = require "tribode"

local drive = tb.system {
  name = "drive",
  parameters = {
    L = { value = 2e-3, unit = "H" },
    R = { value = 1, unit = "ohm" },
    K = { value = 0.1, unit = "N m/A" },
    J = { value = 3e-4, unit = "kg m2" },
    kp = { value = 5, unit = "ohm" },
    kv = { value = 0.6, unit = "A s/rad" },
    limit = { value = 8, unit = "A" },
  },
  inputs = { target = { unit = "rad/s" } },
  states = { i = { unit = "A" }, w = { unit = "rad/s" } },
  discrete = { u = { unit = "V" }, wanted = { unit = "A" } },
  der = function(s) return { i = (s.u - s.R * s.i - s.K * s.w) / s.L, w = s.K * s.i / s.J } end,
  outputs = function(s) return { speed = s.w } end,
  sample = {
    {
      name = "current",
      period_s = 1 / 8000,
      set = function(s) return { u = s.kp * (s.wanted - s.i) + s.R * s.wanted + s.K * s.w } end,
    },
    {
      name = "speed",
      period_s = 1e-3,
      offset_s = 1 / 16000,
      set = function(s)
        return { wanted = math.max(-s.limit, math.min(s.limit, s.kv * (s.target - s.w))) }
      end,
    },
  },
}

for _, solver in ipairs { "exact", "erk" } do
  local run = tb.run_system { system = drive, duration_s = 0.2, inputs = { target = 50 }, solver = solver }
  assert(run.ok, run.message)
  print(string.format("%-5s: %d steps, at the end %.9f rad/s", solver, run.statistics.steps, run.final.w))
  local function curve(name, values, style) return { name = name, x = run.t, y = values, style = style } end
  tb.plot {
    file = solver,
    panels = {
      { y_label = "Speed [rad/s]", series = { curve("speed", run.values.w) } },
      { x_label = "Time [s]", y_label = "Current [A]",
        series = { curve("current", run.values.i), curve("wanted", run.values.wanted, "steps") } },
    },
  }
end

-- Both clocks and the motor as one sampled linear system, about rest.
local linear = tb.linearize { system = drive, input = "target", output = "speed", frequency_hz = { 1, 10, 100 } }
print(string.format("stable: %s, sample time %s, gain at 100 Hz %.1f dB", linear.stable,
  tb.format(linear.sample_time_s, "s"), linear.response.gain_db[3]))
