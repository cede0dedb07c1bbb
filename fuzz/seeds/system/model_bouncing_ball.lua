local make = function(...)
local tb = require "tribode"

return tb.system {
  name = "bouncing ball",
  parameters = { g = { value = 9.81, unit = "m/s2" }, e = 0.7, v_min = { value = 0.1, unit = "m/s" } },
  states = { h = { start = 1, unit = "m" }, v = { start = 0, unit = "m/s" } },
  der = function() return { h = 0, v = 0 } end,
  modes = {
    flying = {
      der = function(s) return { h = s.v, v = -s.g } end,
      when = {
        {
          name = "impact",
          crossing = function(s) return s.h end,
          set = function(s) return { h = 0, v = -s.e * s.v } end,
        },
        {
          name = "rest",
          condition = function(s)
            return tb.all(tb.less_equal(s.h, 0), tb.less(s.v, s.v_min), tb.less_equal(0, s.v))
          end,
          set = function() return { h = 0, v = 0 } end,
          mode = "resting",
        },
      },
    },
    resting = {},
  },
  start_mode = "flying",
}
end
local tb = require "tribode"
local s = make()
tb.run_system { system = s, duration_s = 0.5, output_step_s = 0.1 }
tb.linearize { system = s }
