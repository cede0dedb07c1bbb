-- tb.simulate{ sensitivities = {...} } against differences of whole runs, extrapolated to steps of zero, with every
-- part of a machine and every effect that stays piecewise affine.
local tb = require "tribode"

local channels = { "u", "y", "x", "v" }
-- What rounding leaves of a run, in open and in closed loop: of u, what a controller makes of it.
local roundings = { open = { u = 0, y = 1e-17, x = 1e-17, v = 4e-15 },
  closed = { u = 5e-11, y = 2e-17, x = 2e-17, v = 4e-15 } }
local worst, worst_name, judged, roughly, samples, unjudged = 0, "", 0, 0, 0, {}

-- Differences at h, h/2, h/4, ... extrapolated to zero; for each sample the value, and how far the last two
-- extrapolations moved it.
local function extrapolated(run, size, one_sided)
  local levels, rows, moved = 5, {}, {}
  local here = one_sided and run(0)
  for level = 1, levels do
    local h = size / 2 ^ (level - 1)
    local above, below = run(h), one_sided and here or run(-h)
    rows[level] = {}
    for _, channel in ipairs(channels) do
      local list = {}
      for k = 1, #above.x do list[k] = (above[channel][k] - below[channel][k]) / (one_sided and h or 2 * h) end
      rows[level][channel] = list
    end
  end
  for order = 1, levels - 1 do
    local power = (one_sided and 2 or 4) ^ order
    for level = levels, order + 1, -1 do
      for channel, list in pairs(rows[level]) do
        moved[channel] = moved[channel] or {}
        for k = 1, #list do
          local change = (list[k] - rows[level - 1][channel][k]) / (power - 1)
          if level == levels and order >= levels - 2 then
            moved[channel][k] = math.max(moved[channel][k] or 0, math.abs(change))
          end
          list[k] = list[k] + change
        end
      end
    end
  end
  return rows[levels], moved
end

local function value_at(machine, path)
  local value = machine
  for key in path:gmatch "[^.%[%]]+" do value = value[tonumber(key) or key] end
  return value
end

-- A path, or { path, step =, two_sided = }. Samples at which no step gives the differences to 2e-11 of the greatest one
-- are not judged: there an event crosses the sample instant, or rounding is large, as in a closed loop.
local function check(title, machine, input, paths, options)
  options = options or {}
  machine = tb.with_fields(machine, {})
  local names, tolerated = {}, options.reference or 1e-9
  for i, path in ipairs(paths) do names[i] = type(path) == "table" and path[1] or path end
  local settings = options.settings or { solver = "exact" }
  local function arguments_of(run_machine)
    local arguments = { machine = run_machine, seed = 3 }
    for _, fields in ipairs { settings, input } do
      for key, value in pairs(fields) do arguments[key] = value end
    end
    return arguments
  end
  local arguments = arguments_of(machine)
  arguments.sensitivities = names
  local found = tb.simulate(arguments)
  assert(found.ok, found.message)
  assert(#found.events >= (options.events or 0), title .. ": too few events")
  for i, name in ipairs(names) do
    local own = type(paths[i]) == "table" and paths[i] or {}
    local value = not input[name] and value_at(machine, name) or 0
    local function run(c)
      local other = arguments_of(machine)
      if input[name] then
        other[name] = {}
        for k, u in ipairs(input[name]) do other[name][k] = u * (1 + c) end
      else
        other.machine = tb.with_fields(machine, { [name] = value + c })
      end
      return tb.simulate(other)
    end
    local step = own.step or (input[name] and 1 or math.abs(value)) / 4
    local one_sided = value == 0 and not input[name] and not own.two_sided
    local wanted, uncertain, rounded = {}, {}, {}
    local rounding = options.roundings or input.u and roundings.open or roundings.closed
    local any_judged = false
    for attempt = options.attempts and options.attempts[1] or 0, options.attempts and options.attempts[2] or 4 do
      local values, moved = extrapolated(run, step / 8 ^ attempt, one_sided)
      for _, channel in ipairs(channels) do
        wanted[channel] = wanted[channel] or {}
        uncertain[channel], rounded[channel] = uncertain[channel] or {}, rounded[channel] or {}
        for k = 1, #found.x do
          local most = 0 -- around it: at one sample alone it may happen to be small
          for near = math.max(k - 5, 1), math.min(k + 5, #found.x) do most = math.max(most, moved[channel][near]) end
          local rest = rounding[channel] * 16 * 8 ^ attempt / step -- of the differences
          if most + rest < (uncertain[channel][k] or math.huge) + (rounded[channel][k] or 0) then
            wanted[channel][k], uncertain[channel][k], rounded[channel][k] = values[channel][k], most, rest
          end
        end
      end
    end
    local s = found.sensitivities[name]
    for _, channel in ipairs(channels) do
      assert(#s[channel] == #found.x)
      local largest, off, count, size, none = 0, 0, 0, 0, true
      for k = 1, #found.x do
        largest, size = math.max(largest, math.abs(wanted[channel][k])), math.max(size, math.abs(found[channel][k]))
        none = none and s[channel][k] == 0
      end
      for k = 1, #found.x do
        if uncertain[channel][k] <= 2e-11 * largest and rounded[channel][k] <= tolerated * largest then
          count = count + 1
          off = math.max(off, math.abs(s[channel][k] - wanted[channel][k]) - rounded[channel][k])
        end
      end
      local relative = off == 0 and 0 or off / largest
      if none then -- what does not depend on it: the runs differ by rounding alone
        count = #found.x
        assert(largest * step < 1e-12 * size)
      end
      -- In a closed loop rounding can be larger than that in every sample; then half of them must be near.
      if count == 0 then
        local apart = {}
        for k = 1, #found.x do apart[k] = math.abs(s[channel][k] - wanted[channel][k]) end
        table.sort(apart)
        roughly = roughly + 1
        assert(apart[#apart // 2] < 1e-5 * largest, string.format("%s: d%s/d %s: half of the samples are off by %.2e",
          title, channel, name, apart[#apart // 2] / largest))
      end
      judged, samples = judged + count, samples + #found.x
      local what = string.format("%s: d%s/d %s", title, channel, name)
      if relative > worst then worst, worst_name = relative, what end
      any_judged = any_judged or count > 0
      assert(relative < tolerated,
        string.format("%s: off by %.2e of %.3g, %d samples judged", what, relative, largest, count))
    end
    if not any_judged then unjudged[#unjudged + 1] = title .. " " .. name end
  end
end

local function signal(count, amplitude, frequency, second)
  local list = {}
  for k = 1, count do
    local t = (k - 1) * 5e-4
    list[k] = amplitude * (math.sin(2 * math.pi * frequency * t) + 0.4 * math.sin(2 * math.pi * (second or 71) * t + 1))
  end
  return list
end

local elements = { { K = 4e5, F = 1 }, { K = 6e4, F = 1.5, D = 20 }, { K = 2e4, F = 2 } }
local modes = { { gain = 0.013, freq_hz = 33, zeta = 0.025 }, { gain = 0.005, freq_hz = 82, zeta = 0.02 } }
local function base(changes)
  local machine = { Ts = 5e-4, rigid_gain_per_kg = 0.094, modes = modes,
    friction = { viscous = 2.4, elements = elements } }
  for key, value in pairs(changes or {}) do machine[key] = value end
  return machine
end
local plant_paths = { "rigid_gain_per_kg", "modes[1].gain", "modes[1].freq_hz", "modes[2].zeta", "friction.viscous",
  "friction.elements[1].K", "friction.elements[2].F", "friction.elements[2].D", "friction.elements[3].K",
  { "friction.elements[1].D", step = 10 } }
local function with(list, more)
  local all = {}
  for _, path in ipairs(list) do all[#all + 1] = path end
  for _, path in ipairs(more) do all[#all + 1] = path end
  return all
end

check("elements and modes", base(), { u = signal(300, 12, 11) }, with(plant_paths, { "u" }), { events = 8 })
check("delays and a lag", base { input_delay_s = 6.3e-4, output_delay_s = 4.18e-4, current_loop_hz = 750 },
  { u = signal(300, 12, 11) }, with(plant_paths, { "input_delay_s", "output_delay_s", "current_loop_hz" }),
  { events = 8 })
check("delays without a lag", base { input_delay_s = 6.3e-4, output_delay_s = 4.18e-4 },
  { u = signal(300, 12, 11) }, { "input_delay_s", "output_delay_s" }, { events = 8 })
for _, lag in ipairs { false, 750 } do
  check(lag and "Coulomb friction and a lag" or "Coulomb friction",
    base { friction = { coulomb = 3, viscous = 2.4, elements = elements }, input_delay_s = 3e-4,
      current_loop_hz = lag or nil },
    { u = signal(300, 14, 11) }, with(plant_paths, { "friction.coulomb", "input_delay_s" }), { events = 8 })
end
check("a mode alone", { Ts = 5e-4, modes = { modes[1] }, friction = { coulomb = 2 } }, { u = signal(300, 9, 11) },
  { "modes[1].gain", "modes[1].freq_hz", "modes[1].zeta", "friction.coulomb" }, { events = 2 })

-- Closed loops. The controller's numbers, references and excitations; no rounding by the encoder.
local pid = { type = "pid", kp = 2.05e4, ki = 1.8e5, kd = 653, derivative_filter_hz = 300 }
local loop = { input_delay_s = 6.3e-4, output_delay_s = 4.18e-4, current_loop_hz = 750, controller = pid }
local loop_input = { r = signal(300, 2e-4, 9), exc = signal(300, 8, 11) }
check("PID", base(loop), loop_input, with(plant_paths, { "controller.kp", "controller.ki", "controller.kd",
  "controller.derivative_filter_hz", "input_delay_s", "output_delay_s", "current_loop_hz", "r", "exc" }),
  { events = 8 })
check("PID and Coulomb friction", base { friction = { coulomb = 3, elements = elements }, controller = pid },
  loop_input, { "friction.coulomb", "friction.elements[2].K", "controller.kp", "modes[1].freq_hz", "exc",
  { "input_delay_s", step = 1e-6 }, { "output_delay_s", step = 1e-6 } }, { events = 8 })
local cascade = { type = "cascade", kp = 60, kv = 500, limit = 9, delay_samples = 2 }
check("cascade", base { controller = cascade, output_delay_s = 2e-4 }, { r = signal(300, 6e-4, 9) },
  { "controller.kp", "controller.kv", "controller.limit", "friction.elements[2].F", "modes[1].gain", "r",
  "output_delay_s" },
  { events = 8 })
local filters = { { type = "low_pass", freq_hz = 200 }, { type = "notch", freq_hz = 82, zeta = 0.3 } }
cascade = { type = "cascade", kp = 60, kv = 300, ki = 40, limit = 9, filters = filters }
check("P-PI with filters", base { controller = cascade }, { r = signal(300, 6e-4, 9) },
  { "controller.kp", "controller.kv", "controller.ki", "friction.elements[2].F", "modes[1].gain", "r" },
  { events = 8 })

-- Effects.
local open, small = { u = signal(300, 12, 11) }, { "rigid_gain_per_kg", "friction.elements[2].F", "modes[1].freq_hz" }
local function effect(name, parameters, paths, changes, input, options)
  local own = {}
  for i, path in ipairs(paths) do
    if type(path) == "table" then
      own[i] = { "effects[1].parameters." .. path[1], step = path.step, two_sided = path.two_sided }
    else
      own[i] = "effects[1].parameters." .. path
    end
  end
  local machine = base(changes)
  machine.effects = { { name = name, parameters = parameters } }
  check(name, machine, input or open, with(own, #machine.modes > 0 and small or { "rigid_gain_per_kg" }), options)
end
effect("actuator_lag", { current_loop_hz = 120 }, { "current_loop_hz" })
effect("asymmetric_friction", { dF_pos = 3, dF_neg = 1 }, { "dF_pos", "dF_neg" })
effect("asymmetric_friction", { dF_pos = 3, dF_neg = 1, dD_pos = 5, dD_neg = 2 }, { "dD_pos", "dD_neg" })
effect("constant_force", { F = 4 }, { "F" })
effect("coulomb_friction", { dF = 3 }, { "dF" })
effect("dead_zone", { half_width = 1.5 }, { "half_width" })
effect("encoder_periodic_error", { A = 2e-6, period_m = 1e-3, A2 = 5e-7 }, { "A", "period_m", "A2" }, loop, loop_input)
effect("input_delay", { extra_s = 1.1e-3 }, { "extra_s" })
effect("payload_mass", { ratio = 0.3 }, { "ratio" })
effect("periodic_disturbance", { F = 6, freq_hz = 7 }, { "F", "freq_hz" })
effect("presliding_hysteresis", { elements = { { K = 1e5, F = 2 }, { K = 1e4, F = 2 } } },
  { "elements[1].K", "elements[2].F" })
effect("resonant_mode", { gain = 0.01, freq_hz = 60, zeta = 0.02 }, { "gain", "freq_hz", "zeta" })
effect("spring_force", { k = 300 }, { "k" })
effect("spring_force", { k = 0 }, { { "k", step = 10, two_sided = true } })
effect("thrust_gain", { gain = 1.2 }, { "gain" })
effect("thrust_power_law", { exponent = 1.3, size = 15 }, { "exponent", "size" })
effect("thrust_saturation", { limit = 8 }, { "limit" })
effect("viscous_friction", { dD = 40 }, { "dD" })
for _, sensor in ipairs { "motor", "load" } do
  -- Each impact makes the rounding of a run larger, and the differences are only as good.
  effect("backlash", { gap_m = 5e-5, load_fraction = 0.4, contact_hz = 200, contact_zeta = 0.2, sensor = sensor },
    { "gap_m", "load_fraction", "contact_hz", "contact_zeta" },
    { modes = {}, friction = { elements = elements } }, nil, { reference = 5e-9 })
end
-- With modes, and an axis that also sticks.
for _, sensor in ipairs { "motor", "load" } do
  effect("backlash", { gap_m = 5e-5, load_fraction = 0.4, contact_hz = 200, contact_zeta = 0.2, sensor = sensor },
    { "gap_m", "load_fraction", "contact_hz", "contact_zeta" },
    { friction = { elements = elements, coulomb = 2 } }, nil, { reference = 5e-9 })
end
-- Noise.
check("noise", base { noise_rms_m = 1e-7, process_noise_rms_N = 0.2, controller = pid }, loop_input,
  { { "noise_rms_m", step = 5e-8 }, "process_noise_rms_N", "controller.kd" })

-- Effects by which a machine is not piecewise affine, in open and in closed loop. The reference is only as good as the
-- solver's tolerances, in a loop with kinks least.
local collocation = { solver = "collocation", relative_tolerance = 1e-13, absolute_tolerance_m = 1e-16 }
local erk = { solver = "erk", relative_tolerance = 1e-13, absolute_tolerance_m = 1e-16 }
local short_open, short_loop = { u = signal(120, 12, 11) }, { r = signal(80, 2e-4, 9), exc = signal(80, 8, 11) }
local sticking = { coulomb = 2, viscous = 2.4, elements = elements }
local function curved(name, parameters, paths, options)
  options = options or {}
  local own = {}
  for i, path in ipairs(paths) do
    own[i] = { "effects[1].parameters." .. (path[1] or path), step = type(path) == "table" and path.step or nil }
  end
  local settings, effects = options.settings or collocation, { { name = name, parameters = parameters } }
  local rounding = { y = 1e-16, x = 1e-16, v = 2e-14, u = 1e-10 }
  check(name, base { friction = options.rolling and base().friction or sticking, effects = effects }, short_open,
    with(own, { "friction.elements[2].F", options.more }),
    { settings = settings, roundings = rounding, attempts = { 0, 2 }, events = options.rolling and 2 or 4 })
  local machine = base { controller = pid, input_delay_s = 6.3e-4, output_delay_s = 4.18e-4, current_loop_hz = 750,
    friction = options.in_loop, effects = effects }
  local in_loop = { settings = settings, roundings = rounding, attempts = { 0, 1 }, reference = 5e-9 }
  if settings == erk then
    in_loop.roundings, in_loop.reference = { y = 1e-14, x = 1e-14, v = 2e-12, u = 1e-9 }, 1e-7
  end
  check(name .. " in a loop", machine, short_loop, { own[1] }, in_loop)
end
curved("cubic_stiffness", { k3 = 5e11, y0 = 1e-4 }, { "k3", "y0" })
local harmonics = { { F = 3, period_m = 2e-3, phase = 0.4 }, { F = 1, period_m = 7e-4, phase = 1 } }
curved("force_ripple", { harmonics = harmonics },
  { "harmonics[1].F", "harmonics[1].period_m", "harmonics[2].phase" })
curved("gravity", { F = 5, turn_m = 0.04, phase = 0.3 }, { "F", "turn_m", "phase" })
curved("quadratic_drag", { c = 3000 }, { "c" })
curved("power_drag", { c = 200, exponent = 1.7 }, { "c", "exponent" })
curved("position_dependent_friction", { mode = "sine", a = 0.5, period_m = 2e-3, phase = 0.4 },
  { "a", "period_m", "phase" })
curved("position_dependent_friction", { mode = "gradient", a = 0.5, period_m = 2e-4 }, { "a", "period_m" },
  { settings = erk }) -- it ends at kinks
curved("time_varying_friction", { kind = "exp", a = 0.8, T = 0.1 }, { "a", "T" })
curved("time_varying_friction", { kind = "ramp", a = 0.8, T = 0.1 }, { "a", "T" })
curved("time_varying_friction", { kind = "sine", a = 0.8, T = 0.1 }, { "a", "T" })
curved("stribeck_friction", { dFs = 3, velocity = 0.01, exponent = 1 }, { "dFs", "velocity" },
  { in_loop = sticking, more = "friction.coulomb" })
curved("stribeck_friction", { dFs = 3, velocity = 0.01, exponent = 2 }, { "velocity", { "exponent", step = 0.1 } },
  { in_loop = sticking })
local rolling = { rolling = true, settings = erk }
curved("load_dependent_friction", { share = 0.1, reach = 2e-5 }, { "share", "reach" }, rolling)
curved("lugre_friction", { F = 3, Fs = 4, velocity = 0.005, exponent = 2, K = 1e5, D = 30, viscous = 3 },
  { "Fs", "velocity", { "exponent", step = 0.2 }, "K", "D" }, rolling)
curved("dahl_friction", { F = 3, K = 1e5, exponent = 1.5 }, { "F", "K", { "exponent", step = 0.2 } },
  rolling)
curved("bouc_wen_friction", { F = 3, reach = 3e-5, beta = 0.6, exponent = 2 }, { "F", "reach", "beta", "exponent" },
  rolling)

-- By the start, which no field moves: on a spring it swings, on friction it goes along.
local spring = { Ts = 5e-4, rigid_gain_per_kg = 0.1,
  effects = { { name = "spring_force", parameters = { k = 2000 } } } }
local run = tb.simulate { machine = spring, u = signal(200, 5, 9),
  sensitivities = { "start.position_m", "start.velocity_m_per_s" } }
local omega = math.sqrt(0.1 * 2000)
for k, t in ipairs(run.t) do
  assert(math.abs(run.sensitivities["start.position_m"].x[k] - math.cos(omega * t)) < 1e-12)
  assert(math.abs(run.sensitivities["start.velocity_m_per_s"].x[k] - math.sin(omega * t) / omega) < 1e-13)
end
run = tb.simulate { machine = base(), u = signal(200, 12, 9), sensitivities = { "start.position_m" } }
for k = 1, 200 do
  assert(math.abs(run.sensitivities["start.position_m"].y[k] - 1) < 1e-12)
  assert(math.abs(run.sensitivities["start.position_m"].v[k]) < 1e-10)
end

-- The run itself is the same to the bit with and without; rounding by the encoder counts as none.
local rounded = base { encoder_resolution_m = 1e-6, controller = pid }
local alone = tb.simulate { machine = rounded, r = loop_input.r }
run = tb.simulate { machine = rounded, r = loop_input.r, sensitivities = { "controller.kp", "friction.viscous" } }
for _, channel in ipairs { "t", "r", "u", "y", "x", "v", "f" } do
  for k, value in ipairs(alone[channel]) do assert(run[channel][k] == value) end
end
assert(#run.events == #alone.events)

-- What has no derivative is refused with one sentence.
local function refused(changes, name, sentence, input)
  local ok, message = pcall(tb.simulate, { machine = base(changes), sensitivities = { name },
    u = not input and signal(20, 5, 9) or nil, r = input and signal(20, 1e-4, 9) or nil,
    friction_feedback = input and 0.5 or nil })
  assert(not ok and message:find(sentence, 1, true), tostring(message))
end
refused({}, "friction.viscosity", "is no number of the machine (did you mean \"friction.viscous\"?)")
refused({}, "Ts", "it sets the sample instants")
refused({ encoder_resolution_m = 1e-6 }, "encoder_resolution_m", "rounding jumps with it")
refused({}, "friction.coulomb", "any other value adds a part")
refused({ friction = { coulomb = 1, stribeck = { static = 2, velocity = 0.1, exponent = 0.5 } } }, "friction.viscous",
  "the Stribeck level has no finite slope at rest")
refused({ friction = { coulomb = 2, stribeck = { static = 2, velocity = 0.1 } } }, "friction.stribeck.static",
  "any other value adds a part")
refused({ effects = { { name = "dahl_friction", parameters = { F = 3, K = 1e5, exponent = 0.5 } } } },
  "friction.viscous", "no finite slope at its level")
refused({ effects = { { name = "own_force", parameters = { force = "-3*v^3" } } } }, "friction.viscous", "own_force")
refused({ controller = cascade }, "controller.filters[1].freq_hz", "filters of the controller are taken as exact")
refused({ input = "band_limited" }, "friction.viscous", "u varies between its samples")
refused({ controller = pid }, "friction.viscous", "friction is fed back", true)

print(string.format("worst: %.2e, %s; %d of %d samples judged, %d curves by half of their samples, all of: %s",
  worst, worst_name, judged, samples, roughly, table.concat(unjudged, ", ")))
assert(worst < 5e-9 and judged > 0.6 * samples and #unjudged < 10)
