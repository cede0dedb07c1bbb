-- The systems of models/systems, each run and drawn. Their equations stand at the head of each file.
--
--   tribode run scripts/systems.lua -D system=stick_slip
--
-- Results, for each system: NAME.csv, the plot NAME (png, svg) with the instants of the events where they are not too
-- many to tell apart; summary.json with events, steps and solver.

local tb = require "tribode"

-- How long each runs, what is drawn (a panel per list), and what drives it.
local runs = {
  bouncing_ball = { duration = 3, panels = { { "h" }, { "v" } } },
  dc_motor = { duration = 0.01, panels = { { "i" }, { "duty", "saw" } } },
  inverted_pendulum = { duration = 5, panels = { { "phi", "x" }, { "u" } } },
  paper_table = {
    duration = 0.4,
    panels = { { "plant.y" }, { "friction.friction", "amplifier.thrust" } },
    inputs = { exc = function(t) return 15 * math.sin(20 * math.pi * t) end },
  },
  robertson = { duration = 40, panels = { { "y1", "y3" }, { "y2" } }, solver = "bdf" },
  stick_slip = { duration = 5, panels = { { "x" }, { "v" } } },
  tank = { duration = 900, panels = { { "h" }, { "out" } } },
  thermostat = { duration = 3600, panels = { { "T" } } },
  two_guides = {
    duration = 0.2,
    panels = { { "x" }, { "phi" }, { "left.F", "right.F" } },
    inputs = {
      nut = function(t) return 1e-4 * math.sin(100 * t) end,
      nut_speed = function(t) return 1e-2 * math.cos(100 * t) end,
    },
  },
  two_mass_drive = { duration = 0.5, panels = { { "w1", "w2" }, { "phi" }, { "u" } } },
  van_der_pol = { duration = 20, panels = { { "x0", "x1" } } },
}

local names = {}
for name in pairs(runs) do names[#names + 1] = name end
table.sort(names)
local option = tb.options {
  system = { default = "all", choices = { "all", table.unpack(names) }, help = "which of models/systems" },
}

-- Units of a panel's axis: those of its columns, each once.
local function label(columns)
  local units, seen = {}, {}
  for _, column in ipairs(columns) do
    if column.unit ~= "" and not seen[column.unit] then
      seen[column.unit] = true
      units[#units + 1] = column.unit
    end
  end
  return #units > 0 and "[" .. table.concat(units, ", ") .. "]" or ""
end

local summary = {}
for _, name in ipairs(names) do
  if option.system == "all" or option.system == name then
    local case = runs[name]
    local run = tb.run_system {
      system = require("systems." .. name),
      duration_s = case.duration,
      output_step_s = case.duration / (tb.quick and 100 or 2000),
      solver = case.solver,
      inputs = case.inputs,
    }
    assert(run.ok, run.message)
    local by_name = {}
    for _, column in ipairs(run.columns) do by_name[column.name] = column end
    local panels = {}
    for i, drawn in ipairs(case.panels) do
      local columns, series = {}, {}
      for j, column in ipairs(drawn) do
        columns[j] = by_name[column]
        series[j] = { name = column, x = run.t, y = run.values[column] }
      end
      panels[i] = {
        x_label = i == #case.panels and "Time [s]" or "",
        y_label = label(columns),
        series = series,
        events = #run.events <= 60 and run.events or nil,
      }
    end
    tb.plot { file = name, title = "models/systems/" .. name .. ".lua", panels = panels }
    tb.write_csv { file = name .. ".csv", columns = run.columns }
    summary[name] = {
      solver = run.solver,
      events = run.events,
      steps = run.statistics.steps,
      derivative_evaluations = run.statistics.derivative_evaluations,
    }
    print(string.format("%-18s %-6s %6g s  %5d steps  %3d events", name, run.solver, case.duration,
      run.statistics.steps, #run.events))
  end
end
tb.write_json { file = "summary.json", value = summary }
