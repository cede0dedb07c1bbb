-- A record as a logger might leave it, in milliseconds and volts, and a run under it.
local tb = require "tribode"

local t, u = {}, {}
for k = 0, 399 do
  t[#t + 1] = 0.5 * k
  u[#u + 1] = 0.2 * math.sin(2 * math.pi * 5 * 0.5e-3 * k)
end
tb.write_mat { file = "logged.mat", columns = { { name = "time_ms", values = t }, { name = "u_V", values = u } } }

local option = tb.options { record = "logged.mat" }
local names, factors = { t = "time_ms", u = "u_V" }, { t = 1e-3, u = 35.15 }
local record = tb.read_record { file = option.record, columns = names, scale = factors }
print(string.format("%d samples, %g s apart, %d missing",
  #record.data.t, record.time.sample_time_s, record.time.dropped))

local machine = tb.machine "models/bare_mass.lua"
machine.closed_loop = false
local run = tb.simulate { machine = machine, input = option.record, columns = names, scale = factors }
print(string.format("at the end %g mm", run.x[#run.x] * 1e3))
