-- Parameters of a model from the residual of its simulation: steps of Gauss and Newton, with differences for the
-- derivatives. A script says: local fit = require "lib.simulation_fit".
--
--   fit(values, names, left)   values: table of numbers; names: list of those that move; left(values): list of what
--                              is measured less what is simulated with them
--
-- Returns { values, errors, rms }: errors are standard errors, with the residual taken for white; rms is that of what
-- is left. A step that leaves more than before is halved, five times at most.

local tb = require "tribode"

local function rms(list)
  local sum = 0
  for _, value in ipairs(list) do sum = sum + value ^ 2 end
  return math.sqrt(sum / #list)
end

return function(start, names, left)
  local values, errors = {}, {}
  for key, value in pairs(start) do values[key] = value end
  local now = left(values)
  for _ = 1, 12 do
    local columns, before = {}, {}
    for i, name in ipairs(names) do
      local was = values[name]
      local step = 1e-4 * math.max(math.abs(was), 1e-9)
      values[name] = was + step
      local moved = left(values)
      columns[i] = {}
      for k = 1, #now do columns[i][k] = (now[k] - moved[k]) / step end
      values[name], before[i] = was, was
    end
    local solved = tb.least_squares { columns = columns, values = now }
    local share, better = 1, nil
    for _ = 1, 5 do
      for i, name in ipairs(names) do values[name] = before[i] + share * solved.coefficients[i] end
      local ok, after = pcall(left, values)
      if ok and rms(after) < rms(now) then
        better = after
        break
      end
      share = share / 2
    end
    for i, name in ipairs(names) do errors[name] = solved.standard_errors[i] end
    if not better then
      for i, name in ipairs(names) do values[name] = before[i] end
      break
    end
    local decrease = 1 - rms(better) / rms(now)
    now = better
    if decrease < 1e-5 then break end
  end
  return { values = values, errors = errors, rms = rms(now) }
end
