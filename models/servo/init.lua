-- A servo machine as systems of equations: its parts, made of its description, and their wiring by the names of
-- signals.
--
--   local servo = require "servo"
--   local parts = servo.parts(tb.machine "models/linear_motor_table.lua")
--   parts.friction = my_friction
--   local run = tb.run_system { system = servo.wire(parts), duration_s = 1, inputs = { exc = … } }
--
-- signal        given by
-- y, v          plant       position [m] and velocity [m/s] of the driven point
-- push          plant       all that pushes the axis while it rests, friction apart [N]
-- thrust        amplifier   the motor's force [N]
-- force         forces      other forces on the driven point [N]
-- friction      friction    [N]
-- held          friction    1 while dry friction holds the axis, else 0
-- measured      encoder     [m]
-- u             controller  thrust reference [N]; without a controller an input of the whole
-- fed_back      friction_feedback  the share of the modeled friction that the drive adds [N]; without it an input
-- r, exc        -           inputs of the whole: reference [m], excitation [N]
local tb = require "tribode"
local amplifier = require "servo.amplifier"
local backlash = require "servo.backlash"
local controller = require "servo.controller"
local encoder = require "servo.encoder"
local forces = require "servo.forces"
local friction = require "servo.friction"
local friction_feedback = require "servo.friction_feedback"
local plant = require "servo.plant"

local servo = {}

-- What each kind of effect does to the settings `m` of the parts, with its parameters `p`: the Lua text of its
-- description (engine/tribode/effect/kinds), compiled. It changes fields of m, or calls m.add_force or
-- m.scale_friction.
local kinds = {}
for _, kind in ipairs(tb.effects {}) do
  local change, message = load("local m, p, tb = ...\n" .. kind.lua, "=" .. kind.name)
  kinds[kind.name] = { change = assert(change, message), parameters = kind.parameters, has_text = kind.lua ~= "",
    is_friction_law = kind.is_friction_law }
end

-- Parameters with the default numbers of those that are left out.
local function with_defaults(fields, values)
  local all = {}
  for name, value in pairs(values or {}) do all[name] = value end
  for _, field in ipairs(fields) do
    local name = field.name
    if field.type == "number" and all[name] == nil then
      all[name] = field.default
    elseif field.type == "records" then
      local list = {}
      for i, record in ipairs(all[name]) do list[i] = with_defaults(field.fields, record) end
      all[name] = list
    end
  end
  return all
end

local function add_effect(m, effect)
  local kind = kinds[effect.name]
  if not kind.has_text then error("servo.parts: the effect " .. effect.name .. " has no equations in Lua", 0) end
  kind.change(m, with_defaults(kind.parameters, effect.parameters), tb)
end

local function copied(list) return { table.unpack(list or {}) } end

-- The settings of all parts, from a description as tb.machine gives it.
local function settings_of(machine, options)
  local continuous = machine.input == "band_limited"
  if machine.initial == "fitted" then
    error("servo.parts: initial = \"fitted\" needs a record, which parts do not have; take the field out and give " ..
      "tb.run_system start = { [\"plant.position\"] =, [\"plant.velocity\"] = }", 0)
  end
  local period, given = machine.Ts or 5e-4, machine.friction or {}
  local stribeck = given.stribeck or {}
  local m = {
    plant = { rigid_gain = machine.rigid_gain_per_kg or 0, modes = copied(machine.modes) },
    friction = {
      elements = copied(given.elements), viscous = given.viscous or 0, coulomb = given.coulomb or 0,
      static = stribeck.static or given.coulomb or 0, velocity = stribeck.velocity or 1,
      exponent = stribeck.exponent or 1,
      forward = { level = 0, viscous = 0 }, backward = { level = 0, viscous = 0 },
    },
    amplifier = {
      period = period, delay = machine.input_delay_s or 0, lag_hz = machine.current_loop_hz or 0, half_width = 0,
      gain = 1, continuous = continuous,
    },
    encoder = {
      period = period, delay = machine.output_delay_s or 0, resolution = machine.encoder_resolution_m or 0,
      errors = {}, noise_rms = machine.noise_rms_m or 0, seed = options.seed,
    },
    forces = {}, scales = {}, period = period,
  }
  -- A force on the driven point: force(s, own), and states with their rates(s, own); see servo.forces.
  function m.add_force(force) table.insert(m.forces, force) end
  -- A factor on all friction, a function of t and y.
  function m.scale_friction(factor) table.insert(m.scales, factor) end
  for _, effect in ipairs(machine.effects or {}) do add_effect(m, effect) end
  if continuous and m.amplifier.delay > 0 then
    error("servo.parts: input = \"band_limited\" goes through the amplifier undelayed; take the delay out and give " ..
      "it to the input of tb.run_system as offset_s", 0)
  end
  if (machine.process_noise_rms_N or 0) > 0 then
    m.noise = { rms = machine.process_noise_rms_N, seed = options.seed, period = period }
  end
  if #m.scales > 0 then
    m.friction.factor = function(t, y)
      local product = 1
      for _, scale in ipairs(m.scales) do product = product * math.max(0, scale(t, y)) end
      return product
    end
  end
  return m
end

-- The parts of a machine: plant, friction, amplifier, encoder; forces and controller where it has them.
-- options: seed of the noise (default 0), friction_feedback (the share that the drive adds of the modeled friction,
-- default 0: then there is no such part). Errors: a fitted start, a band-limited input with a delay, an unknown option.
function servo.parts(machine, options)
  options = options or {}
  for name in pairs(options) do
    if name ~= "seed" and name ~= "friction_feedback" then
      error("servo.parts: " .. tostring(name) .. " is not an option, which are seed and friction_feedback", 0)
    end
  end
  local m = settings_of(tb.with_fields(machine, {}), { seed = options.seed or 0 })
  local parts = {
    plant = plant(m.plant), friction = friction(m.friction), amplifier = amplifier(m.amplifier),
    encoder = encoder(m.encoder),
  }
  if m.backlash then
    local settings = { rigid_gain = m.plant.rigid_gain, vibrations = m.plant.modes }
    for key, value in pairs(m.backlash) do settings[key] = value end
    parts.plant = backlash(settings)
  end
  if #m.forces > 0 or m.noise then parts.forces = forces.system(m.forces, m.noise) end
  if machine.controller then parts.controller = controller[machine.controller.type](machine.controller, m.period) end
  local share = options.friction_feedback or 0
  if type(share) ~= "number" or not (share >= 0 and share < math.huge) then
    error(string.format("servo.parts: friction_feedback = %s, must be a number, finite and not negative", share), 0)
  end
  if share > 0 then
    if not machine.controller then error("servo.parts: friction_feedback needs a controller, which adds it", 0) end
    for _, effect in ipairs(machine.effects or {}) do
      if kinds[effect.name].is_friction_law then
        error("servo.parts: friction_feedback of a machine with " .. effect.name .. " has no equations in Lua", 0)
      end
    end
    local modeled = machine.friction or {}
    parts.friction_feedback = friction_feedback {
      share = share, period = m.period, viscous = modeled.viscous or 0, elements = modeled.elements or {},
      coulomb = modeled.coulomb or 0, stribeck = modeled.stribeck, resolution = m.encoder.resolution,
    }
  end
  return parts
end

-- Parts as one system: each input is the output of the same name of another part, whichever part that is; what none of
-- them gives is an input of the whole. Errors: two parts that give the same signal, an algebraic loop.
function servo.wire(parts)
  local names, variables, giver = {}, {}, {}
  for name in pairs(parts) do names[#names + 1] = name end
  table.sort(names)
  for _, name in ipairs(names) do
    variables[name] = tb.system_variables { system = parts[name] }
    for _, output in ipairs(variables[name].outputs) do
      if not output.name:find("%.") then
        if giver[output.name] then
          error(string.format("servo.wire: %s and %s both give %s", giver[output.name], name, output.name), 0)
        end
        giver[output.name] = name
      end
    end
  end
  local inputs, wires = {}, {}
  for _, name in ipairs(names) do
    for _, input in ipairs(variables[name].inputs) do
      if not input.name:find("%.") then
        local from = giver[input.name]
        if not from then inputs[input.name] = { value = input.value, unit = input.unit } end
        wires[name .. "." .. input.name] = function(s) return from and s[from][input.name] or s[input.name] end
      end
    end
  end
  return tb.system {
    name = "servo axis",
    parts = parts,
    inputs = inputs,
    connect = function(s)
      local connected = {}
      for input, wire in pairs(wires) do connected[input] = wire(s) end
      return connected
    end,
  }
end

return servo
