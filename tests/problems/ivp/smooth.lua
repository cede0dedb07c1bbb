-- Problems that are not stiff.
return {
  {
    name = "ARENSTORF", source = "a periodic orbit about earth and moon [Hairer 1993, II.0], after one period",
    start = { 0.994, 0, 0, -2.00158510637908252240537862224 }, duration_s = 17.0652165601579625588917206249,
    accepted = { erk = 2e5, adams = 2e6, bdf = 2e7 },
    reference = { 0.994, 0, 0, -2.00158510637908252240537862224 },
    der = function(_, y)
      local mu = 0.012277471
      local rest = 1 - mu
      local earth = ((y[1] + mu) ^ 2 + y[2] ^ 2) ^ 1.5
      local moon = ((y[1] - rest) ^ 2 + y[2] ^ 2) ^ 1.5
      return {
        y[3], y[4],
        y[1] + 2 * y[4] - rest * (y[1] + mu) / earth - mu * (y[1] - rest) / moon,
        y[2] - 2 * y[3] - rest * y[2] / earth - mu * y[2] / moon,
      }
    end,
  },
  {
    name = "PLEIADES", source = "seven stars in a plane, of masses 1 to 7 [Mazzia 2008]; x, y, x', y'",
    start = { 3, 3, -1, -3, 2, -2, 2, 3, -3, 2, 0, 0, -4, 4, 0, 0, 0, 0, 0, 1.75, -1.5, 0, 0, 0, -1.25, 1, 0, 0 },
    duration_s = 3, accepted = { erk = 5e3, adams = 6e4, bdf = 3e5 },
    der = function(_, y)
      local rates = {}
      for i = 1, 14 do rates[i] = y[14 + i] end
      for i = 1, 7 do
        local ax, ay = 0, 0
        for j = 1, 7 do
          if j ~= i then
            local dx, dy = y[j] - y[i], y[7 + j] - y[7 + i]
            local r3 = (dx * dx + dy * dy) ^ 1.5
            ax, ay = ax + j * dx / r3, ay + j * dy / r3
          end
        end
        rates[14 + i], rates[21 + i] = ax, ay
      end
      return rates
    end,
    reference = { 0.3706139143970502, 0.3237284092057233e1, -0.3222559032418324e1, 0.6597091455775310,
      0.3425581707156584, 0.1562172101400631e1, -0.7003092922212495, -0.3943437585517392e1, -0.3271380973972550e1,
      0.5225081843456543e1, -0.2590612434977470e1, 0.1198213693392275e1, -0.2429682344935824, 0.1091449240428980e1,
      0.3417003806314313e1, 0.1354584501625501e1, -0.2590065597810775e1, 0.2025053734714242e1, -0.1155815100160448e1,
      -0.8072988170223021, 0.5952396354208710, -0.3741244961234010e1, 0.3773459685750630, 0.9386858869551073,
      0.3667922227200571, -0.3474046353808490, 0.2344915448180937e1, -0.1947020434263292e1 },
  },
}
