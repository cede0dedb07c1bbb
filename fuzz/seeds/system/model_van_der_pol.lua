local make = function(...)
local tb = require "tribode"

return tb.system {
  name = "van der Pol",
  parameters = { mu = 1 },
  states = { x0 = 2, x1 = 0 },
  der = function(s) return { x0 = s.x1, x1 = s.mu * (1 - s.x0 ^ 2) * s.x1 - s.x0 } end,
}
end
local tb = require "tribode"
local s = make()
tb.run_system { system = s, duration_s = 0.5, output_step_s = 0.1 }
tb.linearize { system = s }
