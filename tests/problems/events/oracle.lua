-- Trajectories with events by another road than the engine: Gragg's midpoint rule extrapolated to order 16 in short
-- fixed steps, in plain Lua, and events by bisection of the last step, which is made anew each time.
local oracle = {}

local function midpoint(f, t, y, H, n)
  local h, now = H / n, {}
  local before, slope = y, f(t, y)
  for i = 1, #y do now[i] = y[i] + h * slope[i] end
  for k = 1, n - 1 do
    slope = f(t + k * h, now)
    local after = {}
    for i = 1, #y do after[i] = before[i] + 2 * h * slope[i] end
    before, now = now, after
  end
  return now
end

local columns = 8

-- The states `y`, a list, after a step of H.
function oracle.step(f, t, y, H)
  local last
  for k = 1, columns do
    local row = { midpoint(f, t, y, H, 2 * k) }
    for j = 1, k - 1 do
      local factor, next_column = 1 / ((k / (k - j)) ^ 2 - 1), {}
      for i = 1, #y do next_column[i] = row[j][i] + (row[j][i] - last[j][i]) * factor end
      row[j + 1] = next_column
    end
    last = row
  end
  return last[columns]
end

-- From t to t_end in steps of `step`, or to the first point at which the function `guard(t, y)` falls below zero.
-- Returns the time, the states and whether it fell. A guard that falls and rises within a step is not seen.
function oracle.follow(f, guard, t, y, t_end, step)
  while t < t_end do
    local H = math.min(step, t_end - t)
    local after = oracle.step(f, t, y, H)
    if guard and guard(t + H, after) < 0 then
      local low, high = 0, H
      while high - low > 1e-16 * (1 + math.abs(t)) do
        local middle = low + (high - low) / 2
        if middle == low or middle == high then break end
        if guard(t + middle, oracle.step(f, t, y, middle)) < 0 then high = middle else low = middle end
      end
      return t + high, oracle.step(f, t, y, high), true
    end
    t, y = t + H, after
    if t_end - t < 1e-14 * (1 + math.abs(t_end)) then break end
  end
  return t_end, y, false
end

-- Where the function f(t), above zero at `low`, falls below zero before `high`.
function oracle.crossing(f, low, high)
  for _ = 1, 200 do
    local middle = low + (high - low) / 2
    if middle == low or middle == high then break end
    if f(middle) < 0 then high = middle else low = middle end
  end
  return high
end

return oracle
