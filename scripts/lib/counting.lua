-- How many of the cases of a score hold.

local counting = {}

-- Of the cases that count, how many hold: { count, of, share }; share is nil where none counts.
function counting.share(cases, counts, holds)
  local k, n = 0, 0
  for _, c in ipairs(cases) do
    if counts(c) then
      n = n + 1
      if holds(c) then k = k + 1 end
    end
  end
  return { count = k, of = n, share = n > 0 and k / n or nil }
end

-- The same as text.
function counting.told(s) return s.of == 0 and "none to count" or string.format("%d of %d", s.count, s.of) end

return counting
