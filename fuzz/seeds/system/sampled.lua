local tb = require "tribode"
local s = tb.system { states = { x = 1 }, discrete = { u = 0 }, der = function(s) return { x = s.x + s.u } end,
  sample = { { period_s = 0.1, set = function(s) return { u = -3 * s.x } end } } }
tb.run_system { system = s, duration_s = 0.3 }
local lag = tb.system { parameters = { T = 1 }, inputs = { u = 0 }, states = { y = 0 }, der = function(s) return { y = (s.u - s.y) / s.T } end }
local chain = tb.system { parts = { first = lag, second = lag }, connect = function(s) return { ["second.u"] = s.first.y, ["first.u"] = 1 } end }
tb.run_system { system = chain, duration_s = 1, solver = "erk", output_step_s = 0.5 }
