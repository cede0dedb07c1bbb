-- tb.linspace and tb.logspace: both ends included, even spacing, and what they refuse.
local tb = require "tribode"

local function near(found, wanted, tolerance)
  assert(math.abs(found - wanted) <= tolerance, string.format("%.17g instead of %.17g", found, wanted))
end

local function refused(message, action, ...)
  local ok, text = pcall(action, ...)
  assert(not ok, "not refused: " .. message)
  assert(text:find(message, 1, true), "\"" .. message .. "\" is not in: " .. text)
end

local even = tb.linspace(10, 200, 20)
assert(#even == 20)
for i, value in ipairs(even) do near(value, 10 * i, 1e-12) end -- a rounding or two
assert(even[1] == 10 and even[20] == 200)

local falling = tb.linspace(1, -1, 3)
assert(falling[1] == 1 and falling[2] == 0 and falling[3] == -1)

local decades = tb.logspace(0.1, 1000, 5)
assert(#decades == 5)
for i, value in ipairs(decades) do near(value, 10.0 ^ (i - 2), 1e-12 * 10.0 ^ (i - 2)) end

refused("argument 3 = 1, must be a whole number from 2", tb.linspace, 0, 1, 1)
refused("argument 3 = 2.5, must be a whole number", tb.linspace, 0, 1, 2.5)
refused("argument 2 must be a number", tb.linspace, 0, "one", 3)
refused("argument 3 must be a number", tb.linspace, 0, 1)
refused("both ends must be positive", tb.logspace, 0, 1, 3)
refused("both must be finite", tb.linspace, 0, 0 / 0, 3)
refused("from -inf to 1: both must be finite", tb.linspace, -math.huge, 1, 3)
