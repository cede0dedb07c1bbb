-- The test set DETEST [Hull 1972], classes A to E, at t = 20. D and most of A have closed forms; the other values are
-- from tests/problems/detest.py: the midpoint rule extrapolated to order 28 in 40 digits. They agree with the table of
-- [Enright 1987] to its digits.
local tb = require "tribode"

-- The states of `der(t, y)`, a list, are y1, y2, ...
local function system_of(start, der)
  local states = {}
  for i, value in ipairs(start) do states[string.format("y%02d", i)] = value end
  return tb.system {
    states = states,
    der = function(s)
      local y, rates = {}, {}
      for i = 1, #start do y[i] = s[string.format("y%02d", i)] end
      for i, rate in ipairs(der(s.t, y)) do rates[string.format("y%02d", i)] = rate end
      return rates
    end,
  }
end

local function unit(n)
  local start = { 1 }
  for i = 2, n do start[i] = 0 end
  return start
end

local function heat(_, y)
  local rates = {}
  for i = 1, #y do rates[i] = (y[i - 1] or 0) - 2 * y[i] + (y[i + 1] or 0) end
  return rates
end

-- Five outer planets in the coordinates of the sun; y: places, then velocities.
local function planets(_, y)
  local k2 = 2.95912208286
  local m0, m = 1.00000597682, {
    0.000954786104043, 0.000285583733151, 0.0000437273164546, 0.0000517759138449, 0.00000277777777778,
  }
  local function cube(a, b, c) return (a * a + b * b + c * c) ^ 1.5 end
  local function place(j) return y[3 * j - 2], y[3 * j - 1], y[3 * j] end
  local rates, r3 = {}, {}
  for j = 1, 5 do r3[j] = cube(place(j)) end
  for j = 1, 5 do
    for i = 1, 3 do
      local force = -(m0 + m[j]) * y[3 * j - 3 + i] / r3[j]
      for k = 1, 5 do
        if k ~= j then
          local xj, yj, zj = place(j)
          local xk, yk, zk = place(k)
          local far = y[3 * k - 3 + i]
          force = force + m[k] * ((far - y[3 * j - 3 + i]) / cube(xk - xj, yk - yj, zk - zj) - far / r3[k])
        end
      end
      rates[3 * j - 3 + i] = y[15 + 3 * j - 3 + i]
      rates[15 + 3 * j - 3 + i] = k2 * force
    end
  end
  return rates
end

-- An orbit of eccentricity e; Kepler's equation E - e sin E = t gives its place.
local function orbit(e)
  local E = 20
  for _ = 1, 100 do E = E - (E - e * math.sin(E) - 20) / (1 - e * math.cos(E)) end
  return {
    { 1 - e, 0, 0, math.sqrt((1 + e) / (1 - e)) },
    function(_, y)
      local r3 = (y[1] ^ 2 + y[2] ^ 2) ^ 1.5
      return { y[3], y[4], -y[1] / r3, -y[2] / r3 }
    end,
    { math.cos(E) - e, math.sqrt(1 - e * e) * math.sin(E) },
  }
end

-- Start, right side, the first values at t = 20.
local problems = {
  A1 = { { 1 }, function(_, y) return { -y[1] } end, { math.exp(-20) } },
  A2 = { { 1 }, function(_, y) return { -y[1] ^ 3 / 2 } end, { 1 / math.sqrt(21) } },
  A3 = { { 1 }, function(t, y) return { y[1] * math.cos(t) } end, { math.exp(math.sin(20)) } },
  A4 = { { 1 }, function(_, y) return { y[1] / 4 * (1 - y[1] / 20) } end, { 20 / (1 + 19 * math.exp(-5)) } },
  A5 = { { 4 }, function(t, y) return { (y[1] - t) / (y[1] + t) } end,
    { -0.78878266889640142373 } },
  B1 = { { 1, 3 }, function(_, y) return { 2 * (y[1] - y[1] * y[2]), -(y[2] - y[1] * y[2]) } end,
    { 0.67618760085766066073, 0.18608160996400298008 } },
  B2 = { { 2, 0, 1 }, function(_, y) return { -y[1] + y[2], y[1] - 2 * y[2] + y[3], y[2] - y[3] } end,
    { 1.00000000103057681122, 1.00000000000000000000, 0.99999999896942318878 } },
  B3 = { { 1, 0, 0 }, function(_, y) return { -y[1], y[1] - y[2] ^ 2, y[2] ^ 2 } end,
    { 2.06115362243855782797e-9, 0.05257228022048512529, 0.94742771771836125227 } },
  B4 = { { 3, 0, 0 }, function(_, y)
      local r = math.sqrt(y[1] ^ 2 + y[2] ^ 2)
      return { -y[2] - y[1] * y[3] / r, y[1] - y[2] * y[3] / r, y[1] / r }
    end,
    { 0.98269509280065304993, 2.19844708169492970225, 0.91294525072762765438 } },
  B5 = { { 0, 1, 1 }, function(_, y) return { y[2] * y[3], -y[1] * y[3], -0.51 * y[1] * y[2] } end,
    { -0.93965707987292039619, -0.34211777540007490653, 0.74141265961999530078 } },
  C1 = { unit(10), function(_, y)
      local rates = { -y[1] }
      for i = 2, 9 do rates[i] = y[i - 1] - y[i] end
      rates[10] = y[9]
      return rates
    end,
    { 2.06115362243855782797e-9, 4.12230724487711565593e-8, 4.12230724487711565593e-7, 2.74820482991807710395e-6,
      1.37410241495903855198e-5, 5.49640965983615420791e-5, 1.83213655327871806930e-4, 5.23467586651062305515e-4,
      0.00130866896662765576, 0.99791274095086498120 } },
  C2 = { unit(10), function(_, y)
      local rates = { -y[1] }
      for i = 2, 9 do rates[i] = (i - 1) * y[i - 1] - i * y[i] end
      rates[10] = 9 * y[9]
      return rates
    end,
    { 2.06115362243855782797e-9, 2.06115361819020357267e-9, 2.06115361394184932614e-9, 2.06115360969349508836e-9,
      2.06115360544514085934e-9, 2.06115360119678663907e-9, 2.06115359694843242756e-9, 2.06115359270007822481e-9,
      2.06115358845172403082e-9, 0.99999998144961755099 } },
  C3 = { unit(10), heat,
    { 0.00294811921102269941, 0.00563538015484529592, 0.00782907251592703829, 0.00934825790859559708,
      0.01007943610301980475, 0.00998267417142948901, 0.00908869333276533190, 0.00748911519518508500,
      0.00532296413095267560, 0.00276243437902951443 } },
  C4 = { unit(51), heat,
    { 0.00312411145372210304, 0.00601541684215132272, 0.00847002183484361070, 0.01033682931733392330,
      0.01153249572873920368, 0.01204549525737912385, 0.01192957068015219180, 0.01128883207111128841,
      0.01025804501390988110, 0.00898201758193416997, 0.00759750090249272787, 0.00621992055682536724 } },
  C5 = { {
      3.42947415189, 3.35386959711, 1.35494901715, 6.64145542550, 5.97156957878, 2.18231499728, 11.2630437207,
      14.6952576794, 6.27960525067, -30.1552268759, 1.65699966404, 1.43785752721, -21.1238353380, 28.4465098142,
      15.3882659679, -0.557160570446, 0.505696783289, 0.230578543901, -0.415570776342, 0.365682722812, 0.169143213293,
      -0.325325669158, 0.189706021964, 0.0877265322780, -0.0240476254170, -0.287659532608, -0.117219543175,
      -0.176860753121, -0.216393453025, -0.0148647893090,
    }, planets,
    { -4.79273022432363490389, -2.42055072544902206245, -0.92125093060151186795, -4.21731040403521339353,
      7.35620294749896997219, 3.22378598542121177161, 4.03555944326227056185, 17.19865528670554963422,
      7.47891079423370276104, -29.98759326324844223961, -4.10731093755092956480, -0.92770083217544082989,
      -24.42125302518482774210, 23.81459045746554445983, 14.92096306951358808344 } },
  D1 = orbit(0.1), D2 = orbit(0.3), D3 = orbit(0.5), D4 = orbit(0.7), D5 = orbit(0.9),
  E1 = { { 0.6713967071418030, 0.09540051444747446 }, function(t, y)
      return { y[2], -(y[2] / (t + 1) + (1 - 0.25 / (t + 1) ^ 2) * y[1]) }
    end,
    { 0.14567236007282465250, -0.09883500195574578108 } },
  E2 = { { 2, 0 }, function(_, y) return { y[2], (1 - y[1] ^ 2) * y[2] - y[1] } end,
    { 2.00814976217494859201, -0.04250887527320214699 } },
  E3 = { { 0, 0 }, function(t, y) return { y[2], y[1] ^ 3 / 6 - y[1] + 2 * math.sin(2.78535 * t) } end,
    { -0.10041788586472407104, 0.24114001320959555824 } },
  E4 = { { 30, 0 }, function(_, y) return { y[2], 0.032 - 0.4 * y[2] ^ 2 } end,
    { 33.95091444646556399773, 0.27678226596728677902 } },
  E5 = { { 0, 0 }, function(t, y) return { y[2], math.sqrt(1 + y[2] ^ 2) / (25 - t) } end,
    { 14.11797390542625468251, 2.40000000000000000000 } },
}

local count = 0
for name, problem in pairs(problems) do
  local system = system_of(problem[1], problem[2])
  local function check(solver, relative_tolerance, off)
    local run = tb.run_system { system = system, duration_s = 20, output_step_s = 20, solver = solver,
      relative_tolerance = relative_tolerance, absolute_tolerance = relative_tolerance / 100 }
    assert(run.ok, string.format("%s by %s: %s", name, run.solver, run.message))
    for i, wanted in ipairs(problem[3]) do
      local found = run.final[string.format("y%02d", i)]
      assert(math.abs(found - wanted) <= off * (1 + math.abs(wanted)),
        string.format("%s by %s: y%d = %.17g instead of %.17g", name, run.solver, i, found, wanted))
    end
    return run.solver
  end
  -- Along three turns of the orbit of eccentricity 0.9 an error grows a thousandfold; elsewhere less.
  check("erk", 1e-12, name == "D5" and 1e-8 or 2e-10)
  check("adams", 1e-10, name == "D5" and 1e-4 or 1e-6)
  check("bdf", 1e-10, name == "D5" and 1e-4 or 1e-6)
  if check("auto", 1e-12, name == "D5" and 1e-8 or 2e-10) == "exact" then check("exact", 1e-12, 1e-13) end
  count = count + 1
end
assert(count == 25)
