-- Robertson's chemical reaction: stiff, over eleven decades of time. The equations and the two roots of SUNDIALS'
-- example cvRoberts_dns [Hindmarsh 2005]:
--
--   der(y1) = -0.04 y1 + 1e4 y2 y3
--   der(y2) = 0.04 y1 - 1e4 y2 y3 - 3e7 y2^2
--   der(y3) = 3e7 y2^2
--   events at y1 = 1e-4 and y3 = 0.01
local tb = require "tribode"

return tb.system {
  name = "Robertson",
  states = { y1 = 1, y2 = { start = 0, nominal = 1e-6 }, y3 = 0 },
  der = function(s)
    local slow, fast, turn = 0.04 * s.y1, 3e7 * s.y2 ^ 2, 1e4 * s.y2 * s.y3
    return { y1 = turn - slow, y2 = slow - turn - fast, y3 = fast }
  end,
  outputs = function(s) return { sum = s.y1 + s.y2 + s.y3 } end,
  when = {
    { name = "y1 = 1e-4", crossing = function(s) return s.y1 - 1e-4 end, direction = "both" },
    { name = "y3 = 0.01", crossing = function(s) return s.y3 - 0.01 end, direction = "both" },
  },
}
