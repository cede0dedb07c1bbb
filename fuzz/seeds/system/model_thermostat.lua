local make = function(...)
local tb = require "tribode"

local function rate(power) return function(s) return { T = (power(s) - (s.T - s.T_out) / s.R) / s.C } end end

return tb.system {
  name = "thermostat",
  parameters = {
    C = { value = 1e5, unit = "J/K" },
    R = { value = 0.01, unit = "K/W" },
    P = { value = 2000, unit = "W" },
    cold = { value = 19, unit = "degC" },
    warm = { value = 21, unit = "degC" },
  },
  inputs = { T_out = { value = 10, unit = "degC" } },
  states = { T = { start = 18, unit = "degC" } },
  modes = {
    heating = {
      der = rate(function(s) return s.P end),
      when = {
        { name = "off", crossing = function(s) return s.T - s.warm end, direction = "rising", mode = "waiting" },
      },
    },
    waiting = {
      der = rate(function() return 0 end),
      when = { { name = "on", crossing = function(s) return s.T - s.cold end, mode = "heating" } },
    },
  },
  start_mode = "heating",
}
end
local tb = require "tribode"
local s = make()
tb.run_system { system = s, duration_s = 0.5, output_step_s = 0.1 }
tb.linearize { system = s }
