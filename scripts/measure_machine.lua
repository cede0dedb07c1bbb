-- Measures a machine that is known only roughly, from the plan of the excitation to the identified machine: limits on
-- stroke, velocity and thrust; files for the drive; its logs; friction, frequency response and modes with standard
-- errors; a validation by a move that no fit has seen.
--
--   tribode run scripts/measure_machine.lua -D hidden=3
--
-- The drive is simulated: `hidden` draws a machine, of which the measurement sees its logs, encoder, controller and
-- delays only. With a real drive, describe what you know of it (sample time, mass, controller, delays, encoder) and run
-- the script with -D machine=FILE -D plan=true. Play plan_slow.csv, plan_multisine.csv and plan_move.csv (columns t, r,
-- exc), and run it again with -D slow=LOG1 -D multisine=LOG2 -D move=LOG3 (columns t, r, exc, u, y).
--
-- Results: plan_slow.csv, plan_multisine.csv, plan_move.csv, log_*.csv, identified.json (the machine), summary.json,
-- the folder fra (report of the frequency response) and the plots plan, friction, response, validation.

local tb = require "tribode"

local option = tb.options {
  machine = { default = "", help = "file with what is known of the machine; empty: a loop of 6 Hz around mass_kg" },
  mass_kg = { default = 10, unit = "kg", help = "of the moving parts, roughly" },
  stroke_mm = { default = 40, unit = "mm", help = "that the axis may use, from end to end" },
  velocity = { default = 0.2, unit = "m/s", help = "limit" },
  thrust = { default = 120, unit = "N", help = "limit" },
  f_max = { default = 160, unit = "Hz", help = "highest frequency" },
  period_s = { default = tb.quick and 2 or 4, unit = "s", help = "of the multisine" },
  periods = { default = tb.quick and 3 or 5, help = "of the multisine; the first one only settles" },
  max_modes = { default = 3, help = "of the fitted model" },
  elements = { default = 12, help = "of a friction model of elements" },
  friction = {
    default = tb.quick and "elements" or "any", choices = { "any", "elements" },
    help = "models: Maxwell-slip elements and dry friction alone, or every friction law",
  },
  structures = { default = 2, help = "friction models that are estimated with all parameters, the likeliest ones" },
  iterations = { default = tb.quick and 4 or 30, help = "at most, of the joint estimation" },
  simulations = { default = 400, help = "of a log, after which no iteration of it begins" },
  hidden = { default = 1, help = "the machine that is measured" },
  plots = { default = true, help = "and the report of the response" },
  plan = { default = false, help = "only write the files for the drive" },
  slow = { default = "", help = "log of plan_slow.csv; empty: simulated" },
  multisine = { default = "", help = "log of plan_multisine.csv; empty: simulated" },
  move = { default = "", help = "log of plan_move.csv; empty: simulated, or no validation where other logs are given" },
}

-- ---- what is known of the machine before --------------------------------------------------------------------------

local Ts = 250e-6
local w_loop = 2 * math.pi * 6 -- [rad/s]
local controllers = {
  pid = {
    type = "pid", kp = option.mass_kg * w_loop ^ 2, ki = option.mass_kg * w_loop ^ 3 / 5,
    kd = 1.4 * option.mass_kg * w_loop,
  },
  ["P-P"] = { type = "cascade", kp = w_loop / 1.4, kv = 1.4 * option.mass_kg * w_loop },
  ["P-PI"] = { type = "cascade", kp = w_loop / 1.4, kv = 1.4 * option.mass_kg * w_loop, ki = w_loop / 5 },
}
local known = {
  Ts = Ts,
  rigid_gain_per_kg = 1 / option.mass_kg,
  input_delay_s = 250e-6,
  output_delay_s = 125e-6,
  current_loop_hz = 2000,
  encoder_resolution_m = 0.1e-6,
  controller = controllers.pid,
  closed_loop = true,
}
if option.machine ~= "" then
  known = tb.machine(option.machine)
  Ts = known.Ts
  assert(known.closed_loop and known.rigid_gain_per_kg, option.machine .. ": must have mass_kg and a controller")
end

-- ---- the drive: a machine of which nothing but its logs is used below, until the last lines compare ---------------

local function draw(seed)
  local state = (seed * 7919 + 104729) % 2147483647
  return function(low, high)
    state = state * 48271 % 2147483647
    return low + (high - low) * state / 2147483647
  end
end

-- Of the hidden machines in turn. The laws are those of docs/friction.md.
local kinds = {
  "rolling", "rolling and viscous", "rolling and dry", "Stribeck", "Dahl", "LuGre", "Bouc-Wen", "GMS", "load-dependent",
}

local function hidden_friction(kind, random)
  local level = random(3, 9)
  local friction, law = { viscous = kind == "rolling" and 0 or random(2, 20), elements = {} }, nil
  local reach = 5e-6 * random(1, 2) ^ 2.5 -- 5 to 28 um
  local static, speed = level * random(1.2, 1.6), random(5e-3, 15e-3)
  if kind:find "rolling" then
    -- A curve from a reversal that bends from 1 um to 1 mm.
    local x = 1e-6
    for i = 1, 10 do
      local share = level / 10 * random(0.6, 1.4)
      friction.elements[i] = { K = share / (x / 2), F = share }
      x = x * 2.1
    end
    if kind == "rolling and dry" then friction.coulomb = random(0.5, 2) end
  elseif kind == "Stribeck" then
    friction.coulomb, friction.stribeck = level, { static = static, velocity = speed }
  elseif kind == "Dahl" then
    law = { name = "dahl_friction", parameters = { F = level, K = level / reach } }
  elseif kind == "LuGre" then
    law = {
      name = "lugre_friction",
      parameters = { F = level, Fs = static, velocity = speed, K = level / reach, D = random(20, 80) },
    }
  elseif kind == "Bouc-Wen" then
    law = {
      name = "bouc_wen_friction",
      parameters = { F = level, reach = reach, beta = random(0.5, 0.9), exponent = random(1, 2) },
    }
  elseif kind == "GMS" then
    local share = random(0.3, 0.5)
    law = {
      name = "gms_friction",
      parameters = {
        F = level, Fs = static, velocity = speed, attraction = random(200, 1000),
        elements = {
          { K = level * share / reach, share = share },
          { K = level * (0.8 - share) / (4 * reach), share = 0.8 - share },
          { K = level * 0.2 / (16 * reach), share = 0.2 },
        },
      },
    }
  else
    law = { name = "load_dependent_friction", parameters = { share = random(0.05, 0.2), reach = reach } }
  end
  return friction, law
end

-- The machine, the kind of its friction, and its controller.
local function hidden_machine(seed)
  local random = draw(seed)
  for _ = 1, 5 do random(0, 1) end
  local machine = tb.with_fields(known, {})
  machine.rigid_gain_per_kg = 1 / (option.mass_kg * random(0.8, 1.25))
  machine.modes = {}
  local f, count = random(30, 50), 1 + math.floor(random(0, 3))
  for j = 1, count do
    machine.modes[j] = {
      gain = machine.rigid_gain_per_kg * random(0.08, 0.3) / j,
      freq_hz = f,
      zeta = random(0.006, 0.03),
    }
    f = f * random(1.6, 1.9)
  end
  local kind = kinds[1 + seed % #kinds]
  local law
  machine.friction, law = hidden_friction(kind, random)
  machine.effects = law and { law } or nil
  machine.encoder_resolution_m = 10 ^ random(-8, -6)
  machine.noise_rms_m = random(0, 1) * math.min(machine.encoder_resolution_m, 0.1e-6)
  machine.input_delay_s = known.input_delay_s + random(-0.5, 0.5) * Ts
  local names = { "pid", "P-P", "P-PI" }
  local loop = names[1 + math.floor(random(0, 3))]
  machine.controller = controllers[loop]
  return machine, kind, loop
end

-- The encoder and the controller are known, the delay to half a sample.
if option.machine == "" then
  local hidden, _, loop = hidden_machine(option.hidden)
  known.encoder_resolution_m, known.controller = hidden.encoder_resolution_m, controllers[loop]
end

-- ---- the plan -----------------------------------------------------------------------------------------------------

local function list(seconds, value)
  local values = {}
  for k = 1, math.floor(seconds / Ts + 0.5) do values[k] = value((k - 1) * Ts) end
  return values
end

local function zeros(count)
  local values = {}
  for k = 1, count do values[k] = 0 end
  return values
end

local function largest(values)
  local most = 0
  for _, value in ipairs(values) do most = math.max(most, math.abs(value)) end
  return most
end

-- Slow sines for the friction: a wide one, whose speed is a tenth of the limit, with nested loops; then one that
-- reaches 0.6 of the limit of velocity, for viscous friction and mass. Both begin and end at rest.
local stroke = option.stroke_mm * 1e-3
local wide, slow_hz = 0.35 * stroke, 0.1 * option.velocity / (2 * math.pi * 0.35 * stroke)
local fast_hz = math.max(0.6 * option.velocity / (2 * math.pi * 0.35 * stroke), 4 * slow_hz)
local fast = math.min(wide, 0.6 * option.velocity / (2 * math.pi * fast_hz))
local slow_seconds, fast_seconds = 1.5 / slow_hz, 4 / fast_hz
local function ease(t, total) return math.min(1, t / 0.5, (total - t) / 0.5) end
local slow_plan = list(slow_seconds + fast_seconds, function(t)
  if t < slow_seconds then
    local w = 2 * math.pi * slow_hz
    return ease(t, slow_seconds) * wide
      * (0.75 * math.sin(w * t) + 0.15 * math.sin(6.3 * w * t) + 0.03 * math.sin(17.1 * w * t))
  end
  local own = t - slow_seconds
  return ease(own, fast_seconds) * fast * math.sin(2 * math.pi * fast_hz * own)
end)

-- The multisine beside a sinusoidal carrier of the reference, so that the axis hardly sticks. The carrier has whole
-- periods in one of the multisine; it is none of its lines.
local carrier_periods = math.max(1, math.floor(0.5 * option.period_s))
local carrier_hz = carrier_periods / option.period_s
local carrier = math.min(0.3 * stroke, 0.25 * option.velocity / (2 * math.pi * carrier_hz))
local total = option.period_s * option.periods
local carrier_plan = list(total, function(t) return carrier * math.sin(2 * math.pi * carrier_hz * t) end)

local function rough_run(r, exc)
  local run = tb.simulate { machine = known, r = r, exc = exc }
  assert(run.ok, run.message)
  local v = 0
  for k = 2, #run.x do v = math.max(v, math.abs(run.x[k] - run.x[k - 1]) / Ts) end
  return { stroke = 2 * largest(run.x), velocity = v, thrust = largest(run.u) }
end

-- As strong as the rough model allows, with half of the margin for what it does not know (modes, friction).
local amplitude = 0.5 * option.thrust
local expected, excitation
for _ = 1, 20 do
  excitation = tb.multisine {
    sample_time_s = Ts, period_s = option.period_s, periods = option.periods, f_min_hz = 8, f_max_hz = option.f_max,
    amplitude_N = amplitude,
  }
  expected = rough_run(carrier_plan, excitation.values)
  if expected.stroke < 0.8 * stroke and expected.velocity < 0.7 * option.velocity
      and expected.thrust < 0.7 * option.thrust then
    break
  end
  amplitude = 0.85 * amplitude
end
print(string.format("Plan: multisine of %.3g N, %d lines from 8 to %g Hz, %d periods of %g s; carrier %.3g mm, %.3g Hz",
  amplitude, #excitation.frequency_hz, option.f_max, option.periods, option.period_s, carrier * 1e3, carrier_hz))
print(string.format("      expected %.3g mm, %.3g m/s, %.3g N; allowed %g mm, %g m/s, %g N", expected.stroke * 1e3,
  expected.velocity, expected.thrust, option.stroke_mm, option.velocity, option.thrust))

-- The move of the validation: a smooth step there and back.
local move_plan = list(1.2, function(t)
  local function smooth(s)
    s = math.max(0, math.min(1, s))
    return s ^ 3 * (10 - 15 * s + 6 * s ^ 2)
  end
  return 0.4 * stroke * (smooth((t - 0.1) / 0.3) - smooth((t - 0.7) / 0.25))
end)

local plans = {
  slow = { r = slow_plan, exc = zeros(#slow_plan) },
  multisine = { r = carrier_plan, exc = excitation.values },
  move = { r = move_plan, exc = zeros(#move_plan) },
}
for name, plan in pairs(plans) do
  plan.t = list(#plan.r * Ts, function(t) return t end)
  tb.write_csv {
    file = "plan_" .. name .. ".csv",
    columns = {
      { name = "t", unit = "s", values = plan.t },
      { name = "r", unit = "m", values = plan.r },
      { name = "exc", unit = "N", values = plan.exc },
    },
  }
end
local plot = option.plots and tb.plot or function() end
plot {
  file = "plan",
  title = "What the drive plays",
  panels = {
    { y_label = "Reference, friction [m]", series = { { x = plans.slow.t, y = plans.slow.r } }, legend = "none" },
    { y_label = "Carrier [m]", series = { { x = plans.multisine.t, y = plans.multisine.r } }, legend = "none" },
    {
      x_label = "Time [s]", y_label = "Multisine [N]", legend = "none",
      series = { { x = plans.multisine.t, y = plans.multisine.exc } },
    },
  },
}
if option.plan then return end

-- ---- the measurement ----------------------------------------------------------------------------------------------

local function simulated_drive(name)
  local machine = hidden_machine(option.hidden)
  local run = tb.simulate { machine = machine, r = plans[name].r, exc = plans[name].exc, seed = option.hidden }
  assert(run.ok, run.message)
  local log = { t = run.t, r = plans[name].r, exc = plans[name].exc, u = run.u, y = run.y }
  local columns = {}
  for i, column in ipairs { { "t", "s" }, { "r", "m" }, { "exc", "N" }, { "u", "N" }, { "y", "m" } } do
    columns[i] = { name = column[1], unit = column[2], values = log[column[1]] }
  end
  tb.write_csv { file = "log_" .. name .. ".csv", columns = columns }
  return log
end

local function log_of(name, file)
  if not file or file == "" then return simulated_drive(name) end
  return tb.read_record { file = file, columns = { t = "t", r = "r", exc = "exc", u = "u", y = "y" } }.data
end

local slow, multisine = log_of("slow", option.slow), log_of("multisine", option.multisine)
for _, log in ipairs { slow, multisine } do
  if largest(log.u) > option.thrust then print(string.format("warning: the log reaches %.4g N", largest(log.u))) end
  if 2 * largest(log.y) > stroke then
    print(string.format("warning: the log reaches %.4g mm", 2e3 * largest(log.y)))
  end
end

-- ---- friction, mass and viscous friction from the slow log --------------------------------------------------------

-- u at the time the detected position belongs to.
local lag = known.current_loop_hz and 1 / (2 * math.pi * known.current_loop_hz) or 0
local dead_time = Ts / 2 + (known.input_delay_s or 0) + (known.output_delay_s or 0) + lag
local function delayed_thrust(u, k)
  local ago = dead_time / Ts
  local whole = math.floor(ago)
  local a, b = u[math.max(k - whole, 1)], u[math.max(k - whole - 1, 1)]
  return a + (ago - whole) * (b - a)
end

-- Accelerations and velocities from differences over up to 10 ms each way, so far that rounding counts as 0.1 N at
-- most: what an axis does within less, as in stick-slip, does not show.
local rounding_m = known.encoder_resolution_m or 0
local reach = math.ceil(math.max(1e-3, math.min(0.01, (rounding_m / known.rigid_gain_per_kg / 0.1) ^ 0.5)) / Ts)
local position, thrust, velocity, acceleration = {}, {}, {}, {}
for k = reach + 1, #slow.y - reach do
  local before, here, after = slow.y[k - reach], slow.y[k], slow.y[k + reach]
  local i = #position + 1
  position[i], thrust[i] = here, delayed_thrust(slow.u, k)
  velocity[i] = (after - before) / (2 * reach * Ts)
  acceleration[i] = (after - 2 * here + before) / (reach * Ts) ^ 2
end
-- Rounding keeps every tenth sample as good as all of them.
local step = 8
local function thinned(values)
  local few = {}
  for i = 1, #values, step do few[#few + 1] = values[i] end
  return few
end
local few = {
  position = thinned(position), thrust = thinned(thrust), velocity = thinned(velocity),
  acceleration = thinned(acceleration),
}

-- Friction models: `machine` makes the fields of a machine from the shape and a level; `fitted` are paths of it.
local law_fields = "effects[1].parameters."
local function of_law(name, parameters) return { effects = { { name = name, parameters = parameters } } } end
local function paths(...)
  local all = {}
  for _, name in ipairs { ... } do all[#all + 1] = law_fields .. name end
  return all
end

local function rms(values)
  local sum = 0
  for _, value in ipairs(values) do sum = sum + value ^ 2 end
  return math.sqrt(sum / #values)
end

-- Where the axis sticks, dry friction is what holds it, which no position shows: fits and residuals are of what moves.
local function moving(values)
  local own = {}
  for i, v in ipairs(few.velocity) do
    if math.abs(v) > 1e-3 then own[#own + 1] = values[i] end
  end
  return own
end
local moved = { thrust = moving(few.thrust), velocity = moving(few.velocity), acceleration = moving(few.acceleration) }
local function explained(modeled)
  return tb.least_squares {
    columns = { moved.acceleration, moved.velocity, moving(modeled) }, values = moved.thrust,
  }
end

-- Elements, then mass and viscous friction with them, in turn: each is linear least squares.
local function fitted_elements()
  local mass, viscous = 1 / known.rigid_gain_per_kg, 0
  local found, straight
  for _ = 1, 6 do
    local force = {}
    for i = 1, #few.thrust do force[i] = few.thrust[i] - mass * few.acceleration[i] - viscous * few.velocity[i] end
    found = tb.fit_friction {
      position = few.position, force = force, elements = option.elements,
      shortest_m = math.max(2 * (known.encoder_resolution_m or 0), 2e-7), longest_m = 0.2 * wide,
      first_fitted = math.floor(#force / 8),
    }.elements
    straight = explained(tb.friction_force { elements = found, position = few.position })
    mass, viscous = straight.coefficients[1], math.max(straight.coefficients[2], 0)
  end
  return {
    name = "elements", mass = mass, viscous = viscous, residual = rms(straight.residual),
    fields = { friction = { elements = found } },
    fitted = { "friction.elements[*].K", "friction.elements[*].F" },
  }
end
local by_elements = fitted_elements()
local elements = by_elements.fields.friction.elements
local level, half_reach = 0, 0
for _, element in ipairs(elements) do
  level = level + element.F
  half_reach = half_reach + 2 * element.F ^ 2 / element.K
end
half_reach = half_reach / math.max(level, 1e-9) -- where elements slip, on the mean

-- Laws with a shape: Gauss-Newton on the logarithms of its numbers; level, mass and viscous friction are linear.
local function fitted_law(name, shape, fields_of, fitted)
  local keys, numbers = {}, {}
  for key in pairs(shape) do keys[#keys + 1] = key end
  table.sort(keys)
  for i, key in ipairs(keys) do numbers[i] = math.log(shape[key]) end
  local function shape_of(at)
    local own = {}
    for i, key in ipairs(keys) do own[key] = math.exp(at[i]) end
    return own
  end
  local level_now = math.max(level, 0.1)
  local function tried(at)
    local fields = fields_of(level_now, shape_of(at))
    fields.Ts, fields.rigid_gain_per_kg = step * Ts, known.rigid_gain_per_kg
    fields.encoder_resolution_m = known.encoder_resolution_m
    local ok, modeled = pcall(tb.friction_force, { machine = fields, position = few.position, thrust = few.thrust })
    if not ok then return nil end
    local done, straight = pcall(explained, modeled)
    return done and straight.coefficients[3] > 0 and straight or nil
  end
  local here = tried(numbers)
  for _ = 1, 15 do
    if not here then return nil end
    level_now = math.min(math.max(level_now * here.coefficients[3], 0.05), 1e3)
    local base, columns, left = tried(numbers), {}, {}
    if not base then return nil end
    local change = 0.02
    for i = 1, #keys do
      local there = table.move(numbers, 1, #numbers, 1, {})
      there[i] = there[i] + change
      local other = tried(there)
      if not other then return nil end
      columns[i] = {}
      for k = 1, #moved.thrust do columns[i][k] = (other.residual[k] - base.residual[k]) / change end
    end
    for k = 1, #moved.thrust do left[k] = -base.residual[k] end
    local solved, towards = pcall(tb.least_squares, { columns = columns, values = left })
    if not solved then break end
    local share, better = 1, nil
    while not better and share > 0.05 do
      local there = {}
      for i = 1, #keys do
        -- What bends within less than a micrometer is dry friction.
        local least = math.log(keys[i] == "reach" and 1e-6 or shape[keys[i]] / 20)
        there[i] = math.max(least, numbers[i] + share * math.max(-0.7, math.min(0.7, towards.coefficients[i])))
      end
      local other = tried(there)
      if other and rms(other.residual) < rms(base.residual) then numbers, better = there, other end
      share = share / 3
    end
    here = better or base
    if not better or rms(better.residual) > 0.999 * rms(base.residual) then break end
  end
  level_now = level_now * here.coefficients[3]
  return {
    name = name, mass = here.coefficients[1], viscous = math.max(here.coefficients[2], 0),
    residual = rms(here.residual), fields = fields_of(level_now, shape_of(numbers)), fitted = fitted,
  }
end

local structures = { by_elements }
if option.friction == "any" then
  local bend = math.max(half_reach / 2, 2 * (known.encoder_resolution_m or 0), 1e-6)
  local function add(...) structures[#structures + 1] = fitted_law(...) end
  add("Stribeck", { ratio = 1.3, velocity = 0.01 }, function(F, shape)
    local static = F * math.max(1.02, shape.ratio)
    return { friction = { coulomb = F, stribeck = { static = static, velocity = shape.velocity } } }
  end, { "friction.coulomb", "friction.stribeck.static", "friction.stribeck.velocity" })
  add("Dahl", { reach = bend }, function(F, shape)
    return of_law("dahl_friction", { F = F, K = F / shape.reach })
  end, paths("F", "K"))
  add("Bouc-Wen", { reach = bend, beta = 0.7, exponent = 1.4 }, function(F, shape)
    return of_law("bouc_wen_friction", { F = F, reach = shape.reach, beta = math.min(shape.beta, 0.99),
      exponent = math.max(1, shape.exponent) })
  end, paths("F", "reach", "beta", "exponent"))
  add("LuGre", { reach = bend, ratio = 1.3, velocity = 0.01, D = 40 }, function(F, shape)
    return of_law("lugre_friction", { F = F, Fs = F * shape.ratio, velocity = shape.velocity, K = F / shape.reach,
      D = shape.D })
  end, paths("F", "Fs", "velocity", "K", "D"))
  add("GMS", { reach = bend / 2, ratio = 1.3, velocity = 0.01, share1 = 0.4, share2 = 0.4, attraction = 400 },
    function(F, shape)
      local sum = shape.share1 + shape.share2 + 0.2
      local own = {}
      for i, share in ipairs { shape.share1 / sum, shape.share2 / sum, 0.2 / sum } do
        own[i] = { K = F * share / (shape.reach * 4 ^ (i - 1)), share = share }
      end
      return of_law("gms_friction", { F = F, Fs = F * shape.ratio, velocity = shape.velocity,
        attraction = shape.attraction, elements = own })
    end, paths("F", "Fs", "velocity", "attraction", "elements[*].K", "elements[1].share", "elements[2].share"))
  add("load-dependent", { reach = bend }, function(F, shape)
    -- The level is that of the laws; what it is of the load, least squares say.
    return of_law("load_dependent_friction", { share = F / math.max(1, level) * 0.1, reach = shape.reach })
  end, paths("share", "reach"))
end
table.sort(structures, function(a, b) return a.residual < b.residual end)
print(string.format("Friction: level %.3g N; residual force of the slow log by friction model [N rms]:", level))
for _, one in ipairs(structures) do
  print(string.format("  %-15s %8.3g   mass %.4g kg, viscous %.3g N s/m", one.name, one.residual, one.mass,
    one.viscous))
end

-- ---- response and modes -------------------------------------------------------------------------------------------

local function described(structure, viscous)
  local machine = tb.with_fields(known, {})
  machine.rigid_gain_per_kg = 1 / structure.mass
  machine.friction = { viscous = viscous }
  for key, value in pairs(structure.fields.friction or {}) do machine.friction[key] = value end
  machine.effects = structure.fields.effects
  return machine
end
local identified = described(structures[1], structures[1].viscous)

local function analyze(modes, report)
  return tb.fra {
    machine = identified, records = { { exc = multisine.exc, u = multisine.u, y = multisine.y } },
    methods = { "fra1", "proposed", "improved" }, modes = modes, fit_min_hz = 8, fit_max_hz = option.f_max,
    report = report,
  }
end

-- As few modes as explain the response.
local modes, best = 0, nil
for count = 0, option.max_modes do
  local tried = analyze(count)
  local own = tried.fits and tried.fits.improved
  local usable = own and #own.covariance > 0
  for _, mode in ipairs(usable and own.modes or {}) do usable = usable and mode.zeta < 0.3 end
  -- What is less than 0.3 % is no mode, but friction.
  local needed = not best or (best.misfit > 3e-3 and own and own.misfit < 0.7 * best.misfit)
  if usable and needed then modes, best = count, own end
end
print(string.format("Modes: %d, misfit %.2g %%", modes, 100 * best.misfit))
identified.rigid_gain_per_kg = best.k0
identified.modes = {}
for j, mode in ipairs(best.modes) do
  identified.modes[j] = { gain = mode.gain, freq_hz = mode.freq_hz, zeta = mode.zeta }
end

-- ---- all parameters at once ---------------------------------------------------------------------------------------

-- From both logs, by the simulated position: what the steps above leave of one part in another goes, and the standard
-- errors contain how well all others are known. Of the elements the displacements at which they slip are fitted too.
local simulations_left = option.simulations
local records = { { u = slow.u, y = slow.y }, { u = multisine.u, y = multisine.y } }
local function estimate(structure, machine, iterations)
  local parameters = { "rigid_gain_per_kg", "friction.viscous" }
  if (machine.input_delay_s or 0) > 0 then parameters[#parameters + 1] = "input_delay_s" end
  if #machine.modes > 0 then parameters[#parameters + 1] = "modes" end
  for _, path in ipairs(structure.fitted) do parameters[#parameters + 1] = path end
  local found = tb.identify {
    machine = machine, parameters = parameters, iterations = iterations, records = records,
    simulations = math.max(simulations_left, 1),
  }
  simulations_left = simulations_left - found.simulations
  -- A further parameter must lower the objective by two.
  found.score = found.objective + 2 * #found.parameters
  print(string.format("  %-16s objective %.1f with %d parameters, %d iterations, %d simulations; residual %.3g and "
    .. "%.3g um rms", structure.name, found.objective, #found.parameters, found.iterations, found.simulations,
    found.residual_rms_m[1] * 1e6, found.residual_rms_m[2] * 1e6))
  return found
end

-- What a structure leaves of both logs as it was fitted to the slow one tells structures from each other better than
-- the residual force does, which is of twofold differences: a single simulation of each.
local function start_of(one)
  local start = described(one, math.max(one.viscous, 0.5))
  start.rigid_gain_per_kg, start.modes = identified.rigid_gain_per_kg, identified.modes
  return start
end
print "Objective of both logs by friction model, with the start values:"
for _, one in ipairs(structures) do
  local ran, found = pcall(tb.identify, { machine = start_of(one), records = records, iterations = 0 })
  one.objective = ran and found.objective or math.huge
  print(string.format("  %-15s %s", one.name, ran and string.format("%.1f", one.objective) or found))
end
local closest = structures[1]
table.sort(structures, function(a, b) return a.objective < b.objective end)
local tried = { table.unpack(structures) }
-- The second one is what the slow log alone takes for the best.
for i = 3, #tried do
  if tried[i] == closest then table.insert(tried, 2, table.remove(tried, i)) end
end
-- An element that slips within a few encoder steps may be dry friction, which is set-valued.
local stiffest = elements[1]
for i, one in ipairs(tried) do
  if one == by_elements and stiffest and 2 * stiffest.F / stiffest.K < 1e-6 + 4 * (known.encoder_resolution_m or 0) then
    local others = {}
    for k = 2, #elements do others[#others + 1] = elements[k] end
    table.insert(tried, i + 1, {
      name = "elements and dry", mass = one.mass, viscous = one.viscous,
      fields = { friction = { coulomb = stiffest.F, elements = others } },
      fitted = #others == 0 and { "friction.coulomb" }
        or { "friction.coulomb", "friction.elements[*].K", "friction.elements[*].F" },
    })
    break
  end
end
-- A few iterations for each, and then the best one to the end. A law that leaves what noise does has no rival.
local joint, structure
print "Joint estimation by friction model:"
for i, one in ipairs(tried) do
  local most = option.structures + (one.name == "elements and dry" and 1 or 0)
  if i > most or (joint and joint.excess < 1.5 and structure ~= by_elements) then break end
  local found = estimate(one, start_of(one), math.min(i == 1 and 8 or 5, option.iterations))
  if not joint or found.score < joint.score then joint, structure = found, one end
end
if not joint.converged and option.iterations > joint.iterations then
  joint = estimate(structure, joint.machine, option.iterations - joint.iterations)
end
for _, note in ipairs(joint.notes) do print(note) end
identified = joint.machine
tb.write_json { file = "identified.json", value = identified }
print(string.format("Friction model: %s; standard errors are %.2g times those of pure noise", structure.name,
  joint.excess))

-- The response with the friction that was found, and its distortion.
local fra = analyze(modes, option.plots and "fra" or nil)
local function median(values)
  local sorted = {}
  for _, value in ipairs(values) do if value == value then sorted[#sorted + 1] = value end end
  table.sort(sorted)
  return sorted[math.max(1, math.floor(#sorted / 2))]
end
local distortion = {}
for _, method in ipairs { "fra1", "improved" } do
  distortion[method] = median(fra.responses[method].odd_distortion_db)
end
-- What the identified machine, simulated in its loop, leaves of the measured motion at odd lines that are not excited,
-- relative to the motion at the line below; noise, which differs between the periods, and rounding are taken off. A
-- right friction model leaves -55 dB and less, also where the axis sticks, when a model that is driven by the position
-- cannot know the friction and the response keeps some distortion. One whose force is 3 to 6 % wrong leaves -42 to
-- -51 dB.
local function rms_difference(a, b)
  local sum = 0
  for k = 1, #a do sum = sum + (a[k] - b[k]) ^ 2 end
  return math.sqrt(sum / #a)
end
local function distortion_left()
  local exact = tb.with_fields(identified, { noise_rms_m = 0, encoder_resolution_m = 0 })
  local run = tb.simulate { machine = exact, r = multisine.r, exc = multisine.exc }
  assert(run.ok, run.message)
  local n = excitation.period_samples
  local periods = #multisine.y // n - 1 -- that count
  local mean, half, motion = {}, {}, {}
  for k = 1, n do
    mean[k], motion[k] = 0, 0
    local first, last
    for p = 1, periods do
      local at = p * n + k
      last = multisine.y[at] - run.y[at]
      first = first or last
      mean[k], motion[k] = mean[k] + last / periods, motion[k] + multisine.y[at] / periods
    end
    half[k] = (last - first) / 2
    mean[n + k], half[n + k], motion[n + k] = mean[k], half[k], motion[k]
  end
  local function power(values)
    return tb.spectrum {
      output = values, sample_time_s = Ts, window = "rectangular", window_samples = n, overlap = 0, detrend = "none",
    }.power
  end
  local left, noise, all = power(mean), power(half), power(motion)
  -- Rounding by the encoder, white over the sampled band; what is the same in all periods does not show in `half`.
  local rounding = (known.encoder_resolution_m or 0) ^ 2 / 6 * Ts
  local excited = {}
  for _, f in ipairs(excitation.frequency_hz) do excited[math.floor(f * n * Ts + 0.5)] = true end
  local shares, near = {}, nil
  local share, scatter, count = 0, 0, 0
  for line_number = math.floor(excitation.frequency_hz[1] * n * Ts), math.floor(option.f_max * n * Ts) do
    if excited[line_number] then
      near = all[line_number]
    elseif near and line_number % 2 == 1 then
      local own = math.max(noise[line_number], rounding - noise[line_number])
      share, scatter, count = share + left[line_number] / near, scatter + own / near, count + 1
      if count == 4 then
        shares[#shares + 1] = math.max(share - scatter, 0.1 * scatter) / count
        share, scatter, count = 0, 0, 0
      end
    end
  end
  return 10 * math.log(median(shares), 10)
end
distortion.left = distortion_left()
local right = distortion.left < -53
print(string.format("Odd distortion, median: FRA-1 %.1f dB, response with the friction model %.1f dB, left by the "
  .. "identified machine %.1f dB: the friction model is %s", distortion.fra1, distortion.improved, distortion.left,
  right and "good" or "NOT good, its parameters and damping ratios are doubtful"))

-- ---- the validation -----------------------------------------------------------------------------------------------

local simulated = option.multisine == ""
local gap, move, again
if simulated or option.move ~= "" then
  move = log_of("move", option.move)
  again = tb.simulate { machine = identified, r = move.r, exc = move.exc }
  assert(again.ok, again.message)
  gap = rms_difference(move.y, again.y)
  print(string.format("Validation move: measured minus simulated position %.3g um rms (measured minus reference %.4g)",
    gap * 1e6, 1e6 * rms_difference(move.y, move.r)))
end

-- ---- plots --------------------------------------------------------------------------------------------------------

local improved = fra.responses.improved
local gain_low, gain_high, phase_low, phase_high = {}, {}, {}, {}
for i = 1, #improved.frequency_hz do
  gain_low[i] = improved.gain_db[i] - 1.96 * improved.std_gain_db[i]
  gain_high[i] = improved.gain_db[i] + 1.96 * improved.std_gain_db[i]
  phase_low[i] = improved.phase_deg[i] - 1.96 * improved.std_phase_deg[i]
  phase_high[i] = improved.phase_deg[i] + 1.96 * improved.std_phase_deg[i]
end
local dense = tb.logspace(8, option.f_max, 800)
local model = tb.plant_response { machine = identified, frequency_hz = dense }
local wrapped = {}
for i, phase in ipairs(model.phase_deg) do wrapped[i] = phase > 0 and phase - 360 or phase end
plot {
  file = "response",
  title = "Measured response with 95 % bounds, identified model, distortion",
  panels = {
    {
      y_label = "Gain [dB re 1 m/N]", x_log = true,
      series = {
        { name = "FRA-1, thrust to position", x = fra.responses.fra1.frequency_hz, y = fra.responses.fra1.gain_db },
        {
          name = "Improved, with friction model", x = improved.frequency_hz, y = improved.gain_db, low = gain_low,
          high = gain_high, style = "band",
        },
        { name = "identified", x = dense, y = model.gain_db, style = "dashed", color = "#000000" },
      },
    },
    {
      y_label = "Phase [deg]", x_log = true, legend = "none",
      series = {
        { x = fra.responses.fra1.frequency_hz, y = fra.responses.fra1.phase_deg },
        { x = improved.frequency_hz, y = improved.phase_deg, low = phase_low, high = phase_high, style = "band" },
        { x = dense, y = wrapped, style = "dashed", color = "#000000" },
      },
    },
    {
      x_label = "Frequency [Hz]", y_label = "Odd distortion [dB]", x_log = true, legend = "none",
      series = {
        { x = fra.responses.fra1.frequency_hz, y = fra.responses.fra1.odd_distortion_db },
        { x = improved.frequency_hz, y = improved.odd_distortion_db },
      },
    },
  },
}
local measured_force = {}
for i = 1, #few.thrust do
  measured_force[i] = few.thrust[i] - few.acceleration[i] / identified.rigid_gain_per_kg
end
local modeled_force = tb.friction_force {
  machine = tb.with_fields(identified, { Ts = step * Ts }), position = few.position, thrust = few.thrust,
}
plot {
  file = "friction",
  title = "Friction loops of the slow log",
  panels = {
    {
      x_label = "Position [m]", y_label = "Force [N]",
      series = {
        { name = "measured, less inertia", x = few.position, y = measured_force },
        { name = "friction model", x = few.position, y = modeled_force, width = 0.8 },
      },
    },
  },
}
local difference = {}
for k = 1, move and #move.y or 0 do difference[k] = move.y[k] - again.y[k] end
if move then plot {
  file = "validation",
  title = "A move that no fit has seen",
  panels = {
    {
      y_label = "Position [m]",
      series = {
        { name = "measured", x = move.t, y = move.y },
        { name = "identified machine", x = move.t, y = again.y, style = "dashed", color = "#000000" },
      },
    },
    { x_label = "Time [s]", y_label = "Difference [m]", legend = "none", series = { { x = move.t, y = difference } } },
  },
} end

-- ---- the truth, where the drive was simulated ---------------------------------------------------------------------

local summary = {
  distortion_fra1_db = distortion.fra1,
  distortion_improved_db = distortion.improved,
  distortion_left_db = distortion.left,
  friction_model_is_good = right,
  misfit = best.misfit,
  simulations = option.simulations - simulations_left,
  converged = joint.converged,
  excess = joint.excess,
  validation_um = gap and gap * 1e6,
  modes = modes,
  parameters = {},
}
local truth, kind, loop = hidden_machine(option.hidden)
local function compare(name, found, error, wanted)
  summary.parameters[#summary.parameters + 1] =
    { name = name, value = found, standard_error = error, truth = wanted }
  print(string.format("  %-10s %11.5g +- %-9.2g %s", name, found, error,
    wanted and string.format("truth %.5g: %+.2f %%, %.1f standard errors", wanted, 100 * (found / wanted - 1),
      math.abs(found - wanted) / error) or ""))
end
print("Identified machine" .. (simulated and string.format(", beside the truth (%s, %d modes, %s, encoder %.3g um)",
  kind, #truth.modes, loop, truth.encoder_resolution_m * 1e6) or ""))
local short = { rigid_gain_per_kg = "k0", input_delay_s = "delay", ["friction.viscous"] = "viscous",
  ["friction.coulomb"] = "dry", ["friction.stribeck.static"] = "static", ["friction.stribeck.velocity"] = "v_s" }
for j = 1, modes do
  local path = "modes[" .. j .. "]."
  short[path .. "gain"], short[path .. "freq_hz"], short[path .. "zeta"] = "k" .. j, "f" .. j, "zeta" .. j
end
-- Of the truth, where it has such a field and this describes the same.
local function true_value(path)
  if not simulated or (path:find "^modes" and modes ~= #truth.modes) then return nil end
  local same_law = structure.name == kind and not path:find "elements"
  if path:find "^effects" and not same_law then return nil end
  if path:find "^friction" and path ~= "friction.viscous" and not same_law
      and not (path == "friction.coulomb" and structure.name == "elements and dry" and kind == "rolling and dry") then
    return nil
  end
  local value = truth
  for key in path:gmatch "[^%.%[%]]+" do value = value and value[tonumber(key) or key] end
  return value
end
for _, parameter in ipairs(joint.parameters) do
  local name = short[parameter.name] or parameter.name:match "^effects%[1%]%.parameters%.([%w]+)$"
  if name then compare(name, parameter.value, parameter.standard_error, true_value(parameter.name)) end
end
summary.structure = structure.name
if simulated then
  summary.kind, summary.true_modes, summary.controller = kind, #truth.modes, loop
  summary.encoder_um = truth.encoder_resolution_m * 1e6
  -- The friction models over the true motion of the multisine.
  local still = { noise_rms_m = 0, encoder_resolution_m = 0 }
  local run = tb.simulate { machine = tb.with_fields(truth, still), r = multisine.r, exc = multisine.exc }
  local function friction_of(machine)
    return tb.friction_force { machine = tb.with_fields(machine, still), position = run.x, thrust = run.u }
  end
  local wanted = friction_of(truth)
  summary.friction_error = rms_difference(friction_of(identified), wanted) / rms(wanted)
  print(string.format("Friction force over the motion: %.2g %% of its rms value wrong", 100 * summary.friction_error))
end
tb.write_json { file = "summary.json", value = summary }
