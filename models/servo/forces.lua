-- The forces on the driven point of an axis besides those of motor and friction. in: y [m], v [m/s]; out: force [N].
--
-- Inside, all are plain numbers, as in the text of a user.
local tb = require "tribode"

local make = {}

-- forces: a list of { force =, states =, rates =, nominal = }. force(s, own) returns a force in N, a function of s.y,
-- s.v, s.t and the states of its own, own.NAME. states: their values at the start by name; rates(s, own): their rates
-- by name; nominal: their size. noise: nil, or { rms = [N], seed =, period = [s] } of a force that is drawn anew at
-- each sample.
function make.system(forces, noise)
  local states = {}
  for i, force in ipairs(forces) do
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
