-- Two records as the logger of a drive might leave them. A simulation stands for the real axis: it has what
-- my_axis.lua lacks, a cogging force of 3 N with the pitch of the magnets. With an axis of your own, use its records.
local tb = require "tribode"

local axis = tb.with_fields(require "my_axis", {}) -- a copy
axis.effects = {
  { name = "force_ripple", parameters = { harmonics = { { F = 3, period_m = 0.024, phase = 0.7 } } } },
}

local function record(file, stroke_m, rate_hz, seed)
  local reference = {}
  for k = 0, math.floor(3 / axis.Ts) - 1 do
    reference[k + 1] = stroke_m / 2 * (1 - math.cos(2 * math.pi * rate_hz * k * axis.Ts))
  end
  local run = tb.simulate { machine = axis, r = reference, seed = seed }
  local reference_mm, position_mm = {}, {}
  for k = 1, #run.t do reference_mm[k], position_mm[k] = run.r[k] * 1e3, run.y[k] * 1e3 end
  tb.write_csv {
    file = file,
    columns = {
      { name = "time_s", values = run.t }, { name = "demand_mm", values = reference_mm },
      { name = "force_N", values = run.u }, { name = "actual_mm", values = position_mm },
    },
  }
end

record("ident.csv", 0.06, 0.5, 1)
record("valid.csv", 0.04, 0.7, 2)
