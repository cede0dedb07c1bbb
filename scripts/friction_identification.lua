-- Rolling friction identified as a machine of one's own would show it (section IV-A, Fig. 2, Table II): a slow sine in
-- closed loop for the elements, another record with nested loops for validation, and runs of constant velocity in both
-- directions for D_v. Position and thrust come through encoder, delays, controller and vibration modes.
--
--   tribode run scripts/friction_identification.lua -D elements=8,20 -D amplitude_mm=5
--
-- Results: friction.json, elements.csv, error.csv, loop.csv, held_out.csv and the plots loop, error, held_out, branches
-- (virgin curve, branch from a reversal and both readings of Table II).

local tb = require "tribode"

local option = tb.options {
  machine = { default = "models/linear_motor_table.lua", help = "machine description, .lua or .json" },
  amplitude_mm = { default = 5, unit = "mm", help = "of the slow sine" },
  frequency = { default = 0.05, unit = "Hz", help = "of the slow sine" },
  periods = { default = tb.quick and 1.75 or 3, help = "of the slow sine; the first 0.75 only prepare the elements" },
  elements = { default = tb.quick and { 4, 8, 20 } or { 2, 3, 4, 6, 8, 10, 12, 16, 20, 30 }, help = "N to fit" },
  shortest_um = { default = 0.3, unit = "um", help = "least displacement from a reversal at which an element slips" },
  longest_mm = { default = 3, unit = "mm", help = "greatest one, read from the loop: where it becomes flat" },
  velocities = { default = { 0.05, 0.1, 0.2, 0.3 }, unit = "m/s", help = "of the runs for D_v" },
  delay_s = { default = 1.38e-3, unit = "s", help = "of the loop, thrust to detected position" },
  seed = { default = 0, help = "of the sensor noise" },
}
local machine = tb.machine { file = option.machine, argument = {} }
local Ts, mass = machine.Ts, 1 / machine.rigid_gain_per_kg
local two_pi = 2 * math.pi

local function run(seconds, reference)
  local r = {}
  for k = 1, math.floor(seconds / Ts + 0.5) do r[k] = reference((k - 1) * Ts) end
  local result = tb.simulate { machine = machine, r = r, seed = option.seed }
  assert(result.ok, result.message)
  return result
end

-- u at the time the detected position belongs to: the delay ago, between two samples.
local function delayed_thrust(u, k)
  local ago = option.delay_s / Ts
  local whole = math.floor(ago)
  local a, b = u[math.max(k - whole, 1)], u[math.max(k - whole - 1, 1)]
  return a + (ago - whole) * (b - a)
end

-- ---- D_v: forces at constant velocity, half the difference of both directions ------------------------------------

-- The velocity comes up smoothly; then the controller settles, and the mean is taken over the last half second.
local function drag(velocity)
  local ramp, seconds = 0.3, 1.8
  local result = run(seconds, function(t)
    local s = math.min(t, ramp)
    return velocity * (t - s + s / 2 - ramp / two_pi * math.sin(math.pi * s / ramp))
  end)
  local last, first = #result.u, #result.u - math.floor(0.5 / Ts)
  local sum = 0
  for k = first + 1, last do sum = sum + delayed_thrust(result.u, k) end
  return sum / (last - first), (result.y[last] - result.y[first]) / ((last - first) * Ts)
end

local speeds, drags = {}, {}
for i, v in ipairs(option.velocities) do
  local forward, v_forward = drag(v)
  local backward, v_backward = drag(-v)
  speeds[i], drags[i] = (v_forward - v_backward) / 2, (forward - backward) / 2
end

-- Least-squares line: the level at rest and the slope.
local function line(x, y)
  local mx, my, xx, xy = 0, 0, 0, 0
  for i = 1, #x do mx, my = mx + x[i] / #x, my + y[i] / #x end
  for i = 1, #x do xx, xy = xx + (x[i] - mx) ^ 2, xy + (x[i] - mx) * (y[i] - my) end
  return my - xy / xx * mx, xy / xx
end
local level, viscous = line(speeds, drags)
print(string.format("Constant velocity: level %.3f N, D_v %.4f N s/m", level, viscous))
if machine.friction then
  print(string.format("             true: D_v %.4f N s/m, difference %.2f %%", machine.friction.viscous,
    100 * (viscous / machine.friction.viscous - 1)))
end

-- ---- records of position and friction ----------------------------------------------------------------------------

-- Thrust less inertia and viscous force. Velocity and acceleration from differences over 20 ms each way, in which a
-- step of the encoder is a few mN.
local function record(result)
  local n = math.floor(0.02 / Ts + 0.5)
  local position, force, time = {}, {}, {}
  for k = n + 1, #result.y - n do
    local before, here, after = result.y[k - n], result.y[k], result.y[k + n]
    local i = k - n
    time[i], position[i] = result.t[k], here
    force[i] = delayed_thrust(result.u, k) - mass * (after - 2 * here + before) / (n * Ts) ^ 2
        - viscous * (after - before) / (2 * n * Ts)
  end
  return { t = time, position = position, force = force }
end

local amplitude, w = option.amplitude_mm * 1e-3, two_pi * option.frequency
local slow = record(run(option.periods / option.frequency, function(t) return amplitude * math.sin(w * t) end))
-- Nested loops: two faster sines on a slow one, none of them with a whole ratio.
local nested_seconds = (tb.quick and 1.5 or 2.5) / option.frequency
local held_out = record(run(nested_seconds, function(t)
  return amplitude * (0.7 * math.sin(w * t) + 0.2 * math.sin(6.3 * w * t) + 0.05 * math.sin(17.1 * w * t))
end))
local first = math.floor(0.75 / option.frequency / Ts)

local function rms_against(record_, elements)
  local model = tb.friction_force { elements = elements, position = record_.position }
  local sum = 0
  for k = first, #model do sum = sum + (record_.force[k] - model[k]) ^ 2 end
  return math.sqrt(sum / (#model - first + 1)), model
end

-- ---- fits --------------------------------------------------------------------------------------------------------

local function fit(count, kind)
  return tb.fit_friction {
    position = slow.position, force = slow.force, elements = count, break_points = kind,
    shortest_m = option.shortest_um * 1e-6, longest_m = option.longest_mm * 1e-3, first_fitted = first,
  }
end

local kinds = { "geometric", "optimised" }
local fits, errors = {}, { geometric = {}, optimised = {} }
local columns = { { name = "elements", values = {} } }
print(string.format("\nrms error in %% of the level of %.2f N", level))
print("    N   geometric: fitted  held out   optimised: fitted  held out")
for i, n in ipairs(option.elements) do
  columns[1].values[i] = n
  local cells = {}
  for _, kind in ipairs(kinds) do
    local found = fit(n, kind)
    local nested, model = rms_against(held_out, found.elements)
    fits[kind .. math.floor(n)] = { elements = found.elements, model = model }
    errors[kind][i] = { fitted = found.residual_rms, held_out = nested }
    cells[#cells + 1] = string.format("%10.3f %9.3f", 100 * found.residual_rms / level, 100 * nested / level)
  end
  print(string.format("%5d           %s             %s", n, cells[1], cells[2]))
end
for _, kind in ipairs(kinds) do
  for _, which in ipairs { "fitted", "held_out" } do
    local values = {}
    for i, e in ipairs(errors[kind]) do values[i] = e[which] end
    columns[#columns + 1] = { name = kind .. "_" .. which .. "_rms_N", unit = "N", values = values }
  end
end
tb.write_csv { file = "error.csv", columns = columns }

-- What the records say by themselves: the friction of the machine against the same samples.
local true_elements = machine.friction and machine.friction.elements or {}
if #true_elements > 0 then
  print(string.format("the machine's own elements on the held-out record: %.3f %%",
    100 * rms_against(held_out, true_elements) / level))
end

local function error_series(column, kind, which)
  return { name = kind .. ", " .. which, x = columns[1].values, y = columns[column].values, style = "line_points" }
end
tb.plot {
  file = "error",
  title = "Error of the identified friction against the number of elements",
  panels = { {
    x_label = "Elements N", y_label = "rms error [N]", y_log = true,
    series = {
      error_series(2, "geometric", "fitted record"), error_series(3, "geometric", "held-out record"),
      error_series(4, "optimised", "fitted record"), error_series(5, "optimised", "held-out record"),
    },
  } },
}

-- ---- the elements beside Table II --------------------------------------------------------------------------------

local last = math.floor(option.elements[1])
for _, n in ipairs(option.elements) do
  if n == 20 or (last ~= 20 and n > last) then last = math.floor(n) end
end
local best = fits["optimised" .. last].elements
local table_columns = {}
for j, column in ipairs { { "fitted_F", "N" }, { "fitted_K", "N/m" }, { "true_F", "N" }, { "true_K", "N/m" } } do
  local values = {}
  for i = 1, math.max(#best, #true_elements) do
    local element = (j <= 2 and best or true_elements)[i]
    values[i] = element and element[j % 2 == 1 and "F" or "K"] or 0 / 0
  end
  table_columns[j] = { name = column[1] .. "_" .. column[2]:gsub("/", "_per_"), unit = column[2], values = values }
end
tb.write_csv { file = "elements.csv", columns = table_columns }

print(string.format("\nElements as Table II prints them (full swing); fitted with N = %d", last))
print("         fitted: F_m [N]  K [N/mm]  slips after [um]     true: F_m [N]  K [N/mm]  slips after [um]")
local function cells(element)
  if not element then return "" end
  return string.format("%8.3f %9.1f %12.1f", 2 * element.F, element.K * 1e-3, 2 * element.F / element.K * 1e6)
end
for i = 1, math.max(#best, #true_elements) do
  print(string.format("%5d          %-36s         %s", i, cells(best[i]), cells(true_elements[i])))
end

-- ---- virgin curve, branch from a reversal, both readings ---------------------------------------------------------

-- The force from relaxed along growing displacements.
local displacement = { 0 }
for _, x in ipairs(tb.logspace(1e-8, 1e-2, 400)) do displacement[#displacement + 1] = x end
local function virgin(elements) return tb.friction_force { elements = elements, position = displacement } end

-- The branch after a reversal: 10 mm one way, then back.
local function branch(elements)
  local path = { 0 }
  for i, d in ipairs(displacement) do path[i + 1] = 10e-3 - d end
  local force = tb.friction_force { elements = elements, position = path }
  local change = {}
  for i = 1, #displacement do change[i] = force[2] - force[i + 1] end
  return change
end

local um = {}
for i, d in ipairs(displacement) do um[i] = d * 1e6 end
local curves = { { name = string.format("identified, N = %d: virgin curve f(x)", last), x = um, y = virgin(best) } }
local double_um, double_virgin = {}, {}
for i, f in ipairs(virgin(best)) do double_um[i], double_virgin[i] = 2 * um[i], 2 * f end
curves[2] = { name = "identified: from a reversal, g(d)", x = um, y = branch(best), width = 4, color = "#a0c8e8" }
curves[3] = { name = "Masing's rule 2 f(d/2)", x = double_um, y = double_virgin, style = "dashed", color = "#000000" }
if #true_elements > 0 then
  local printed = {}
  for i, e in ipairs(true_elements) do printed[i] = { K = e.K, F = 2 * e.F, D = e.D } end
  curves[4] = { name = "Table II halved: g(d)", x = um, y = branch(true_elements) }
  curves[5] = { name = "Table II as printed: g(d)", x = um, y = branch(printed) }
  local largest, here = 0, virgin(best)
  for i, f in ipairs(virgin(true_elements)) do largest = math.max(largest, math.abs(f - here[i])) end
  print(string.format("\nvirgin curve: fitted and true differ by at most %.3f N", largest))
end
tb.plot {
  file = "branches",
  height = 700,
  title = "Virgin curve, branch from a reversal and both readings of Table II",
  panels = { {
    x_label = "Displacement from rest or reversal [um]", y_label = "Force [N]", x_log = true, x_range = { 0.1, 1e4 },
    legend = "top left", series = curves,
  } },
}

-- ---- loops (Fig. 2) ----------------------------------------------------------------------------------------------

local function thinned(list, from, factor)
  local out = {}
  for k = from, #list, 20 do out[#out + 1] = list[k] * (factor or 1) end
  return out
end
local _, model = rms_against(slow, best)
local x, measured, modeled = thinned(slow.position, first, 1e3), thinned(slow.force, first), thinned(model, first)
local top = amplitude * 1e3
local function loop_panel(label, range)
  return {
    x_label = label, y_label = "Friction [N]", x_range = range,
    series = {
      { name = "measured", x = x, y = measured },
      { name = string.format("identified, N = %d", last), x = x, y = modeled, style = "dashed", color = "#000000" },
    },
  }
end
tb.plot {
  file = "loop",
  title = string.format("Hysteresis at %g Hz (Fig. 2)", option.frequency),
  panels = { loop_panel("Position [mm]"), loop_panel("Position near a reversal [mm]", { top - 0.3, top + 0.01 }) },
}
tb.write_csv {
  file = "loop.csv",
  columns = {
    { name = "position_mm", unit = "mm", values = x },
    { name = "measured_N", unit = "N", values = measured },
    { name = "identified_N", unit = "N", values = modeled },
  },
}

-- Nested loops: the held-out record.
local nested_x, nested_f = thinned(held_out.position, first, 1e3), thinned(held_out.force, first)
local nested_model = thinned(fits["optimised" .. last].model, first)
local t, difference = thinned(held_out.t, first), {}
for i = 1, #nested_f do difference[i] = (nested_f[i] - nested_model[i]) * 1e3 end
tb.plot {
  file = "held_out",
  title = string.format("Nested loops of a record that the fit has not seen, N = %d", last),
  panels = {
    {
      x_label = "Position [mm]", y_label = "Friction [N]",
      series = {
        { name = "measured", x = nested_x, y = nested_f },
        { name = "predicted", x = nested_x, y = nested_model, style = "dashed", color = "#000000" },
      },
    },
    {
      x_label = "Time [s]", y_label = "Difference [mN]", legend = "none",
      series = { { name = "difference", x = t, y = difference } },
    },
  },
}
tb.write_csv {
  file = "held_out.csv",
  columns = {
    { name = "t_s", unit = "s", values = t },
    { name = "position_mm", unit = "mm", values = nested_x },
    { name = "measured_N", unit = "N", values = nested_f },
    { name = "predicted_N", unit = "N", values = nested_model },
  },
}

-- ---- the result: a friction block as machine descriptions have it ------------------------------------------------

local rms = {}
for i, n in ipairs(option.elements) do
  rms[tostring(math.floor(n))] = {
    geometric_N = errors.geometric[i].held_out, optimised_N = errors.optimised[i].held_out,
  }
end
tb.write_json {
  file = "friction.json",
  value = { friction = { viscous = viscous, elements = best }, level_N = level, held_out_rms = rms },
}
