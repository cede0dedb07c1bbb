-- A brushless motor that cogs (gchenfc/ODrive): the current that holds the rotor still over a turn. From a constant to
-- harmonics of the turn, each beside the figures of an independent fit; then the diagnosis is asked what the constant
-- lacks.
--
--   tribode run scripts/cogging.lua -D data=/data/cogging -o results/cogging
--
-- The data are not part of Tribode: the folder must hold map_a_16.csv, map_b_16.csv and map_d_16.csv with the columns
-- theta_rad, iq_A. Results: steps.json, report.html, the plot steps, and below diagnosis what the diagnosis writes.

local tb = require "tribode"
local steps = require "lib.system_steps"

local option = steps.options("the cogging maps, map_a_16.csv, map_b_16.csv and map_d_16.csv with "
  .. "the columns theta_rad, iq_A, from the repository gchenfc/ODrive")

local function motor(name, harmonics, published)
  local parameters, free = { c = { value = 0, unit = "A" } }, { "c" }
  for _, n in ipairs(harmonics) do
    for _, wave in ipairs { "s", "c" } do
      parameters[wave .. n] = { value = 0, unit = "A" }
      free[#free + 1] = wave .. n
    end
  end
  return { name = name, published = published, system = tb.system {
    name = "motor", parameters = parameters, inputs = { theta = { unit = "rad" } },
    states = {}, der = function() return {} end,
    outputs = function(s)
      local i = s.c
      for _, n in ipairs(harmonics) do
        i = i + s["s" .. n] * math.sin(n * s.theta) + s["c" .. n] * math.cos(n * s.theta)
      end
      return { iq = { i, unit = "A" } }
    end,
    free = free,
  } }
end

local models = {
  motor("constant", {}, { 0.835, 0.828 }),
  motor("+ 12 per turn", { 12 }, { 0.814, 0.807 }),
  motor("+ 7, 14, 28 per turn", { 7, 14, 28 }, { 0.313, 0.312 }),
  motor("+ 12, 36, 84", { 7, 14, 28, 12, 36, 84 }, { 0.112, 0.115 }),
  motor("+ 21, 42, 56", { 7, 14, 28, 12, 36, 84, 21, 42, 56 }, { 0.082, 0.085 }),
}
local common = { data = { option.data .. "/map_a_16.csv" }, validate = { option.data .. "/map_b_16.csv" },
  columns = { theta = "theta_rad", iq = "iq_A" }, budget_s = option.budget }
local rows = steps.fit(common, models)
steps.report("A motor that cogs", "A", rows, steps.diagnose(common, models[1].system))
