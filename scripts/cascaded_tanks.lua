-- Two cascaded water tanks [Schoukens 2016]: a pump fills the upper one, whose level is not measured. From the first
-- model to one in which both tanks overflow, each beside the figures of an independent fit; then the diagnosis is
-- asked what the first one lacks.
--
--   tribode run scripts/cascaded_tanks.lua -D data=/data/cascaded_tanks -o results/tanks
--
-- The data are not part of Tribode: the folder must hold est.csv and val.csv with the columns t_s, u_V, y_V. Results:
-- steps.json, report.html, the plot steps, and below diagnosis what the diagnosis writes.

local tb = require "tribode"
local steps = require "lib.system_steps"

local option = steps.options("the cascaded tanks, est.csv and val.csv with the columns t_s, u_V, y_V, "
  .. "from nonlinearbenchmark.org")

local function root(x) return math.sqrt(math.max(x, 0)) end
local function above(x, level) return math.max(x - level, 0) end

-- One model of all: what a model lacks has a gain of zero that is not free.
local function tanks(name, extra, outflow)
  local free = { "a", "b", "c1", "d", "e", "c2", "x1.start", "x2.start" }
  for _, parameter in ipairs(extra) do free[#free + 1] = parameter end
  outflow = outflow or root
  local has = {}
  for _, parameter in ipairs(extra) do has[parameter] = true end
  local function value(parameter, with) return has[parameter] and with or 0 end
  return { name = name, system = tb.system {
    name = "two tanks",
    parameters = { a = 0.05, b = 0.05, c1 = 0.001, d = 0.05, e = 0.05, c2 = 0.001,
      spill1 = value("spill1", 0.05), level1 = 8, caught = value("caught", 0.03),
      spill2 = value("spill2", 0.05), level2 = 9.5 },
    inputs = { u = { unit = "V" } },
    states = { x1 = 5, x2 = { start = 5, unit = "V" } },
    der = function(s)
      local over = above(s.x1, s.level1)
      return { x1 = s.b * s.u + s.c1 - s.a * outflow(s.x1) - s.spill1 * over,
        x2 = s.d * outflow(s.x1) + s.c2 - s.e * outflow(s.x2) + s.caught * over - s.spill2 * above(s.x2, s.level2) }
    end,
    outputs = function(s) return { y = s.x2 } end,
    free = free,
  } }
end

local models = {
  tanks("linear outflow", {}, function(x) return 0.3 * x end),
  tanks("first model", {}),
  tanks("upper tank overflows, water lost", { "spill1", "level1" }),
  tanks("upper tank overflows into the lower", { "spill1", "level1", "caught" }),
  tanks("and the lower one overflows", { "spill1", "level1", "caught", "spill2", "level2" }),
}
local published = { { 0.526, 0.589 }, { 0.566, 0.643 }, { 0.432, 0.534 }, { 0.361, 0.438 }, { 0.267, 0.351 } }
for i, model in ipairs(models) do model.published = published[i] end

local common = { data = { option.data .. "/est.csv" }, validate = { option.data .. "/val.csv" },
  columns = { t = "t_s", u = "u_V", y = "y_V" }, budget_s = option.budget }
local rows = steps.fit(common, models)
steps.report("Two cascaded tanks", "V", rows, steps.diagnose(common, models[2].system))
