local tb = require "tribode"
local s = tb.system { states = { x = 1, v = 0 },
  der = function(s) return { x = s.v, v = tb.where(tb.less(s.x, 0), -4 * s.x, -1) } end }
tb.run_system { system = s, duration_s = 2, solver = "auto" }
