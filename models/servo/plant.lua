-- The moving parts of a servo axis: rigid body and vibration modes, eq. (1). All forces act on the driven point.
--
--   y = x0 + sum q_j,   x0'' = k0 u_e,   q_j'' = k_j u_e - r_j,   r_j = 2 zeta_j w_j q_j' + w_j^2 q_j
--   u_e = thrust + force - friction
--
-- with y and v in place of x0 and x0', so that v' = k u_e - sum r_j, k = k0 + sum k_j. While friction holds the axis
-- (held = 1), v' = 0, and u_e = sum r_j/k.
--
-- in: thrust, force, friction [N], held; out: y [m], v [m/s], push [N], all that pushes the axis while it rests,
-- friction apart.
local tb = require "tribode"

local function sum_of(list, term)
  local sum = 0
  for j, entry in ipairs(list) do sum = sum + term(j, entry) end
  return sum
end

-- rigid_gain = k0 [m/(N s^2)], modes = { { gain = k_j, freq_hz =, zeta = }, … }
return function(settings)
  local modes = settings.modes
  local parameters = { k0 = { value = settings.rigid_gain, unit = "1/kg" } }
  for j, mode in ipairs(modes) do
    local w = 2 * math.pi * mode.freq_hz
    parameters["k" .. j] = { value = mode.gain, unit = "1/kg" }
    parameters["damping" .. j] = { value = 2 * mode.zeta * w, unit = "1/s" }
    parameters["stiffness" .. j] = { value = w * w, unit = "1/s2" }
  end
  local function gain(s) return s.k0 + sum_of(modes, function(j) return s["k" .. j] end) end
  local function pull(s) -- r_j
    return function(j) return s["damping" .. j] * s["w" .. j] + s["stiffness" .. j] * s["q" .. j] end
  end
  local function restoring(s) return sum_of(modes, pull(s)) / gain(s) end

  local states = { position = { unit = "m" }, velocity = { unit = "m/s", nominal = 100 } }
  for j in ipairs(modes) do
    states["q" .. j] = { unit = "m" }
    states["w" .. j] = { unit = "m/s", nominal = 100 }
  end
  return tb.system {
    name = "plant",
    parameters = parameters,
    inputs = { thrust = { unit = "N" }, force = { unit = "N" }, friction = { unit = "N" }, held = 0 },
    states = states,
    der = function(s)
      local held = tb.greater(s.held, 0)
      local effective = tb.where(held, restoring(s), s.thrust + s.force - s.friction)
      local pulls = sum_of(modes, pull(s))
      local rates = { position = s.velocity, velocity = tb.where(held, 0, gain(s) * effective - pulls) }
      for j in ipairs(modes) do
        rates["q" .. j] = s["w" .. j]
        rates["w" .. j] = s["k" .. j] * effective - pull(s)(j)
      end
      return rates
    end,
    outputs = function(s)
      return {
        y = { s.position, unit = "m" },
        v = { s.velocity, unit = "m/s" },
        push = { s.thrust + s.force - restoring(s), unit = "N" },
      }
    end,
    when = {
      { -- an impulse at the driven point takes the rest of its velocity
        name = "stops",
        condition = function(s) return tb.greater(s.held, 0) end,
        set = function(s)
          local set = { velocity = 0 }
          for j in ipairs(modes) do set["w" .. j] = s["w" .. j] - s["k" .. j] * (s.velocity / gain(s)) end
          return set
        end,
      },
    },
  }
end
