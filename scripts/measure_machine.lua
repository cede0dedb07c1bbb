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
  elements = { default = 12, help = "of the friction model" },
  iterations = { default = 30, help = "at most, of the joint estimation" },
  hidden = { default = 1, help = "the machine that is measured" },
  plots = { default = true, help = "and the report of the response" },
  plan = { default = false, help = "only write the files for the drive" },
  slow = { default = "", help = "log of plan_slow.csv; empty: simulated" },
  multisine = { default = "", help = "log of plan_multisine.csv; empty: simulated" },
  move = { default = "", help = "log of plan_move.csv; empty: simulated, or no validation where other logs are given" },
}

-- ---- what is known of the machine before --------------------------------------------------------------------------

local Ts = 250e-6
local loop_hz = 6
local w_loop = 2 * math.pi * loop_hz
local known = {
  Ts = Ts,
  rigid_gain_per_kg = 1 / option.mass_kg,
  input_delay_s = 250e-6,
  output_delay_s = 125e-6,
  current_loop_hz = 2000,
  encoder_resolution_m = 0.1e-6,
  controller = {
    type = "pid",
    kp = option.mass_kg * w_loop ^ 2,
    ki = option.mass_kg * w_loop ^ 3 / 5,
    kd = 1.4 * option.mass_kg * w_loop,
  },
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

local kinds = { "rolling", "rolling and viscous", "rolling and dry", "Stribeck" }

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
  local level = random(3, 9)
  machine.friction = { viscous = kind == "rolling" and 0 or random(2, 20), elements = {} }
  if kind ~= "Stribeck" then
    -- A curve from a reversal that bends from 1 um to 1 mm.
    local x = 1e-6
    for i = 1, 10 do
      local share = level / 10 * random(0.6, 1.4)
      machine.friction.elements[i] = { K = share / (x / 2), F = share }
      x = x * 2.1
    end
  end
  if kind == "rolling and dry" then machine.friction.coulomb = random(0.5, 2) end
  if kind == "Stribeck" then
    machine.friction.coulomb = level
    machine.friction.stribeck = { static = 1.5 * level, velocity = 0.01 }
  end
  machine.encoder_resolution_m = known.encoder_resolution_m
  machine.noise_rms_m = random(0, 0.1e-6)
  return machine, kind
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
local slow_seconds, fast_seconds = (tb.quick and 1.5 or 2.5) / slow_hz, 6 / fast_hz
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

-- Accelerations and velocities from differences over 10 ms each way.
local reach = math.floor(0.01 / Ts + 0.5)
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

-- Elements, then mass and viscous friction with them, in turn: each is linear least squares.
local mass, viscous, elements = 1 / known.rigid_gain_per_kg, 0, nil
local fit
for _ = 1, 6 do
  local force = {}
  for i = 1, #few.thrust do force[i] = few.thrust[i] - mass * few.acceleration[i] - viscous * few.velocity[i] end
  fit = tb.fit_friction {
    position = few.position, force = force, elements = option.elements,
    shortest_m = math.max(2 * (known.encoder_resolution_m or 0), 2e-7), longest_m = 0.2 * wide,
    first_fitted = math.floor(#force / 8),
  }
  elements = fit.elements
  local modeled = tb.friction_force { elements = elements, position = few.position }
  local straight = tb.least_squares { columns = { few.acceleration, few.velocity, modeled }, values = few.thrust }
  mass, viscous = straight.coefficients[1], math.max(straight.coefficients[2], 0)
end
local level = 0
for _, element in ipairs(elements) do level = level + element.F end
print(string.format("Friction: level %.3g N in %d elements, viscous %.3g N s/m, mass %.4g kg; residual %.3g N rms",
  level, #elements, viscous, mass, fit.residual_rms))

-- ---- response and modes -------------------------------------------------------------------------------------------

local identified = tb.with_fields(known, {})
identified.rigid_gain_per_kg = 1 / mass
identified.friction = { viscous = viscous, elements = elements }

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
local function estimate(machine)
  local parameters = { "rigid_gain_per_kg" }
  for path, present in pairs {
    input_delay_s = (machine.input_delay_s or 0) > 0, modes = #machine.modes > 0,
    ["friction.viscous"] = machine.friction.viscous > 0, ["friction.coulomb"] = machine.friction.coulomb,
    ["friction.elements[*].K"] = #machine.friction.elements > 0,
    ["friction.elements[*].F"] = #machine.friction.elements > 0,
  } do
    if present then parameters[#parameters + 1] = path end
  end
  table.sort(parameters)
  return tb.identify {
    machine = machine, parameters = parameters, iterations = option.iterations,
    records = { { u = slow.u, y = slow.y }, { u = multisine.u, y = multisine.y } },
  }
end
local joint = estimate(identified)
-- An element that slips within a few encoder steps may be dry friction, which is set-valued.
local stiffest = elements[1]
if stiffest and 2 * stiffest.F / stiffest.K < 1e-6 then
  local others = {}
  for i = 2, #elements do others[#others + 1] = elements[i] end
  local dry = tb.with_fields(identified, {})
  dry.friction = { viscous = viscous, coulomb = stiffest.F, elements = others }
  local tried = estimate(dry)
  if tried.objective < joint.objective then joint = tried end
end
for _, note in ipairs(joint.notes) do print(note) end
identified = joint.machine
tb.write_json { file = "identified.json", value = identified }
print(string.format(
  "Joint estimation: residual %.3g and %.3g um rms; standard errors are %.2g times those of pure noise",
  joint.residual_rms_m[1] * 1e6, joint.residual_rms_m[2] * 1e6, joint.excess))

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
-- A right friction model leaves -45 dB and less, one that is 20 % wrong -39 dB.
local right = distortion.improved < -42
print(string.format("Odd distortion, median: FRA-1 %.1f dB, with the friction model %.1f dB: the friction model is %s",
  distortion.fra1, distortion.improved, right and "good" or "NOT good, its parameters and damping ratios are doubtful"))

-- ---- the validation -----------------------------------------------------------------------------------------------

local simulated = option.multisine == ""
local function rms_difference(a, b)
  local sum = 0
  for k = 1, #a do sum = sum + (a[k] - b[k]) ^ 2 end
  return math.sqrt(sum / #a)
end
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
local found_friction = identified.friction
local measured_force = {}
local modeled_force = tb.friction_force { elements = found_friction.elements, position = few.position }
for i = 1, #few.thrust do
  local v = few.velocity[i]
  measured_force[i] = few.thrust[i] - few.acceleration[i] / identified.rigid_gain_per_kg
  modeled_force[i] = modeled_force[i] + found_friction.viscous * v
    + (found_friction.coulomb or 0) * (v > 0 and 1 or v < 0 and -1 or 0)
end
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
  friction_model_is_good = right,
  misfit = best.misfit,
  validation_um = gap and gap * 1e6,
  modes = modes,
  parameters = {},
}
local truth, kind = hidden_machine(option.hidden)
local function compare(name, found, error, wanted)
  summary.parameters[#summary.parameters + 1] =
    { name = name, value = found, standard_error = error, truth = wanted }
  print(string.format("  %-6s %11.5g +- %-9.2g %s", name, found, error,
    wanted and string.format("truth %.5g: %+.2f %%, %.1f standard errors", wanted, 100 * (found / wanted - 1),
      math.abs(found - wanted) / error) or ""))
end
print("Identified machine" .. (simulated and ", beside the truth (" .. kind .. ", " .. #truth.modes .. " modes)" or ""))
local by_name = {}
for _, parameter in ipairs(joint.parameters) do by_name[parameter.name] = parameter end
local function compare_field(name, path, wanted)
  local found = by_name[path]
  compare(name, found.value, found.standard_error, wanted)
end
compare_field("k0", "rigid_gain_per_kg", simulated and truth.rigid_gain_per_kg or nil)
for j = 1, modes do
  local own = simulated and truth.modes[j] or {}
  compare_field("k" .. j, "modes[" .. j .. "].gain", own.gain)
  compare_field("f" .. j, "modes[" .. j .. "].freq_hz", own.freq_hz)
  compare_field("zeta" .. j, "modes[" .. j .. "].zeta", own.zeta)
end
if simulated then
  summary.kind, summary.true_modes = kind, #truth.modes
  summary.viscous, summary.true_viscous = identified.friction.viscous, truth.friction.viscous
end
tb.write_json { file = "summary.json", value = summary }
