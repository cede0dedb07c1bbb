-- Two tanks, one above the other, as a model to diagnose: what it returns is the system.
local tb = require "tribode"
return tb.system {
  parameters = { a = 0.02, b = 0.02, d = 0.02, e = 0.02 },
  inputs = { u = { unit = "V" } },
  states = { x1 = 4, x2 = { start = 5, unit = "V" } },
  der = function(s)
    local out = s.a * math.sqrt(math.max(s.x1, 0))
    return { x1 = s.b * s.u - out, x2 = s.d / s.a * out - s.e * math.sqrt(math.max(s.x2, 0)) }
  end,
  outputs = function(s) return { y = s.x2 } end,
}
