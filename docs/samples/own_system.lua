-- A motor with a thermal switch: two states, a sampled controller, two modes of operation.
local tb = require "tribode"

local motor = tb.system {
  name = "motor",
  parameters = {
    J = { value = 2e-4, unit = "kg m2" },
    K = { value = 0.06, unit = "N m/A" },
    d = { value = 1e-4, unit = "N m s" },
    load = { value = 0.15, unit = "N m" },
    slow = { value = 1, unit = "1/s" },
    R = { value = 1.2, unit = "ohm" },
    C = { value = 8, unit = "J/K" },
    G = { value = 0.15, unit = "W/K" },
    ambient = { value = 25, unit = "K" },
    hot = { value = 60, unit = "K" },
    cool = { value = 55, unit = "K" },
    kp = { value = 0.08, unit = "A s" },
    target = { value = 100, unit = "1/s" },
  },
  states = { w = { start = 0, unit = "1/s" }, T = { start = 25, unit = "K" } },
  discrete = { i = { unit = "A" } },
  start_mode = "on",
  der = function(s)
    return {
      w = (s.K * s.i - s.d * s.w - s.load * tb.tanh(s.w / s.slow)) / s.J,
      T = (s.R * s.i ^ 2 - s.G * (s.T - s.ambient)) / s.C,
    }
  end,
  modes = {
    on = { when = { { name = "too hot", condition = function(s) return tb.greater(s.T, s.hot) end, mode = "off" } } },
    off = {
      der = function(s)
        return {
          w = (-s.d * s.w - s.load * tb.tanh(s.w / s.slow)) / s.J,
          T = -s.G * (s.T - s.ambient) / s.C,
        }
      end,
      when = { { name = "cool again", condition = function(s) return tb.less(s.T, s.cool) end, mode = "on" } },
    },
  },
  sample = {
    { period_s = 1e-3, set = function(s) return { i = math.max(0, math.min(5, s.kp * (s.target - s.w))) } end },
  },
}

local run = tb.run_system { system = motor, duration_s = tb.quick and 20 or 200, output_step_s = 0.01 }
assert(run.ok, run.message)
for _, event in ipairs(run.events) do print(string.format("%8.3f s  %s", event.t, event.name)) end
print(string.format("at the end %.1f 1/s and %.1f degrees, solver %s", run.final.w, run.final.T, run.solver))
tb.plot {
  file = "motor",
  panels = {
    { x_label = "Time [s]", y_label = "Speed [1/s]", series = { { name = "speed", x = run.t, y = run.values.w } } },
    { x_label = "Time [s]", y_label = "Temperature", series = { { name = "winding", x = run.t, y = run.values.T } } },
  },
}
