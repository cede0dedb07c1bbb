-- Cases for the diagnosis, made by simulation: random machines with an effect hidden in them, with two, with none, or
-- with a force that is on no list. Some machines are known within their tolerance only, some have process noise, and
-- with -D model_error some have friction of a structure that their description lacks.
-- Each case is a folder as scripts/diagnosis_score.lua takes it: nominal.json, ident.csv.gz, valid.csv.gz, truth.json.
--
--   tribode run scripts/diagnosis_cases.lua -o results/cases -D count=60 -D seed=7
--   tribode run scripts/diagnosis_cases.lua -D effects=backlash,none,two,unknown -D model_error=0.5
--   tribode run scripts/diagnosis_cases.lua -o results/many -D count=450 --max-instructions 100000000000
--
-- The cases of a seed stay the same when more are asked for. Results: the folders cases/001, cases/002, ..., and
-- cases.csv with what is hidden where.

local tb = require "tribode"

local option = tb.options {
  count = { default = tb.quick and 4 or 36, help = "how many cases" },
  seed = { default = 1, help = "of everything that is drawn" },
  effects = { default = "", help = "names, or none, two, unknown, to choose from; default all" },
  duration = { default = tb.quick and 3 or 7, unit = "s", help = "of each record" },
  tolerance = { default = 0.2, help = "share of the machines whose fields are off by their tolerance" },
  process_noise = { default = 0.2, help = "share of the machines with process noise" },
  more = { default = 0, help = "further records to fit, drawn anew, beside the first; the rest stays the same" },
  model_error = { default = 0, help = "share of the cases whose model is wrong besides: friction of another structure, "
    .. "fields off by their tolerance, process noise, one of them or more" },
  open_loop = { default = 0.1, help = "share of the machines without a controller" },
}

-- ---- drawing ------------------------------------------------------------------------------------------------------

local random = math.random
local function uniform(low, high) return low + (high - low) * random() end
local function spread(low, high) return low * (high / low) ^ random() end -- evenly over the decades
local function pick(list) return list[random(#list)] end
local function chance(share) return random() < share end
local function either(value) return chance(0.5) and value or -value end
local function normal() return math.sqrt(-2 * math.log(1 - random())) * math.cos(2 * math.pi * random()) end

-- Four digits are enough for a truth that a person reads, and the files say them in full.
local function rounded(value)
  if type(value) == "table" then
    local list = {}
    for key, entry in pairs(value) do list[key] = rounded(entry) end
    return list
  end
  return math.type(value) == "float" and tonumber(string.format("%.4g", value)) or value
end

local function copy(value)
  if type(value) ~= "table" then return value end
  local other = {}
  for key, entry in pairs(value) do other[key] = copy(entry) end
  return other
end

local turn = 2 * math.pi
local function phase() return uniform(0, turn) end

-- ---- machines -----------------------------------------------------------------------------------------------------

-- Maxwell-slip elements whose levels sum to `total`: the stiff ones slip first.
local function elements(count, total)
  local list, sum = {}, 0
  for i = 1, count do
    local F = uniform(0.6, 1.4)
    list[i] = { F = F, slip = 5e-7 * (2e-3 / 5e-7) ^ ((i - 1 + uniform(0, 0.6)) / count) }
    sum = sum + F
  end
  for i, element in ipairs(list) do
    local F = element.F / sum * total
    list[i] = { F = F, K = F / element.slip }
  end
  return list
end

local function draw_machine(modes)
  local mass = spread(4, 30)
  local machine = {
    Ts = 5e-4,
    rigid_gain_per_kg = 1 / mass,
    friction = { viscous = spread(2, 40) },
    input_delay_s = pick { 2.5e-4, 5e-4, 7.5e-4 },
    output_delay_s = pick { 0, 2e-4, 4.18e-4 },
    current_loop_hz = pick { 500, 750, 1000, 1500 },
    encoder_resolution_m = pick { 5e-8, 1e-7, 2e-7 },
    noise_rms_m = spread(4e-8, 2.5e-7),
    closed_loop = not chance(option.open_loop),
  }
  local level = spread(2.5, 12)
  if chance(0.3) then
    machine.friction.elements = elements(random(3, 6), level)
  else
    machine.friction.coulomb = level
    if chance(0.15) then
      machine.friction.stribeck = { static = level * uniform(1.1, 1.5), velocity = spread(2e-3, 2e-2), exponent = 1 }
    end
  end
  local lowest = spread(45, 90)
  for j = 1, modes do
    machine.modes = machine.modes or {}
    machine.modes[j] = { gain = spread(0.03, 0.15) / mass, freq_hz = lowest * 1.9 ^ (j - 1) * uniform(0.9, 1.1),
      zeta = spread(5e-3, 4e-2) }
  end
  local w = turn * (modes > 0 and spread(6, 10) or spread(11, 22))
  if chance(0.15) then
    machine.controller = { type = "cascade", kp = w / 3, kv = mass * w, delay_samples = 1 }
  else
    machine.controller = { type = "pid", kp = mass * w ^ 2 / pick { 2, 3 }, ki = mass * w ^ 3 / 27, kd = mass * w,
      derivative_filter_hz = pick { 300, 400 } }
  end
  return rounded(machine), level
end

-- The machine as it is: fields off by their tolerance, at most two standard deviations.
local function true_machine(machine)
  if not machine.tolerance then return copy(machine) end
  local scale = {}
  local function off(path, deviation) scale[path] = 1 + deviation * math.max(-2, math.min(2, normal())) end
  local keys = {}
  for key in pairs(machine.tolerance) do keys[#keys + 1] = key end
  table.sort(keys) -- so that the same numbers are drawn
  for _, key in ipairs(keys) do
    local deviation = machine.tolerance[key]
    if key:find("modes.", 1, true) then
      for j = 1, #machine.modes do off("modes[" .. j .. "]." .. key:sub(7), deviation) end
    elseif key == "friction.elements" then
      off("friction.elements[*].F", deviation)
      scale["friction.elements[*].K"] = scale["friction.elements[*].F"]
    else
      off(key, deviation)
    end
  end
  if scale["friction.coulomb"] and machine.friction.stribeck then
    scale["friction.stribeck.static"] = scale["friction.coulomb"]
  end
  return tb.with_fields { machine = machine, scale = scale }
end

local function draw_tolerance(machine)
  local tolerance = { rigid_gain_per_kg = uniform(0.01, 0.05), ["friction.viscous"] = uniform(0.05, 0.2) }
  if machine.friction.elements then tolerance["friction.elements"] = uniform(0.03, 0.1) end
  if machine.friction.coulomb then tolerance["friction.coulomb"] = uniform(0.03, 0.1) end
  if machine.modes then
    tolerance["modes.gain"], tolerance["modes.freq_hz"] = uniform(0.03, 0.1), uniform(0.005, 0.02)
    tolerance["modes.zeta"] = uniform(0.1, 0.3)
  end
  return rounded(tolerance)
end

-- ---- records ------------------------------------------------------------------------------------------------------

local function samples(machine, f)
  local list = {}
  for k = 1, math.floor(option.duration / machine.Ts + 0.5) do list[k] = f((k - 1) * machine.Ts) end
  return list
end

local function gently(t, over) return t < over and (1 - math.cos(math.pi * t / over)) / 2 or 1 end

local function sine(machine, amplitude, speed)
  local w = math.min(speed / amplitude, turn * 3)
  return samples(machine, function(t) return gently(t, 0.5) * amplitude * math.sin(w * t) end)
end

-- To and fro at constant velocity, the corners rounded over a twentieth of the period.
local function ramps(machine, amplitude, speed)
  local period = 4 * amplitude / speed
  local order = { 1, 3, 5, 7, 9, 11, 13, 15, 17, 19 }
  return samples(machine, function(t)
    local sum = 0
    for _, n in ipairs(order) do
      sum = sum + (n % 4 == 1 and 1 or -1) * math.sin(turn * n * t / period) / n ^ 2 / (1 + (n / 15) ^ 4)
    end
    return gently(t, 0.3) * amplitude * 8 / math.pi ^ 2 * sum
  end)
end

-- Point to point, with rests between.
local function moves(machine, amplitude, speed)
  local at, from, to, begin, duration = 0, 0, 0, 0, 0.2
  return samples(machine, function(t)
    if t > begin + duration + at then
      from, begin = to, t
      to = uniform(-amplitude, amplitude)
      duration = math.max(0.08, 1.9 * math.abs(to - from) / speed)
      at = pick { 0.05, 0.1, 0.3 }
    end
    local s = math.max(0, math.min(1, (t - begin) / duration))
    return from + (to - from) * s ^ 3 * (10 - 15 * s + 6 * s ^ 2)
  end)
end

local function multisine(machine, rms, lowest, highest)
  local w, phases = {}, {}
  for f = lowest, highest, 1.5 do
    w[#w + 1], phases[#phases + 1] = turn * f, phase()
  end
  local amplitude = rms * math.sqrt(2 / #w)
  return samples(machine, function(t)
    local sum = 0
    for i = 1, #w do sum = sum + math.sin(w[i] * t + phases[i]) end
    return gently(t, 0.2) * amplitude * sum
  end)
end

local function chirp(machine, amplitude, lowest, highest)
  local rate = math.log(highest / lowest) / option.duration
  return samples(machine, function(t)
    return gently(t, 0.2) * amplitude * math.sin(turn * lowest * (math.exp(rate * t) - 1) / rate)
  end)
end

local function nothing(machine) return samples(machine, function() return 0 end) end

-- Kinds of records, and a draw of one: { kind, r and exc, or u }.
local kinds = { "sine", "small_sine", "slow_ramps", "ramps", "moves", "multisine", "chirp" }
local function draw_record(machine, level, kind)
  local record = { kind = kind }
  if not machine.closed_loop then
    local force = level * uniform(1.5, 3)
    record.kind = pick { "multisine", "chirp" }
    record.u = record.kind == "multisine" and multisine(machine, force, spread(2, 5), spread(40, 150))
      or chirp(machine, 1.4 * force, spread(1.5, 4), spread(40, 150))
    return record
  end
  local still = nothing(machine)
  if kind == "sine" then
    record.r, record.exc = sine(machine, spread(5e-3, 4e-2), spread(0.03, 0.3)), still
  elseif kind == "small_sine" then
    record.r, record.exc = sine(machine, spread(1e-4, 2e-3), spread(2e-3, 1e-2)), still
  elseif kind == "ramps" then
    record.r, record.exc = ramps(machine, spread(1e-2, 4e-2), spread(0.05, 0.15)), still
  elseif kind == "slow_ramps" then
    record.r, record.exc = ramps(machine, spread(2e-3, 1e-2), spread(5e-3, 2e-2)), still
  elseif kind == "moves" then
    record.r, record.exc = moves(machine, spread(3e-3, 4e-2), spread(0.05, 0.4)), still
  else
    local slow = chance(0.5) and sine(machine, spread(2e-3, 2e-2), spread(0.01, 0.06)) or still
    local force = level * uniform(0.7, 2.5)
    record.r = slow
    record.exc = kind == "multisine" and multisine(machine, force, spread(2, 6), spread(50, 200))
      or chirp(machine, 1.4 * force, spread(2, 5), spread(60, 200))
  end
  return record
end

-- With these effects, besides those that the machine has.
local function run(machine, record, seed, effects)
  local with = copy(machine)
  if not seed then with.noise_rms_m, with.encoder_resolution_m, with.process_noise_rms_N = 0, 0, 0 end
  with.effects = table.move(effects or {}, 1, #(effects or {}), #(with.effects or {}) + 1, copy(with.effects or {}))
  local result = tb.simulate { machine = with, r = record.r, exc = record.exc, u = record.u, seed = seed or 0 }
  return result.ok and result or nil
end

local function rms(a, b)
  local sum = 0
  for k = 1, #a do sum = sum + (a[k] - b[k]) ^ 2 end
  return math.sqrt(sum / #a)
end

local function extremes(list)
  local low, high = math.huge, -math.huge
  for _, value in ipairs(list) do low, high = math.min(low, value), math.max(high, value) end
  return low, high
end

-- What the effects may be scaled by: level of friction, stroke, speed, thrust.
local function scales(machine, level, records)
  local s = { level = level, viscous = machine.friction.viscous, mass = 1 / machine.rigid_gain_per_kg, low = 0,
    high = 0, speed = 0, thrust = 0, modes = machine.modes ~= nil, rest_in = machine.current_loop_hz,
    coulomb = machine.friction.coulomb or 0, stribeck = machine.friction.stribeck ~= nil }
  for _, record in ipairs(records) do
    local low, high = extremes(record.before.y)
    s.low, s.high = math.min(s.low, low), math.max(s.high, high)
    low, high = extremes(record.before.v)
    s.speed = math.max(s.speed, -low, high)
    low, high = extremes(record.before.u)
    s.thrust = math.max(s.thrust, -low, high)
  end
  s.stroke = s.high - s.low
  return s
end

-- ---- effects ------------------------------------------------------------------------------------------------------

-- Parameters of each effect, in the range where it matters on such a machine; nil where it has no place there.
local draw = {
  coulomb_friction = function(s)
    return { dF = s.coulomb > 0 and chance(0.4) and -s.coulomb * uniform(0.2, 0.6) or s.level * uniform(0.15, 0.6) }
  end,
  viscous_friction = function(s)
    return { dD = chance(0.3) and -s.viscous * uniform(0.3, 0.8) or s.viscous * uniform(0.5, 4) }
  end,
  stribeck_friction = function(s)
    if s.stribeck then return end
    return { dFs = s.level * uniform(0.2, 0.6), velocity = spread(2e-3, 2e-2), exponent = pick { 1, 2 } }
  end,
  presliding_hysteresis = function(s)
    local replace = s.coulomb > 0 and chance(0.6)
    return { elements = elements(random(3, 6), replace and s.coulomb or s.level * uniform(0.3, 0.9)),
      replace_coulomb = replace }
  end,
  asymmetric_friction = function(s)
    local a = s.level * uniform(0.15, 0.5)
    return pick {
      { dF_pos = a, dF_neg = 0.0, dD_pos = 0.0, dD_neg = 0.0 },
      { dF_pos = 0.0, dF_neg = a, dD_pos = 0.0, dD_neg = 0.0 },
      { dF_pos = a, dF_neg = -0.3 * math.min(a, s.coulomb), dD_pos = 0.0, dD_neg = 0.0 },
      { dF_pos = 0.0, dF_neg = 0.0, dD_pos = s.viscous * uniform(1, 4), dD_neg = 0.0 },
    }
  end,
  position_dependent_friction = function(s)
    if chance(0.7) then
      return { mode = "sine", a = uniform(0.2, 0.6), period_m = s.stroke * uniform(0.25, 1), phase = phase() }
    end
    return { mode = "gradient", a = either(uniform(0.2, 0.6)), period_m = s.stroke * uniform(0.3, 0.8), phase = 0.0 }
  end,
  time_varying_friction = function()
    local kind = pick { "exp", "ramp", "sine" }
    local T = ({ exp = uniform(0.15, 0.5), ramp = 1, sine = uniform(0.2, 0.7) })[kind] * option.duration
    return { kind = kind, a = kind == "sine" and uniform(0.2, 0.6) or either(uniform(0.3, 0.6)), T = T }
  end,
  force_ripple = function(s)
    local list = {}
    local period = spread(math.max(2e-3, s.stroke / 12), math.max(4e-3, s.stroke / 1.5))
    for i = 1, pick { 1, 1, 2 } do
      list[i] = { F = s.level * uniform(0.1, 0.4) / i, period_m = period / i, phase = phase() }
    end
    return { harmonics = list }
  end,
  -- A turn within the stroke is that of a ripple, one of many strokes bends no more than a spring.
  gravity = function(s)
    return { F = s.level * uniform(0.5, 2), turn_m = s.stroke * uniform(1.2, 3), phase = phase() }
  end,
  constant_force = function(s) return { F = either(s.level * uniform(0.15, 0.7)) } end,
  spring_force = function(s)
    return { k = s.level * uniform(0.3, 2) / s.stroke, y0 = chance(0.5) and 0.0 or uniform(s.low, s.high) }
  end,
  cubic_stiffness = function(s) return { k3 = s.level * uniform(0.5, 4) / (s.stroke / 2) ^ 3, y0 = 0.0 } end,
  power_drag = function(s)
    local exponent = pick { uniform(1.3, 1.7), uniform(2.5, 3.2) }
    return { c = s.level * uniform(0.4, 2) / s.speed ^ exponent, exponent = exponent }
  end,
  quadratic_drag = function(s) return { c = s.level * uniform(0.3, 2) / s.speed ^ 2 } end,
  periodic_disturbance = function(s)
    return { F = s.level * uniform(0.1, 0.5), freq_hz = spread(1, 60), phase = phase() }
  end,
  backlash = function(s)
    if s.modes then return end
    return { gap_m = spread(2e-5, 2e-4), load_fraction = uniform(0.3, 0.7), contact_hz = uniform(90, 250),
      contact_zeta = uniform(0.05, 0.3), sensor = pick { "motor", "load" } }
  end,
  dead_zone = function(s) return { half_width = s.level * uniform(0.1, 0.4) } end,
  thrust_power_law = function(s)
    return { exponent = pick { uniform(0.7, 0.9), uniform(1.15, 1.5) }, size = s.thrust * uniform(0.7, 1.1) }
  end,
  load_dependent_friction = function(s)
    return { share = uniform(0.08, 0.4), reach = s.stroke * spread(2e-3, 2e-2) }
  end,
  thrust_saturation = function(s) return { limit = s.thrust * uniform(0.5, 0.85) } end,
  thrust_gain = function() return { gain = chance(0.5) and uniform(0.75, 0.92) or uniform(1.08, 1.25) } end,
  payload_mass = function() return { ratio = chance(0.7) and uniform(0.08, 0.6) or -uniform(0.08, 0.25) } end,
  input_delay = function() return { extra_s = uniform(3e-4, 1.2e-3) } end,
  actuator_lag = function(s) return { current_loop_hz = s.rest_in / uniform(4, 10) } end,
  resonant_mode = function(s)
    return { gain = uniform(0.04, 0.12) / s.mass, freq_hz = spread(40, 150), zeta = spread(0.01, 0.05) }
  end,
  encoder_quantization = function() return { resolution_m = pick { 1e-6, 2e-6, 5e-6 } } end,
  encoder_periodic_error = function()
    local A = spread(5e-7, 5e-6)
    return { A = A, period_m = pick { 1e-4, 2e-4, 1e-3, 2e-3 }, phase = phase(), A2 = A * uniform(0, 0.4),
      phase2 = phase() }
  end,
}

-- Forces on no list, as text of own_force.
local strange = {
  { kind = "bristle", -- of LuGre: friction with a memory that is no Maxwell-slip element
    force = "return -(sigma * z + damping * (v - math.abs(v) / slip * z))", states = { "z" },
    rates = "return v - math.abs(v) / slip * z",
    constants = function(s)
      local F, slip = s.level * uniform(0.4, 1), spread(5e-6, 1e-4)
      return { sigma = F / slip, slip = slip, damping = 0.1 * F / slip / spread(100, 400) }
    end },
  { kind = "wandering_force",
    force = "local sum = 0 for i = 1, 9 do sum = sum + math.sin(6.2832 * rate * i ^ 1.37 * t + offset * i * i) end "
      .. "return F * sum / 3",
    constants = function(s)
      return { F = s.level * uniform(0.15, 0.4), rate = uniform(0.2, 0.5), offset = phase() }
    end },
  { kind = "tight_spot", -- more friction at one place
    force = "return -F * math.exp(-((y - place) / width) ^ 2) * v / (math.abs(v) + 1e-3)",
    constants = function(s)
      return { F = s.level * uniform(0.3, 0.8), place = s.low + s.stroke * uniform(0.3, 0.7),
        width = s.stroke * uniform(0.05, 0.12) }
    end },
  { kind = "settling_force", -- a cable that creeps after the motion
    force = "return -k * (y - z)", states = { "z" }, rates = "return (y - z) / T",
    constants = function(s) return { k = s.level * uniform(0.5, 2) / s.stroke, T = spread(0.05, 0.6) } end },
  { kind = "even_drag", -- pushes the same way in both directions
    force = "return F * (v / speed) ^ 2 * math.cos(6.2832 * y / pitch)",
    constants = function(s)
      return { F = s.level * uniform(0.4, 1), speed = s.speed, pitch = s.stroke * uniform(0.4, 0.9) }
    end },
  { kind = "rising_tone", -- a disturbance whose frequency drifts
    force = "return F * math.sin(6.2832 * (from * t + rate * t * t))",
    constants = function(s)
      return { F = s.level * uniform(0.1, 0.3), from = uniform(1, 4), rate = uniform(0.3, 1.5) }
    end },
}

-- An effect drawn for these scales: as the machine has it and as the truth tells it.
local function draw_effect(name, s)
  if name == "unknown" then
    local one = pick(strange)
    local constants = rounded(one.constants(s))
    local parameters = { force = one.force, states = one.states, rates = one.rates, constants = constants }
    return { name = "own_force", parameters = parameters }, { name = "unknown",
      params = { kind = one.kind, force = one.force, constants = constants } }
  end
  local parameters = draw[name](s)
  if not parameters then return end
  parameters = rounded(parameters)
  return { name = name, parameters = parameters }, { name = name, params = parameters }
end

-- Where friction that differs by direction is a constant force beside a level that the machine's tolerance allows: the
-- change of the level as an effect.
local function level_beside(effect, machine, nominal)
  local p, deviation = effect.parameters, (nominal.tolerance or {})["friction.coulomb"]
  local change = (p.dF_pos + p.dF_neg) / 2
  if not deviation or change == 0 then return {} end
  local level = nominal.friction.coulomb
  if math.abs(machine.friction.coulomb + change - level) > 2.5 * deviation * level then return {} end
  return { { name = "coulomb_friction", parameters = { dF = change } } }
end

-- What may do the same as an effect with one number: another name, where its number is sought, and what is beside it.
local function doubles_of(effect, machine, nominal)
  local p = effect.parameters
  if effect.name == "thrust_gain" then
    return "payload_mass", 1 / p.gain - 1, 0.3, function(x) return { ratio = x } end
  elseif effect.name == "payload_mass" then
    return "thrust_gain", 1 / (1 + p.ratio), 0.2, function(x) return { gain = x } end
  elseif effect.name == "constant_force" then
    return "asymmetric_friction", p.F, 0.3 * p.F, function(x) return { dF_pos = -x, dF_neg = x } end
  elseif effect.name == "asymmetric_friction" and p.dD_pos == 0 then
    local function parameters(x) return { F = x } end
    return "constant_force", (p.dF_neg - p.dF_pos) / 2, 0.3 * p.dF_pos + 0.3, parameters,
      level_beside(effect, machine, nominal)
  elseif effect.name == "input_delay" then
    local rest = 1 / (turn * machine.current_loop_hz)
    local function parameters(x) return { current_loop_hz = 1 / (turn * x) } end
    return "actuator_lag", rest + p.extra_s, 0.3 * p.extra_s, parameters
  elseif effect.name == "actuator_lag" then
    local extra = 1 / (turn * p.current_loop_hz) - 1 / (turn * machine.current_loop_hz)
    return "input_delay", extra, 0.3 * extra, function(x) return { extra_s = x } end
  elseif effect.name == "force_ripple" and #p.harmonics == 1 then -- the weight of an arm is a ripple
    local h = p.harmonics[1]
    local function parameters(x) return { F = x, turn_m = h.period_m, phase = h.phase + math.pi } end
    return "gravity", h.F, 0.3 * h.F, parameters
  elseif effect.name == "gravity" then
    local opposite = p.phase + math.pi
    local function parameters(x) return { harmonics = { { F = x, period_m = p.turn_m, phase = opposite } } } end
    return "force_ripple", p.F, 0.3 * p.F, parameters
  elseif effect.name == "dead_zone" then
    return "coulomb_friction", p.half_width, 0.3 * p.half_width, function(x) return { dF = x } end
  end
end

-- Whether another effect leaves less than a sixth of the noise, with its number as it suits best (golden section).
local function is_double(machine, records, name, middle, reach, parameters, beside)
  local function misfit(x)
    local worst = 0
    for _, record in ipairs(records) do
      local effects = { { name = name, parameters = parameters(x) }, table.unpack(beside or {}) }
      local ok, result = pcall(run, machine, record, nil, effects)
      worst = math.max(worst, ok and result and rms(result.y, record.after.y) / record.floor or math.huge)
    end
    return worst
  end
  local a, b, ratio = middle - math.abs(reach), middle + math.abs(reach), (math.sqrt(5) - 1) / 2
  local c, d = b - ratio * (b - a), a + ratio * (b - a)
  local at_c, at_d = misfit(c), misfit(d)
  for _ = 1, 14 do
    if at_c < at_d then
      b, d, at_d = d, c, at_c
      c = b - ratio * (b - a)
      at_c = misfit(c)
    else
      a, c, at_c = c, d, at_d
      d = a + ratio * (b - a)
      at_d = misfit(d)
    end
  end
  return math.min(at_c, at_d) < 0.15
end

-- ---- model error --------------------------------------------------------------------------------------------------

-- Friction of another structure than the description says, of about the same level: as effects that nobody asks for.
local function draw_structure(machine, level)
  local coulomb = machine.friction.coulomb
  local kind = pick(coulomb and { "presliding", "stribeck", "direction" } or { "stribeck", "direction" })
  local effects
  if kind == "presliding" then
    local part = coulomb * uniform(0.1, 0.5)
    effects = { { name = "presliding_hysteresis", parameters = { elements = elements(3, part) } },
      { name = "coulomb_friction", parameters = { dF = -part } } }
  elseif kind == "stribeck" then
    if machine.friction.stribeck then return end
    effects = { { name = "stribeck_friction",
      parameters = { dFs = level * spread(0.01, 0.1), velocity = spread(2e-3, 2e-2), exponent = 1 } } }
  else
    effects = { { name = "asymmetric_friction", parameters = { dF_pos = level * spread(0.005, 0.05) } } }
  end
  return rounded(effects), kind
end

-- What the friction does to the records by itself, in units of their noise; nil where the machine does not bear it.
local function structure_shows(machine, records, effects)
  local shows = {}
  for i, record in ipairs(records) do
    local with = run(machine, record, nil, effects)
    if not with then return end
    shows[i] = rms(with.y, record.before.y) / record.floor
  end
  return shows
end

-- ---- a case -------------------------------------------------------------------------------------------------------

-- Runs the machine under two records without effects; nil where it will not follow them.
local function draw_records(machine, level)
  local records, noisy = {}, 0
  for i = 1, 2 do
    local record = draw_record(machine, level, pick(kinds))
    record.before = run(machine, record)
    if not record.before then return end
    local low, high = extremes(record.before.y)
    if high - low > 0.3 or high - low < 200 * machine.encoder_resolution_m then return end
    if record.r and rms(record.before.y, record.r) > 0.02 then return end
    local with_noise = run(machine, record, 99)
    if not with_noise then return end
    record.floor = rms(with_noise.y, record.before.y)
    records[i], noisy = record, math.max(noisy, record.floor)
  end
  return noisy < 1e-5 and records or nil
end

local function names_of(kind)
  if kind == "none" then return {} end
  if kind ~= "two" then return { kind } end
  -- Two that do not share their place in the machine.
  return pick {
    { "coulomb_friction", "force_ripple" }, { "payload_mass", "input_delay" },
    { "thrust_gain", "periodic_disturbance" }, { "constant_force", "resonant_mode" },
    { "viscous_friction", "encoder_periodic_error" }, { "spring_force", "payload_mass" },
    { "quadratic_drag", "constant_force" }, { "coulomb_friction", "payload_mass" },
    { "force_ripple", "viscous_friction" }, { "periodic_disturbance", "input_delay" },
  }
end

-- What is wrong with the model of a case besides its effects: { fields, force, friction }, one of them or more.
local function draw_model_error(kind)
  if option.model_error == 0 or not chance(option.model_error) then return {} end
  -- Where nothing is hidden, a wrong friction would be what is missing.
  local first = pick(kind == "none" and { "fields", "force" } or { "fields", "force", "friction" })
  local wrong = { fields = chance(0.3), force = chance(0.3) }
  wrong[first] = true
  return wrong
end

-- One draw of all; nil where the effects do not show, or the machine does not bear them.
local function attempt(kind, wrong)
  local names = names_of(kind)
  local machine, level = draw_machine(pick { 0, 0, 0, 1, 1, 2 })
  if chance(option.tolerance) then machine.tolerance = draw_tolerance(machine) end
  if chance(option.process_noise) then machine.process_noise_rms_N = rounded(level * uniform(0.02, 0.08)) end
  if wrong.fields then machine.tolerance = machine.tolerance or draw_tolerance(machine) end
  if wrong.force then machine.process_noise_rms_N = rounded(level * uniform(0.02, 0.08)) end
  local real = true_machine(machine)
  local records = draw_records(real, level)
  if not records then return end
  local s = scales(real, level, records)
  local model_error
  if wrong.friction then
    local friction, name = draw_structure(real, level)
    local shows = friction and structure_shows(real, records, friction)
    -- More than noise, and less than what is hidden.
    if not shows or shows[1] < 1 or shows[1] > 6 or shows[2] > 10 then return end
    real.effects = friction
    model_error = { friction = name, ratio_y = rounded(shows) }
  end
  local effects, truth = {}, {}
  for i, name in ipairs(names) do
    effects[i], truth[i] = draw_effect(name, s)
    if not effects[i] then return end
  end
  for number, record in ipairs(records) do
    record.measured = run(real, record, random(1 << 30), effects)
    record.after = run(real, record, nil, effects)
    if not record.measured or not record.after then return end
    local low, high = extremes(record.after.y)
    if high - low > 0.5 or (record.r and rms(record.after.y, record.r) > 0.05) then return end
    -- A record without motion is refused.
    if high - low < 20 * (real.noise_rms_m + real.encoder_resolution_m) then return end
    -- Each effect must show by itself, beside the others.
    for i = 1, #effects do
      local others = copy(effects)
      table.remove(others, i)
      local without = run(real, record, nil, others)
      if not without then return end
      local ratio = rms(record.after.y, without.y) / record.floor
      if ratio < (number == 1 and 6 or 3) * (model_error and 2 or 1) then return end
      truth[i].detectability = truth[i].detectability or {}
      truth[i].detectability[number == 1 and "ident" or "valid"] = { ratio_y = rounded(ratio) }
    end
  end
  local accept = {}
  for i, effect in ipairs(effects) do
    accept[#accept + 1] = truth[i].name
    local name, middle, reach, parameters, beside = doubles_of(effect, real, machine)
    local all = copy(effects)
    table.remove(all, i)
    for _, other in ipairs(beside or {}) do all[#all + 1] = other end
    if name and is_double(real, records, name, middle, reach, parameters, all) then
      accept[#accept + 1], truth[i].alike = name, name
    end
  end
  -- Where the friction differs by direction besides, one name says both.
  if #effects == 1 and truth[1].name == "coulomb_friction" and model_error and model_error.friction == "direction" then
    accept[#accept + 1] = "asymmetric_friction"
  end
  if #effects == 1 and truth[1].name == "unknown" and truth[1].params.kind == "bristle" then
    accept[#accept + 1] = "lugre_friction" -- with as much damping
  end
  if #effects == 0 then accept, truth = { "none" }, { { name = "none" } } end
  -- Whether the effects show in these is left to chance.
  for _ = 1, option.more do
    local record
    repeat
      record = draw_record(real, level, pick(kinds))
      record.measured = run(real, record, random(1 << 30), effects)
    until record.measured and not (record.r and rms(record.measured.y, record.r) > 0.05)
    records[#records + 1] = record
  end
  return machine, real, records, { effects = truth, accept = accept, model_error = model_error }
end

local function write(folder, machine, records, truth)
  local names = { "ident", "valid" }
  for i = 3, #records do names[i] = "ident_" .. i - 1 end
  machine.records = {}
  for i, name in ipairs(names) do machine.records[name] = { kind = records[i].kind } end
  tb.write_json { file = folder .. "/nominal.json", value = machine }
  for i, name in ipairs(names) do
    local signals = records[i].measured
    local columns = { { name = "t", unit = "s", values = signals.t } }
    if machine.closed_loop then columns[2] = { name = "r", unit = "m", values = signals.r } end
    columns[#columns + 1] = { name = "u", unit = "N", values = signals.u }
    columns[#columns + 1] = { name = "y", unit = "m", values = signals.y }
    tb.write_csv { file = folder .. "/" .. name .. ".csv.gz", columns = columns }
  end
  tb.write_json { file = folder .. "/truth.json", value = truth }
end

-- The kinds in turn, in an order that the seed shuffles.
local function deck()
  local list = {}
  for name in option.effects:gmatch "[^,%s]+" do
    if not draw[name] and name ~= "none" and name ~= "two" and name ~= "unknown" then
      error("-D effects: \"" .. name .. "\" is no effect, nor none, two or unknown", 0)
    end
    list[#list + 1] = name
  end
  if #list > 0 then return list end
  for name in pairs(draw) do list[#list + 1] = name end
  for _ = 1, 5 do list[#list + 1] = "none" end
  for _ = 1, 4 do
    list[#list + 1] = "two"
    list[#list + 1] = "unknown"
  end
  table.sort(list)
  math.randomseed(option.seed)
  for i = #list, 2, -1 do
    local j = random(i)
    list[i], list[j] = list[j], list[i]
  end
  return list
end

local cards = deck()
local lines = { "case,hidden,accept,ident,valid,modes,closed_loop,tolerance,process_noise_N,other_friction" }
for i = 1, option.count do
  local kind, name = cards[(i - 1) % #cards + 1], string.format("%03d", i)
  math.randomseed(option.seed, i)
  local machine, real, records, truth
  local wrong = draw_model_error(kind)
  for _ = 1, 400 do
    machine, real, records, truth = attempt(kind, wrong)
    if machine then break end
  end
  if not machine then
    print(string.format("%s: no machine was drawn that shows %s; left out", name, kind))
  else
    if machine.tolerance or real.effects then truth.machine = real end
    write("cases/" .. name, machine, records, truth)
    local hidden = {}
    for e, effect in ipairs(truth.effects) do
      hidden[e] = effect.name == "unknown" and "unknown " .. effect.params.kind or effect.name
    end
    print(string.format("%s: %s (%s, %s)", name, table.concat(hidden, " + "), records[1].kind, records[2].kind))
    lines[#lines + 1] = table.concat({ name, table.concat(hidden, "+"), table.concat(truth.accept, "+"),
      records[1].kind, records[2].kind, machine.modes and #machine.modes or 0, machine.closed_loop and 1 or 0,
      machine.tolerance and 1 or 0, machine.process_noise_rms_N or 0,
      truth.model_error and truth.model_error.friction or "" }, ",")
  end
end
tb.write_text { file = "cases.csv", text = table.concat(lines, "\n") .. "\n" }
