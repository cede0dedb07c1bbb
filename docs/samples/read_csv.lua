-- A CSV file with names and units of its own, read, and a machine run under it.
local tb = require "tribode"

-- A file as a logger might leave it. With a file of your own: -D record=FILE.
local t, demand, position = {}, {}, {}
for k = 0, 999 do
  t[k + 1], demand[k + 1] = 0.5 * k, 2 * math.sin(2 * math.pi * 2 * 0.5e-3 * k)
  position[k + 1] = demand[k + 1]
end
tb.write_csv {
  file = "logged.csv",
  columns = {
    { name = "time_ms", values = t },
    { name = "demand_mm", values = demand },
    { name = "actual_mm", values = position },
  },
}

local option = tb.options { record = "logged.csv" }
local columns = { t = "time_ms", r = "demand_mm", y = "actual_mm" }
local scale = { t = 1e-3, r = 1e-3, y = 1e-3 }
local record = tb.read_record { file = option.record, columns = columns, scale = scale }
print(string.format("%d samples, %g s apart, %d missing",
  #record.data.t, record.time.sample_time_s, record.time.dropped))

local run = tb.simulate {
  machine = tb.machine "models/bare_mass.lua",
  input = option.record, columns = { t = "time_ms", r = "demand_mm" }, scale = { t = 1e-3, r = 1e-3 },
}
print(string.format("at the end: measured %.3f mm, simulated %.3f mm",
  record.data.y[#run.t] * 1e3, run.y[#run.t] * 1e3))
