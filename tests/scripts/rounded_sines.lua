-- The bounds of single sines under rounding alone, next to a mode that the change of frequency has set off. While it
-- lasts, it is noise that makes the rounding random; then all periods are rounded in the same way.
local tb = require "tribode"

local function machine_with(step_m)
  local machine = tb.machine "models/linear_motor_table.lua"
  machine.friction, machine.encoder_resolution_m = nil, step_m
  machine.modes[2].zeta = 0.003
  return machine
end

local function measured(step_m, phase)
  local machine, exc = machine_with(step_m), {}
  for i, f in ipairs { 66, 75, 80 } do -- 80 Hz: 25 samples a period
    for k = 0, 7999 do
      exc[#exc + 1] = (12 + 6 * phase) * math.sin(2 * math.pi * (f * k * machine.Ts + phase * (0.5 + 0.618 * i)))
    end
  end
  local run = tb.simulate { machine = machine, exc = exc }
  local fra = tb.fra { machine = machine, records = { { exc = exc, u = run.u, y = run.y } }, methods = { "fra1" } }
  local r = fra.responses.fra1
  for i, f in ipairs(r.frequency_hz) do
    if math.abs(f - 80) < 0.1 then return r.phase_deg[i], r.std_phase_deg[i] end
  end
  error "80 Hz has no value"
end

local squares, count = 0, 12
for n = 1, count do
  local phase = n / count
  local found, bound = measured(1e-7, phase)
  local truth = measured(0, phase)
  local z = ((found - truth + 180) % 360 - 180) / bound
  squares = squares + z ^ 2
  print(string.format("phase %.3f: error %.2e deg, bound %.2e, ratio %.2f", phase, z * bound, bound, z))
end
print("rms of the ratios:", math.sqrt(squares / count))
assert(math.sqrt(squares / count) < 1.2 and math.sqrt(squares / count) > 0.2)
