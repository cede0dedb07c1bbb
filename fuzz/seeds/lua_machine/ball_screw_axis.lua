-- A ball-screw axis with Coulomb friction and a cascade controller: the electro-mechanical positioning system of the
-- benchmark [Janot 2019], published parameters, at a sample time of 1 ms. The friction is set-valued: the axis
-- truly sticks. Its constant offset force of 3.16 N is left out.

local newton_per_volt = 35.15065188248547
local volt_seconds_per_metre, limit_volt = 243.45, 10

return {
  Ts = 1e-3,
  rigid_gain_per_kg = 1 / 95.1089,
  friction = { coulomb = 20.3935, viscous = 203.5034 },
  encoder_resolution_m = 5e-8,
  controller = {
    type = "cascade",
    kp = 160.18,
    kv = volt_seconds_per_metre * newton_per_volt,
    limit = limit_volt * newton_per_volt,
    delay_samples = 1,
  },
  closed_loop = true,
}
