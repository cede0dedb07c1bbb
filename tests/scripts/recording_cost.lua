-- Recording is linear in the size of a system: how often a function is called on numbers depends on the variables that
-- it reads, not on how many there are. Branches on variables that the equations do not depend on are found as before.
local tb = require "tribode"

local function calls_of_each(count)
  local states, events, calls = {}, {}, 0
  for i = 1, count do
    local h, v = "h" .. i, "v" .. i
    states[h], states[v] = 0.5 + i / count, 0
    events[i] = {
      crossing = function(s)
        calls = calls + 1
        return s[h]
      end,
      set = function(s)
        calls = calls + 1
        return { [h] = 0, [v] = -s[v] }
      end,
    }
  end
  tb.system { states = states, when = events, der = function(s)
    local rates = {}
    for i = 1, count do rates["h" .. i], rates["v" .. i] = s["v" .. i], -9.81 end
    return rates
  end }
  return calls / (2 * count)
end
local few, many = calls_of_each(10), calls_of_each(160)
assert(few == many and many < 40, few .. " and " .. many .. " calls")

-- A system of many variables, one of which a function looks at without a term of it.
local states = { x = 1, y = { start = 0, size = 2 } }
for i = 1, 200 do states["z" .. i] = 0 end
local function refused(rate)
  local ok, message = pcall(tb.system, { states = states, der = function(s)
    local rates = {}
    for name in pairs(states) do rates[name] = 0 end
    rates.y = { 0, 0 }
    rates.x = rate(s)
    return rates
  end })
  return not ok and tostring(message):find("takes a branch", 1, true) ~= nil, message
end
local function is_refused(rate)
  local found, message = refused(rate)
  assert(found, tostring(message))
end
is_refused(function(s) return s.z150 == 1 and s.x or -s.x end)
is_refused(function(s) return s.y[2] == 0 and s.x or -s.x end)
is_refused(function(s) -- read by a branch alone
  if s.z3 == 0 then return s.x * s.z199 end
  return s.x
end)
is_refused(function(s) -- what a table of the variables holds is not seen by pairs while equations are recorded
  local sum = s.x
  for _, value in pairs(s) do sum = type(value) == "number" and sum + value or sum end
  return sum
end)
is_refused(function(s) return next(s) and s.x or -s.x end)
assert(not refused(function(s) return s.x + s.y[2] - s.z200 end))
print "as it should be"
