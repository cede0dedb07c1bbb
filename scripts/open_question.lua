-- The paper's open question: where does the remaining error of the proposed analysis come from? Each cause is
-- switched off in turn, then one after the other, which ends in the analysis "Improved" (docs/open-question.md). Last,
-- both analyses and FRA-1 against the amplitude, down to near the Coulomb level.
--
--   tribode run scripts/open_question.lua -D amplitude=8 -D frequencies=100
--
-- Results: open_question.json, causes.csv, amplitudes.csv and the plots causes, steps, parameters,
-- amplitudes.

local tb = require "tribode"

local option = tb.options {
  machine = { default = "models/linear_motor_table.lua", help = "machine description, .lua or .json" },
  amplitude = { default = 15, unit = "N", help = "of the excitation" },
  amplitudes = { default = tb.quick and { 8, 50 } or { 8, 10, 12, 15, 20, 30, 50 }, unit = "N", help = "to compare" },
  frequencies = { default = tb.quick and 40 or 400, help = "how many in each sweep" },
  f_min = { default = 20, unit = "Hz", help = "lowest frequency" },
  f_max = { default = 200, unit = "Hz", help = "highest frequency" },
  harmonics = { default = 15, help = "of the motion that the improved analysis takes into account" },
  delay_s = { default = 1.38e-3, unit = "s", help = "of the delay model C_dly" },
  long_settle_s = { default = 3, unit = "s", help = "settling where that cause is off" },
  long_measure_s = { default = 1, unit = "s", help = "window where that cause is off" },
  seed = { default = 0, help = "of the sensor noise" },
}
local machine = tb.machine { file = option.machine, argument = {} }
local f = tb.linspace(option.f_min, option.f_max, option.frequencies)
local modes = #(machine.modes or {})
local truth = tb.plant_parameters { machine = machine }
local plant = tb.plant_response { machine = machine, frequency_hz = f }

-- ---- complex numbers ---------------------------------------------------------------------------------------------

local function polar(size, angle) return { size * math.cos(angle), size * math.sin(angle) } end
local function times(a, b) return { a[1] * b[1] - a[2] * b[2], a[1] * b[2] + a[2] * b[1] } end
local function minus(a, b) return { a[1] - b[1], a[2] - b[2] } end
local function inverse(a)
  local square = a[1] ^ 2 + a[2] ^ 2
  return { a[1] / square, -a[2] / square }
end
local function size(a) return math.sqrt(a[1] ^ 2 + a[2] ^ 2) end
local function angle(a) return math.atan(a[2], a[1]) end
local function at(response, i) return { response.real[i], response.imag[i] } end

local function response_of(value)
  local response = { frequency_hz = f, real = {}, imag = {} }
  for i = 1, #f do
    local h = value(i)
    response.real[i], response.imag[i] = h[1], h[2]
  end
  return response
end

local function distance(a, b) -- abs(a/b - 1) at each frequency
  local list = {}
  for i = 1, #f do list[i] = size(minus(times(at(a, i), inverse(at(b, i))), { 1, 0 })) end
  return list
end

local function rms(list)
  local sum = 0
  for _, x in ipairs(list) do sum = sum + x ^ 2 end
  return math.sqrt(sum / #list)
end

-- ---- sweeps ------------------------------------------------------------------------------------------------------

local sweeps = 0
local function sweep(changes)
  sweeps = sweeps + 1
  local options = {
    machine = machine, frequency_hz = f, amplitude_N = option.amplitude, delay_s = option.delay_s, improved = true,
    seed = option.seed, checkpoint = string.format("sweep_%d.resume.json", sweeps),
  }
  for key, value in pairs(changes) do options[key] = value end
  local result = tb.sweep(options)
  for _, warning in ipairs(result.warnings) do
    print(string.format("warning: %g N, %s", options.amplitude_N, warning))
  end
  assert(#result.responses.Improved.frequency_hz == #f, "a frequency failed, see the warnings")
  return result.responses
end

local exact_encoder = {}
for key, value in pairs(machine) do exact_encoder[key] = value end
exact_encoder.encoder_resolution_m, exact_encoder.noise_rms_m = 0, 0

local many = option.harmonics
local base = sweep {}
local with_harmonics = sweep { harmonics = many }
local long = sweep { settle_time_s = option.long_settle_s, measure_time_s = option.long_measure_s }
local exact = sweep { machine = exact_encoder }
local last_but_one = sweep {
  harmonics = many, settle_time_s = option.long_settle_s, measure_time_s = option.long_measure_s,
}
local last = sweep {
  harmonics = many, settle_time_s = option.long_settle_s, measure_time_s = option.long_measure_s,
  machine = exact_encoder,
}
local pure_sine = sweep { harmonics = 1 }

-- ---- the analysis with its parts exchanged -----------------------------------------------------------------------

-- What the loop really makes of u on its way to y besides the plant: hold, dead times, current loop. Wrong on request:
-- dead time too long [s], corner of the current loop too high by a factor.
local function loop(frequency, too_long, too_high)
  local half_turn = math.pi * frequency * machine.Ts
  local dead = (machine.input_delay_s or 0) + (machine.output_delay_s or 0) + (too_long or 0)
  local response = polar(math.sin(half_turn) / half_turn, -half_turn - 2 * math.pi * frequency * dead)
  if machine.current_loop_hz then
    response = times(response, inverse { 1, frequency / (machine.current_loop_hz * (too_high or 1)) })
  end
  return response
end

-- Per unit of position, as the sweep has them: thrust 1/H1, friction at the samples 1/H1 - 1/H2 and between them.
-- off.gain: gain of hold and current loop in place of one; off.pade: dead time in place of its Pade filter; off.lag:
-- the loop's phase in place of a dead time; off.friction: friction between the samples.
local function analysis(off)
  return response_of(function(i)
    local thrust, no_friction = inverse(at(base["FRA-1"], i)), inverse(at(base["FRA-2"], i))
    local sampled = minus(thrust, no_friction)
    local pade = times(minus(inverse(at(base.Proposed, i)), { -sampled[1], -sampled[2] }), at(base["FRA-1"], i))
    local true_loop, dead = loop(f[i]), polar(1, -2 * math.pi * f[i] * option.delay_s)
    local delay = off.pade and dead or pade
    if off.lag then delay = times(delay, polar(1, angle(true_loop) - angle(dead))) end
    if off.gain then delay = times(delay, { size(true_loop), 0 }) end
    local friction = sampled
    if off.friction then
      friction = minus(times(true_loop, thrust), inverse(at(base.Improved, i)))
    end
    return inverse(minus(times(delay, thrust), friction))
  end)
end

-- ---- the errors --------------------------------------------------------------------------------------------------

local names = { "k0" }
for j = 1, modes do
  for _, name in ipairs { "k" .. j, "f" .. j .. "_hz", "zeta" .. j } do names[#names + 1] = name end
end

local function case(name, response, reference, label)
  local fit = tb.fit_modal { response = response, modes = modes, f_min_hz = option.f_min, f_max_hz = option.f_max }
  local result = { name = name, label = label, errors = {}, standard_errors = {}, distance = distance(response, plant) }
  for _, key in ipairs(names) do
    result.errors[key] = fit[key] / truth[key] - 1
    result.standard_errors[key] = fit.standard_errors[key] / truth[key]
  end
  result.rms_distance = rms(result.distance)
  result.change = reference and distance(response, reference)
  result.rms_change = result.change and rms(result.change)
  return result
end

local function head(title, last_column)
  print("\n" .. title)
  local cells = {}
  for _, key in ipairs(names) do cells[#cells + 1] = string.format("%8s", (key:gsub("_hz", ""))) end
  print(string.format("%-44s %s   %8s %s", "", table.concat(cells), "abs(H/P-1)", last_column or ""))
end

local function row(result)
  local cells = {}
  for _, key in ipairs(names) do cells[#cells + 1] = string.format("%+8.2f", 100 * result.errors[key]) end
  print(string.format("%-44s %s   %8.3f %s", result.name, table.concat(cells), 100 * result.rms_distance,
    result.rms_change and string.format("%12.3f", 100 * result.rms_change) or ""))
end

-- Each cause off alone. `change`: how far that moves the response, its size.
local proposed = case("Proposed", base.Proposed, nil, "Proposed")
local causes = {
  case("gain of hold and current loop", analysis { gain = true }, base.Proposed, "gain"),
  case("Pade filter for a dead time", analysis { pade = true }, base.Proposed, "Pade"),
  case("one dead time for all lags", analysis { lag = true }, base.Proposed, "one dead time"),
  case("friction model at the samples", analysis { friction = true }, base.Proposed, "friction at samples"),
  case("rounding of the encoder", exact.Proposed, base.Proposed, "rounding"),
  case("settling and window", long.Proposed, base.Proposed, "settling, window"),
  case("harmonics in the sine fit", with_harmonics.Proposed, base.Proposed, "harmonics"),
}
head(string.format("Errors in %% at %g N from %d frequencies, each cause off alone; rms over the frequencies",
  option.amplitude, #f), "moved by it")
row(proposed)
local largest = causes[1]
for _, cause in ipairs(causes) do
  row(cause)
  if cause.rms_change > largest.rms_change then largest = cause end
end
print("The largest cause: " .. largest.name)

-- One after the other.
local steps = {
  proposed,
  case("- gain of hold and current loop", analysis { gain = true }, nil, "- gain"),
  case("- Pade filter", analysis { gain = true, pade = true }, nil, "- Pade"),
  case("- one dead time for all lags", analysis { gain = true, pade = true, lag = true }, nil, "- one dead time"),
  case("- sampled friction = Improved, 5 harmonics", base.Improved, nil, "- friction at samples"),
  case(string.format("Improved, %d harmonics", many), with_harmonics.Improved, nil, "Improved"),
  case("- settling and window", last_but_one.Improved, nil, "- window"),
  case("- rounding", last.Improved, nil, "- rounding"),
}
head("Off one after the other, in %")
for _, step in ipairs(steps) do row(step) end
local improved = steps[6]
local of_sine = case("Improved, motion taken as a sine", pure_sine.Improved)
row(of_sine)

-- The improved analysis where what it is told of the machine is wrong.
local function misled(wrong)
  return response_of(function(i)
    local thrust = inverse(at(with_harmonics["FRA-1"], i))
    local friction = minus(times(loop(f[i]), thrust), inverse(at(with_harmonics.Improved, i)))
    local told = times(loop(f[i], wrong.dead_time_s, wrong.current_loop), thrust)
    return inverse(minus(told, times(friction, { wrong.friction or 1, 0 })))
  end)
end

local wrongs = {
  case("dead time 25 us too long", misled { dead_time_s = 25e-6 }),
  case("corner of the current loop 10 % too high", misled { current_loop = 1.1 }),
  case("friction 5 % too high", misled { friction = 1.05 }),
}
head("Improved with a wrong description, in %")
for _, wrong in ipairs(wrongs) do row(wrong) end

-- ---- amplitudes --------------------------------------------------------------------------------------------------

-- FRA-1 as the paper treats it: the delay read from its phase at 120 Hz, eq. (18), is taken out.
local function without_delay(response)
  local delay = tb.phase_delay { response = response, at_hz = math.max(option.f_min, math.min(120, option.f_max)) }
  return tb.remove_delay { response = response, delay_s = delay }, delay
end

-- What FRA-1 is off by, in two: friction alone, with the loop taken out exactly, and what is left of the loop when the
-- delay read by eq. (18) is taken out of it, with no friction. Both act on the same response and cancel in part.
local function apart(response, delay_s)
  local friction_alone = response_of(function(i) return times(at(response, i), inverse(loop(f[i]))) end)
  local loop_alone = response_of(function(i)
    return times(times(at(plant, i), loop(f[i])), polar(1, 2 * math.pi * f[i] * delay_s))
  end)
  return rms(distance(friction_alone, plant)), rms(distance(loop_alone, plant))
end

local by_amplitude, amplitude_columns = {}, { { name = "amplitude_N", unit = "N", values = option.amplitudes } }
head("Against the amplitude, in %")
for i, amplitude in ipairs(option.amplitudes) do
  local responses = amplitude == option.amplitude and with_harmonics
    or sweep { amplitude_N = amplitude, harmonics = many }
  by_amplitude[i] = { amplitude_N = amplitude }
  for _, name in ipairs { "FRA-1", "Proposed", "Improved" } do
    local response, delay = responses[name], nil
    if name == "FRA-1" then response, delay = without_delay(response) end
    local result = case(string.format("%s, %g N", name, amplitude), response)
    row(result)
    by_amplitude[i][name] = result
    if delay then
      local friction, rest = apart(responses[name], delay)
      result.delay_s, result.friction_alone, result.loop_alone = delay, friction, rest
      print(string.format("  friction alone %.1f %%; the loop behind the delay of %.3f ms that is read %.1f %%",
        100 * friction, delay * 1e3, 100 * rest))
    end
  end
end

-- ---- files -------------------------------------------------------------------------------------------------------

local function summary(result)
  return {
    name = result.name, errors = result.errors, standard_errors = result.standard_errors,
    rms_distance = result.rms_distance, rms_change = result.rms_change, delay_s = result.delay_s,
    friction_alone = result.friction_alone, loop_alone = result.loop_alone,
  }
end
local function summaries(list)
  local all = {}
  for i, result in ipairs(list) do all[i] = summary(result) end
  return all
end

local amplitude_summaries = {}
for i, entry in ipairs(by_amplitude) do
  amplitude_summaries[i] = { amplitude_N = entry.amplitude_N }
  for _, name in ipairs { "FRA-1", "Proposed", "Improved" } do
    amplitude_summaries[i][name] = summary(entry[name])
  end
end
tb.write_json {
  file = "open_question.json",
  value = {
    amplitude_N = option.amplitude, truth = truth, Proposed = summary(proposed), Improved = summary(improved),
    largest_cause = largest.name, off_alone = summaries(causes), off_one_after_the_other = summaries(steps),
    motion_as_sine = summary(of_sine), wrong_description = summaries(wrongs), amplitudes = amplitude_summaries,
  },
}

local function column_name(text) return (text:lower():gsub("[^%w]+", "_"):gsub("^_", "")) end
local columns = { { name = "frequency_hz", unit = "Hz", values = f } }
for _, cause in ipairs(causes) do
  columns[#columns + 1] = { name = column_name(cause.name) .. "_size", unit = "", values = cause.change }
end
for _, step in ipairs(steps) do
  columns[#columns + 1] = { name = column_name(step.name) .. "_error", unit = "", values = step.distance }
end
tb.write_csv { file = "causes.csv", columns = columns }

for _, name in ipairs { "FRA-1", "Proposed", "Improved" } do
  for _, key in ipairs(names) do
    local values = {}
    for i, entry in ipairs(by_amplitude) do values[i] = entry[name].errors[key] end
    amplitude_columns[#amplitude_columns + 1] =
      { name = column_name(name) .. "_" .. key:gsub("_hz", "") .. "_error", unit = "", values = values }
  end
end
tb.write_csv { file = "amplitudes.csv", columns = amplitude_columns }

-- ---- plots -------------------------------------------------------------------------------------------------------

-- A logarithmic axis has no place for zero.
local least = 1e-6
local function shown(list)
  local values = {}
  for i, x in ipairs(list) do values[i] = math.max(math.abs(x), least) end
  return values
end

-- One color more than the palette has: the last of the steps is black.
local function color_of(step) return step == steps[#steps] and "#000000" or nil end

local sizes, distances = {}, {}
for i, cause in ipairs(causes) do sizes[i] = { name = cause.label, x = f, y = shown(cause.change) } end
for i, step in ipairs(steps) do
  distances[i] = {
    name = step.label, x = f, y = shown(step.distance), width = step == improved and 3 or 1.6, color = color_of(step),
  }
end
tb.plot {
  file = "causes",
  title = string.format("Size of each cause of the error of the proposed analysis, %g N", option.amplitude),
  height = 800,
  panels = { {
    x_label = "Frequency [Hz]", y_label = "abs(H/H_off - 1) [-]", y_log = true, y_range = { least, 0.1 },
    series = sizes,
  } },
}
tb.plot {
  file = "steps",
  title = string.format("Distance from the true plant, causes off one after the other, %g N", option.amplitude),
  height = 800,
  panels = { {
    x_label = "Frequency [Hz]", y_label = "abs(H/P - 1) [-]", y_log = true, y_range = { least, 0.1 },
    series = distances,
  } },
}

local places, place_names, parameter_series = {}, {}, {}
for i, key in ipairs(names) do
  places[i], place_names[i] = i, string.format("%d: %s", i, (key:gsub("_hz", "")))
end
for i, step in ipairs(steps) do
  local values = {}
  for j, key in ipairs(names) do values[j] = math.max(100 * math.abs(step.errors[key]), 1e-4) end
  parameter_series[i] = { name = step.label, x = places, y = values, style = "line_points", color = color_of(step) }
end
tb.plot {
  file = "parameters",
  title = string.format("Errors of the parameters, causes off one after the other, %g N", option.amplitude),
  height = 800,
  panels = { {
    x_label = table.concat(place_names, "   "), y_label = "abs(error) [%]", y_log = true,
    x_range = { 0.5, #names + 0.5 }, series = parameter_series,
  } },
}

if #option.amplitudes > 1 then
  local series = {}
  for _, name in ipairs { "FRA-1", "Proposed", "Improved" } do
    local values = {}
    for i, entry in ipairs(by_amplitude) do values[i] = entry[name].rms_distance end
    series[#series + 1] = { name = name, x = option.amplitudes, y = values, style = "line_points" }
  end
  tb.plot {
    file = "amplitudes",
    title = "Distance from the true plant against the amplitude",
    panels = { {
      x_label = "Amplitude of the excitation [N]", y_label = "rms of abs(H/P - 1) [-]", x_log = true, y_log = true,
      series = series,
    } },
  }
end
