-- A pendulum that swings freely [Kaheman 2022]: from gravity and viscous friction to dry friction and drag together,
-- each beside the figures of an independent fit; then the diagnosis is asked what the first model lacks.
--
--   tribode run scripts/pendulum.lua -D data=/data/pendulum -o results/pendulum
--
-- The data are not part of Tribode: the folder must hold swing_A.csv with the columns t_s, theta_rad (pi hangs down).
-- The first two thirds are fitted, the last one is predicted. Results: steps.json, report.html, the plot steps,
-- and below diagnosis what the diagnosis writes.

local tb = require "tribode"
local steps = require "lib.system_steps"

local option = steps.options("the pendulum, swing_A.csv with the columns t_s, theta_rad, from the "
  .. "repository dynamicslab/MultiArm-Pendulum")

local function pendulum(name, extra, published)
  local free = { "w2", "viscous", "offset", "theta.start", "omega.start" }
  for _, parameter in ipairs(extra) do free[#free + 1] = parameter end
  return { name = name, published = published, system = tb.system {
    name = "pendulum",
    parameters = { w2 = { value = 40, unit = "1/s2" }, viscous = { value = 0.02, unit = "1/s" },
      offset = { value = 0, unit = "rad" }, dry = { value = 0, unit = "rad/s2" }, drag = 0,
      slow = { value = 0.05, unit = "rad/s" } },
    states = { theta = { start = 1.523, unit = "rad" }, omega = { start = 1.85, unit = "rad/s" } },
    der = function(s)
      return { theta = s.omega, omega = s.w2 * math.sin(s.theta + s.offset) - s.viscous * s.omega
        - s.dry * tb.tanh(s.omega / s.slow) - s.drag * s.omega * math.abs(s.omega) }
    end,
    free = free,
  } }
end

local models = {
  pendulum("gravity, viscous friction", {}, { 0.0119, 0.0536 }),
  pendulum("+ dry friction", { "dry" }, { 0.0119, 0.0536 }),
  pendulum("+ quadratic drag", { "drag" }, { 0.0077, 0.0779 }),
  pendulum("+ dry friction and quadratic drag", { "dry", "drag" }, { 0.0027, 0.0250 }),
}
local common = { data = { option.data .. "/swing_A.csv" }, columns = { t = "t_s", theta = "theta_rad" },
  budget_s = option.budget }
local rows = steps.fit(common, models)
steps.report("A pendulum", "rad", rows, steps.diagnose(common, models[1].system))
