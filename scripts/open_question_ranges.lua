-- The paper's open question with what an experimenter can know: the delay read by eq. (18) or with the friction model,
-- friction identified from a slow record, a friction model whose structure is slightly wrong, a coarse encoder. Sines
-- in turn on three machines and on several neighboring grids of frequencies; the ranges of the errors in one table
-- (docs/open-question.md).
--
--   tribode run scripts/open_question_ranges.lua -D grids=10 -D frequencies=40
--
-- Results: ranges.json, ranges.csv, ranges.txt and the plot ranges.

local tb = require "tribode"
local modal_parameters = require "lib.modal_parameters"

local option = tb.options {
  grids = { default = tb.quick and 2 or 10, help = "neighboring grids of frequencies" },
  frequencies = { default = tb.quick and 20 or 40, help = "of each grid" },
  f_min = { default = 20, unit = "Hz", help = "lowest frequency" },
  f_max = { default = 200, unit = "Hz", help = "highest frequency" },
  seconds = { default = tb.quick and 1 or 1.5, unit = "s", help = "for each sine" },
  delay_hz = { default = 120, unit = "Hz", help = "where eq. (18) reads the delay" },
  machines = { default = tb.quick and { 1 } or { 1, 2, 3 }, help = "of the three machines" },
  joint = { default = not tb.quick, help = "with the joint estimation of all parameters, on one grid" },
}

-- ---- the machines: the paper's, a light one with stiffer guides, a heavy one with little friction -----------------

local paper = tb.machine { file = "models/linear_motor_table.lua", argument = {} }
local function changed(mass, friction, stiffness, modes, fields)
  local machine = tb.with_fields {
    machine = paper, fields = fields,
    scale = {
      rigid_gain_per_kg = 1 / mass, ["friction.elements[*].F"] = friction, ["friction.elements[*].K"] = stiffness,
      ["controller.kp"] = mass, ["controller.ki"] = mass, ["controller.kd"] = mass,
    },
  }
  for j, mode in ipairs(modes) do
    machine.modes[j] = { gain = mode[1] * machine.rigid_gain_per_kg, freq_hz = mode[2], zeta = mode[3] }
  end
  return tb.machine(machine)
end
local machines = {
  { name = "paper", machine = paper, amplitude = 15 },
  {
    name = "light", amplitude = 10,
    machine = changed(0.5, 0.6, 1.5, { { 0.2, 47, 0.015 }, { 0.1, 96, 0.008 } }, { input_delay_s = 250e-6 }),
  },
  {
    name = "heavy", amplitude = 20,
    machine = changed(2, 0.8, 0.6, { { 0.25, 28, 0.02 }, { 0.08, 71, 0.006 } }, { output_delay_s = 250e-6 }),
  },
}

-- ---- records and analyses -----------------------------------------------------------------------------------------

local function sines(machine, amplitude, grid)
  local exc = {}
  local step = (option.f_max - option.f_min) / option.frequencies
  local samples = math.floor(option.seconds / machine.Ts + 0.5)
  for i = 1, option.frequencies do
    local f = option.f_min + step * (i - 1 + (grid - 1) / option.grids)
    for k = 0, samples - 1 do exc[#exc + 1] = amplitude * math.sin(2 * math.pi * f * k * machine.Ts) end
  end
  local run = tb.simulate { machine = machine, exc = exc }
  assert(run.ok, run.message)
  return { exc = exc, u = run.u, y = run.y }
end

-- What the machine file says, and what the log holds.
local function analyze(described, record)
  return tb.fra {
    machine = described, records = { record }, methods = { "fra1", "fra2", "proposed", "improved" },
    fit_min_hz = option.f_min, fit_max_hz = option.f_max, modes = 2,
  }
end

-- Eq. (18) reads hold, dead times and lag together, and friction as a shorter delay; with a friction model it does not.
-- What is not known apart counts as a delay before the machine.
local function with_delay_read(machine, log, how)
  local found = analyze(machine, log).responses
  local function plain(r) return { frequency_hz = r.frequency_hz, real = r.real, imag = r.imag } end
  local read
  if how == "(18)" then
    read = tb.phase_delay { response = plain(found.fra1), at_hz = option.delay_hz }
  else
    read = tb.estimate_delay {
      fra1 = plain(found.fra1), fra2 = plain(found.fra2), f_min_hz = option.delay_hz, f_max_hz = option.f_max,
    }.delay_s
  end
  local rest = machine.Ts / 2 + machine.output_delay_s + 1 / (2 * math.pi * machine.current_loop_hz)
  return tb.with_fields(machine, { input_delay_s = math.max(read - rest, 0) }), read
end

-- Elements, mass and viscous friction from slow motions with nested loops and a faster one, as they are logged.
local function slow_record(machine)
  local r = {}
  local slow = 20
  for k = 0, math.floor((slow + 4) / machine.Ts) do
    local t = k * machine.Ts
    local s = 2 * math.pi * t
    r[#r + 1] = t < slow and math.min(1, t) * (4.5e-3 * math.sin(0.1 * s) + 6e-4 * math.sin(0.63 * s)
        + 1e-4 * math.sin(1.71 * s))
      or math.min(1, t - slow) * 8e-3 * math.sin(1.5 * 2 * math.pi * (t - slow)) - 8e-5 * math.cos(s)
  end
  local run = tb.simulate { machine = machine, r = r }
  assert(run.ok, run.message)
  return { r = r, u = run.u, y = run.y }
end
local function friction_identified(described, log)
  local Ts = described.Ts
  local dead_time = (Ts / 2 + described.input_delay_s + described.output_delay_s
    + 1 / (2 * math.pi * described.current_loop_hz)) / Ts
  local whole, part = math.floor(dead_time), dead_time - math.floor(dead_time)
  local reach = math.floor(0.01 / Ts + 0.5)
  local position, thrust, velocity, acceleration = {}, {}, {}, {}
  for k = reach + 1, #log.y - reach, 4 do
    local i = #position + 1
    local a, b = log.u[math.max(k - whole, 1)], log.u[math.max(k - whole - 1, 1)]
    position[i], thrust[i] = log.y[k], a + part * (b - a)
    velocity[i] = (log.y[k + reach] - log.y[k - reach]) / (2 * reach * Ts)
    acceleration[i] = (log.y[k + reach] - 2 * log.y[k] + log.y[k - reach]) / (reach * Ts) ^ 2
  end
  local mass, viscous, elements = 1 / described.rigid_gain_per_kg, 0, nil
  for _ = 1, 5 do
    local force = {}
    for i = 1, #thrust do force[i] = thrust[i] - mass * acceleration[i] - viscous * velocity[i] end
    elements = tb.fit_friction {
      position = position, force = force, elements = 20, longest_m = 3e-3, first_fitted = #force // 6,
      shortest_m = 2 * described.encoder_resolution_m,
    }.elements
    local straight = tb.least_squares {
      columns = { acceleration, velocity, tb.friction_force { elements = elements, position = position } },
      values = thrust,
    }
    mass, viscous = straight.coefficients[1], math.max(straight.coefficients[2], 0)
  end
  return tb.with_fields(described, { friction = { viscous = viscous, elements = elements } })
end

local function with_friction_law(machine, fields)
  local other = tb.with_fields(machine, {})
  if fields.coulomb then other.friction.coulomb = fields.coulomb end
  if fields.lugre then
    other.effects = { {
      name = "lugre_friction",
      parameters = { F = fields.lugre, Fs = 1.3 * fields.lugre, velocity = 5e-3, K = 2e5 * fields.lugre, D = 20 },
    } }
  end
  return tb.machine(other)
end

local function level_of(machine)
  local level = 0
  for _, element in ipairs(machine.friction.elements) do level = level + element.F end
  return level
end

-- ---- what is known, and what is not -------------------------------------------------------------------------------

-- `log` names the true machine where it is another one; cases with the same share their records.
local function coarse(m) return tb.with_fields(m, { encoder_resolution_m = 1e-6 }) end
local cases = {
  { name = "everything known" },
  { name = "delay from (18)", delay = "(18)" },
  { name = "friction identified", friction = true },
  { name = "delay from (18), friction identified", delay = "(18)", friction = true },
  { name = "friction identified, delay read with it", delay = "friction", friction = true },
  { name = "elements 5 % too strong", scale = 1.05 },
  {
    name = "0.5 N of dry friction more", log = "dry",
    truth = function(m) return with_friction_law(m, { coulomb = 0.5 }) end,
  },
  {
    name = "LuGre friction more, 10 % of the level", log = "lugre",
    truth = function(m) return with_friction_law(m, { lugre = 0.1 * level_of(m) }) end,
  },
  { name = "encoder of 1 um", log = "coarse", truth = coarse },
  {
    name = "encoder of 1 um, delay from (18), friction identified", delay = "(18)", friction = true,
    log = "coarse", truth = coarse,
  },
  {
    name = "encoder of 1 um, friction identified, delay with it", delay = "friction", friction = true,
    log = "coarse", truth = coarse,
  },
}
local names = { "k0", "k1", "f1", "zeta1", "k2", "f2", "zeta2" }
local methods = { "proposed", "improved" }

local text = {}
local function line(...)
  text[#text + 1] = string.format(...)
  print(text[#text])
end
local function cell(range) return range and string.format("%+.2f..%+.2f", 100 * range[1], 100 * range[2]) or "-" end

local rows = {}
local head = {}
for i, name in ipairs(names) do head[i] = string.format("%15s", name) end
line("Ranges of the errors over %d grids of %d frequencies, in %%", option.grids, option.frequencies)
line("%-6s %-58s %-9s %s", "", "", "", table.concat(head))
local function add(machine, case, method, ranges)
  rows[#rows + 1] = { machine = machine, case = case, method = method, ranges = ranges }
  local cells = {}
  for i, name in ipairs(names) do cells[i] = string.format("%15s", cell(ranges[name])) end
  line("%-6s %-58s %-9s %s", machine, case, method, table.concat(cells))
end

for _, index in ipairs(option.machines) do
  local one = machines[index]
  local truth = {}
  for name, value in pairs(tb.plant_parameters { machine = one.machine }) do
    if type(value) == "number" then truth[name:gsub("_hz", "")] = value end
  end
  local kept = {} -- records and identified friction
  local delays = {}
  for _, case in ipairs(cases) do
    local true_machine = case.truth and case.truth(one.machine) or one.machine
    local encoder = true_machine.encoder_resolution_m
    local key = case.log or "as described"
    kept[key] = kept[key] or { sines = {} }
    local ranges = {}
    for grid = 1, option.grids do
      local log = kept[key].sines[grid] or sines(true_machine, one.amplitude, grid)
      kept[key].sines[grid] = log
      local described = tb.with_fields(one.machine, { encoder_resolution_m = encoder })
      if case.friction then
        kept[key].slow = kept[key].slow or slow_record(true_machine)
        kept[key].friction = kept[key].friction or friction_identified(described, kept[key].slow).friction
        described = tb.with_fields(described, { friction = kept[key].friction })
      end
      if case.delay then
        local read
        described, read = with_delay_read(described, log, case.delay)
        delays[case.delay] = delays[case.delay] or {}
        table.insert(delays[case.delay], read)
      end
      if case.scale then
        described = tb.with_fields { machine = described, scale = { ["friction.elements[*].F"] = case.scale } }
      end
      local fra = analyze(described, log)
      for _, method in ipairs(methods) do
        ranges[method] = ranges[method] or {}
        local fit = fra.fits[method]
        for name, value in pairs(fit and modal_parameters(fit) or {}) do
          local error = value / truth[name] - 1
          local range = ranges[method][name] or { error, error }
          ranges[method][name] = { math.min(range[1], error), math.max(range[2], error) }
        end
      end
    end
    for _, method in ipairs(methods) do add(one.name, case.name, method, ranges[method]) end
  end
  for _, how in ipairs { "(18)", "friction" } do
    table.sort(delays[how])
    line("%-6s delay read %s: %.4f to %.4f ms; the loop has %.4f ms", one.name,
      how == "(18)" and "by eq. (18)" or "with the friction model", 1e3 * delays[how][1],
      1e3 * delays[how][#delays[how]], 1e3 * (one.machine.Ts / 2 + one.machine.input_delay_s
        + one.machine.output_delay_s + 1 / (2 * math.pi * one.machine.current_loop_hz)))
  end
  -- All parameters at once from the slow record and the sines, from what an experimenter knows.
  if option.joint then
    local plain = kept["as described"]
    local described = tb.with_fields(one.machine, { friction = plain.friction })
    described = with_delay_read(described, plain.sines[1], "friction")
    local start = tb.with_fields(described, {})
    local fit = modal_parameters(analyze(described, plain.sines[1]).fits.improved)
    start.rigid_gain_per_kg = fit.k0
    for j = 1, 2 do start.modes[j] = { gain = fit["k" .. j], freq_hz = fit["f" .. j], zeta = fit["zeta" .. j] } end
    local found = tb.identify {
      machine = tb.machine(start),
      records = { { u = plain.slow.u, y = plain.slow.y }, { u = plain.sines[1].u, y = plain.sines[1].y } },
    }
    local ranges = {}
    for name, value in pairs(tb.plant_parameters { machine = found.machine }) do
      local short = name:gsub("_hz", "")
      if truth[short] then ranges[short] = { value / truth[short] - 1, value / truth[short] - 1 } end
    end
    add(one.name, "friction identified, then all parameters at once (one grid)", "joint", ranges)
  end
end

tb.write_text { file = "ranges.txt", text = table.concat(text, "\n") .. "\n" }
tb.write_json { file = "ranges.json", value = rows }
local csv = { "machine,case,method,parameter,lowest,highest" }
for _, row in ipairs(rows) do
  for _, name in ipairs(names) do
    local range = row.ranges[name]
    if range then
      csv[#csv + 1] = string.format("%s,%s,%s,%s,%.6g,%.6g", row.machine, row.case:gsub(",", ";"), row.method, name,
        range[1], range[2])
    end
  end
end
tb.write_text { file = "ranges.csv", text = table.concat(csv, "\n") .. "\n" }

-- The largest error of each parameter by case, over all machines.
local series = {}
for i, case in ipairs(cases) do
  local one = { name = case.name, x = {}, y = {}, style = "line_points" }
  for j, name in ipairs(names) do
    local most = 1e-6
    for _, row in ipairs(rows) do
      local range = row.case == case.name and row.method == "improved" and row.ranges[name]
      if range then most = math.max(most, math.abs(range[1]), math.abs(range[2])) end
    end
    one.x[j], one.y[j] = j, 100 * most
  end
  series[i] = one
end
local places = {}
for i, name in ipairs(names) do places[i] = string.format("%d: %s", i, name) end
tb.plot {
  file = "ranges", title = "Improved analysis: largest error over grids and machines", height = 700,
  panels = { {
    x_label = table.concat(places, "   "), y_label = "abs(error) [%]", y_log = true,
    x_range = { 0.5, #names + 0.5 }, series = series,
  } },
}
