-- The encoder of a servo axis: measured[k] is the position at k Ts - delay, with periodic errors and noise, rounded.
--
--   q = y + sum of A sin(2 pi y/period_m + phase) + A2 sin(4 pi y/period_m + phase2) + noise_rms n[k]
--   measured = resolution floor(q/resolution + 1/2)
--
-- The delay is the offset of the sample clock; whole samples of it are places in a row, m1, m2, …
-- in: y [m]; out: measured [m].
local tb = require "tribode"

-- period [s], delay [s], resolution [m] (0: none), noise_rms [m], seed,
-- errors = { { A =, period_m =, phase =, A2 =, phase2 = }, … }
return function(settings)
  local is_noisy = settings.noise_rms > 0
  local function noise(k) return is_noisy and settings.noise_rms * tb.standard_normal(settings.seed, 1, k) or 0 end
  local function detect(y, added, metre)
    local q, error = y, 0
    for _, e in ipairs(settings.errors) do
      local angle = 2 * math.pi * (y / metre) / e.period_m
      error = error + (e.A * math.sin(angle + (e.phase or 0)) + (e.A2 or 0) * math.sin(2 * angle + (e.phase2 or 0)))
    end
    q = q + metre * error + added
    if settings.resolution > 0 then q = settings.resolution * math.floor(q / settings.resolution + 0.5) end
    return q
  end
  -- The instant k Ts - delay is k' Ts + offset, k' = k - lead; at k Ts that is the last reading but `behind`.
  local samples = settings.delay / settings.period
  local lead = math.floor(samples + 0.5)
  local offset = 0
  if math.abs(samples - lead) >= 1e-9 then
    lead = math.floor(samples) + 1
    offset = settings.period - (settings.delay - (lead - 1) * settings.period)
  end
  local behind = offset > 0 and lead - 1 or lead
  local discrete = {}
  -- Before t = 0 the axis rested at 0: m0 is the reading of sample lead - 1.
  for i = 0, behind do
    discrete["m" .. i] = { start = detect(0, noise(math.max(lead - 1 - i, 0)), 1), unit = "m" }
  end
  local clocks = {
    {
      name = "encoder",
      period_s = settings.period,
      offset_s = offset,
      set = function(s)
        local set = { m0 = detect(s.y, is_noisy and s.noise or 0, s.metre) }
        for i = 1, behind do set["m" .. i] = s["m" .. i - 1] end
        return set
      end,
    },
  }
  if is_noisy then
    discrete.noise = { unit = "m" }
    table.insert(clocks, 1, {
      name = "noise",
      period_s = settings.period,
      offset_s = offset,
      call = function(_, k) return { noise = noise(k + lead) } end,
    })
  end
  return tb.system {
    name = "encoder",
    parameters = { metre = { value = 1, unit = "m" } },
    inputs = { y = { unit = "m" } },
    discrete = discrete,
    outputs = function(s) return { measured = { s["m" .. behind], unit = "m" } } end,
    sample = clocks,
  }
end
