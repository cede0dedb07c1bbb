-- Designs of experiments, fields of a machine, and what is made of results, as a script sees them.
local tb = require "tribode"

local function refused(message, action, ...)
  local ok, text = pcall(action, ...)
  assert(not ok, "not refused: " .. message)
  assert(text:find(message, 1, true), "\"" .. message .. "\" is not in: " .. text)
end

-- A design is a plain table: points made from a copy of it, in parts, are the same.
local factors = {
  { name = "friction.viscous", distribution = "normal", mean = 2.35, sd = 0.2, low = 0 },
  { name = "modes[1].freq_hz", low = 30, high = 36 },
}
local design = tb.sobol { factors = factors, count = 16, seed = 7 }
assert(design.count == 16 and design.names[2] == "modes[1].freq_hz")
local points = tb.points { design = design }
assert(#points == 16)
local copy = { design = "sobol", factors = design.factors, count = 16, seed = 7 }
local part = tb.points { design = copy, first = 5, count = 2 }
assert(#part == 2)
for name, value in pairs(points[6]) do assert(part[2][name] == value) end

local grid = tb.points { design = tb.grid { factors = { { name = "n", values = { 1, 2 } },
  { name = "solver", values = { "erk", "exact" } } } } }
assert(#grid == 4 and grid[2].n == 1 and math.type(grid[2].n) == "integer" and grid[2].solver == "exact")

for _, name in ipairs { "monte_carlo", "latin_hypercube", "sobol" } do
  local rows = tb.points { design = tb[name] { factors = factors, count = 100 } }
  for _, row in ipairs(rows) do assert(row["modes[1].freq_hz"] > 30 and row["modes[1].freq_hz"] < 36) end
  refused("cout is not", tb[name], { factors = factors, count = 5, cout = 5 })
end
assert(tb.saltelli { factors = factors, base_count = 8 }.count == 32)
assert(tb.one_at_a_time { factors = factors }.count == 5)
assert(tb.list { points = { { a = 1 }, { a = 2 } } }.count == 2)
refused("factors[1].distribution = \"gauss\"", tb.monte_carlo,
  { factors = { { name = "a", distribution = "gauss" } }, count = 5 })
refused("first = 17", tb.points, { design = design, first = 17 })

-- Fields of a machine: a copy is changed, and it is checked.
local machine = tb.machine "models/linear_motor_table.lua"
local changed = tb.with_fields(machine, points[1])
assert(changed.friction.viscous == points[1]["friction.viscous"] and machine.friction.viscous == 2.35)
local scaled = tb.with_fields { machine = machine, scale = { ["friction.elements[*].F"] = 2 } }
for i, element in ipairs(scaled.friction.elements) do assert(element.F == 2 * machine.friction.elements[i].F) end
refused("did you mean \"viscous\"?", tb.with_fields, machine, { ["friction.viscos"] = 1 })
refused("elements has 20 entries", tb.with_fields, machine, { ["friction.elements[21].K"] = 1 })
refused("must be zero or positive", tb.with_fields, machine, { ["friction.viscous"] = -1 })
refused("is no path of a field", tb.with_fields, machine, { ["modes[x].gain"] = 1 })

-- Statistics: nan is a run that failed.
local nan = 0 / 0
local s = tb.statistics { values = { 1, 2, nan, 3, 4 }, probabilities = { 0.5 } }
assert(s.count == 4 and s.missing == 1 and s.mean == 2.5 and s.quantiles[1].value == 2.5)
local h = tb.histogram { values = { 0, 1, 1, 4 }, bins = 2 }
assert(h.counts[1] == 3 and h.counts[2] == 1 and h.edges[3] == 4)
local worst = tb.worst_cases { values = { 3, nan, 5, 1 }, count = 2 }
assert(worst[1].row == 3 and worst[1].value == 5 and worst[2].row == 1)

-- Sensitivity of y = x1 + 2 x2, whose indices are 1/5 and 4/5; within four of the stated standard errors.
local two = { { name = "x1", low = 0, high = 1 }, { name = "x2", low = 0, high = 1 } }
local y = {}
local saltelli = tb.saltelli { factors = two, base_count = 1024 }
for i, p in ipairs(tb.points { design = saltelli }) do y[i] = p.x1 + 2 * p.x2 end
local indices = tb.sobol_indices { values = y, factors = { "x1", "x2" } }
assert(math.abs(indices.first[1] - 0.2) < 4 * indices.first_error[1])
assert(math.abs(indices.total[2] - 0.8) < 4 * indices.total_error[2])
refused("must be groups of 5", tb.sobol_indices, { values = y, factors = { "a", "b", "c" } })

local x1, x2, sum = {}, {}, {}
for i, p in ipairs(tb.points { design = tb.latin_hypercube { factors = two, count = 500 } }) do
  x1[i], x2[i], sum[i] = p.x1, p.x2, p.x1 + 2 * p.x2
end
local columns = { { name = "x1", values = x1 }, { name = "x2", values = x2 } }
local regression = tb.regression_sensitivity { factors = columns, values = sum }
assert(regression.r_squared > 1 - 1e-12) -- a linear function, to rounding
assert(math.abs(regression.coefficients[2] / regression.coefficients[1] - 2) < 0.02) -- Latin: equal deviations to 1/n
local bars = tb.tornado { factors = columns, values = sum }
assert(bars[1].name == "x2" and bars[1].high - bars[1].low > 1.6) -- 2 times 0.9 less the chance of x1
refused("a factor has 499 values", tb.tornado,
  { factors = { { name = "x1", values = table.move(x1, 1, 499, 1, {}) } }, values = sum })
