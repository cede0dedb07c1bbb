-- A pneumatic piston drawn to and fro (TU Delft 2021): the force over an imposed motion, at four pressures. From a
-- force that is proportional to the pressure to dry friction that grows with it, each beside the figures of an
-- independent fit; then the diagnosis is asked what the first model lacks.
--
--   tribode run scripts/seal.lua -D data=/data/seal -o results/seal
--
-- The data are not part of Tribode: the folder must hold oring_X_Pbar.csv, X one of a and e, P one of 1, 3, 5, 7,
-- with the columns t_s, x_m, p_Pa, F_N. Results: steps.json, report.html, the plot steps, and below diagnosis what
-- the diagnosis writes.

local tb = require "tribode"
local steps = require "lib.system_steps"

local option = steps.options("the seal, oring_a_1bar.csv and so on with the columns t_s, x_m, p_Pa, F_N, "
  .. "from the repository EvaZillen/3D-printed-pneumatic-actuator")

-- friction: of the variables and the direction of motion, which is rounded off over a small velocity, or with
-- presliding follows it over a distance. published: fitted on a, validated on e.
local function piston(name, extra, published, friction, presliding)
  local free = { "area", "F0" }
  for _, parameter in ipairs(extra) do free[#free + 1] = parameter end
  return { name = name, published = published, system = tb.system {
    name = "piston",
    parameters = { area = { value = 5.2e-4, unit = "m2" }, F0 = { value = 0, unit = "N" },
      k = { value = 0, unit = "N/m" }, D = { value = 0, unit = "N s/m" },
      Fc = { value = presliding and 5 or 0, unit = "N" }, g = { value = 0, unit = "m2" },
      slow = { value = 5e-4, unit = "m/s" }, distance = { value = 1e-4, unit = "m" } },
    inputs = { x = { unit = "m" }, x_rate = { unit = "m/s" }, p = { unit = "Pa" } },
    states = presliding and { way = 0 } or {},
    der = function(s)
      return presliding and { way = (s.x_rate - math.abs(s.x_rate) * s.way) / s.distance } or {}
    end,
    outputs = function(s)
      local F = s.area * s.p + s.F0
      if friction then F = F + friction(s, presliding and s.way or tb.tanh(s.x_rate / s.slow)) end
      return { F = { F, unit = "N" } }
    end,
    free = free,
  } }
end

local models = {
  piston("first model", {}, { 6.29, 7.15 }),
  piston("spring", { "k" }, { 6.29, 7.14 }, function(s) return s.k * s.x end),
  piston("viscous in place of dry", { "D" }, { 2.08, 2.59 }, function(s) return s.D * s.x_rate end),
  piston("dry", { "Fc" }, { 1.55, 2.55 }, function(s, way) return s.Fc * way end),
  piston("dry with presliding", { "Fc", "distance" }, { 1.38, 2.42 }, function(s, way) return s.Fc * way end, true),
  piston("and growing with pressure", { "Fc", "g", "distance" }, { 0.84, 2.41 },
    function(s, way) return (s.Fc + s.g * s.p) * way end, true),
}
local function records(run)
  local list = {}
  for i, bar in ipairs { 1, 3, 5, 7 } do list[i] = string.format("%s/oring_%s_%dbar.csv", option.data, run, bar) end
  return list
end
local common = { data = records("a"), validate = records("e"),
  columns = { t = "t_s", x = "x_m", p = "p_Pa", F = "F_N" }, budget_s = option.budget }
local rows = steps.fit(common, models)
steps.report("A piston and its seal", "N", rows, steps.diagnose(common, models[1].system))
