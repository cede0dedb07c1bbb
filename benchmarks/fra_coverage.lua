-- Do 95 % bounds of measured frequency responses cover the truth? Are points called settled when they are, and only
-- then? What does the distortion say of a friction model? By repetition, beside what is asked or was measured before.
--
--   tribode run benchmarks/fra_coverage.lua -D repetitions=40 -D seconds=4,0.8
--   tribode run benchmarks/fra_coverage.lua -D parts=weights,dead,distortion
--
-- Coverage and settling, on a table without friction. The truth of the parameters is the machine's, of the response it
-- is what the same analysis finds without noise and rounding in a record that is long enough for every transient.
-- Each row: noise, seconds per sine, share of values within their 95 % bounds (parameters of the fit, gain and phase of
-- the response), share of points called settled and largest error among them, in units of the larger of 0.2 % and two
-- standard errors, share of points without a value, spread over the repetitions / mean standard error of each
-- parameter.
-- Weights: how much smaller the scatter of fitted parameters is where each point is weighted by its variance.
-- Dead frequencies: a table with dry friction under sines that do not all move it.
-- Distortion: multisines on the table with its friction, with friction models right and wrong.
-- Results: coverage.json and the tables.

local tb = require "tribode"
local modal_parameters = dofile "scripts/lib/modal_parameters.lua"

local option = tb.options {
  repetitions = { default = tb.quick and 3 or 40, help = "records of each row" },
  seconds = { default = "4,0.8", help = "per sine" },
  frequencies = { default = 40, help = "of a record, from 20 to 200 Hz" },
  method = { default = "improved", choices = { "fra1", "proposed", "improved" }, help = "the analysis" },
  rows = { default = "rounding,0.3,3", help = "noise in um rms, or rounding: of the encoder alone" },
  zeta2 = { default = 0.003, help = "damping ratio of the second mode" },
  period_s = { default = 1, unit = "s", help = "of the multisines of 24 s, which have 71 lines with 1" },
  parts = { default = "coverage,weights,dead,distortion", help = "of the benchmark" },
}

local function machine_with(noise_m, step_m)
  local machine = tb.machine "models/linear_motor_table.lua"
  machine.friction = nil
  machine.modes[2].zeta = option.zeta2
  machine.noise_rms_m = noise_m
  machine.encoder_resolution_m = step_m
  return machine
end

local ts = machine_with(0, 0).Ts
local frequencies = tb.linspace(20, 200, option.frequencies)

-- Sines in turn. Phase and amplitude differ from repetition to repetition, so that the rounding does.
local function excitation(seconds, phase)
  local values = {}
  local count = math.floor(seconds / ts)
  for i, f in ipairs(frequencies) do
    for k = 0, count - 1 do
      values[#values + 1] = (12 + 6 * phase) * math.sin(2 * math.pi * (f * k * ts + phase * (0.5 + 0.618 * i)))
    end
  end
  return values
end

local function measured(machine, seconds, phase, seed)
  local exc = excitation(seconds, phase)
  local run = tb.simulate { machine = machine, exc = exc, seed = seed }
  return tb.fra {
    machine = machine,
    records = { { exc = exc, u = run.u, y = run.y } },
    methods = { option.method },
  }
end

local parts = {}
for part in option.parts:gmatch "[^,]+" do parts[part] = true end
local results = {}

if parts.coverage then
  local truth = measured(machine_with(0, 0), 20, 0, 0)
  local true_fit = {}
  for name, value in pairs(tb.plant_parameters { machine = machine_with(0, 0) }) do
    true_fit[name:gsub("_hz", "")] = value
  end
  local true_points = {}
  for i, f in ipairs(truth.responses[option.method].frequency_hz) do
    local r = truth.responses[option.method]
    true_points[string.format("%.6f", f)] = { gain = r.gain_db[i], phase = r.phase_deg[i] }
  end

  local names = { "k0", "k1", "f1", "zeta1", "k2", "f2", "zeta2" }
  print(string.format("%-9s %5s  %10s %8s %8s %8s %8s  %s", "noise", "s", "parameters", "response", "settled", "error",
    "missing", "spread / standard error of " .. table.concat(names, ", ")))
  for row in option.rows:gmatch("[^,]+") do
    for text in option.seconds:gmatch("[^,]+") do
      local seconds = tonumber(text)
      local noise = row == "rounding" and 0 or tonumber(row) * 1e-6
      local machine = machine_with(noise, 1e-7)
      local hits, values, point_hits, point_values, missing, settled, largest = 0, 0, 0, 0, 0, 0, 0
      local squares, errors = {}, {}
      for repetition = 1, option.repetitions do
        local fra = measured(machine, seconds, repetition / option.repetitions, repetition)
        local fit = fra.fits[option.method]
        local found, bound = modal_parameters(fit), modal_parameters(fit.standard_errors)
        for _, name in ipairs(names) do
          local error = found[name] - true_fit[name]
          values = values + 1
          if math.abs(error) < 1.96 * bound[name] then hits = hits + 1 end
          squares[name] = (squares[name] or 0) + error ^ 2
          errors[name] = (errors[name] or 0) + bound[name] ^ 2
        end
        local r = fra.responses[option.method]
        missing = missing + #r.missing
        for i, f in ipairs(r.frequency_hz) do
          local point = true_points[string.format("%.6f", f)]
          if point then
            local phase = (r.phase_deg[i] - point.phase + 180) % 360 - 180
            if math.abs(r.gain_db[i] - point.gain) < 1.96 * r.std_gain_db[i] then point_hits = point_hits + 1 end
            if math.abs(phase) < 1.96 * r.std_phase_deg[i] then point_hits = point_hits + 1 end
            point_values = point_values + 2
            settled = settled + r.settled[i]
            if r.settled[i] == 1 then
              local error = math.max(math.abs(r.gain_db[i] - point.gain) / 8.686, math.abs(phase) / 57.3)
              largest = math.max(largest, error / math.max(2e-3, 2 * r.std_gain_db[i] / 8.686))
            end
          end
        end
      end
      local ratios = {}
      for i, name in ipairs(names) do ratios[i] = string.format("%.2f", math.sqrt(squares[name] / errors[name])) end
      results[#results + 1] = {
        noise = row, seconds = seconds, parameters = hits / values, response = point_hits / point_values,
        settled = 2 * settled / point_values, largest_error_of_settled = largest,
        missing = missing / (option.repetitions * #frequencies),
      }
      print(string.format("%-9s %5g  %10.3f %8.3f %8.3f %8.2f %8.3f  %s", row, seconds, hits / values,
        point_hits / point_values, 2 * settled / point_values, largest, missing / (option.repetitions * #frequencies),
        table.concat(ratios, " ")))
    end
  end
  print("asked:           0.90-0.98  0.9-0.98        (once: settled 0.54 under 0.3 um, 0.03 under 3 um; error 6)")
end

-- ---- fits with and without weights ----------------------------------------------------------------------------------

if parts.weights then
  local function scatter(found, kind, name)
    local sum, squares, n = 0, 0, #found
    for _, one in ipairs(found) do sum, squares = sum + one[kind][name], squares + one[kind][name] ^ 2 end
    return math.sqrt(math.max(squares / n - (sum / n) ^ 2, 0) * n / (n - 1))
  end
  local with_friction = tb.with_fields(tb.machine "models/linear_motor_table.lua", { noise_rms_m = 0.3e-6 })
  print "\nScatter of a plain fit over that of the weighted one   (before)"
  for _, row in ipairs {
    { "table, 0.3 um", with_friction, k0 = 8.4, k1 = 2.3 },
    { "without friction, 3 um", machine_with(3e-6, 1e-7), k0 = 18.6, k1 = 3.8 },
  } do
    for text in option.seconds:gmatch("[^,]+") do
      local found = {}
      for repetition = 1, option.repetitions do
        local fra = measured(row[2], tonumber(text), repetition / option.repetitions, repetition)
        local r = fra.responses[option.method]
        local plain = tb.fit_modal {
          response = { frequency_hz = r.frequency_hz, real = r.real, imag = r.imag }, modes = 2, f_min_hz = 15,
          f_max_hz = 210,
        }
        found[repetition] = { plain = plain, weighted = modal_parameters(fra.fits[option.method]) }
      end
      local ratio = {}
      for _, name in ipairs { "k0", "k1" } do
        ratio[name] = scatter(found, "plain", name) / scatter(found, "weighted", name)
      end
      print(string.format("  %-24s %4s s per sine   k0 %5.1f (%.1f)   k1 %5.1f (%.1f)", row[1], text, ratio.k0, row.k0,
        ratio.k1, row.k1))
      results[#results + 1] = { weights = row[1], seconds = tonumber(text), k0 = ratio.k0, k1 = ratio.k1 }
    end
  end
end

-- ---- frequencies at which nothing moves ---------------------------------------------------------------------------

if parts.dead then
  local machine = tb.machine "models/linear_motor_table.lua"
  machine.friction = { coulomb = 5 }
  machine.closed_loop = false
  local u = {}
  for i, f in ipairs(frequencies) do
    local amplitude = i % 4 == 0 and 3 or 100
    for k = 0, math.floor(0.8 / ts) - 1 do u[#u + 1] = amplitude * math.sin(2 * math.pi * f * k * ts) end
  end
  local run = tb.simulate { machine = machine, u = u }
  local fra = tb.fra { machine = machine, records = { { u = u, y = run.y } }, methods = { option.method } }
  local missing = fra.responses[option.method].missing
  local wanted = #frequencies // 4
  print(string.format("\nDead frequencies: %d of %d without a value (%s); fit of the others: k0 %+.2f %%", #missing,
    wanted, missing[1] and missing[1].reason or "", 100 * (fra.fits[option.method].k0 / machine.rigid_gain_per_kg - 1)))
  results[#results + 1] = { dead = #missing, of = wanted }
end

-- ---- distortion ---------------------------------------------------------------------------------------------------

if parts.distortion then
  local table_machine = tb.machine "models/linear_motor_table.lua"
  local with_dry = tb.with_fields(table_machine, { ["friction.coulomb"] = 0.5 })
  local linear = tb.with_fields(table_machine, { friction = { viscous = 2.35 } })
  -- The friction model is driven by the detected position: an encoder step moves its force by 0.35 N.
  local ideal = tb.with_fields(table_machine, { encoder_resolution_m = 0 })
  local noisy = tb.with_fields(table_machine, { noise_rms_m = 1e-7 })
  local function scaled(factor)
    return tb.with_fields { machine = table_machine, scale = { ["friction.elements[*].F"] = factor } }
  end
  local rows = {
    { "FRA-1", table_machine, table_machine, "fra1", -25 },
    { "friction model right", table_machine, table_machine, "improved", -48 },
    { "the same, ideal encoder", ideal, ideal, "improved" },
    { "the same, 0.1 um of noise", noisy, noisy, "improved" },
    { "friction 5 % wrong", table_machine, scaled(1.05), "improved", -45 },
    { "friction 20 % wrong", table_machine, scaled(1.2), "improved", -39 },
    { "0.5 N of dry friction unknown", with_dry, table_machine, "improved", -35 },
    { "floor: no friction", linear, linear, "fra1", -52 },
  }
  local repetitions = math.min(8, option.repetitions)
  print(string.format("\nOdd distortion [dB], median over the lines, of %d multisines of 24 s   (before)", repetitions))
  local logs = {}
  for _, row in ipairs(rows) do
    local lowest, highest, sum = math.huge, -math.huge, 0
    for repetition = 1, repetitions do
      logs[row[2]] = logs[row[2]] or {}
      local log = logs[row[2]][repetition]
      if not log then
        local drive = tb.multisine {
          sample_time_s = ts, period_s = option.period_s, periods = 24 // option.period_s, amplitude_N = 30,
          seed = repetition,
        }
        local run = tb.simulate { machine = row[2], exc = drive.values, seed = repetition }
        log = { exc = drive.values, u = run.u, y = run.y }
        logs[row[2]][repetition] = log
      end
      local fra = tb.fra { machine = row[3], records = { log }, methods = { row[4] } }
      local values = {}
      for _, value in ipairs(fra.responses[row[4]].odd_distortion_db) do
        if value == value then values[#values + 1] = value end
      end
      table.sort(values)
      local median = values[(#values + 1) // 2]
      lowest, highest, sum = math.min(lowest, median), math.max(highest, median), sum + median
    end
    print(string.format("  %-30s %6.1f (%.1f to %.1f) %8s", row[1], sum / repetitions, lowest, highest, row[5] or ""))
    results[#results + 1] = {
      distortion = row[1], mean_db = sum / repetitions, lowest_db = lowest, highest_db = highest,
    }
  end
end
tb.write_json { file = "coverage.json", value = results }
