-- A rigid body in two halves with play between them, in place of the plant. The motor's force acts on the motor's body,
-- friction and all other forces on the driven point, the body whose position is measured. Vibration modes are of that
-- body, as those of the plant.
--
--   d = y_motor - y_load;   beyond half a gap g/2 on either side the contact presses, and never pulls, with
--   F = c d' + k (d -+ g/2) on the load, -F on the motor,   k = m w^2,   c = 2 zeta w m,   m the reduced mass
--
-- Five modes of operation: open, pressing and parting on either side. Parting is still within reach of the contact, but
-- faster than it relaxes. In and out as of the plant.
local tb = require "tribode"

local function sum_of(list, term)
  local sum = 0
  for j, entry in ipairs(list) do sum = sum + term(j, entry) end
  return sum
end

-- rigid_gain = 1/mass [m/(N s^2)], gap_m, load_fraction, contact_hz, contact_zeta, sensor = "motor" or "load";
-- vibrations = { { gain = k_j, freq_hz =, zeta = }, … }
return function(settings)
  local at_load, vibrations = settings.sensor == "load", settings.vibrations
  local load = settings.rigid_gain / settings.load_fraction
  local motor = settings.rigid_gain / (1 - settings.load_fraction)
  local own, other = at_load and load or motor, at_load and motor or load
  local reduced, w = 1 / (load + motor), 2 * math.pi * settings.contact_hz
  local stiffness, damping = reduced * w * w, 2 * settings.contact_zeta * w * reduced
  local parameters = {
    own = { value = own, unit = "1/kg" }, beside = { value = other, unit = "1/kg" },
    stiffness = { value = stiffness, unit = "N/m" }, damping = { value = damping, unit = "N s/m" },
    half = { value = settings.gap_m / 2, unit = "m" },
  }
  local states = {
    position = { unit = "m" }, velocity = { unit = "m/s", nominal = 100 },
    other = { unit = "m" }, other_velocity = { unit = "m/s", nominal = 100 },
  }
  for j, mode in ipairs(vibrations) do
    local omega = 2 * math.pi * mode.freq_hz
    parameters["k" .. j] = { value = mode.gain, unit = "1/kg" }
    parameters["damping" .. j] = { value = 2 * mode.zeta * omega, unit = "1/s" }
    parameters["stiffness" .. j] = { value = omega * omega, unit = "1/s2" }
    states["q" .. j] = { unit = "m" }
    states["w" .. j] = { unit = "m/s", nominal = 100 }
  end
  local function gain(s) return s.own + sum_of(vibrations, function(j) return s["k" .. j] end) end
  local function pull(s) -- r_j
    return function(j) return s["damping" .. j] * s["w" .. j] + s["stiffness" .. j] * s["q" .. j] end
  end
  local function restoring(s) return sum_of(vibrations, pull(s)) / gain(s) end

  local function ahead(own_value, other_value) -- of the motor's over the load's
    return at_load and other_value - own_value or own_value - other_value
  end
  local function distance(s) return ahead(s.position, s.other) end
  local function contact(side)
    return function(s)
      return s.stiffness * (distance(s) - side * s.half) + s.damping * ahead(s.velocity, s.other_velocity)
    end
  end
  -- What acts on the driven point, friction apart, and on the other body, under the contact's force.
  local function pushes(s, pressed)
    if at_load then return s.force + pressed, s.thrust - pressed end
    return s.thrust + s.force - pressed, pressed
  end
  local function mode(pressed, when)
    return {
      der = function(s)
        local push, beside = pushes(s, pressed(s))
        local held = tb.greater(s.held, 0)
        local effective = tb.where(held, restoring(s), push - s.friction)
        local pulls = sum_of(vibrations, pull(s))
        local rates = {
          position = s.velocity,
          velocity = tb.where(held, 0, gain(s) * effective - pulls),
          other = s.other_velocity,
          other_velocity = s.beside * beside,
        }
        for j in ipairs(vibrations) do
          rates["q" .. j] = s["w" .. j]
          rates["w" .. j] = s["k" .. j] * effective - pull(s)(j)
        end
        return rates
      end,
      outputs = function(s) return { push = { pushes(s, pressed(s)) - restoring(s), unit = "N" } } end,
      when = when,
    }
  end
  local function none() return 0 end

  local modes = {
    open = mode(none, {
      { name = "touches ahead", crossing = function(s) return s.half - distance(s) end, mode = "pressing_ahead" },
      { name = "touches behind", crossing = function(s) return s.half + distance(s) end, mode = "pressing_behind" },
    }),
  }
  for name, side in pairs { ahead = 1, behind = -1 } do
    modes["pressing_" .. name] = mode(contact(side), {
      { name = "parts", crossing = function(s) return side * contact(side)(s) end, mode = "parting_" .. name },
    })
    modes["parting_" .. name] = mode(none, {
      { -- a little beyond, so that rounding does not take it back at once
        name = "leaves",
        crossing = function(s) return side * distance(s) - s.half * (1 - 1e-9) end,
        mode = "open",
      },
      {
        name = "presses",
        crossing = function(s) return s.half * s.stiffness * 1e-9 - side * contact(side)(s) end,
        mode = "pressing_" .. name,
      },
    })
  end
  return tb.system {
    name = "plant with backlash",
    parameters = parameters,
    inputs = { thrust = { unit = "N" }, force = { unit = "N" }, friction = { unit = "N" }, held = 0 },
    states = states,
    modes = modes,
    start_mode = "open",
    outputs = function(s) return { y = { s.position, unit = "m" }, v = { s.velocity, unit = "m/s" } } end,
    when = {
      { -- an impulse at the driven point takes the rest of its velocity
        name = "stops",
        condition = function(s) return tb.greater(s.held, 0) end,
        set = function(s)
          local set = { velocity = 0 }
          for j in ipairs(vibrations) do set["w" .. j] = s["w" .. j] - s["k" .. j] * (s.velocity / gain(s)) end
          return set
        end,
      },
    },
  }
end
