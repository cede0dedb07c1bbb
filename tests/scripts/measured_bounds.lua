-- The bounds of measured responses where a drift, a wrong controller or the motion of a free axis might pass unseen.
local tb = require "tribode"

local function machine_with(more)
  local description = { Ts = 5e-4, rigid_gain_per_kg = 0.1, modes = { { gain = 0.02, freq_hz = 40, zeta = 0.02 } } }
  for name, value in pairs(more) do description[name] = value end
  return tb.machine(description)
end

local function closed_loop(noise_m, kp)
  return machine_with { noise_rms_m = noise_m, closed_loop = true,
    controller = { type = "pid", kp = kp or 2e4, ki = 1e5, kd = 700, derivative_filter_hz = 300 } }
end

-- The share of gains and phases from 5 to 200 Hz that the 95 % bounds cover.
local function covered(name, machine, response)
  local truth = tb.plant_response { machine = machine, frequency_hz = response.frequency_hz }
  local inside, count = 0, 0
  for i, f in ipairs(response.frequency_hz) do
    if f >= 5 and f <= 200 then
      local gain = math.abs(response.gain_db[i] - truth.gain_db[i])
      local phase = math.abs((response.phase_deg[i] - truth.phase_deg[i] + 180) % 360 - 180)
      count = count + 2
      if gain < 1.96 * response.std_gain_db[i] then inside = inside + 1 end
      if phase < 1.96 * response.std_phase_deg[i] then inside = inside + 1 end
    end
  end
  print(string.format("%s: %d values, %.3f of them within their bounds", name, count, inside / count))
  assert(count > 100)
  return inside / count
end

-- A multisine with all lines, while the reference moves.
for _, velocity in ipairs { 0, 1e-5, 1e-3 } do
  local machine = closed_loop(1e-7)
  local r, exc = {}, tb.multisine {
    period_s = 2, periods = 4, f_min_hz = 5, f_max_hz = 200, odd = false, detection = 0,
  }.values
  for k = 1, #exc do r[k] = velocity * (k - 1) * machine.Ts end
  local run = tb.simulate { machine = machine, exc = exc, r = r, seed = 1 }
  local fra = tb.fra {
    machine = machine, records = { { exc = exc, r = r, u = run.u, y = run.y } }, methods = { "improved" },
  }
  assert(covered(string.format("velocity %g m/s", velocity), machine, fra.responses.improved) > 0.9)
end

-- A noisy reference is the excitation, and the controller in the machine file is not that of the drive.
do
  local drive, r, x = closed_loop(5e-6), {}, 0
  for k = 1, 40000 do
    x = 0.7 * x + tb.standard_normal(1, 7, k) * 2e-5
    r[k] = x
  end
  local run = tb.simulate { machine = drive, r = r, seed = 1 }
  local record = { r = r, u = run.u, y = run.y }
  local fra = tb.fra { machine = closed_loop(5e-6, 2.1e4), records = { record }, methods = { "improved" } }
  assert(fra.records[1]:find("excitation r,", 1, true), fra.records[1])
  assert(covered("controller 5 % off", drive, fra.responses.improved) > 0.92)
end

-- A free axis with viscous friction that is known: what it does until it is at rest in the mean has friction of its
-- own.
do
  local machine, u = machine_with { friction = { viscous = 5 }, noise_rms_m = 1e-8 }, {}
  for _, f in ipairs { 20, 30, 60, 80, 100, 150 } do
    for k = 0, 3999 do u[#u + 1] = 15 * math.sin(2 * math.pi * f * k * machine.Ts) end
  end
  local run = tb.simulate { machine = machine, u = u, seed = 1 }
  local fra = tb.fra { machine = machine, records = { { u = u, y = run.y } }, methods = { "improved" } }
  local response = fra.responses.improved
  local truth = tb.plant_response { machine = machine, frequency_hz = response.frequency_hz }
  for i, f in ipairs(response.frequency_hz) do
    local gain = response.gain_db[i] - truth.gain_db[i]
    local phase = (response.phase_deg[i] - truth.phase_deg[i] + 180) % 360 - 180
    print(f, string.format("gain error %.2e dB, bound %.1e, phase error %.2e deg, bound %.1e", gain,
      response.std_gain_db[i], phase, response.std_phase_deg[i]))
    -- What the samples fold back from above half the rate is 1e-3 at the highest frequency.
    assert(math.abs(gain) < 4 * response.std_gain_db[i] + 2e-6 * f ^ 2, f)
    assert(math.abs(phase) < 4 * response.std_phase_deg[i] + 1e-4 * f, f)
  end
end
