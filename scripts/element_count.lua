-- How many elements does a friction model need? A machine with many elements is the truth; models of 1, 2, 3, ...
-- elements are fitted to one record of its friction. For each: the force it misses on another record, the motion it
-- misses where it takes the place of the true friction in the machine, what it costs to simulate, and how far the
-- proposed analysis is from the true plant where it is the friction model of the analysis.
--
--   tribode run scripts/element_count.lua -D elements=1,2,4,8,16
--
-- Results: elements.csv, cost.csv, elements.json and the plots accuracy, cost, curve.

local tb = require "tribode"
local plots = require "lib.batch_plots"

local option = tb.options {
  machine = { default = "models/linear_motor_table.lua", help = "machine description, .lua or .json" },
  elements = { default = tb.quick and { 1, 4, 20 } or { 1, 2, 3, 4, 5, 6, 8, 10, 12, 15, 20, 25, 30 }, help = "N" },
  break_points = { default = "optimised", choices = { "geometric", "optimised" }, help = "of tb.fit_friction" },
  reach = { default = 2e-3, unit = "m", help = "half the stroke of the record that is fitted" },
  seconds = { default = tb.quick and 0.5 or 2, unit = "s", help = "of the run that compares motions" },
  frequencies = { default = tb.quick and 6 or 20, help = "of the sweep" },
  amplitude = { default = 15, unit = "N", help = "of the sweep" },
  repeats = { default = tb.quick and 1 or 5, help = "runs for each processor time; the shortest counts" },
}
local machine = tb.machine { file = option.machine, argument = {} }
local friction = machine.friction
local two_pi = 2 * math.pi

-- ---- records of the friction ----------------------------------------------------------------------------------------

-- Slow loops, one inside the other: fine where elements let go, after each reversal.
local function loops(reaches)
  local position, here = { 0 }, 0
  for _, target in ipairs(reaches) do
    local way = math.abs(target - here)
    for _, part in ipairs(tb.logspace(1e-8, way, 300)) do
      position[#position + 1] = here + (target > here and part or -part)
    end
    here = target
  end
  return position
end

local r = option.reach
local fitted = loops { r, -r, r, -r }
local held_out = loops { 0.7 * r, -0.3 * r, 0.2 * r, -0.05 * r, 0.02 * r, -0.005 * r, 0.5 * r, 0.49 * r, 0.5 * r }
local fitted_force = tb.friction_force { elements = friction.elements, position = fitted }
local held_out_force = tb.friction_force { elements = friction.elements, position = held_out }

local function fit(count)
  return tb.fit_friction {
    position = fitted, force = fitted_force, elements = count, break_points = option.break_points,
    shortest_m = 1e-7, longest_m = 1.9 * r, first_fitted = 301,
  }
end

local function rms_difference(a, b)
  local sum = 0
  for k = 1, #a do sum = sum + (a[k] - b[k]) ^ 2 end
  return math.sqrt(sum / #a)
end

-- ---- one model in the machine ---------------------------------------------------------------------------------------

-- An excitation of three sines that reverses at many amplitudes. The loop is closed: without it the slightest force
-- adds up to a drift. The fit finds no damping, so that of the machine's own elements is missed by every model.
local excitation = {}
for k = 1, math.floor(option.seconds / machine.Ts + 0.5) do
  local t = (k - 1) * machine.Ts
  excitation[k] = 8 * math.sin(two_pi * 3 * t) + 5 * math.sin(two_pi * 7.3 * t) + 3 * math.sin(two_pi * 31 * t)
end
local frequency_hz = tb.linspace(15, 200, option.frequencies)

local function simulate(elements)
  local changed = tb.with_fields(machine, { ["friction.elements"] = elements, encoder_resolution_m = 0 })
  return tb.simulate { machine = changed, exc = excitation }
end

local true_motion = simulate(friction.elements)
local truth = tb.plant_response { machine = machine, frequency_hz = frequency_hz }

-- The distance of the proposed analysis from the true plant, with a friction model of these elements.
local function distance(elements)
  local sweep = tb.sweep {
    machine = machine, frequency_hz = frequency_hz, amplitude_N = option.amplitude,
    friction_model = { elements = elements, viscous = friction.viscous },
  }
  local response, sum = sweep.responses["Proposed"], 0
  for i = 1, #response.real do
    sum = sum + ((response.real[i] - truth.real[i]) ^ 2 + (response.imag[i] - truth.imag[i]) ^ 2)
      / (truth.real[i] ^ 2 + truth.imag[i] ^ 2)
  end
  return 100 * math.sqrt(sum / #response.real)
end

local function run(point)
  local found = fit(point.elements)
  local motion = simulate(found.elements)
  assert(motion.ok, motion.message)
  local force = tb.friction_force { elements = found.elements, position = held_out }
  return {
    elements_found = #found.elements,
    fitted_rms_N = found.residual_rms,
    held_out_rms_N = rms_difference(force, held_out_force),
    motion_rms_um = 1e6 * rms_difference(motion.x, true_motion.x),
    events = motion.statistics.events,
    restarts = motion.statistics.restarts,
    analysis_distance_pct = distance(found.elements),
  }
end

-- ---- all of them ----------------------------------------------------------------------------------------------------

-- Processor time is no function of the point, so it is not kept of the points but measured here, one model at a time.
local function cost_of(merged)
  local ms = {}
  for i, count in ipairs(merged.parameters.elements) do
    local elements, least = fit(count).elements, math.huge
    for _ = 1, option.repeats do
      local start = os.clock()
      simulate(elements)
      least = math.min(least, os.clock() - start)
    end
    ms[i] = least * 1e3 / option.seconds
  end
  return ms
end

local function draw(merged, ms)
  local n, result = merged.parameters.elements, merged.results
  local function curve(name, y) return { name = name, x = n, y = y, style = "line_points" } end
  local x_label = "Elements of the model"
  tb.plot {
    file = "accuracy",
    title = string.format("What a friction model of N elements misses of one with %d", #friction.elements),
    panels = {
      {
        y_label = "Friction force, rms [N]", y_log = true,
        series = {
          curve("record that was fitted", result.fitted_rms_N), curve("another record", result.held_out_rms_N),
        },
      },
      { y_label = "Motion, rms [um]", y_log = true, legend = "none", series = { curve("", result.motion_rms_um) } },
      {
        x_label = x_label, y_label = "Analysis [%]", legend = "none",
        series = { curve("proposed analysis, rms distance from the true plant", result.analysis_distance_pct) },
      },
    },
  }
  tb.plot {
    file = "cost",
    title = "What it costs to simulate one second",
    panels = {
      { y_label = "Processor time [ms]", series = { curve("", ms) } },
      { x_label = x_label, y_label = "Transitions", series = { curve("", result.events) } },
    },
  }
  local um, series = {}, {}
  for k, x in ipairs(fitted) do um[k] = x * 1e6 end
  local shown = { n[1], n[math.min(#n, 4)], n[#n] }
  for i, count in ipairs(shown) do
    local force = tb.friction_force { elements = fit(count).elements, position = fitted }
    series[i] = { name = string.format("%d elements", count), x = um, y = force }
  end
  series[#series + 1] = { name = "truth", x = um, y = fitted_force, style = "dashed", color = "#000000" }
  tb.plot {
    file = "curve",
    title = "Friction over displacement, models of N elements",
    panels = { { x_label = "Displacement [um]", y_label = "Force [N]", series = series } },
  }
end

tb.batch {
  name = "element_count",
  points = tb.grid { factors = { { name = "elements", values = option.elements } } },
  units = { fitted_rms_N = "N", held_out_rms_N = "N", motion_rms_um = "um" },
  run = run,
  finish = function(merged)
    assert(#merged.failures == 0, merged.failures[1] and merged.failures[1].reason)
    local ms, result = cost_of(merged), merged.results
    tb.write_csv { file = "elements.csv", columns = plots.columns(merged) }
    tb.write_csv {
      file = "cost.csv",
      columns = {
        { name = "elements", values = merged.parameters.elements },
        { name = "processor_ms_per_s", unit = "ms/s", values = ms },
      },
    }
    tb.write_json { file = "elements.json", value = { elements = merged.parameters.elements, results = result } }
    print(string.format("%4s %11s %12s %11s %9s %12s %12s", "N", "fitted [N]", "another [N]", "motion [um]", "analysis",
      "transitions", "ms per s"))
    for i, count in ipairs(merged.parameters.elements) do
      print(string.format("%4d %11.4f %12.4f %11.3f %7.2f %% %12d %12.2f", count, result.fitted_rms_N[i],
        result.held_out_rms_N[i], result.motion_rms_um[i], result.analysis_distance_pct[i], result.events[i], ms[i]))
    end
    draw(merged, ms)
  end,
}
