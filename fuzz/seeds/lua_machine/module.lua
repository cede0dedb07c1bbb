local ok, part = pcall(require, "part")
local text = string.format("%q %s %5.3f", "a\0b", tostring(ok), 1.5):rep(3):gsub("%d+", "#")
local t = setmetatable({}, { __index = function(_, k) return #k end })
table.sort({ 3, 1, 2 }, function(a, b) return a < b end)
return { rigid_gain_per_kg = t.abc / 30, comment = text, closed_loop = false }
