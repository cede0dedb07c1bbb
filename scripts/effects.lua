-- What each effect does to a machine: the same input with and without it, and the difference, drawn against what the
-- effect depends on, after the start has died away. Of friction and forces the thrust is drawn that they cost, of the
-- others the position. One plot per group of effects.
--
--   tribode run scripts/effects.lua -D machine=models/bare_mass.lua
--
-- Results: effects.csv (rms and largest difference of position and thrust), and the plots friction, forces, amplifier,
-- dynamics, encoder (png, svg).

local tb = require "tribode"

local option = tb.options {
  machine = { default = "models/bare_mass.lua", help = "machine description, .lua or .json" },
  amplitude = { default = 0.02, unit = "m", help = "of the reference" },
  frequency = { default = 1.0, unit = "Hz", help = "of the reference" },
  duration = { default = tb.quick and 1 or 3, unit = "s", help = "of each run" },
}

local described = {}
for _, kind in ipairs(tb.effects {}) do described[kind.name] = kind end

-- Every kind with the values of its example, in groups that share a plot.
local groups = {
  { name = "friction", thrust = true, effects = { "coulomb_friction", "viscous_friction", "stribeck_friction",
    "presliding_hysteresis", "asymmetric_friction", "position_dependent_friction", "time_varying_friction" } },
  { name = "laws", thrust = true, effects = { "dahl_friction", "lugre_friction", "bouc_wen_friction",
    "gms_friction", "leuven_friction", "load_dependent_friction" } },
  { name = "forces", thrust = true, effects = { "force_ripple", "gravity", "constant_force", "spring_force",
    "cubic_stiffness", "power_drag", "quadratic_drag", "periodic_disturbance" } },
  { name = "amplifier", effects = { "dead_zone", "thrust_power_law", "thrust_saturation", "thrust_gain" } },
  { name = "dynamics", effects = { "backlash", "payload_mass", "input_delay", "actuator_lag", "resonant_mode" } },
  { name = "encoder", effects = { "encoder_quantization", "encoder_periodic_error" } },
}
local others = { name = "others", effects = {} }
local grouped = { own_force = true } -- whatever you write
for _, group in ipairs(groups) do
  for _, name in ipairs(group.effects) do grouped[name] = true end
end
for _, kind in ipairs(tb.effects {}) do
  if not grouped[kind.name] then table.insert(others.effects, kind.name) end
end
if #others.effects > 0 then table.insert(groups, others) end

local reference, excitation = {}, {}
local machine = tb.machine(option.machine)
for k = 1, math.floor(option.duration / machine.Ts + 0.5) + 1 do
  local t = (k - 1) * machine.Ts
  reference[k] = option.amplitude * (1 - math.cos(2 * math.pi * option.frequency * t))
  excitation[k] = 0
end

local function run(effects)
  local changed = tb.machine(option.machine)
  changed.effects = effects
  return tb.simulate { machine = changed, r = reference, exc = excitation }
end

-- What the friction effects scale must be there.
local function base_of(name)
  if name == "position_dependent_friction" or name == "time_varying_friction" then
    return { { name = "coulomb_friction", parameters = { dF = 5 } } }
  end
  return {}
end

local function distance_since_reversal(trace)
  local list, from, last = {}, trace.x[1], 0
  for k, v in ipairs(trace.v) do
    if v * last < 0 then from = trace.x[k] end
    if v ~= 0 then last = v end
    list[k] = math.abs(trace.x[k] - from)
  end
  return list
end

-- Values along the axis a kind is drawn against, with its label.
local function along(axis, trace)
  if axis == "position" then return trace.x, "Position [m]" end
  if axis == "velocity" then return trace.v, "Velocity [m/s]" end
  if axis == "thrust" then return trace.u, "Thrust reference [N]" end
  if axis == "distance since reversal" then return distance_since_reversal(trace), "Distance since reversal [m]" end
  return trace.t, "Time [s]"
end

local names, rms_y, peak_y, rms_u, group_of = {}, {}, {}, {}, {}
for number, group in ipairs(groups) do
  local panels = {}
  for _, name in ipairs(group.effects) do
    local base = base_of(name)
    local before = run(base)
    base[#base + 1] = { name = name, parameters = described[name].example }
    local after = run(base)
    local x, label = along(described[name].drawn_against, after)
    local begin = label == "Time [s]" and 1 or #after.y // 3
    local sum_y, sum_u, peak, shown = 0, 0, 0, { x = {}, y = {} }
    for k = 1, #after.y do
      local dy, du = after.y[k] - before.y[k], after.u[k] - before.u[k]
      sum_y, sum_u, peak = sum_y + dy ^ 2, sum_u + du ^ 2, math.max(peak, math.abs(dy))
      if k >= begin then
        shown.x[#shown.x + 1], shown.y[#shown.y + 1] = x[k], group.thrust and du or 1e6 * dy
      end
    end
    names[#names + 1], group_of[#group_of + 1] = name, number
    rms_y[#rms_y + 1], rms_u[#rms_u + 1] = math.sqrt(sum_y / #after.y), math.sqrt(sum_u / #after.y)
    peak_y[#peak_y + 1] = peak
    local title = name .. ": " .. described[name].equation
    -- What hardly changes is shown beside zero.
    local low, high = math.huge, -math.huge
    for _, value in ipairs(shown.y) do low, high = math.min(low, value), math.max(high, value) end
    local size = math.max(math.abs(low), math.abs(high))
    panels[#panels + 1] = { title = #title < 120 and title or name, x_label = label,
      y_label = group.thrust and "Thrust with - without [N]" or "Position with - without [um]", legend = "none",
      y_range = high - low < 0.1 * size and { -1.2 * size, 1.2 * size } or nil,
      series = { { name = name, x = shown.x, y = shown.y, style = "points" } } }
    print(string.format("%-28s rms %9.3f um, largest %9.3f um, thrust rms %7.3f N", name, 1e6 * rms_y[#rms_y],
      1e6 * peak, rms_u[#rms_u]))
  end
  tb.plot { file = group.name, title = "Effects: " .. group.name, panels = panels }
end
tb.write_json { file = "effects.json", value = { names = names, rms_m = rms_y, largest_m = peak_y, rms_N = rms_u } }
tb.write_csv { file = "effects.csv", columns = {
  { name = "group", values = group_of }, { name = "rms", unit = "m", values = rms_y },
  { name = "largest", unit = "m", values = peak_y }, { name = "thrust_rms", unit = "N", values = rms_u } } }
