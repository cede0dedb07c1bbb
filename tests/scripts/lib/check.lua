-- What the scripts beside this folder check with.
local check = {}

-- Fails unless a number is within `tolerance`, relative to its size and 1, of the wanted one.
function check.near(found, wanted, tolerance, what)
  assert(math.abs(found - wanted) <= tolerance * (1 + math.abs(wanted)),
    string.format("%s: %.17g instead of %.17g", what or "value", found, wanted))
end

-- Fails unless `make` throws an error that contains the message.
function check.refused(message, make)
  local ok, text = pcall(make)
  assert(not ok and text:find(message, 1, true), tostring(text))
end

return check
