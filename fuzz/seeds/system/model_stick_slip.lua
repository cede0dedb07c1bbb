local make = function(...)
local tb = require "tribode"

local function slip(side) -- side 1: the belt is faster than the block and drags it along
  return function(s) return { x = s.v, v = (side * s.F_slip - s.k * s.x - s.d * s.v) / s.m } end
end
local function holding(s) return s.k * s.x + s.d * s.belt end
local caught = { name = "sticks", mode = "stick", set = function(s) return { v = s.belt } end }
local function catch(direction)
  return { name = caught.name, mode = caught.mode, set = caught.set, direction = direction,
    crossing = function(s) return s.v - s.belt end }
end

return tb.system {
  name = "stick-slip",
  parameters = {
    m = { value = 1, unit = "kg" },
    k = { value = 100, unit = "N/m" },
    d = { value = 0.5, unit = "N s/m" },
    F_static = { value = 10, unit = "N" },
    F_slip = { value = 6, unit = "N" },
    belt = { value = 0.1, unit = "m/s" },
  },
  states = { x = { unit = "m" }, v = { start = 0.1, unit = "m/s" } },
  modes = {
    stick = {
      der = function(s) return { x = s.belt, v = 0 } end,
      when = {
        { name = "slips", crossing = function(s) return s.F_static - holding(s) end, mode = "behind" },
        { name = "slips", crossing = function(s) return s.F_static + holding(s) end, mode = "before" },
      },
    },
    behind = { der = slip(1), when = { catch "rising" } },
    before = { der = slip(-1), when = { catch "falling" } },
  },
  start_mode = "stick",
}
end
local tb = require "tribode"
local s = make()
tb.run_system { system = s, duration_s = 0.5, output_step_s = 0.1 }
tb.linearize { system = s }
