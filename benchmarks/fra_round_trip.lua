-- From planned excitation to identified machine on many hidden machines (scripts/measure_machine.lua): how many
-- parameters are within three standard errors of the truth, and within 1 % (gains, frequencies) and 5 % (damping
-- ratios); apart where the distortion says that the friction model is good, and where it says that it is not.
--
--   tribode run benchmarks/fra_round_trip.lua -D machines=20
--
-- Results: round_trip.json, machines.txt and the tables.

local tb = require "tribode"

local option = tb.options {
  machines = { default = tb.quick and 2 or 20, help = "that are measured" },
  first = { default = 1, help = "the first of them" },
}

local groups = { good = {}, ["not good"] = {} }
local lines = {}
local function line(...)
  lines[#lines + 1] = string.format(...)
  print(lines[#lines])
end

line("%-3s %-20s %-9s %9s %9s %8s  %8s %8s %8s  %8s  %s", "", "friction", "modes", "FRA-1 dB", "Impr. dB", "misfit %",
  "k0 %", "k, f %", "zeta %", "move um", "friction model")
for hidden = option.first, option.first + option.machines - 1 do
  local folder = tb.run {
    script = "scripts/measure_machine.lua", folder = "machine_" .. hidden, options = { hidden = hidden, plots = false },
  }.folder
  local result = tb.read_json { file = folder .. "/summary.json" }
  local verdict = result.friction_model_is_good and "good" or "not good"
  local group = groups[verdict]
  local worst = { k0 = 0, kf = 0, zeta = 0 }
  group.machines = (group.machines or 0) + 1
  group.right_modes = (group.right_modes or 0) + (result.modes == result.true_modes and 1 or 0)
  for _, parameter in ipairs(result.parameters) do
    if parameter.truth and result.modes == result.true_modes then
      local error = math.abs(parameter.value / parameter.truth - 1)
      local kind = parameter.name == "k0" and "k0" or parameter.name:find "zeta" and "zeta" or "kf"
      worst[kind] = math.max(worst[kind], error)
      group.values = (group.values or 0) + 1
      local inside = math.abs(parameter.value - parameter.truth) < 3 * parameter.standard_error
      group.inside = (group.inside or 0) + (inside and 1 or 0)
      group.close = (group.close or 0) + (error < (kind == "zeta" and 0.05 or 0.01) and 1 or 0)
    end
  end
  line("%-3d %-20s %d of %-4d %9.1f %9.1f %8.3f  %8.2f %8.2f %8.2f  %8.2f  %s", hidden, result.kind, result.modes,
    result.true_modes, result.distortion_fra1_db, result.distortion_improved_db, 100 * result.misfit, 100 * worst.k0,
    100 * worst.kf, 100 * worst.zeta, result.validation_um, verdict)
end
for _, verdict in ipairs { "good", "not good" } do
  local group = groups[verdict]
  if group.machines then
    line("Friction model %s: %d machines, number of modes right in %d; of their parameters %.0f %% within three "
      .. "standard errors, %.0f %% within 1 %% (k, f) and 5 %% (zeta)", verdict, group.machines, group.right_modes,
      100 * (group.inside or 0) / (group.values or 1), 100 * (group.close or 0) / (group.values or 1))
  end
end
tb.write_text { file = "machines.txt", text = table.concat(lines, "\n") .. "\n" }
tb.write_json { file = "round_trip.json", value = groups }
