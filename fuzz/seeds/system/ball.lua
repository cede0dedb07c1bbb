local tb = require "tribode"
local s = tb.system { parameters = { g = 9.81, e = 0.8 }, states = { h = 1, v = 0 }, discrete = { n = 0 },
  der = function(s) return { h = s.v, v = -s.g } end,
  when = { { name = "bounce", crossing = function(s) return s.h end, set = function(s) return { v = -s.e * s.v, n = s.n + 1 } end } } }
tb.run_system { system = s, duration_s = 1, relative_tolerance = 1e-6 }
