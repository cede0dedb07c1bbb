-- A free mass of 10 kg under PID control at 10 Hz: no modes, no friction, no delay, an exact encoder. The smallest
-- machine there is, and one whose response is known in closed form.

local mass, w = 10, 2 * math.pi * 10

return {
  Ts = 500e-6,
  rigid_gain_per_kg = 1 / mass,
  controller = { type = "pid", kp = mass * w ^ 2, ki = mass * w ^ 3 / 5, kd = 1.4 * mass * w },
  closed_loop = true,
}
