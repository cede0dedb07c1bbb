-- From planned excitation to identified machine on many hidden machines (scripts/measure_machine.lua): how many
-- parameters are within three standard errors of the truth, and within 1 % (gains, frequencies) and 5 % (damping
-- ratios); and whether the friction model is as good as its distortion says.
--
--   tribode run benchmarks/fra_round_trip.lua -D machines=20
--   tribode run benchmarks/fra_round_trip.lua -D machines=20 -D friction=elements
--
-- The second form knows no friction but Maxwell-slip elements and dry friction, so that it cannot describe most laws.
-- An interrupted run is continued with -D resume=true and the same folder: machines that are measured are not measured
-- again, so program and options must be the same.
--
-- Machines can be measured by processes of their own, side by side, and summed up here:
--
--   tribode run scripts/measure_machine.lua -D hidden=7 -D periods=3 -D plots=false -o all/machine_7
--   tribode run benchmarks/fra_round_trip.lua -D measured=all
--
-- Results: round_trip.json, machines.txt and the tables.

local tb = require "tribode"

local option = tb.options {
  machines = { default = tb.quick and 2 or 20, help = "that are measured" },
  first = { default = 1, help = "the first of them" },
  friction = { default = "any", choices = { "any", "elements" }, help = "models that the measurement knows" },
  periods = { default = 3, help = "of the multisine" },
  resume = { default = false, help = "keep machines that the folder of the run already has" },
  measured = { default = "", help = "folder with the folders machine_1, ... of measurements; empty: measure" },
}

local lines = {}
local function line(...)
  lines[#lines + 1] = string.format(...)
  print(lines[#lines])
end

-- Gains, frequencies and damping ratios are what the response is measured for.
local function kind_of(name)
  if name:find "^zeta%d" then return "zeta" end
  return (name == "k0" or name:find "^k%d" or name:find "^f%d") and "kf" or nil
end

local function new_group()
  return { machines = 0, right_modes = 0, values = 0, inside = 0, all = 0, all_inside = 0, close = 0 }
end
local groups = { good = new_group(), ["not good"] = new_group() }
local is_good = { good = { good = 0, bad = 0 }, ["not good"] = { good = 0, bad = 0 } }
line("%-3s %-20s %-4s %7s %-16s %-7s %8s %8s %8s %10s %8s %8s  %-9s %8s  %s", "", "friction", "loop", "encoder",
  "identified as", "modes", "FRA-1 dB", "Impr. dB", "left dB", "friction %", "k, f %", "zeta %", "within 3", "move um",
  "it says")
for hidden = option.first, option.first + option.machines - 1 do
  local folder = option.measured .. "/machine_" .. hidden
  if option.measured == "" then
    folder = "machine_" .. hidden
    if not (option.resume and pcall(tb.read_json, { file = folder .. "/summary.json" })) then
      folder = tb.run {
        script = "scripts/measure_machine.lua", folder = folder,
        options = { hidden = hidden, plots = false, periods = option.periods, friction = option.friction },
      }.folder
    end
  end
  local result = tb.read_json { file = folder .. "/summary.json" }
  local verdict = result.friction_model_is_good and "good" or "not good"
  local group = groups[verdict]
  local worst = { kf = 0, zeta = 0 }
  group.machines = group.machines + 1
  local right_modes = result.modes == result.true_modes
  group.right_modes = group.right_modes + (right_modes and 1 or 0)
  local inside, all = 0, 0
  for _, parameter in ipairs(result.parameters) do
    -- Without a standard error the records do not determine it.
    if parameter.truth and parameter.truth ~= 0 and parameter.standard_error then
      local error = math.abs(parameter.value / parameter.truth - 1)
      local within = math.abs(parameter.value - parameter.truth) < 3 * parameter.standard_error
      inside, all = inside + (within and 1 or 0), all + 1
      local kind = kind_of(parameter.name)
      if kind then
        worst[kind] = math.max(worst[kind], error)
        group.values = group.values + 1
        group.inside = group.inside + (within and 1 or 0)
        group.close = group.close + (error < (kind == "zeta" and 0.05 or 0.01) and 1 or 0)
      end
    end
  end
  group.all, group.all_inside = group.all + all, group.all_inside + inside
  -- What the distortion is to tell: friction within 3 %, and with it all gains, frequencies and damping ratios.
  local truly = right_modes and result.friction_error < 0.03 and worst.kf < 0.01 and worst.zeta < 0.05
  is_good[verdict][truly and "good" or "bad"] = is_good[verdict][truly and "good" or "bad"] + 1
  line("%-3d %-20s %-4s %7.3f %-16s %d of %-2d %8.1f %8.1f %8.1f %10.2g %8.2g %8.2g  %2d of %-3d %8.3g  %s%s", hidden,
    result.kind, result.controller, result.encoder_um, result.structure, result.modes, result.true_modes,
    result.distortion_fra1_db, result.distortion_improved_db, result.distortion_left_db,
    100 * result.friction_error, 100 * worst.kf, 100 * worst.zeta, inside, all, result.validation_um, verdict,
    (verdict == "good") == truly and "" or ", but it is not so")
end
for _, verdict in ipairs { "good", "not good" } do
  local group = groups[verdict]
  if group.machines > 0 then
    line("Friction model %s: %d machines, number of modes right in %d. Gains, frequencies, damping ratios: %d of %d "
      .. "within three standard errors, %d within 1 and 5 %%; with delay and friction %d of %d within three", verdict,
      group.machines, group.right_modes, group.inside, group.values, group.close, group.all_inside, group.all)
  end
end
line("%-28s %10s %10s", "the distortion says", "it is good", "it is bad")
for _, verdict in ipairs { "good", "not good" } do
  line("%-28s %10d %10d", verdict, is_good[verdict].good, is_good[verdict].bad)
end
tb.write_text { file = "machines.txt", text = table.concat(lines, "\n") .. "\n" }
tb.write_json { file = "round_trip.json", value = { groups = groups, distortion_says = is_good } }
