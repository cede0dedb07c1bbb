-- Do 95 % bounds of measured frequency responses cover the truth? By repetition, on a table without friction.
--
--   tribode run benchmarks/fra_coverage.lua -D repetitions=40 -D seconds=4,0.8
--
-- The truth of the parameters is the machine's, that of the response is what the same analysis finds without noise and
-- rounding in a record that is long enough for every transient.
-- Each row: noise, seconds per sine, share of values within their 95 % bounds (parameters of the fit, gain and phase of
-- the response), share of points without a value, spread over the repetitions / mean standard error of each parameter.
-- Results: coverage.json and the table.

local tb = require "tribode"

local option = tb.options {
  repetitions = { default = tb.quick and 3 or 40, help = "records of each row" },
  seconds = { default = "4,0.8", help = "per sine" },
  frequencies = { default = 40, help = "of a record, from 20 to 200 Hz" },
  method = { default = "improved", choices = { "fra1", "proposed", "improved" }, help = "the analysis" },
  rows = { default = "rounding,0.3,3", help = "noise in um rms, or rounding: of the encoder alone" },
  zeta2 = { default = 0.003, help = "damping ratio of the second mode" },
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

local function parameters(fit)
  local values = { k0 = fit.k0 }
  for j, mode in ipairs(fit.modes) do
    values["k" .. j], values["f" .. j], values["zeta" .. j] = mode.gain, mode.freq_hz, mode.zeta
  end
  return values
end

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
local results = {}
print(string.format("%-9s %5s  %10s %8s %8s %8s  %s", "noise", "s", "parameters", "response", "settled", "missing",
  "spread / standard error of " .. table.concat(names, ", ")))
for row in option.rows:gmatch("[^,]+") do
  for text in option.seconds:gmatch("[^,]+") do
    local seconds = tonumber(text)
    local noise = row == "rounding" and 0 or tonumber(row) * 1e-6
    local machine = machine_with(noise, 1e-7)
    local hits, values, point_hits, point_values, missing, settled = 0, 0, 0, 0, 0, 0
    local squares, errors = {}, {}
    for repetition = 1, option.repetitions do
      local fra = measured(machine, seconds, repetition / option.repetitions, repetition)
      local fit = fra.fits[option.method]
      local found, bound = parameters(fit), parameters(fit.standard_errors)
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
        end
      end
    end
    local ratios = {}
    for i, name in ipairs(names) do ratios[i] = string.format("%.2f", math.sqrt(squares[name] / errors[name])) end
    results[#results + 1] = {
      noise = row, seconds = seconds, parameters = hits / values, response = point_hits / point_values,
      missing = missing / (option.repetitions * #frequencies),
    }
    print(string.format("%-9s %5g  %10.3f %8.3f %8.3f %8.3f  %s", row, seconds, hits / values,
      point_hits / point_values, 2 * settled / point_values, missing / (option.repetitions * #frequencies),
      table.concat(ratios, " ")))
  end
end
tb.write_json { file = "coverage.json", value = results }
