-- Vectors of states, discrete variables, parameters, inputs and outputs.
local tb = require "tribode"

local check = require "lib.check"
local near, refused = check.near, check.refused

-- A rod in n pieces with both ends at zero: the slowest wave decays by a known rate.
local function rod(n)
  local h = 1 / (n + 1)
  return tb.system {
    parameters = { a = { value = 0.1, unit = "1/s" } },
    states = { T = { size = n, start = function(i) return math.sin(math.pi * i * h) end, unit = "K" } },
    der = function(s)
      local T, rate = s.T, {}
      assert(#T == n and select("#", table.unpack(T)) == n)
      local count = 0
      for i, value in ipairs(T) do
        rate[i] = s.a / h ^ 2 * ((i > 1 and T[i - 1] or 0) - 2 * value + (i < n and T[i + 1] or 0))
        count = count + 1
      end
      assert(count == n)
      return { T = rate }
    end,
    outputs = function(s)
      return { mean = { (s.T[1] + s.T[n]) / 2, unit = "K" }, pair = { s.T[1], s.T[n], unit = "K" } }
    end,
  }
end
-- A vector of the system may be handed back as it is.
local cart = tb.system {
  states = { x = { size = 3, start = { 1, 2, 3 } }, v = { size = 3, start = { 0.5, -1, 2 } } },
  der = function(s) return { x = s.v, v = { 0, 0, 0 } } end,
  outputs = function(s) return { copy = s.x } end,
}
local moved = tb.run_system { system = cart, duration_s = 2 }
for i, wanted in ipairs { 2, 0, 7 } do
  near(moved.final.x[i], wanted, 1e-14)
  near(moved.values.copy[i][#moved.t], wanted, 1e-14)
end

local n = 12
local wave = rod(n)
for _, solver in ipairs { "exact", "bdf" } do
  local run = tb.run_system { system = wave, duration_s = 2, solver = solver, output_step_s = 0.5 }
  local decay = 4 * 0.1 * (n + 1) ^ 2 * math.sin(math.pi / (2 * (n + 1))) ^ 2
  for i = 1, n do
    local wanted = math.sin(math.pi * i / (n + 1))
    near(run.final.T[i], wanted * math.exp(-2 * decay), solver == "exact" and 1e-13 or 1e-6)
    near(run.values.T[i][3], wanted * math.exp(-decay), solver == "exact" and 1e-13 or 1e-6)
  end
  near(run.values.pair[1][3], run.values.T[1][3], 1e-15)
  near(run.values.pair[2][3], run.values.T[n][3], 1e-15)
  assert(#run.values.T == n and run.columns[3].name == "T[2]" and run.columns[11].name == "T[10]")
  assert(run.columns[3].unit == "K" and run.columns[n + 4].name == "pair[2]")
  -- As a start, whole or in parts; and continued.
  local more = tb.run_system { system = wave, duration_s = 1, start = run.final, solver = solver }
  local on = tb.run_system { system = wave, duration_s = 1, resume = run.state, solver = solver }
  near(more.final.T[5], math.sin(math.pi * 5 / (n + 1)) * math.exp(-3 * decay), 1e-6)
  near(on.final.T[5], more.final.T[5], 1e-6)
end
assert(tb.run_system { system = wave, duration_s = 1e-9, start = { ["T[3]"] = 9 } }.values.T[3][1] == 9)

-- A thousand pieces are recorded in seconds, with the Jacobian of a band.
local big = rod(1000)
local run = tb.run_system { system = big, duration_s = 1e-4, solver = "erk", output_step_s = 1e-4 }
assert(run.ok and #run.final.T == 1000)

-- Everything else that may be a vector: written by single elements too.
local mixed = tb.system {
  parameters = { k = { size = 2, value = { 2, 3 } }, one = { size = 1, value = 5 } },
  inputs = { u = { size = 2, value = 1, unit = "N" } },
  states = { x = { size = 2, nominal = 1e-3 }, z = { size = 1, start = 7 }, plain = 0 },
  discrete = { n = { size = 3, start = { 1, 2, 3 } }, hits = 0 },
  der = function(s)
    return { x = { s.k[1] * s.u[1], s.k[2] * s.u[2] }, z = { s.one[1] }, plain = s.x[1] + s.n[3] }
  end,
  when = {
    { name = "up", crossing = function(s) return s.x[1] - 1 end, direction = "rising",
      set = function(s) return { ["x[2]"] = 10, n = { s.n[3], s.n[1], s.n[2] } } end },
  },
  sample = { { period_s = 1, offset_s = 0.75, call = function(s, k)
    assert(#s.n == 3)
    return { hits = s.hits + #s.x + k, n = { s.n[1], s.n[2], s.n[3] + s.x[1] } }
  end } },
}
run = tb.run_system { system = mixed, duration_s = 1 }
near(run.events[1].t, 0.5, 1e-14)
near(run.final.x[2], 10 + 3 * 0.5, 1e-13)
near(run.final.z[1], 12, 1e-14)
assert(run.final.n[1] == 3 and run.final.n[2] == 1 and math.abs(run.final.n[3] - 3.5) < 1e-13 and run.final.hits == 2)
run = tb.run_system { system = mixed, duration_s = 1, parameters = { k = { 0, 1 }, ["one[1]"] = 2 },
  inputs = { u = { 0, function(t) return 2 * t end } } }
near(run.final.x[2], 1, 1e-13)
near(run.final.z[1], 9, 1e-14)
run = tb.run_system { system = mixed, duration_s = 1,
  inputs = { u = { 1, { sample_time_s = 0.5, values = { 4, 0 } } } }, parameters = { k = { 0, 1 } } }
near(run.final.x[2], 2, 1e-13)
-- In a part.
local whole = tb.system { parts = { m = mixed }, states = { y = 0 },
  connect = function(s) return { ["m.u"] = { s.t, 0 } } end,
  der = function(s) return { y = s.m.x[1] * #s.m.x } end }
run = tb.run_system { system = whole, duration_s = 0.7 }
near(run.values["m.x"][1][#run.t], 0.49, 1e-13)
near(run.final.y, 2 * 0.7 ^ 3 / 3, 1e-13)
local steady = tb.steady_state { system = tb.system { states = { v = { size = 3, start = 1 } },
  der = function(s) return { v = { 1 - s.v[1], s.v[1] - 2 * s.v[2], s.v[2] - s.v[3] } } end } }
near(steady.start.v[3], 0.5, 1e-14)

-- What is refused.
local function vector(field, der)
  return function()
    return tb.system { states = { x = field }, discrete = { k = 1 }, der = der or function(s) return { x = s.x } end }
  end
end
refused("size = 0, must be a whole number from 1", vector { size = 0 })
refused("size = 2.5", vector { size = 2.5 })
refused("start has 2 values, must have 3", vector { size = 3, start = { 1, 2 } })
refused("start of element 2 is a string", vector { size = 3, start = { 1, "a", 3 } })
refused("start of element 1 is a boolean", vector { size = 3, start = function() return true end })
refused("x[0] is not there: x has the elements 1 to 3", vector({ size = 3 }, function(s) return { x = { s.x[0] } } end))
refused("x[5] is not there", vector({ size = 3 }, function(s) return { x = { s.x[5] } } end))
refused("x has 2 values, must have 3", vector({ size = 3 }, function(s) return { x = { s.x[1], 0 } } end))
refused("x is indexed by a symbolic value", vector({ size = 3 }, function(s) return { x = { s.x[s.k], 0, 0 } } end))
refused("the table of variables is indexed by a symbolic value",
  vector({ size = 3 }, function(s) return { x = { s[s.k], 0, 0 } } end))
refused("a table that is indexed by a symbolic value gives nil", vector({ size = 1 }, function(s)
  local gains = { 1, 2, 3 }
  return { x = { 2 * gains[s.k] } }
end))
refused("cannot be set here", vector({ size = 3 }, function(s)
  s.x[1] = 2
  return {}
end))
refused("der has no equation for the state x[2]",
  vector({ size = 2 }, function() return { ["x[1]"] = 1 } end))
refused("start: x[1] is not a known field", function()
  tb.run_system { system = wave, duration_s = 1, start = { x = { 1, 2, 3, 4 } } }
end)
refused("inputs.u must be a list of 2 inputs", function()
  tb.run_system { system = mixed, duration_s = 1, inputs = { u = 3 } }
end)
print("ok")
