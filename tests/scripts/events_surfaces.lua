-- Resets onto a surface: balls that bounce on random planes, circles and parabolas, at any height and scale, with any
-- restitution, never get to the other side: they bounce on, or the run ends as chattering. `count` of each kind.
local tb = require "tribode"
local o = tb.options { count = 12 }

local seed = 7
local function random(low, high)
  seed = (seed * 48271) % 2147483647
  return low + (high - low) * seed / 2147483647
end

-- Each returns a surface function of (x, y), positive on the side of the ball, its gradient, a point above, and how a
-- point near the surface is put onto it. L is the scale, (cx, cy) an offset.
local surfaces = {}

function surfaces.plane(L, cx, cy)
  local angle = random(-0.5, 0.5)
  local nx, ny = math.sin(angle), math.cos(angle)
  local function f(x, y) return nx * (x - cx) + ny * (y - cy) end
  return f, function() return nx, ny end, cx, cy + L, function(x, y)
    local d = f(x, y)
    return x - d * nx, y - d * ny
  end
end

function surfaces.floor(L, cx, cy)
  return function(_, y) return y - cy end, function() return 0, 1 end, cx, cy + L, function(x) return x, cy end
end

function surfaces.bowl(L, cx, cy) -- inside a circle
  local function f(x, y) return L ^ 2 - (x - cx) ^ 2 - (y - cy) ^ 2 end
  return f, function(x, y) return -2 * (x - cx), -2 * (y - cy) end, cx + random(-0.5, 0.5) * L, cy, function(x, y)
    local part = L / math.sqrt((x - cx) ^ 2 + (y - cy) ^ 2)
    return cx + part * (x - cx), cy + part * (y - cy)
  end
end

function surfaces.parabola(L, cx, cy)
  local function f(x, y) return y - cy - (x - cx) ^ 2 / L end
  return f, function(x) return -2 * (x - cx) / L, 1 end, cx + random(-0.3, 0.3) * L, cy + L, function(x)
    return x, cy + (x - cx) ^ 2 / L
  end
end

local runs, impacts, ended = 0, 0, 0
for _, kind in ipairs { "plane", "floor", "bowl", "parabola" } do
  for i = 1, o.count do
    local L = 10 ^ random(-9, 9)
    local far = 10 ^ random(-2, 3) * L -- how far the origin is: rounding of a position is that of `far`
    local f, gradient, x0, y0, put = surfaces[kind](L, random(-1, 1) * far, random(-1, 1) * far)
    local e = i % 4 == 0 and (i % 8 == 0 and 0 or 1) or random(0, 1)
    local g = 10 ^ random(-2, 2) * L -- [1/s^2 L]
    local places = i % 3 == 1 -- also the position is put; else only the velocity is turned
    local strict = i % 2 == 0
    local system = tb.system {
      states = { x = { start = x0, nominal = L }, y = { start = y0, nominal = L }, u = { nominal = L },
        v = { nominal = L } },
      der = function(s) return { x = s.u, y = s.v, u = -1e-9 * s.u ^ 3 / L ^ 2, v = -g } end,
      when = { {
        name = "impact",
        condition = function(s)
          if strict then return tb.less(f(s.x, s.y), 0) end
          return tb.less_equal(f(s.x, s.y), 0)
        end,
        set = function(s)
          local nx, ny = gradient(s.x, s.y)
          local normal = (s.u * nx + s.v * ny) / (nx ^ 2 + ny ^ 2)
          local set = { u = s.u - (1 + e) * normal * nx, v = s.v - (1 + e) * normal * ny }
          if places then set.x, set.y = put(s.x, s.y) end
          return set
        end,
      } },
    }
    local duration = 12 * math.sqrt(2 * L / g)
    for _, solver in ipairs { "erk", "adams", "bdf" } do
      local run = tb.run_system { system = system, duration_s = duration, output_step_s = duration / 200,
        solver = solver, relative_tolerance = 1e-9, absolute_tolerance = 1e-12 }
      local what = string.format("%s %d by %s, L = %g, far = %g, e = %g, put %s, strict %s: %d impacts, %s", kind, i,
        solver, L, far, e, places, strict, #run.events, run.message)
      assert(run.ok or run.message:find "chattering", what)
      -- Below it by no more than rounding of the positions and, where only the velocity is set, what the bounces lose.
      local size = f(x0, y0)
      for k = 1, #run.t do
        local depth = -f(run.values.x[k], run.values.y[k]) / size
        assert(depth < 1e-6 + 1e-13 * far / L,
          string.format("%s: %g below at %g of %g s", what, depth, run.t[k], duration))
      end
      assert(#run.events > 0, what)
      runs, impacts, ended = runs + 1, impacts + #run.events, ended + (run.ok and 0 or 1)
    end
  end
end
print(string.format("%d runs, %d impacts, %d ended as chattering", runs, impacts, ended))
