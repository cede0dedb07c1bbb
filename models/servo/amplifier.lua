-- The amplifier of a servo axis: its curve, the hold with the dead time before it, the current loop.
--
--   w = clip(u, -limit, limit);  gain power(w -+ half_width) beyond the dead zone, 0 in it
--   power(w) = size (abs(w)/size)^exponent sign(w)
--   u[k] acts from k Ts + delay on;   thrust' = 2 pi lag_hz (held - thrust), or thrust = held
--
-- The dead time is the offset of the sample clock; whole samples of it are places in a row, u1, u2, … Without a hold
-- (continuous) u goes through as it is.
-- in: u [N]; out: thrust [N].
local tb = require "tribode"

-- The delay in whole samples and a rest [s]; a rest within 1e-9 of a whole sample is none.
local function split(delay, period)
  local samples = delay / period
  local nearest = math.floor(samples + 0.5)
  if math.abs(samples - nearest) < 1e-9 then return nearest, 0 end
  local whole = math.floor(samples)
  return whole, delay - whole * period
end

-- period [s], delay [s], lag_hz (0: none), limit [N] (nil: none), half_width [N], exponent and size [N] of the power
-- law (nil: none), gain, continuous
return function(settings)
  local whole, rest = split(settings.delay, settings.period)
  local function curve(u)
    local w = u
    if settings.limit then w = math.max(-settings.limit, math.min(settings.limit, w)) end
    if settings.half_width > 0 then
      w = tb.where(tb.less(w, 0), -1, 1) * math.max(math.abs(w) - settings.half_width, 0)
    end
    if settings.exponent then
      w = tb.where(tb.less(w, 0), -1, 1) * settings.size * (math.abs(w) / settings.size) ^ settings.exponent
    end
    return settings.gain * w
  end
  local has_lag = settings.lag_hz > 0
  local function held(s) return settings.continuous and curve(s.u) or s.held end
  local discrete = not settings.continuous and { held = { unit = "N" } } or nil
  for i = 1, whole do discrete["u" .. i] = { unit = "N" } end
  return tb.system {
    name = "amplifier",
    parameters = has_lag and { lag = { value = 2 * math.pi * settings.lag_hz, unit = "1/s" } } or nil,
    inputs = { u = { unit = "N" } },
    discrete = discrete,
    states = has_lag and { current = { unit = "N", nominal = 1e6 } } or nil,
    der = has_lag and function(s) return { current = s.lag * (held(s) - s.current) } end or nil,
    outputs = function(s) return { thrust = { has_lag and s.current or held(s), unit = "N" } } end,
    sample = not settings.continuous and {
      {
        name = "hold",
        period_s = settings.period,
        offset_s = rest,
        set = function(s)
          local set = { held = whole == 0 and curve(s.u) or s["u" .. whole] }
          for i = 2, whole do set["u" .. i] = s["u" .. i - 1] end
          if whole > 0 then set.u1 = curve(s.u) end
          return set
        end,
      },
    } or nil,
  }
end
