-- The controllers of a servo machine, once a sample. in: r, measured [m], exc, fed_back [N]; out: u [N].
--
--   pid      e = r - measured;  I += ki Ts e;  d = a d + (1 - a)(e - e_prev)/Ts,  a = exp(-2 pi filter Ts), or 0
--            u = filters(kp e + I + kd d) + exc + fed_back
--   cascade  qf[k] = (q[k] + q[k-1])/2,  dq[k] = (qf[k] - qf[k-1])/Ts,  q = measured
--            e = kp (r - q) - dq;  I += ki Ts e, which rests beyond the limit
--            u[k + delay] = clip(filters(kv (e + I)), limit), exc and fed_back added after it; q[-1] = q[0]
--   filters  of second order, one behind another: low_pass, notch; by the bilinear transform
local tb = require "tribode"

local inputs = { r = { unit = "m" }, measured = { unit = "m" }, exc = { unit = "N" }, fed_back = { unit = "N" } }
local function outputs(s) return { u = { s.commanded, unit = "N" } } end

local make = {}

-- The filters behind a controller, as functions: of the discrete values that they need, and of a sample: the filtered
-- value, and the new values of the discrete ones in `set`.
local function chain(list, period)
  local discrete = {}
  for i = 1, #list do
    for _, name in ipairs { "a", "b" } do discrete["filter" .. i .. name] = { unit = "N" } end
  end
  local function step(s, value, set)
    for i, filter in ipairs(list) do
      local c, zeta = 1 / math.tan(math.pi * filter.freq_hz * period), filter.zeta or math.sqrt(0.5)
      local notch = filter.type == "notch"
      local square, linear = notch and 1 or 0, notch and (filter.depth or 0) or 0
      local scale = 1 + 2 * zeta * c + c * c
      local b0, b2 = 1 + 2 * linear * zeta * c + square * c * c, 1 - 2 * linear * zeta * c + square * c * c
      local a, b = "filter" .. i .. "a", "filter" .. i .. "b"
      local out = b0 / scale * value + s[a]
      set[a] = 2 * (1 - square * c * c) / scale * value - 2 * (1 - c * c) / scale * out + s[b]
      set[b] = b2 / scale * value - (1 - 2 * zeta * c + c * c) / scale * out
      value = out
    end
    return value
  end
  return discrete, step
end

local function joined(values, more)
  for name, value in pairs(more) do values[name] = value end
  return values
end

-- kp, ki, kd, derivative_filter_hz, filters
function make.pid(settings, period)
  local filter = settings.derivative_filter_hz or 0
  local a = filter > 0 and math.exp(-2 * math.pi * filter * period) or 0
  local filter_values, filtered = chain(settings.filters or {}, period)
  return tb.system {
    name = "PID controller",
    parameters = {
      kp = { value = settings.kp, unit = "N/m" },
      ki = { value = settings.ki, unit = "N/(m s)" },
      kd = { value = settings.kd, unit = "N s/m" },
      period = { value = period, unit = "s" },
    },
    inputs = inputs,
    discrete = joined({
      commanded = { unit = "N" }, integral = { unit = "N" }, derivative = { unit = "m/s" }, error = { unit = "m" },
    }, filter_values),
    outputs = outputs,
    sample = {
      {
        name = "controller",
        period_s = period,
        set = function(s)
          local e = s.r - s.measured
          local integral = s.integral + s.ki * s.period * e
          local derivative = a * s.derivative + (1 - a) * (e - s.error) / s.period
          local set = { error = e, integral = integral, derivative = derivative }
          set.commanded = filtered(s, s.kp * e + integral + s.kd * derivative, set) + s.exc + s.fed_back
          return set
        end,
      },
    },
  }
end

-- kp, kv, ki, filters, limit, delay_samples
function make.cascade(settings, period)
  local delay = settings.delay_samples or 0
  local ki = settings.ki or 0
  local filter_values, filtered = chain(settings.filters or {}, period)
  local discrete = joined({
    commanded = { unit = "N" }, position = { unit = "m" }, mean = { unit = "m" }, begun = 0,
    integral = ki ~= 0 and { unit = "m/s" } or nil,
  }, filter_values)
  for i = 1, delay do discrete["u" .. i] = { unit = "N" } end
  return tb.system {
    name = "cascade controller",
    parameters = {
      kp = { value = settings.kp, unit = "1/s" },
      kv = { value = settings.kv, unit = "N s/m" },
      ki = ki ~= 0 and { value = ki, unit = "1/s" } or nil,
      period = { value = period, unit = "s" },
    },
    inputs = inputs,
    discrete = discrete,
    outputs = outputs,
    sample = {
      {
        name = "controller",
        period_s = period,
        set = function(s)
          local begun = tb.greater(s.begun, 0)
          local position, last_mean = tb.where(begun, s.position, s.measured), tb.where(begun, s.mean, s.measured)
          local mean = (s.measured + position) / 2
          local set = { begun = 1, position = s.measured, mean = mean }
          local e = s.kp * (s.r - s.measured) - (mean - last_mean) / s.period
          local integral = ki ~= 0 and s.integral + s.ki * s.period * e or nil
          local u = filtered(s, s.kv * (integral and e + integral or e), set)
          if integral then
            set.integral = integral
            if settings.limit then
              local beyond = tb.greater(math.abs(u), settings.limit)
              local further = tb.greater(u * s.kv * (integral - s.integral), 0)
              set.integral = tb.where(tb.all(beyond, further), s.integral, integral)
            end
          end
          if settings.limit then u = math.max(-settings.limit, math.min(settings.limit, u)) end
          set.commanded = (delay > 0 and s["u" .. delay] or u) + s.exc + s.fed_back
          for i = 2, delay do set["u" .. i] = s["u" .. i - 1] end
          if delay > 0 then set.u1 = u end
          return set
        end,
      },
    },
  }
end

return make
