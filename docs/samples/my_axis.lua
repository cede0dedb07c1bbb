-- The axis of the tutorial: a linear-motor stage on ball guides, from its data sheets. SI units.

local mass = 12 -- moving mass [kg]
local crossover = 2 * math.pi * 12 -- of the position loop [rad/s]

-- The guides: a friction force of 8 N, built up over 0.3 mm. Five elements slip one after another.
local elements = {}
for i, slip_um in ipairs { 1, 5, 20, 80, 300 } do
  local level = ({ 1.0, 1.2, 1.6, 2.0, 2.2 })[i] -- [N], 8 N in all
  elements[i] = { F = level, K = level / (slip_um * 1e-6) }
end

return {
  Ts = 500e-6, -- cycle of the drive
  rigid_gain_per_kg = 1 / mass,
  modes = { { gain = 0.02, freq_hz = 65, zeta = 0.02 } }, -- the base frame
  friction = { viscous = 25, elements = elements },
  input_delay_s = 500e-6, -- the controller's result acts one cycle later
  current_loop_hz = 800,
  encoder_resolution_m = 50e-9,
  noise_rms_m = 20e-9,
  controller = {
    type = "pid", kp = mass * crossover ^ 2, ki = mass * crossover ^ 3 / 5, kd = 1.4 * mass * crossover,
  },
  closed_loop = true,
}
