-- Random rows of masses with springs, dry friction on the ground and between neighbors, impacts on one another and on
-- a wall: `exact` and the solvers with tolerances move them alike, and nothing goes through anything.
--
--   tribode run tests/scripts/ready_parts_random.lua [-D seed=7] [-D count=100]
local tb = require "tribode"
local option = tb.options { seed = 7, count = 15 }

local seed = option.seed
local function random(low, high)
  seed = seed * 48271 % 2147483647
  return low + (high - low) * seed / 2147483647
end

local size = 0.7 -- of a mass
local function row_of(count)
  local parts, states, mass, spring, push = {}, {}, {}, {}, {}
  for i = 1, count do
    states["x" .. i], states["v" .. i] = i, random(-2, 2)
    mass[i], spring[i], push[i] = random(0.5, 2), random(0, 1) < 0.5 and random(1, 50) or 0, random(-2, 2)
    if random(0, 1) < 0.6 then
      parts["ground" .. i] = tb.parts.coulomb { velocity = "v" .. i, level = random(0.2, 3),
        static = random(0, 1) < 0.5 and random(3, 4) or nil }
    end
    local kind = i > 1 and random(0, 1) or 1
    if kind < 0.4 then
      parts["beside" .. i] = tb.parts.coulomb { level = random(0.2, 5),
        velocity = function(s) return s["v" .. i] - s["v" .. i - 1] end }
    elseif kind < 0.8 then
      parts["contact" .. i] = tb.parts.impact { restitution = random(0, 0.9), rest_speed = 0.01,
        gap = function(s) return s["x" .. i] - s["x" .. i - 1] - size end }
    end
  end
  parts.contact1 = tb.parts.impact { gap = "x1", restitution = random(0, 0.9), rest_speed = 0.01 }
  local function force(s, name) return parts[name] and s[name].force or 0 end
  return parts, tb.system {
    states = states, parts = parts,
    der = function(s)
      local rates = {}
      for i = 1, count do
        local x, v = s["x" .. i], s["v" .. i]
        local sum = push[i] - spring[i] * (x - i) - 0.3 * v - force(s, "ground" .. i) - force(s, "beside" .. i) +
          force(s, "contact" .. i) + force(s, "beside" .. i + 1) - force(s, "contact" .. i + 1)
        rates["x" .. i], rates["v" .. i] = v, sum / mass[i]
      end
      return rates
    end,
  }
end

for n = 1, option.count do
  local count = math.floor(random(2, 4.99))
  local parts, system = row_of(count)
  local exact = tb.run_system { system = system, duration_s = 6, solver = "exact" }
  assert(exact.ok, n .. exact.message)
  local values = exact.values
  for k = 1, #exact.t do
    for i = 1, count do
      local before = i > 1 and values["x" .. i - 1][k] + size or 0
      assert(not parts["contact" .. i] or values["x" .. i][k] > before - 1e-9, string.format("%d: through %d", n, i))
    end
  end
  for _, solver in ipairs { "erk", "bdf" } do
    local run = tb.run_system { system = system, duration_s = 6, solver = solver, relative_tolerance = 1e-10,
      absolute_tolerance = 1e-12 }
    assert(run.ok, n .. solver .. run.message)
    for i = 1, count do
      for k = 1, #exact.t do
        local off = math.abs(run.values["x" .. i][k] - values["x" .. i][k])
        assert(off < 1e-6, string.format("%d by %s: x%d off by %g", n, solver, i, off))
      end
    end
  end
end
