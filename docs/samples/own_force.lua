local tb = require "tribode"

-- A detent whose strength follows the position with a lag of 20 ms: a force with a state of its own.
local machine = tb.machine "models/bare_mass.lua"
machine.effects = {
  {
    name = "own_force",
    parameters = {
      force = "return -strength * math.sin(2 * math.pi * y / pitch) * (1 + flux)",
      states = { "flux" },
      rates = "return (math.abs(y) / pitch - flux) / 0.02",
      constants = { strength = 2, pitch = 0.01 },
    },
  },
}

local reference = {}
for k = 1, 401 do reference[k] = 0.005 * math.sin(2 * math.pi * 5 * (k - 1) * machine.Ts) end
local run = tb.simulate { machine = machine, r = reference }
tb.write_csv {
  file = "own_force.csv",
  columns = { { name = "t", unit = "s", values = run.t }, { name = "y", unit = "m", values = run.y } },
}
print(string.format("%d samples, at the end %.6f m", #run.y, run.y[#run.y]))
