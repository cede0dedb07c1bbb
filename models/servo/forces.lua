-- The forces on the driven point of an axis besides those of motor and friction, as the effects of a machine name them.
--
--   constant_force: F;  spring_force: -k (y - y0);  cubic_stiffness: -k3 (y - y0)^3;  quadratic_drag: -c v abs(v)
--   force_ripple: sum of F sin(2 pi y/period_m + phase);  periodic_disturbance: F sin(2 pi freq_hz t + phase)
--   own_force: what its text returns
--
-- A sine of the time is carried by two states, so that the axis stays affine. Inside, all are plain numbers, as in the
-- text of a user. in: y [m], v [m/s]; out: force [N].
local tb = require "tribode"

-- The text of an own_force as a function of named values.
local function compiled(text, values)
  local names, list = {}, {}
  for name in pairs(values) do names[#names + 1] = name end
  table.sort(names)
  for i, name in ipairs(names) do list[i] = values[name] end
  local body, message = load("local " .. table.concat(names, ", ") .. " = ...; " .. text, "=own_force")
  if not body then error(message, 0) end
  return body(table.unpack(list))
end

-- Of each kind, with parameters p: force(s, own), and states with their rates; own names a state of this force.
local kinds = {
  constant_force = function(p) return { force = function() return p.F end } end,
  spring_force = function(p) return { force = function(s) return -p.k * (s.y - (p.y0 or 0)) end } end,
  cubic_stiffness = function(p) return { force = function(s) return -p.k3 * (s.y - (p.y0 or 0)) ^ 3 end } end,
  quadratic_drag = function(p)
    return { force = function(s) return -p.c * s.v * tb.no_event(math.abs(s.v)) end }
  end,
  force_ripple = function(p)
    return {
      force = function(s)
        local sum = 0
        for _, h in ipairs(p.harmonics) do
          sum = sum + h.F * math.sin(2 * math.pi / h.period_m * s.y + (h.phase or 0))
        end
        return sum
      end,
    }
  end,
  periodic_disturbance = function(p)
    local w, phase = 2 * math.pi * p.freq_hz, p.phase or 0
    return {
      states = { sine = p.F * math.sin(phase), cosine = p.F * math.cos(phase) },
      rates = function(_, own) return { sine = w * own.cosine, cosine = -w * own.sine } end,
      force = function(_, own) return own.sine end,
      nominal = 1e6,
    }
  end,
  own_force = function(p)
    local function values(s, own)
      local all = { y = s.y, v = s.v, t = s.t }
      for name, value in pairs(p.constants or {}) do all[name] = value end
      for name, value in pairs(own) do all[name] = value end
      return all
    end
    local states, names = {}, p.states or {}
    for _, name in ipairs(names) do states[name] = 0 end
    return {
      states = states,
      rates = function(s, own)
        local returned = #names > 0 and table.pack(compiled(p.rates, values(s, own))) or {}
        local rates = {}
        for i, name in ipairs(names) do rates[name] = returned[i] end
        return rates
      end,
      force = function(s, own) return compiled(p.force, values(s, own)) end,
    }
  end,
}

local make = {}

-- Whether an effect is such a force.
function make.has(name) return kinds[name] ~= nil end

-- effects: a list of { name =, parameters = }. noise: nil, or { rms = [N], seed =, period = [s] } of a force that
-- is drawn anew at each sample.
function make.system(effects, noise)
  local forces, states = {}, {}
  for i, effect in ipairs(effects) do
    local force = kinds[effect.name](effect.parameters)
    forces[i] = force
    for name, start in pairs(force.states or {}) do
      states[name .. "_" .. i] = { start = start, nominal = force.nominal }
    end
  end
  local function own(s, i)
    local values = {}
    for name in pairs(forces[i].states or {}) do values[name] = s[name .. "_" .. i] end
    return values
  end
  local function draw(_, k) return { noise = noise.rms * tb.standard_normal(noise.seed, 2, k) } end
  return tb.system {
    name = "forces",
    parameters = { newton = { value = 1, unit = "N" } },
    inputs = { y = 0, v = 0 },
    discrete = noise and { noise = 0 } or nil,
    sample = noise and { { name = "noise", period_s = noise.period, call = draw } } or nil,
    states = states,
    der = function(s)
      local rates = {}
      for i, force in ipairs(forces) do
        if force.rates then
          for name, rate in pairs(force.rates(s, own(s, i))) do rates[name .. "_" .. i] = rate end
        end
      end
      return rates
    end,
    outputs = function(s)
      local sum = noise and s.noise or 0
      for i, force in ipairs(forces) do sum = sum + force.force(s, own(s, i)) end
      return { force = { s.newton * sum, unit = "N" } }
    end,
  }
end

return make
