local make = function(...)
local tb = require "tribode"

return tb.system {
  name = "inverted pendulum",
  parameters = {
    M = { value = 1, unit = "kg" },
    m = { value = 0.1, unit = "kg" },
    l = { value = 0.5, unit = "m" },
    g = { value = 9.81, unit = "m/s2" },
    k1 = { value = -2, unit = "N/m" },
    k2 = { value = -4, unit = "N s/m" },
    k3 = { value = -40, unit = "N" },
    k4 = { value = -9, unit = "N s" },
  },
  states = {
    x = { unit = "m" }, v = { unit = "m/s" }, phi = { start = 0.2, unit = "rad" }, w = { unit = "rad/s" },
  },
  discrete = { u = { unit = "N" } },
  der = function(s)
    local sin, cos = math.sin(s.phi), math.cos(s.phi)
    local dv = (s.u + s.m * s.l * s.w ^ 2 * sin - s.m * s.g * sin * cos) / (s.M + s.m * sin ^ 2)
    return { x = s.v, v = dv, phi = s.w, w = (s.g * sin - cos * dv) / s.l }
  end,
  sample = {
    {
      name = "state feedback",
      period_s = 0.02,
      set = function(s) return { u = -(s.k1 * s.x + s.k2 * s.v + s.k3 * s.phi + s.k4 * s.w) } end,
    },
  },
}
end
local tb = require "tribode"
local s = make()
tb.run_system { system = s, duration_s = 0.5, output_step_s = 0.1 }
tb.linearize { system = s }
