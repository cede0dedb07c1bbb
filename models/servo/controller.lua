-- The controllers of a servo machine, once a sample. in: r, measured [m], exc, fed_back [N]; out: u [N].
--
--   pid      e = r - measured;  I += ki Ts e;  d = a d + (1 - a)(e - e_prev)/Ts,  a = exp(-2 pi filter Ts), or 0
--            u = kp e + I + kd d + exc + fed_back
--   cascade  qf[k] = (q[k] + q[k-1])/2,  dq[k] = (qf[k] - qf[k-1])/Ts,  q = measured
--            u[k + delay] = clip(kv (kp (r[k] - q[k]) - dq[k]), limit), exc and fed_back added
--            after it; q[-1] = q[0]
local tb = require "tribode"

local inputs = { r = { unit = "m" }, measured = { unit = "m" }, exc = { unit = "N" }, fed_back = { unit = "N" } }
local function outputs(s) return { u = { s.commanded, unit = "N" } } end

local make = {}

-- kp, ki, kd, derivative_filter_hz
function make.pid(settings, period)
  local filter = settings.derivative_filter_hz or 0
  local a = filter > 0 and math.exp(-2 * math.pi * filter * period) or 0
  return tb.system {
    name = "PID controller",
    parameters = {
      kp = { value = settings.kp, unit = "N/m" },
      ki = { value = settings.ki, unit = "N/(m s)" },
      kd = { value = settings.kd, unit = "N s/m" },
      period = { value = period, unit = "s" },
    },
    inputs = inputs,
    discrete = {
      commanded = { unit = "N" }, integral = { unit = "N" }, derivative = { unit = "m/s" }, error = { unit = "m" },
    },
    outputs = outputs,
    sample = {
      {
        name = "controller",
        period_s = period,
        set = function(s)
          local e = s.r - s.measured
          local integral = s.integral + s.ki * s.period * e
          local derivative = a * s.derivative + (1 - a) * (e - s.error) / s.period
          return {
            error = e, integral = integral, derivative = derivative,
            commanded = s.kp * e + integral + s.kd * derivative + s.exc + s.fed_back,
          }
        end,
      },
    },
  }
end

-- kp, kv, limit, delay_samples
function make.cascade(settings, period)
  local delay = settings.delay_samples or 0
  local discrete = {
    commanded = { unit = "N" }, position = { unit = "m" }, mean = { unit = "m" }, begun = 0,
  }
  for i = 1, delay do discrete["u" .. i] = { unit = "N" } end
  return tb.system {
    name = "cascade controller",
    parameters = {
      kp = { value = settings.kp, unit = "1/s" },
      kv = { value = settings.kv, unit = "N s/m" },
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
          local u = s.kv * (s.kp * (s.r - s.measured) - (mean - last_mean) / s.period)
          if settings.limit then u = math.max(-settings.limit, math.min(settings.limit, u)) end
          local set = { begun = 1, position = s.measured, mean = mean }
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
