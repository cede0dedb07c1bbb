-- How far do friction and mass of a machine move its first mode, as a sweep finds it? One random machine a point.
local tb = require "tribode"
local machine = tb.machine "models/linear_motor_table.lua"

local option = tb.options { points = { default = tb.quick and 8 or 10000, help = "how many machines" } }

tb.batch {
  name = "monte carlo",
  seed = 1,
  points = tb.monte_carlo {
    seed = 1, count = option.points,
    factors = {
      { name = "friction_level", distribution = "normal", mean = 1, sd = 0.1 },
      { name = "mass", distribution = "normal", mean = 1, sd = 0.03 },
    },
  },
  run = function(point, seed)
    local drawn = tb.with_fields {
      machine = machine,
      fields = { rigid_gain_per_kg = machine.rigid_gain_per_kg / point.mass },
      scale = { ["friction.elements[*].F"] = point.friction_level },
    }
    local sweep = tb.sweep { machine = drawn, frequency_hz = tb.linspace(20, 60, 30), amplitude_N = 15, seed = seed }
    local fit = tb.fit_modal { response = sweep.responses["FRA-1"], f_min_hz = 20, f_max_hz = 60, modes = 1 }
    return { f1_hz = fit.f1_hz, zeta1 = fit.zeta1 }
  end,
  units = { f1_hz = "Hz" },
  finish = function(merged)
    local s = tb.statistics { values = merged.results.f1_hz }
    print(string.format("f1 %.3f Hz, standard deviation %.3f Hz, %d failed", s.mean, s.standard_deviation, s.missing))
  end,
}
