local elements = {}
for i = 1, 5 do elements[i] = { K = 1e5 / i, F = 0.3 * i ^ 0.5, D = 0 } end
local mass, w = 1 / 0.094, 2 * math.pi * 7
return { Ts = 500e-6, rigid_gain_per_kg = 1 / mass, modes = { { gain = 0.013, freq_hz = 33.3, zeta = 0.02 } },
  friction = { coulomb = 0, viscous = 2.35, elements = elements }, input_delay_s = 5e-4, output_delay_s = 4e-4,
  controller = { type = "pid", kp = mass * w ^ 2, ki = mass * w ^ 3 / 5, kd = 1.4 * mass * w }, closed_loop = true }
