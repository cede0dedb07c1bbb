-- The describing function of the friction over amplitude and frequency of the motion: the fundamental of the friction
-- force over that of a sinusoidal motion, N(a, f) = R + jI. The elements make it depend on the amplitude, viscous
-- friction and their damping on the frequency. Beside it that of the friction model as a controller runs it, at its
-- sample time, where a reversal is seen at the next sample.
--
--   tribode run scripts/describing_function_map.lua -D amplitudes=60
--
-- Three roads to the same number at each point of a grid: the closed form, the elements followed along 2000 points of a
-- period, and the model at the sample time along one second. Last, the friction laws side by side. Results: map.csv,
-- map.json and the plots map, frequency, sampled, laws.

local tb = require "tribode"
local plots = require "lib.batch_plots"

local option = tb.options {
  machine = { default = "models/linear_motor_table.lua", help = "machine description, .lua or .json" },
  amplitudes = { default = tb.quick and 7 or 41, help = "how many, a decade is a quarter of them" },
  least = { default = 1e-7, unit = "m", help = "least amplitude" },
  greatest = { default = 1e-3, unit = "m", help = "greatest amplitude" },
  frequencies = { default = { 11, 23, 47, 101, 199 }, unit = "Hz", help = "whole numbers" },
}
local machine = tb.machine { file = option.machine, argument = {} }
local elements, viscous = machine.friction.elements, machine.friction.viscous or 0
local two_pi = 2 * math.pi

for _, f in ipairs(option.frequencies) do
  -- One second then holds whole periods and whole samples, and no part of a period is preferred.
  if f % 1 ~= 0 or f < 1 then error("-D frequencies: must be whole numbers of Hz", 0) end
end

-- ---- three roads --------------------------------------------------------------------------------------------------

-- Per element: it sticks from each reversal until it has travelled 2 X, cos th = 1 - 2 X/a.
local function closed_form(a, f)
  local re, im = 0, two_pi * f * viscous
  for _, e in ipairs(elements) do
    local th = math.acos(math.max(1 - 2 * (e.F / e.K) / a, -1))
    local n_re, n_im = (th - math.sin(th) * math.cos(th)) / math.pi, math.sin(th) ^ 2 / math.pi
    -- Damping acts in stick only: j w D times the share of the velocity in stick, which has the same n.
    local d = two_pi * f * (e.D or 0)
    re, im = re + e.K * n_re - d * n_im, im + e.K * n_im + d * n_re
  end
  return re, im
end

-- Fundamental of `force` over that of `position`, both periodic in the samples first .. first + count - 1.
local function ratio(position, force, first, count, turns)
  local x_re, x_im, y_re, y_im = 0, 0, 0, 0
  for k = 0, count - 1 do
    local c, s = math.cos(two_pi * turns * k / count), math.sin(two_pi * turns * k / count)
    x_re, x_im = x_re + position[first + k] * c, x_im - position[first + k] * s
    y_re, y_im = y_re + force[first + k] * c, y_im - force[first + k] * s
  end
  local square = x_re ^ 2 + x_im ^ 2
  return (y_re * x_re + y_im * x_im) / square, (y_im * x_re - y_re * x_im) / square
end

-- The elements without damping along a sine; the first period only moves them.
local function followed(a)
  local count, position = 2000, {}
  for k = 0, 2 * count - 1 do position[k + 1] = a * math.sin(two_pi * k / count) end
  local force = tb.friction_force { elements = elements, position = position }
  return ratio(position, force, count + 1, count, 1)
end

-- The damping of the elements along samples: in stick only, with the velocity from the difference of two samples.
local function add_damping(force, position, Ts)
  for _, e in ipairs(elements) do
    local z, limit = 0, e.F / e.K
    for k = 2, (e.D or 0) > 0 and #position or 1 do
      local step = position[k] - position[k - 1]
      z = math.max(-limit, math.min(limit, z + step))
      if math.abs(z) < limit then force[k] = force[k] + e.D * step / Ts end
    end
  end
end

-- The friction model at the sample time: elements, and viscous friction from the difference of two samples.
local function sampled(a, f)
  local Ts = machine.Ts
  local count = math.floor(1 / Ts + 0.5)
  local settle = math.ceil(1 / (f * Ts)) + 1
  local position = {}
  for k = 0, settle + count - 1 do position[k + 1] = a * math.sin(two_pi * f * k * Ts) end
  local force = tb.friction_force { elements = elements, position = position }
  add_damping(force, position, Ts)
  for k = #position, 2, -1 do force[k] = force[k] + viscous * (position[k] - position[k - 1]) / Ts end
  return ratio(position, force, settle + 1, count, f)
end

local function degrees(re, im) return math.deg(math.atan(im, re)) end

local function run(point)
  local a, f = point.amplitude_m, point.frequency_hz
  local re, im = closed_form(a, f)
  local still_re, still_im = closed_form(a, 0)
  local followed_re, followed_im = followed(a)
  local sampled_re, sampled_im = sampled(a, f)
  local size = math.sqrt(re ^ 2 + im ^ 2)
  return {
    real_N_per_m = re,
    imag_N_per_m = im,
    gain_N_per_m = size,
    phase_deg = degrees(re, im),
    force_N = size * a,
    roads_apart = math.sqrt((followed_re - still_re) ^ 2 + (followed_im - still_im) ^ 2)
      / math.sqrt(still_re ^ 2 + still_im ^ 2),
    sampled_gain_error = math.sqrt(sampled_re ^ 2 + sampled_im ^ 2) / size - 1,
    sampled_lag_deg = degrees(re, im) - degrees(sampled_re, sampled_im),
    sampled_error = math.sqrt((sampled_re - re) ^ 2 + (sampled_im - im) ^ 2) / size,
  }
end

-- ---- plots --------------------------------------------------------------------------------------------------------

local function curves(merged, name, factor)
  local series = {}
  for i, f in ipairs(option.frequencies) do
    local x, y = {}, {}
    for k, here in ipairs(merged.parameters.frequency_hz) do
      if here == f then
        x[#x + 1], y[#y + 1] = merged.parameters.amplitude_m[k] * 1e6, merged.results[name][k] * factor
      end
    end
    series[i] = { name = string.format("%d Hz", f), x = x, y = y }
  end
  return series
end

local amplitude_label = "Amplitude of the motion [um]"

local function draw(merged)
  tb.plot {
    file = "map",
    title = "Describing function of the friction",
    panels = {
      { y_label = "Gain [N/m]", x_log = true, y_log = true, series = curves(merged, "gain_N_per_m", 1) },
      { y_label = "Phase [deg]", x_log = true, legend = "none", series = curves(merged, "phase_deg", 1) },
      {
        x_label = amplitude_label, y_label = "Fundamental force [N]", x_log = true, legend = "none",
        series = curves(merged, "force_N", 1),
      },
    },
  }
  tb.plot {
    file = "sampled",
    title = string.format("The friction model at a sample time of %g ms against friction itself", machine.Ts * 1e3),
    panels = {
      { y_label = "Gain error [%]", x_log = true, series = curves(merged, "sampled_gain_error", 100) },
      {
        x_label = amplitude_label, y_label = "Lag [deg]", x_log = true, legend = "none",
        series = curves(merged, "sampled_lag_deg", 1),
      },
    },
  }
  -- Along the frequency, at the amplitudes next to the powers of ten.
  local gain, phase, wanted = {}, {}, option.least
  for _, a in ipairs(tb.logspace(option.least, option.greatest, option.amplitudes)) do
    if a >= wanted * (1 - 1e-9) then
      wanted = wanted * 10
      local f = tb.logspace(1, 500, 120)
      local y_gain, y_phase = {}, {}
      for k, here in ipairs(f) do
        local re, im = closed_form(a, here)
        y_gain[k], y_phase[k] = math.sqrt(re ^ 2 + im ^ 2), degrees(re, im)
      end
      local name = string.format("%.3g um", a * 1e6)
      gain[#gain + 1], phase[#phase + 1] = { name = name, x = f, y = y_gain }, { name = name, x = f, y = y_phase }
    end
  end
  tb.plot {
    file = "frequency",
    title = "The same along the frequency, at several amplitudes",
    panels = {
      { y_label = "Gain [N/m]", x_log = true, y_log = true, series = gain },
      { x_label = "Frequency [Hz]", y_label = "Phase [deg]", x_log = true, series = phase, legend = "none" },
    },
  }
end

-- All laws with the same level and the same stiffness at rest, at a speed where no Stribeck curve matters.
local function draw_laws()
  local F, K, f = 3, 1e5, 10
  local function law(name, parameters) return { { name = name, parameters = parameters } } end
  local cases = {
    { "Dahl, LuGre", law("lugre_friction", { F = F, Fs = F, velocity = 1, K = K }) },
    { "Bouc-Wen, exponent 3", law("bouc_wen_friction", { F = F, reach = F / K, exponent = 3 }) },
    { "GMS, two elements", law("gms_friction", { F = F, Fs = F, velocity = 1, attraction = 1e3,
      elements = { { K = 0.7 * K, share = 0.5 }, { K = 0.3 * K, share = 0.5 } } }) },
    { "Leuven, two elements", law("leuven_friction", { F = F, Fs = F, velocity = 1, transition = 2,
      elements = { { K = 0.7 * K, F = 0.5 * F }, { K = 0.3 * K, F = 0.6 * F } } }) },
    { "one Maxwell-slip element", nil, { elements = { { K = K, F = F } } } },
    { "Coulomb", nil, { coulomb = F } },
  }
  local amplitudes, frequencies = tb.logspace(1e-6, 1e-3, 41), {}
  for i = 1, #amplitudes do frequencies[i] = f end
  local stiffness, damping = {}, {}
  for i, case in ipairs(cases) do
    local n = tb.describing_function {
      machine = { Ts = machine.Ts, mass_kg = 10, effects = case[2], friction = case[3] },
      amplitude_m = amplitudes, frequency_hz = frequencies,
    }
    local x = {}
    for k, a in ipairs(amplitudes) do x[k] = a * 1e6 end
    local style = i > 4 and "dashed" or "line"
    stiffness[i] = { name = case[1], x = x, y = n.real, style = style }
    damping[i] = { name = case[1], x = x, y = n.imag, style = style }
  end
  tb.plot {
    file = "laws",
    title = string.format("Describing functions of friction laws of %g N and %g N/m", F, K),
    panels = {
      { y_label = "Real part [N/m]", x_log = true, series = stiffness, y_range = { -0.1 * K, 1.1 * K } },
      { x_label = amplitude_label, y_label = "Imaginary part [N/m]", x_log = true, legend = "none", series = damping,
        y_range = { 0, 0.7 * K } },
    },
  }
end

tb.batch {
  name = "describing_function_map",
  points = tb.grid {
    factors = {
      { name = "frequency_hz", values = option.frequencies },
      { name = "amplitude_m", values = tb.logspace(option.least, option.greatest, option.amplitudes) },
    },
  },
  units = { amplitude_m = "m", frequency_hz = "Hz", real_N_per_m = "N/m", imag_N_per_m = "N/m", gain_N_per_m = "N/m",
    phase_deg = "deg", force_N = "N", sampled_lag_deg = "deg" },
  run = run,
  finish = function(merged)
    assert(#merged.failures == 0, merged.failures[1] and merged.failures[1].reason)
    tb.write_csv { file = "map.csv", columns = plots.columns(merged) }
    local apart = tb.statistics { values = merged.results.roads_apart }.greatest
    local lag = tb.worst_cases { values = merged.results.sampled_lag_deg, count = 1 }[1]
    local error_row = tb.worst_cases { values = merged.results.sampled_error, count = 1 }[1]
    local function at(row)
      return string.format("%.3g um, %d Hz", merged.parameters.amplitude_m[row] * 1e6,
        merged.parameters.frequency_hz[row])
    end
    print(string.format("Closed form and followed elements agree to %.2g of N", apart))
    print(string.format("The sampled model lags by up to %.1f deg (%s); its error is up to %.1f %% of N (%s)",
      lag.value, at(lag.row), 100 * error_row.value, at(error_row.row)))
    tb.write_json {
      file = "map.json",
      value = { points = merged.count, roads_apart = apart, greatest_sampled_lag_deg = lag.value,
        greatest_sampled_error = error_row.value },
    }
    draw(merged)
    draw_laws()
  end,
}
