local make = function(...)
local tb = require "tribode"

local function outflow(s)
  local smooth = math.sqrt(2 * s.g * s.thin) * s.h / s.thin
  return s.hole * tb.where(tb.less(s.h, s.thin), smooth, math.sqrt(2 * s.g * math.max(s.h, s.thin)))
end

return tb.system {
  name = "tank",
  parameters = {
    area = { value = 0.5, unit = "m2" },
    hole = { value = 1e-3, unit = "m2" },
    g = { value = 9.81, unit = "m/s2" },
    h_low = { value = 0.5, unit = "m" },
    h_full = { value = 1.5, unit = "m" },
    thin = { value = 1e-4, unit = "m" },
  },
  inputs = { pump = { value = 8e-3, unit = "m3/s" } },
  states = { h = { start = 0, unit = "m" } },
  modes = {
    filling = {
      der = function(s) return { h = (s.pump - outflow(s)) / s.area } end,
      when = {
        { name = "full", crossing = function(s) return s.h - s.h_full end, direction = "rising", mode = "draining" },
      },
    },
    draining = {
      der = function(s) return { h = -outflow(s) / s.area } end,
      when = { { name = "low", crossing = function(s) return s.h - s.h_low end, mode = "filling" } },
    },
  },
  start_mode = "filling",
  outputs = function(s) return { out = { outflow(s), unit = "m3/s" } } end,
}
end
local tb = require "tribode"
local s = make()
tb.run_system { system = s, duration_s = 0.5, output_step_s = 0.1 }
tb.linearize { system = s }
