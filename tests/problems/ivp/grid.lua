-- Partial differential equations on a grid.

-- Antibodies that enter tissue and are bound: u and v in n cells, in turn [Mazzia 2008]. No more enter after t = 5.
local tb = require "tribode"

local function akzo(n)
  local start = {}
  for i = 1, n do start[2 * i - 1], start[2 * i] = 0, 1 end
  return {
    name = string.format("MEDAKZO n=%d", 2 * n), stiff = true, source = "medical problem of Akzo Nobel",
    start = start, duration_s = 20, breaks = { 5 }, accepted = { bdf = 40 },
    der = function(t, y)
      local rates, phi = {}, tb.where(tb.less_equal(t, 5), 2, 0)
      for i = 1, n do
        local zeta = i / n
        local alpha, beta = 2 * (zeta - 1) ^ 3 / 16, (zeta - 1) ^ 4 / 16
        local u, v = y[2 * i - 1], y[2 * i]
        local before, after = y[2 * i - 3] or phi, y[2 * i + 1] or u
        local reaction = 100 * u * v
        rates[2 * i - 1] = alpha * (after - before) * (n / 2) + beta * (before - 2 * u + after) * (n * n) - reaction
        rates[2 * i] = -reaction
      end
      return rates
    end,
  }
end

-- A reaction that oscillates, with diffusion, in n cells between fixed ends [Hairer 1996, IV.10]; u and v in turn.
local function brusselator(n)
  local start = {}
  for i = 1, n do
    local x = i / (n + 1)
    start[2 * i - 1], start[2 * i] = 1 + math.sin(2 * math.pi * x), 3
  end
  return {
    name = string.format("BRUSSELATOR n=%d", 2 * n), stiff = true, source = "Brusselator with diffusion",
    accepted = { erk = 6, adams = 40, bdf = 300 },
    start = start, duration_s = 10,
    der = function(_, y)
      local rates, spread = {}, 0.02 * (n + 1) ^ 2
      for i = 1, n do
        local u, v = y[2 * i - 1], y[2 * i]
        local turn = u * u * v
        rates[2 * i - 1] = 1 + turn - 4 * u + spread * ((y[2 * i - 3] or 1) - 2 * u + (y[2 * i + 1] or 1))
        rates[2 * i] = 3 * u - turn + spread * ((y[2 * i - 2] or 3) - 2 * v + (y[2 * i + 2] or 3))
      end
      return rates
    end,
  }
end

local akzo_400 = akzo(200)
akzo_400.reference = {
  [79] = 0.2339942217046434e-3, [133] = 0.3576835958481664e-3, [171] = 0.3085949832350532e-3,
  [199] = 0.1173741304462833e-3, [200] = 0.6190822732534586e-5,
}

local brusselator_40 = brusselator(20)
brusselator_40.reference = {
  0.87765300972831223, 3.15470390906043689, 0.76589282738382700, 3.29554882009086882, 0.67124784709478345,
  3.41364326548684686, 0.59585500175136764, 3.50583009009276079, 0.53864696771409985, 3.57345116636283094,
  0.49693860187311041, 3.62040579138373009, 0.46767208767276525, 3.65144686754175983, 0.44813203482007275,
  3.67104542308988581, 0.43624712600136752, 3.68277084686189941, 0.43066067574771029, 3.68901304276843756,
  0.43071125004027099, 3.69088755124925007, 0.43640532716595237, 3.68821938300227256, 0.44841691838178628,
  3.67955666284548168, 0.46811317898685249, 3.66221478596788616, 0.49756920417095496, 3.63240103145100124,
  0.53948864573568028, 3.58552354881922838, 0.59688972474469755, 3.51683997556843853, 0.67238053025745895,
  3.42260911210287583, 0.76692268412368098, 3.30177843924817225, 0.87829432160429276, 3.15785311724212470,
}

-- From CVODE at 1e-12 and Radau at 1e-9 on equations in C++, which agree to 2e-10.
local brusselator_400 = brusselator(200)
brusselator_400.long, brusselator_400.accepted = true, { bdf = 300 }
brusselator_400.reference = {
  [1] = 0.9871026625, [2] = 3.0162625827, [41] = 0.7472308975, [42] = 3.3179070479, [81] = 0.5786790487,
  [82] = 3.5246790802, [121] = 0.4849333464, [122] = 3.6313244027, [161] = 0.4417113141, [162] = 3.6751060002,
  [201] = 0.4298665290, [202] = 3.6882495774, [241] = 0.4432404392, [242] = 3.6809334315, [281] = 0.4887557604,
  [282] = 3.6389713176, [321] = 0.5861136917, [322] = 3.5276208181, [361] = 0.7587900005, [362] = 3.3108393234,
}

-- From CVODE at 1e-12 and Radau at 1e-10, which agree to 3e-10.
local brusselator_2000 = brusselator(1000)
brusselator_2000.long, brusselator_2000.accepted = true, { bdf = 300 }
brusselator_2000.reference = {
  [1] = 0.9974099838, [2] = 3.0032657203, [201] = 0.7548340193, [202] = 3.3083969385, [401] = 0.5828121650,
  [402] = 3.5197412547, [601] = 0.4867541654, [602] = 3.6293617914, [801] = 0.4423284293, [802] = 3.6744818962,
  [1001] = 0.4298558807, [1002] = 3.6881563059, [1201] = 0.4428090462, [1202] = 3.6812269840, [1401] = 0.4879557876,
  [1402] = 3.6397708982, [1601] = 0.5850694897, [1602] = 3.5288603071, [1801] = 0.7579504298, [1802] = 3.3118991126,
}

return { akzo_400, brusselator_40, brusselator_400, brusselator_2000, brusselator = brusselator }
