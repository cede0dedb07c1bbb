-- An axis on two guides, driven by a ball screw out of its middle: the carriage yaws. One guide, twice a part, each
-- with viscous friction and a bristle that yields (a Dahl element); the screw is a spring.
--
--   m der(v) = F_screw - F_1 - F_2,   J der(w) = a F_screw - b (F_1 - F_2) - k_yaw phi - d_yaw w
local tb = require "tribode"

local guide = tb.system {
  name = "guide",
  parameters = {
    sigma = { value = 1e6, unit = "N/m" },
    level = { value = 15, unit = "N" },
    viscous = { value = 50, unit = "N s/m" },
  },
  inputs = { v = { unit = "m/s" } },
  states = { z = { unit = "m", nominal = 1e-5 } },
  der = function(s) return { z = s.v - s.sigma / s.level * math.abs(s.v) * s.z } end,
  outputs = function(s) return { F = { s.sigma * s.z + s.viscous * s.v, unit = "N" } } end,
}

return tb.system {
  name = "ball-screw axis with two guides",
  parameters = {
    m = { value = 20, unit = "kg" },
    J = { value = 0.4, unit = "kg m2" },
    a = { value = 0.03, unit = "m" },
    b = { value = 0.15, unit = "m" },
    k_screw = { value = 5e7, unit = "N/m" },
    d_screw = { value = 2000, unit = "N s/m" },
    k_yaw = { value = 2e5, unit = "N m/rad" },
    d_yaw = { value = 20, unit = "N m s/rad" },
  },
  inputs = { nut = { unit = "m" }, nut_speed = { unit = "m/s" } },
  states = {
    x = { unit = "m" }, v = { unit = "m/s" },
    phi = { unit = "rad", nominal = 1e-3 }, w = { unit = "rad/s" },
  },
  parts = { left = guide, right = guide },
  connect = function(s) return { ["left.v"] = s.v + s.b * s.w, ["right.v"] = s.v - s.b * s.w } end,
  der = function(s)
    local screw = s.k_screw * (s.nut - s.x - s.a * s.phi) + s.d_screw * (s.nut_speed - s.v - s.a * s.w)
    return {
      x = s.v,
      v = (screw - s.left.F - s.right.F) / s.m,
      phi = s.w,
      w = (s.a * screw - s.b * (s.left.F - s.right.F) - s.k_yaw * s.phi - s.d_yaw * s.w) / s.J,
    }
  end,
}
