-- The friction model that a drive runs and adds to its thrust, FRA-2 in its add-on form, Fig. 6 of the paper:
-- elements, viscous and dry friction driven by the samples of the encoder. Dry friction builds up over two steps.
--
--   z_i[k] = clip(z_i[k-1] + q[k] - q[k-1], -F_i/K_i, F_i/K_i),  v[k] = (q[k] - q[k-1])/Ts,  q = measured
--   w[k] = clip(w[k-1] + q[k] - q[k-1], -reach, reach),  level(v) as in servo.friction
--   fed_back[k] = share (sum of K_i z_i[k] + D_i v[k] where not at its limit, + viscous v[k]
--                        + level(v[k]) w[k]/reach);  q[-1] = q[0]
--
-- in: measured [m]; out: fed_back [N].
local tb = require "tribode"

-- share, period [s], viscous [N s/m], elements = { { K =, F =, D = }, … }, coulomb [N], stribeck as in a machine,
-- resolution of the encoder [m]
return function(settings)
  local elements = settings.elements
  local stribeck = settings.stribeck
  local discrete = { force = { unit = "N" }, position = { unit = "m" }, begun = 0, dry = { unit = "m" } }
  local parameters = {
    period = { value = settings.period, unit = "s" }, viscous = { value = settings.viscous, unit = "N s/m" },
  }
  parameters.coulomb = { value = settings.coulomb, unit = "N" }
  parameters.reach = { value = math.max(2 * settings.resolution, 1e-7), unit = "m" }
  if stribeck then
    parameters.above_coulomb = { value = stribeck.static - settings.coulomb, unit = "N" }
    parameters.stribeck_velocity = { value = stribeck.velocity, unit = "m/s" }
  end
  for i, e in ipairs(elements) do
    discrete["z" .. i] = { unit = "m" }
    parameters["K" .. i] = { value = e.K, unit = "N/m" }
    parameters["D" .. i] = { value = e.D or 0, unit = "N s/m" }
    parameters["limit" .. i] = { value = e.F / e.K, unit = "m" }
  end
  return tb.system {
    name = "friction feedback",
    parameters = parameters,
    inputs = { measured = { unit = "m" } },
    discrete = discrete,
    outputs = function(s) return { fed_back = { s.force, unit = "N" } } end,
    sample = {
      {
        name = "friction feedback",
        period_s = settings.period,
        set = function(s)
          local travel = tb.where(tb.greater(s.begun, 0), s.measured - s.position, 0)
          local velocity = travel / s.period
          local set, force = { begun = 1, position = s.measured }, s.viscous * velocity
          for i in ipairs(elements) do
            local limit = s["limit" .. i]
            local z = math.max(-limit, math.min(limit, s["z" .. i] + travel))
            set["z" .. i] = z
            local damping = tb.where(tb.less(math.abs(z), limit), s["D" .. i] * velocity, 0)
            force = force + s["K" .. i] * z + damping
          end
          set.dry = math.max(-s.reach, math.min(s.reach, s.dry + travel))
          local level = s.coulomb
          if stribeck then
            local ratio = math.abs(velocity) / s.stribeck_velocity
            level = level + s.above_coulomb * math.exp(-ratio ^ (stribeck.exponent or 1))
          end
          set.force = settings.share * (force + level * set.dry / s.reach)
          return set
        end,
      },
    },
  }
end
