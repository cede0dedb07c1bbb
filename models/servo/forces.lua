-- The forces on the driven point of an axis besides those of motor and friction. in: y [m], v [m/s] and, where a force
-- sees it, thrust [N]; out: force [N].
--
-- Inside, all are plain numbers, as in the text of a user.
local tb = require "tribode"

local make = {}

-- forces: a list of { force =, states =, rates =, nominal =, discrete =, when =, sees_thrust = }. force(s, own) returns
-- a force in N, a function of s.y, s.v, s.t, where it sees it s.thrust, and the values of its own, own.NAME. states:
-- their values at the start by name; rates(s, own): their rates by name; nominal: their size. discrete: values at the
-- start of what only events change; when: a list of { name =, condition = function(s, own), set = function(s, own) },
-- which gives new values by name. noise: nil, or { rms = [N], seed =, period = [s] } of a force that is drawn anew at
-- each sample.
function make.system(forces, noise)
  local states, discrete, when = {}, noise and { noise = 0 } or {}, {}
  local inputs = { y = 0, v = 0 }
  local function own(s, i)
    local values = {}
    for name in pairs(forces[i].states or {}) do values[name] = s[name .. "_" .. i] end
    for name in pairs(forces[i].discrete or {}) do values[name] = s[name .. "_" .. i] end
    return values
  end
  for i, force in ipairs(forces) do
    for name, start in pairs(force.states or {}) do
      states[name .. "_" .. i] = { start = start, nominal = force.nominal }
    end
    for name, start in pairs(force.discrete or {}) do discrete[name .. "_" .. i] = start end
    if force.sees_thrust then inputs.thrust = 0 end
    for _, event in ipairs(force.when or {}) do
      table.insert(when, {
        name = string.format("%s (force %d)", event.name, i),
        condition = function(s) return event.condition(s, own(s, i)) end,
        set = function(s)
          local set = {}
          for name, value in pairs(event.set(s, own(s, i))) do set[name .. "_" .. i] = value end
          return set
        end,
      })
    end
  end
  local function draw(_, k) return { noise = noise.rms * tb.standard_normal(noise.seed, 2, k) } end
  return tb.system {
    name = "forces",
    parameters = { newton = { value = 1, unit = "N" } },
    inputs = inputs,
    discrete = next(discrete) and discrete or nil,
    when = #when > 0 and when or nil,
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
