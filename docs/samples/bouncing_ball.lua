-- A ball that bounces, in five lines of equations.
local tb = require "tribode"

local ball = tb.system {
  parameters = { g = { value = 9.81, unit = "m/s2" }, e = 0.7 },
  states = { h = { start = 1, unit = "m" }, v = { start = 0, unit = "m/s" } },
  der = function(s) return { h = s.v, v = -s.g } end,
  when = {
    { name = "impact", crossing = function(s) return s.h end, set = function(s) return { h = 0, v = -s.e * s.v } end },
  },
}
local run = tb.run_system { system = ball, duration_s = 2 }
print(string.format("%d impacts, the first at %.6f s, by %s", #run.events, run.events[1].t, run.solver))
tb.write_csv { file = "ball.csv", columns = run.columns }
