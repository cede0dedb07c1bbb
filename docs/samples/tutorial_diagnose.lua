-- Tutorial, step 5: what does the model lack?
local tb = require "tribode"
local axis = require "my_axis"

require "logged_moves" -- leaves ident.csv and valid.csv in the run folder
local diagnosis = tb.diagnose {
  machine = axis,
  data = { "ident.csv" },
  validate = "valid.csv",
  columns = { t = "time_s", r = "demand_mm", u = "force_N", y = "actual_mm" },
  scale = { r = 1e-3, y = 1e-3 },
}
print(diagnosis.verdict)
for _, effect in ipairs(diagnosis.effects) do
  print(string.format("%s, probability %.2f", effect.name, effect.probability))
end
