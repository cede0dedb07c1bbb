-- Friction laws with states of their own, as effects of a machine: against closed forms, against a small integrator of
-- their equations here, between solvers, and as what the analyses subtract and identify.
local tb = require "tribode"

local Ts, mass = 5e-4, 10
local function machine_with(name, parameters, more)
  local machine = { Ts = Ts, mass_kg = mass, effects = { { name = name, parameters = parameters } } }
  for key, value in pairs(more or {}) do machine[key] = value end
  return machine
end
local function simulated(machine, u, solver)
  local run = tb.simulate { machine = machine, u = u, solver = solver or "erk", relative_tolerance = 1e-11,
    absolute_tolerance_m = 1e-15 }
  assert(run.ok, run.message)
  return run
end
local function close(value, expected, within, what)
  assert(math.abs(value - expected) <= within, string.format("%s: %.12g instead of %.12g", what, value, expected))
end

-- Two sines that take the axis through reversals, presliding and slip.
local thrust = {}
for k = 0, 400 do
  local t = k * Ts
  thrust[k + 1] = 9 * math.sin(2 * math.pi * 11 * t) + 4 * math.sin(2 * math.pi * 31 * t)
end

-- ---- closed forms of the first motion, which goes one way ---------------------------------------------------------

local push = {}
for k = 1, 60 do push[k] = 5 end
local F, K = 3, 1e5
local forms = {
  { "dahl_friction", { F = F, K = K }, function(y) return F * (1 - math.exp(-K * y / F)) end },
  { "dahl_friction", { F = F, K = K, exponent = 2 }, function(y) return F - F / (1 + K * y / F) end },
  { "bouc_wen_friction", { F = F, reach = 3e-5 }, function(y) return F * (1 - math.exp(-y / 3e-5)) end },
  { "bouc_wen_friction", { F = F, reach = 3e-5, beta = 0.8, exponent = 2 },
    function(y)
      local e = math.exp(-2 * y / 3e-5)
      return F * (1 - e) / (1 + e)
    end },
  { "load_dependent_friction", { share = 0.4, reach = 3e-5 },
    function(y) return 0.4 * 5 * (1 - math.exp(-y / 3e-5)) end },
}
for _, form in ipairs(forms) do
  local run = simulated(machine_with(form[1], form[2]), push)
  assert(run.x[60] > 1e-4)
  for k = 2, 60 do close(run.f[k], form[3](run.x[k]), 1e-8, form[1]) end
end

-- Bouc-Wen with beta = 1/2 comes back as a spring, until the force is gone.
local back = {}
for k = 1, 60 do back[k] = k <= 20 and 5 or -20 end
local run = simulated(machine_with("bouc_wen_friction", { F = F, reach = 3e-5 }), back)
local springs = 0
for k = 21, 60 do
  if run.v[k] < 0 and run.f[k] > 0 and run.v[k + 1] < 0 and run.f[k + 1] > 0 then
    close((run.f[k + 1] - run.f[k]) / (run.x[k + 1] - run.x[k]), F / 3e-5, 1e-2, "spring")
    springs = springs + 1
  end
end
assert(springs > 2)

-- LuGre, GMS and Leuven at a steady speed: the Stribeck curve and the viscous part.
local steady = {}
for k = 1, 4000 do steady[k] = 6 end
for name, parameters in pairs {
  lugre_friction = { F = 3, Fs = 4, velocity = 5e-3, K = 1e4, D = 30, viscous = 400 },
  gms_friction = { F = 3, Fs = 4, velocity = 5e-3, viscous = 400, attraction = 300,
    elements = { { K = 1e4, share = 0.7 }, { K = 2e3, share = 0.3 } } },
  leuven_friction = { F = 3, Fs = 4, velocity = 5e-3, viscous = 400, transition = 3, D = 30,
    elements = { { K = 1e4, F = 2 }, { K = 2e3, F = 2.5 } } },
} do
  local moved = simulated(machine_with(name, parameters), steady)
  local v = moved.v[4000]
  close(moved.f[4000], 3 + math.exp(-(v / 5e-3) ^ 2) + 400 * v, 1e-7, name)
  close(moved.f[4000], 6, 1e-6, name)
end

-- GMS with one level for all speeds is Maxwell slip, whose machine is solved exactly.
local elements = { { K = 1e5, F = 1.8 }, { K = 1e4, F = 1.2 } }
local exact = simulated({ Ts = Ts, mass_kg = mass, friction = { elements = elements } }, thrust, "exact")
local gms = simulated(machine_with("gms_friction", { F = 3, Fs = 3, velocity = 5e-3, attraction = 300,
  elements = { { K = 1e5, share = 0.6 }, { K = 1e4, share = 0.4 } } }), thrust)
for k = 1, #thrust do
  close(gms.x[k], exact.x[k], 1e-12, "GMS as Maxwell slip")
  close(gms.f[k], exact.f[k], 1e-7, "GMS as Maxwell slip")
end

-- ---- against an integrator of their equations ---------------------------------------------------------------------

-- m v' = u - f by the classical Runge-Kutta method with small steps; rates(v, s) and friction(v, s, u) of each law, and
-- for GMS which elements slip, looked at after each step.
local function integrated(law, u)
  local steps = law.steps or 200
  local h = Ts / steps
  local n = law.count
  local y, positions, forces = { 0, 0 }, {}, {}
  for i = 1, n do y[2 + i] = 0 end
  local function slope(state, push_)
    local s = table.move(state, 3, 2 + n, 1, {})
    local rates = law.rates(state[2], s)
    local d = { state[2], (push_ - law.friction(state[2], s, push_)) / mass }
    for i = 1, n do d[2 + i] = rates[i] end
    return d
  end
  for k = 1, #u do
    positions[k] = y[1]
    -- The force at a sample is that before the thrust changes.
    forces[k] = law.friction(y[2], table.move(y, 3, 2 + n, 1, {}), u[math.max(k - 1, 1)])
    for _ = 1, steps do
      local sum, at = {}, y
      for stage = 1, 4 do
        local d = slope(at, u[k])
        at = {}
        for i = 1, 2 + n do
          sum[i] = (sum[i] or 0) + d[i] * ({ 1, 2, 2, 1 })[stage]
          at[i] = y[i] + h * d[i] * ({ 0.5, 0.5, 1, 0 })[stage]
        end
      end
      for i = 1, 2 + n do y[i] = y[i] + h / 6 * sum[i] end
      if law.after then law.after(y[2], y) end
    end
  end
  return positions, forces
end

local function sign(x) return x > 0 and 1 or x < 0 and -1 or 0 end
local function level(v) return 3 + math.exp(-(v / 5e-3) ^ 2) end
local slips = { 0, 0 }
local stiffness, share = { 1e5, 1e4 }, { 0.6, 0.4 }

-- The hysteresis of the Leuven model as stop operators over the deflection z, clipped, with what they remember of the
-- last step; the elements of the engine change between stick and slip instead.
local stops = { z = 0, 0, 0, stiffness = { 1e5, 3e4 }, limit = { 2e-5, 1e-4 } }
local function stopped(i, z) return math.max(-stops.limit[i], math.min(stops.limit[i], stops[i] + z - stops.z)) end
local function hysteresis(z) return stops.stiffness[1] * stopped(1, z) + stops.stiffness[2] * stopped(2, z) end
local function leuven_rate(v, z)
  local part = hysteresis(z) * sign(v) / level(v)
  return v * (1 - sign(part) * part * part)
end
local laws = {
  dahl_friction = {
    parameters = { F = 3, K = 1e5, exponent = 1.5 }, count = 1, within = 1e-9,
    rates = function(v, s)
      local left = 1 - 1e5 * s[1] / 3 * sign(v)
      return { v * math.abs(left) ^ 1.5 * sign(left) }
    end,
    friction = function(_, s) return 1e5 * s[1] end,
  },
  lugre_friction = {
    parameters = { F = 3, Fs = 4, velocity = 5e-3, K = 1e5, D = 30, viscous = 10 }, count = 1, within = 1e-9,
    rates = function(v, s) return { v - 1e5 * math.abs(v) / level(v) * s[1] } end,
    friction = function(v, s) return 1e5 * s[1] + 30 * (v - 1e5 * math.abs(v) / level(v) * s[1]) + 10 * v end,
  },
  bouc_wen_friction = {
    parameters = { F = 3, reach = 3e-5, beta = 0.7, exponent = 2 }, count = 1, within = 1e-9,
    rates = function(v, s)
      local z = s[1] / 3e-5 -- as it is usually written: v - beta abs(v) abs(z)^(n - 1) z - gamma v abs(z)^n
      return { v - 0.7 * math.abs(v) * math.abs(z) * z - 0.3 * v * z * z }
    end,
    friction = function(_, s) return 3 / 3e-5 * s[1] end,
  },
  load_dependent_friction = {
    parameters = { share = 0.2, reach = 3e-5 }, count = 1, within = 1e-9,
    rates = function(v, s) return { v - math.abs(v) * s[1] / 3e-5 } end,
    friction = function(_, s, u) return 0.2 * math.abs(u) * s[1] / 3e-5 end,
  },
  gms_friction = {
    parameters = { F = 3, Fs = 4, velocity = 5e-3, attraction = 300, elements = { { K = 1e5, share = 0.6 },
      { K = 1e4, share = 0.4 } } },
    count = 2, within = 2e-7, steps = 1000,
    rates = function(v, s)
      local rates = {}
      for i = 1, 2 do
        local way = slips[i]
        rates[i] = way == 0 and v or 300 * way / stiffness[i] * (share[i] - way * stiffness[i] * s[i] / level(v))
      end
      return rates
    end,
    friction = function(_, s) return stiffness[1] * s[1] + stiffness[2] * s[2] end,
    after = function(v, state)
      for i = 1, 2 do
        if slips[i] ~= 0 and slips[i] * v < 0 then slips[i] = 0 end
        if slips[i] == 0 and sign(v) * stiffness[i] * state[2 + i] > share[i] * level(v) then slips[i] = sign(v) end
      end
    end,
  },
}
laws.leuven_friction = {
  parameters = { F = 3, Fs = 4, velocity = 5e-3, transition = 2, D = 30, viscous = 10,
    elements = { { K = 1e5, F = 2 }, { K = 3e4, F = 3 } } },
  count = 1, within = 2e-7, steps = 1000,
  rates = function(v, s) return { leuven_rate(v, s[1]) } end,
  friction = function(v, s) return hysteresis(s[1]) + 30 * leuven_rate(v, s[1]) + 10 * v end,
  after = function(_, state)
    stops[1], stops[2] = stopped(1, state[3]), stopped(2, state[3])
    stops.z = state[3]
  end,
}
for name, law in pairs(laws) do
  local machine = machine_with(name, law.parameters)
  local by_erk = simulated(machine, thrust)
  local positions, forces = integrated(law, thrust)
  local reversals = 0
  for k = 1, #thrust do
    close(by_erk.x[k], positions[k], law.within, name)
    close(by_erk.f[k], forces[k], 1e6 * law.within, name)
    if k > 1 and by_erk.v[k] * by_erk.v[k - 1] < 0 then reversals = reversals + 1 end
  end
  assert(reversals >= 3, name .. ": " .. reversals .. " reversals")
  local by_bdf = simulated(machine, thrust, "bdf")
  for k = 1, #thrust do close(by_bdf.x[k], by_erk.x[k], 1e-9, name .. " by bdf") end
  local ok, message = pcall(simulated, machine, thrust, "exact")
  assert(not ok and message:find(name, 1, true), message)
end

-- ---- subtracted from measured responses, and identified -----------------------------------------------------------

-- A table whose friction law the machine file knows: by the multisine the distortion goes, and the gain is right.
for name, law in pairs(laws) do
  local machine = machine_with(name, law.parameters, {
    modes = { { gain = 0.02, freq_hz = 60, zeta = 0.02 } }, encoder_resolution_m = 1e-9, input_delay_s = 5e-4,
  })
  local excitation = tb.multisine { sample_time_s = Ts, period_s = 1, periods = 4, amplitude_N = 30, f_max_hz = 150 }
  local log = simulated(machine, excitation.values)
  local fra = tb.fra { machine = machine, records = { { u = excitation.values, y = log.y } } }
  local function median(method)
    local list = {}
    for _, value in ipairs(fra.responses[method].odd_distortion_db) do
      if value == value then list[#list + 1] = value end
    end
    table.sort(list)
    return list[#list // 2]
  end
  local plain, improved = median "fra1", median "improved"
  local k0 = fra.fits.improved.k0 / 0.1 - 1
  print(string.format("%-24s odd distortion %.1f dB, %.1f dB without the friction; k0 %+.3f %%", name, plain, improved,
    100 * k0))
  assert(improved < plain - 12, name)
  local left = fra.residuals[1]
  assert(left.rms < 0.05 * left.friction_rms and #left.force == 2000, name .. ": " .. left.rms)
  assert(math.abs(k0) < 0.01, name)
end

-- Single sines: loops of friction by frequency. With a level of 80 % the model's is flatter, and force is left.
local sines = {}
for _, f in ipairs { 12, 20, 35, 60, 90, 120 } do
  for k = 0, 1999 do sines[#sines + 1] = 30 * math.sin(2 * math.pi * f * k * Ts) end
end
local guided = machine_with("dahl_friction", { F = 3, K = 1e5 }, { encoder_resolution_m = 1e-9 })
local log_of_sines = { u = sines, y = simulated(guided, sines).y }
local right = tb.fra { machine = guided, records = { log_of_sines } }
assert(#right.loops == 4 and right.loops[1].frequency_hz < right.loops[4].frequency_hz)
local function height(loop, of)
  return math.max(table.unpack(loop[of])) - math.min(table.unpack(loop[of]))
end
assert(math.abs(height(right.loops[1], "measured") / height(right.loops[1], "modeled") - 1) < 0.02)
assert(right.residuals[1].rms < 0.02 * right.residuals[1].friction_rms)
local low = tb.with_fields { machine = guided, scale = { ["effects[1].parameters.F"] = 0.8 } }
local wrong = tb.fra { machine = low, records = { log_of_sines } }
assert(height(wrong.loops[1], "measured") > 1.05 * height(wrong.loops[1], "modeled"))
assert(wrong.residuals[1].rms > 5 * right.residuals[1].rms)
print("force left:", right.residuals[1].rms, wrong.residuals[1].rms, "of", right.residuals[1].friction_rms)

-- Parameters of the law from 20 % off, with the others.
local truth = machine_with("lugre_friction", laws.lugre_friction.parameters, {
  mass_kg = false, rigid_gain_per_kg = 0.1, encoder_resolution_m = 1e-9, noise_rms_m = 5e-9,
})
truth.mass_kg = nil
local log = simulated(truth, thrust)
local start = tb.with_fields { machine = tb.with_fields(truth, { rigid_gain_per_kg = 0.11 }),
  scale = { ["effects[1].parameters.F"] = 0.85, ["effects[1].parameters.K"] = 1.2 } }
local found = tb.identify { machine = start, records = { { u = thrust, y = log.y } },
  parameters = { "rigid_gain_per_kg", "effects[1].parameters.F", "effects[1].parameters.K" } }
for i, value in ipairs { 0.1, 3, 1e5 } do
  local one = found.parameters[i]
  print(one.name, one.value, one.standard_error)
  close(one.value, value, math.max(4 * one.standard_error, 1e-4 * value), one.name)
  assert(one.standard_error < 0.02 * value)
end

-- By default all numbers of a law but its exponents and shares.
for name, wanted in pairs {
  bouc_wen_friction = "F reach beta", dahl_friction = "F K", lugre_friction = "F Fs velocity K D viscous",
  gms_friction = "elements[1].K elements[2].K F Fs velocity attraction",
  leuven_friction = "elements[1].K elements[1].F elements[2].K elements[2].F F Fs velocity D viscous",
} do
  local machine = machine_with(name, laws[name].parameters)
  local names = {}
  for _, one in ipairs(tb.identify { machine = machine, records = { { u = thrust, y = log.y } },
    iterations = 1 }.parameters) do
    names[#names + 1] = one.name:match "^effects%[1%]%.parameters%.(.*)"
  end
  table.sort(names)
  local sorted = {}
  for one in wanted:gmatch "%S+" do sorted[#sorted + 1] = one end
  table.sort(sorted)
  print(name, table.concat(names, " "))
  assert(table.concat(names, " ") == table.concat(sorted, " "), name .. ": " .. table.concat(names, " "))
end
