-- Van der Pol's oscillator, der(x0) = x1, der(x1) = mu (1 - x0^2) x1 - x0: stiff for large mu.
local tb = require "tribode"

return tb.system {
  name = "van der Pol",
  parameters = { mu = 1 },
  states = { x0 = 2, x1 = 0 },
  der = function(s) return { x0 = s.x1, x1 = s.mu * (1 - s.x0 ^ 2) * s.x1 - s.x0 } end,
}
