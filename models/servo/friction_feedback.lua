-- The friction model that a drive runs and adds to its thrust, FRA-2 in its add-on form, Fig. 6 of the paper: elements
-- and viscous friction driven by the samples of the encoder.
--
--   z_i[k] = clip(z_i[k-1] + q[k] - q[k-1], -F_i/K_i, F_i/K_i),  v[k] = (q[k] - q[k-1])/Ts,  q = measured
--   fed_back[k] = share (sum of K_i z_i[k] + D_i v[k] where not at its limit, + viscous v[k]);  q[-1] = q[0]
--
-- in: measured [m]; out: fed_back [N].
local tb = require "tribode"

-- share, period [s], viscous [N s/m], elements = { { K =, F =, D = }, … }
return function(settings)
  local elements = settings.elements
  local discrete = { force = { unit = "N" }, position = { unit = "m" }, begun = 0 }
  local parameters = {
    period = { value = settings.period, unit = "s" }, viscous = { value = settings.viscous, unit = "N s/m" },
  }
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
          set.force = settings.share * force
          return set
        end,
      },
    },
  }
end
