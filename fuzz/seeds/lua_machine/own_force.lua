return { rigid_gain_per_kg = 0.1, effects = { { name = "own_force", parameters = {
  force = "return -strength * math.sin(2 * math.pi * y / pitch) * (1 + flux)", states = { "flux" },
  rates = "return (math.abs(y) / pitch - flux) / 0.02", constants = { strength = 2, pitch = 0.01 } } } } }
