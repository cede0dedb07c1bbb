-- A sweep while the axis moves at constant velocity: nothing reverses, so that friction hardly bends the response.
local tb = require "tribode"

local machine = tb.machine "models/linear_motor_table.lua"
local option = tb.options {
  velocity = { default = 0.03, unit = "m/s", help = "of the constant motion; 0: none" },
  amplitude = { default = 15, unit = "N", help = "of the excitation" },
}
local frequency_hz = tb.logspace(12, 120, tb.quick and 15 or 60)

-- The response of y to u at one frequency: both signals as a sine, a cosine, a constant and a ramp.
local function measure(f)
  local periods, settling = math.ceil(0.5 * f), 1.5
  local count = math.floor((settling + periods / f) / machine.Ts)
  local r, exc = {}, {}
  for k = 0, count - 1 do
    r[k + 1] = option.velocity * k * machine.Ts
    exc[k + 1] = option.amplitude * math.sin(2 * math.pi * f * k * machine.Ts)
  end
  local run = tb.simulate { machine = machine, r = r, exc = exc }

  local sine, cosine, one, ramp, u, y = {}, {}, {}, {}, {}, {}
  for k = math.floor(settling / machine.Ts) + 1, count do
    local phase = 2 * math.pi * f * run.t[k]
    sine[#sine + 1], cosine[#cosine + 1], one[#one + 1], ramp[#ramp + 1] = math.sin(phase), math.cos(phase), 1, run.t[k]
    u[#u + 1], y[#y + 1] = run.u[k], run.y[k]
  end
  local columns = { sine, cosine, one, ramp }
  local U = tb.least_squares { columns = columns, values = u }.coefficients
  local Y = tb.least_squares { columns = columns, values = y }.coefficients
  local size = U[1] ^ 2 + U[2] ^ 2
  return (Y[1] * U[1] + Y[2] * U[2]) / size, (Y[2] * U[1] - Y[1] * U[2]) / size
end

local response = { frequency_hz = frequency_hz, real = {}, imag = {} }
for i, f in ipairs(frequency_hz) do response.real[i], response.imag[i] = measure(f) end
response = tb.remove_delay { response = response, delay_s = 1.38e-3 }

local truth = tb.plant_parameters { machine = machine }
local fit = tb.fit_modal { response = response, f_min_hz = 12, f_max_hz = 120 }
for _, name in ipairs { "k0", "k1", "f1_hz", "zeta1" } do
  print(string.format("%-6s true %.5f  at %g m/s %.5f", name, truth[name], option.velocity, fit[name]))
end
tb.write_csv {
  file = "response.csv",
  columns = {
    { name = "frequency_hz", unit = "Hz", values = frequency_hz },
    { name = "real", unit = "m/N", values = response.real }, { name = "imag", unit = "m/N", values = response.imag },
  },
}
