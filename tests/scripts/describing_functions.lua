-- tb.describing_function against closed forms and quadrature, and the loop gain with friction laws against sweeps.
local tb = require "tribode"

local function close(value, expected, within, what)
  assert(math.abs(value - expected) <= within, string.format("%s: %.9g instead of %.9g", what, value, expected))
end
local function machine_with(effects, friction)
  return { Ts = 5e-4, mass_kg = 10, effects = effects, friction = friction }
end
local function of(machine, amplitude, frequency, load)
  local n = tb.describing_function { machine = machine, amplitude_m = { amplitude }, frequency_hz = { frequency },
    load_N = load }
  return n.real[1], n.imag[1]
end

-- Fundamental of a force over that of x = a sin(angle), by the rectangle rule over a period.
local function quadrature(amplitude, force)
  local count, real, imag = 20000, 0, 0
  for i = 0, count - 1 do
    local angle = 2 * math.pi * (i + 0.5) / count
    local f = force(amplitude * math.sin(angle), math.cos(angle))
    real, imag = real + f * math.sin(angle), imag + f * math.cos(angle)
  end
  return 2 * real / (count * amplitude), 2 * imag / (count * amplitude)
end

-- ---- one law at a time --------------------------------------------------------------------------------------------

-- The steady loop of Dahl's law: exponential toward the level on each branch.
local function dahl(amplitude, level, stiffness)
  local e = math.exp(-2 * stiffness * amplitude / level)
  local peak = level * (1 - e) / (1 + e) -- of the force, at the turning points
  return quadrature(amplitude, function(x, way)
    local side = way > 0 and 1 or -1
    return side * (level - (level + peak) * math.exp(-stiffness * (side * x + amplitude) / level))
  end)
end

local K, F = 1e5, 3
for _, amplitude in ipairs { 1e-7, 1e-5, 3e-5, 1e-4, 1e-3 } do
  for _, f in ipairs { 0.5, 20, 400 } do
    local real, imag = dahl(amplitude, F, K)
    local size = math.sqrt(real ^ 2 + imag ^ 2)
    local function agrees(what, effect, load)
      local here_real, here_imag = of(machine_with { effect }, amplitude, f, load)
      close(here_real, real, 2e-4 * size, what)
      close(here_imag, imag, 2e-4 * size, what)
    end
    -- The same loop by every law that has it as a limit.
    agrees("Dahl", { name = "dahl_friction", parameters = { F = F, K = K } })
    agrees("Bouc-Wen", { name = "bouc_wen_friction", parameters = { F = F, reach = F / K, beta = 1 } })
    agrees("load", { name = "load_dependent_friction", parameters = { share = 0.1, reach = F / K } }, F / 0.1)
    agrees("LuGre", { name = "lugre_friction", parameters = { F = F, Fs = F, velocity = 1, K = K } })
    agrees("Leuven", { name = "leuven_friction", parameters = { F = F, Fs = F, velocity = 1, transition = 1,
      elements = { { K = 0.4 * K, F = 100 }, { K = 0.6 * K, F = 200 } } } })

    -- GMS with one level is Maxwell slip, whose closed form is that of the elements.
    local elements, slip = { { K = 1e5, F = 1.8 }, { K = 1e4, F = 1.2 } }, { F = 3, Fs = 3, velocity = 1,
      attraction = 300, elements = { { K = 1e5, share = 0.6 }, { K = 1e4, share = 0.4 } } }
    local a, b = of(machine_with(nil, { elements = elements, viscous = 4 }), amplitude, f)
    local c, d = of(machine_with({ { name = "gms_friction", parameters = slip } }, { viscous = 4 }), amplitude, f)
    size = math.sqrt(a ^ 2 + b ^ 2)
    close(c, a, 2e-4 * size, "GMS")
    close(d, b, 2e-4 * size, "GMS")

    -- Dry friction with a Stribeck effect.
    local stribeck = { coulomb = 2, stribeck = { static = 3, velocity = 0.01, exponent = 1 } }
    a, b = of(machine_with(nil, stribeck), amplitude, f)
    c, d = quadrature(amplitude, function(_, cosine)
      local speed = 2 * math.pi * f * amplitude * math.abs(cosine)
      return (cosine > 0 and 1 or -1) * (2 + math.exp(-speed / 0.01))
    end)
    close(a, c, 1e-4 * math.abs(d), "Stribeck")
    close(b, d, 1e-4 * math.abs(d), "Stribeck")
  end
end
local _, imag = of(machine_with(nil, { coulomb = 2 }), 1e-4, 10)
close(imag, 4 * 2 / (math.pi * 1e-4), 1e-6 * imag, "Coulomb")

-- With a Stribeck curve and damping it depends on the frequency, as the model simulated by itself says: the deflection
-- of LuGre along a sine, by small steps of its own.
local lugre = { F = 3, Fs = 4, velocity = 5e-3, K = 1e5, D = 30, viscous = 10 }
for _, f in ipairs { 5, 50 } do
  local a, w, z, steps = 5e-5, 2 * math.pi * f, 0, 40000
  local real, imaginary = 0, 0
  for i = 0, 4 * steps - 1 do
    local function rate(at, deflection)
      local v = a * w * math.cos(2 * math.pi * at / steps)
      return v - 1e5 * math.abs(v) / (3 + math.exp(-(v / 5e-3) ^ 2)) * deflection
    end
    if i >= 3 * steps then
      local angle = 2 * math.pi * i / steps
      local force = 1e5 * z + 30 * rate(i, z) + 10 * a * w * math.cos(angle)
      real, imaginary = real + 2 / steps * force * math.sin(angle), imaginary + 2 / steps * force * math.cos(angle)
    end
    local half = z + rate(i, z) / (2 * steps * f)
    z = z + rate(i + 0.5, half) / (steps * f)
  end
  local here_real, here_imag = of(machine_with { { name = "lugre_friction", parameters = lugre } }, a, f)
  close(here_real, real / a, 1e-3 * math.abs(imaginary / a), "LuGre with Stribeck")
  close(here_imag, imaginary / a, 1e-3 * math.abs(imaginary / a), "LuGre with Stribeck")
end

-- ---- the loop gain with laws --------------------------------------------------------------------------------------

local mass, omega = 10, 2 * math.pi * 10
local pid = { type = "pid", kp = mass * omega ^ 2, ki = mass * omega ^ 3 / 5, kd = 1.4 * mass * omega }
local stiffness = { dahl_friction = 1e5, lugre_friction = 1e5, gms_friction = 1.1e5, leuven_friction = 1.3e5 }
local elements = { Ts = 5e-4, mass_kg = mass, controller = pid, input_delay_s = 4e-4,
  friction = { elements = { { K = 1e5, F = 3 } } } }
local spring = tb.loop_margins { machine = elements, amplitude_m = 0, friction_feedback = 1 }
assert(math.abs(spring.critical_feedback - 1 - pid.kp / 1e5) < 0.08, spring.critical_feedback)
for name, parameters in pairs {
  dahl_friction = { F = 3, K = 1e5 },
  lugre_friction = { F = 3, Fs = 3.5, velocity = 0.01, K = 1e5, D = 30 },
  gms_friction = { F = 3, Fs = 3.5, velocity = 0.01, attraction = 300,
    elements = { { K = 1e5, share = 0.6 }, { K = 1e4, share = 0.4 } } },
  leuven_friction = { F = 3, Fs = 3.5, velocity = 0.01, transition = 2,
    elements = { { K = 1e5, F = 2 }, { K = 3e4, F = 2 } } },
} do
  local machine = { Ts = 5e-4, mass_kg = mass, controller = pid, input_delay_s = 4e-4,
    effects = { { name = name, parameters = parameters } } }
  for _, share in ipairs { 0, 0.6 } do
    local frequencies, amplitudes = { 12, 20, 35, 60, 100 }, {}
    local sweep = tb.sweep { machine = machine, frequency_hz = frequencies, amplitude_N = 15,
      friction_feedback = share }
    assert(#sweep.warnings == 0, sweep.warnings[1])
    for i, f in ipairs(frequencies) do
      local run = tb.single_frequency { machine = machine, excitation_hz = f, amplitude_N = 15,
        friction_feedback = share }
      amplitudes[i] = (math.max(table.unpack(run.y)) - math.min(table.unpack(run.y))) / 2
    end
    local modeled = tb.loop_gain { machine = machine, frequency_hz = frequencies, amplitude_m = amplitudes,
      friction_feedback = share }
    local worst = 0
    for i in ipairs(frequencies) do
      local a, b, c, d = sweep.loop_gain.real[i], sweep.loop_gain.imag[i], modeled.real[i], modeled.imag[i]
      worst = math.max(worst, math.sqrt(((a - c) ^ 2 + (b - d) ^ 2) / ((1 + c) ^ 2 + d ^ 2)))
    end
    print(string.format("%-16s %3.0f %% fed back: loop gain within %.3f of abs(1 + L)", name, 100 * share, worst))
    assert(worst < 0.06, name)
  end
  local stuck = tb.loop_margins { machine = machine, amplitude_m = 0, friction_feedback = 1 }
  local moved = tb.loop_margins { machine = machine, amplitude_m = 1e-4, friction_feedback = 1 }
  -- Friction that sticks is a spring: what is fed back beyond it, only kp and a little of the integrator hold.
  assert(math.abs(stuck.critical_feedback - 1 - pid.kp / stiffness[name]) < 0.08,
    name .. ": " .. stuck.critical_feedback)
  assert(stuck.stable and moved.critical_feedback > stuck.critical_feedback + 0.05, name)
end

-- ---- bad input ----------------------------------------------------------------------------------------------------

local function refused(message, options, call)
  local ok, text = pcall(call or tb.describing_function, options)
  assert(not ok and text:find(message, 1, true), tostring(text))
end
local geared = { Ts = 5e-4, mass_kg = mass, controller = pid,
  effects = { { name = "load_dependent_friction", parameters = { share = 0.1, reach = 2e-5 } } } }
refused("load_N is missing; the friction of load_dependent_friction grows with the load",
  { machine = geared, amplitude_m = { 1e-5 }, frequency_hz = { 10 } })
refused("the friction of load_dependent_friction grows with the load, which a loop gain does not know",
  { machine = geared, amplitude_m = 1e-5 }, tb.loop_margins)
refused("amplitude_m has 2 entries, must be one or 3",
  { machine = machine_with(), amplitude_m = { 1e-5, 1e-4 }, frequency_hz = { 1, 2, 3 } })
