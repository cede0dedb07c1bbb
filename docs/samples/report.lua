-- A report of one's own: what friction does to a small move, as a page with a table and a plot to zoom into.
local tb = require "tribode"

local machine = tb.machine "models/linear_motor_table.lua"
local reference = {}
for k = 0, 399 do reference[#reference + 1] = k < 40 and 0 or 10e-6 end

local rows, series = {}, {}
for i, share in ipairs { 0, 0.5, 1 } do
  local changed = tb.machine "models/linear_motor_table.lua"
  for _, element in ipairs(changed.friction.elements) do
    element.F, element.K = element.F * share + 1e-9, element.K * share + 1e-3
  end
  local run = tb.simulate { machine = changed, r = reference }
  local ms, um, highest = {}, {}, 0
  for k, t in ipairs(run.t) do
    ms[k], um[k] = t * 1e3, run.x[k] * 1e6
    highest = math.max(highest, um[k])
  end
  local name = string.format("%g %% of the friction", 100 * share)
  series[i], rows[i] = { name = name, x = ms, y = um }, { name, um[#um], highest - 10 }
end

tb.report {
  file = "report.html",
  title = "A step of 10 um under friction",
  summary = string.format("With all of its friction the table is at %.2f um after %g s.", rows[3][2],
    #reference * machine.Ts),
  sections = {
    {
      title = "The step",
      content = {
        "The same controller, with the friction of the table taken away in part.",
        { plot = { panels = { { x_label = "Time [ms]", y_label = "Position [um]", series = series } } } },
        {
          table = {
            columns = {
              { name = "machine" }, { name = "position at the end", unit = "um", decimals = 2 },
              { name = "overshoot", unit = "um", decimals = 2 },
            },
            rows = rows,
          },
        },
      },
    },
  },
}
