-- Runs that go on: from `final`, from a time, and from the state of a run, in a file too.
local tb = require "tribode"

local check = require "lib.check"
local near, refused = check.near, check.refused

-- Each ready system, stopped twice on its way, by each solver that suits it: the same end and the same events.
local cases = {
  { "bouncing_ball", 1.1, "exact", "erk" },
  { "thermostat", 900, "exact", "erk", "bdf" },
  { "tank", 1100, "erk", "bdf" },
  { "stick_slip", 7, "exact" },
  { "two_mass_drive", 0.33, "exact", "erk" },
  { "dc_motor", 0.0113, "exact", "erk" },
  { "inverted_pendulum", 1.37, "erk", "bdf" },
  { "van_der_pol", 23, "erk", "bdf" },
  { "paper_table", 0.0123, "exact", "erk" },
}
for _, case in ipairs(cases) do
  local system, duration = require("systems." .. case[1]), case[2]
  for i = 3, #case do
    local options = { system = system, solver = case[i], end_time_s = duration, output_step_s = duration }
    local tolerance = case[i] == "exact" and 1e-11 or 1e-5
    local whole = tb.run_system(options)
    local events = 0
    for part, stop in ipairs { 0.31 * duration, 0.6180339 * duration, duration } do
      options.end_time_s = stop
      local run = tb.run_system(options)
      assert(run.ok and run.t_end == stop, run.message)
      for _, event in ipairs(run.events) do
        events = events + 1
        assert(event.name == whole.events[events].name)
        near(event.t, whole.events[events].t, tolerance, case[1] .. ": event")
      end
      local file = string.format("%s_%s_%d.json", case[1], case[i], part)
      tb.write_json { file = file, value = run.state }
      options.resume = tb.read_json { file = file }
      if stop == duration then
        for name, value in pairs(whole.final) do
          if type(value) == "string" then
            assert(run.final[name] == value)
          else
            near(run.final[name], value, tolerance, case[1] .. "." .. name)
          end
        end
      end
    end
    assert(events == #whole.events,
      string.format("%s by %s: %d events, not %d", case[1], case[i], events, #whole.events))
  end
end

-- A state that was written when bdf was called cvode continues with its step size, to the bit as it did then.
do
  local decay = tb.system { states = { x = 1 }, der = function(s) return { x = -s.x } end }
  local state = {
    format = "tribode run state 1", solver = "cvode", step_s = 7.071421356417761e-05,
    system = "1a14d41516134e2958ef06fd468f43abd0e38dbae78de63f6139c4b6b4a6fe6e",
    checksum = "97fcaedee04ea91723fa1baa2d3d41b5ca929b4ca89f4d486f0fcb1ca5ef4f69",
    lists = { conditions = {}, samples = {}, slack = {}, t = { 1 }, values = {}, x = { 0.3678794338792009 } },
  }
  for _, solver in ipairs { "bdf", "cvode" } do
    local run = tb.run_system { system = decay, duration_s = 1, resume = state, solver = solver }
    assert(run.final.x == 0.13533527787136768 and run.solver == "bdf" and run.state.solver == "bdf")
  end
  local run = tb.run_system { system = decay, duration_s = 1, start = { x = state.lists.x[1] }, solver = "bdf" }
  assert(run.final.x ~= 0.13533527787136768) -- without the step size
end

-- A sampled loop stopped at its sample instants goes on to the bit by a one-step method, inputs and functions of Lua
-- included, where the largest step is given: the default depends on the duration.
local loop = tb.system {
  inputs = { r = 0 },
  states = { x = 0, v = 0 },
  discrete = { u = 0, sum = 0 },
  der = function(s) return { x = s.v, v = s.u - math.sin(s.x) } end,
  sample = { { period_s = 0.1, call = function(s, k)
    return { u = s.r - 2 * s.x - 0.3 * s.v - 0.1 * s.sum + 0.01 * k, sum = s.sum + s.x - s.r }
  end } },
}
local inputs = { r = { sample_time_s = 0.35, values = { 1, 2, 0.5, 3, 1 }, interpolation = "linear" } }
local whole = tb.run_system { system = loop, inputs = inputs, duration_s = 2, output_step_s = 0.1, solver = "erk",
  max_step_s = 0.1 }
local first = tb.run_system { system = loop, inputs = inputs, end_time_s = 0.8, output_step_s = 0.1, solver = "erk",
  max_step_s = 0.1 }
local second = tb.run_system { system = loop, inputs = inputs, end_time_s = 2, output_step_s = 0.1, solver = "erk",
  max_step_s = 0.1, resume = first.state }
for name, value in pairs(whole.final) do assert(second.final[name] == value, name) end
assert(second.t[1] == 0.8 and second.t[#second.t] == 2 and #second.t == 13)

-- A run begins at another time: clocks keep their instants and samples of inputs their place.
local counter = tb.system {
  inputs = { u = 7 },
  states = { x = 0 },
  discrete = { n = 0, last = -1 },
  der = function(s) return { x = s.u + 0 * s.t } end,
  sample = { { period_s = 1, offset_s = 0.25, set = function(s) return { n = s.n + 1, last = s.t } end } },
}
local u = { sample_time_s = 2, offset_s = 1, values = { 10, 20, 30 } }
local run = tb.run_system { system = counter, start_time_s = 3.5, duration_s = 2, inputs = { u = u } }
near(run.final.x, 1.5 * 20 + 0.5 * 30, 1e-13)
assert(run.final.n == 2 and run.final.last == 5.25 and run.t[1] == 3.5)
run = tb.run_system { system = counter, start_time_s = 0.5, end_time_s = 2, inputs = { u = u } }
near(run.final.x, 0.5 * 7 + 10, 1e-13)
u.interpolation = "linear"
run = tb.run_system { system = counter, start_time_s = 2, end_time_s = 4, inputs = { u = u } }
near(run.final.x, 15 * 2 + 10, 1e-13) -- from 15 to 25

-- `final` is a start, with modes by name, values of inputs in it or not.
local thermostat = require "systems.thermostat"
local earlier = tb.run_system { system = thermostat, duration_s = 1000 }
local later = tb.run_system { system = thermostat, start = earlier.final, start_time_s = 1000, duration_s = 1000 }
near(later.final.T, tb.run_system { system = thermostat, duration_s = 2000 }.final.T, 1e-12)
run = tb.run_system { system = counter, duration_s = 1, inputs = { u = u }, start = { n = 5, x = 2 } }
assert(run.final.n == 6)
tb.run_system { system = counter, duration_s = 1, inputs = { u = u }, start = run.final }
tb.run_system { system = counter, duration_s = 1, start = run.final }
refused("start: mode = \"hot\"", function()
  tb.run_system { system = thermostat, duration_s = 1, start = { mode = "hot" } }
end)
refused("start: y is not a known field", function()
  tb.run_system { system = counter, duration_s = 1, start = { y = 2 } }
end)

-- Rows at chosen times.
run = tb.run_system { system = counter, duration_s = 3, output_times_s = { 0, 0.1, 0.7, 2.75, 3 } }
assert(#run.t == 5 and run.t[3] == 0.7 and run.values.n[3] == 1)
near(run.values.x[4], 7 * 2.75, 1e-13)
for message, times in pairs {
  ["has 1 behind 1, must increase"] = { 0, 1, 1 },
  ["is empty"] = {},
  ["a row is to be at t = 4 s, must be between the start at 0 s and the end at 3 s"] = { 1, 4 },
} do
  refused(message, function() tb.run_system { system = counter, duration_s = 3, output_times_s = times } end)
end

-- What does not fit is refused.
local function resumed(state, more)
  local options = { system = thermostat, duration_s = 10, resume = state }
  for key, value in pairs(more or {}) do options[key] = value end
  return function() tb.run_system(options) end
end
local function changed(change)
  tb.write_json { file = "state.json", value = earlier.state }
  local copy = tb.read_json { file = "state.json" }
  change(copy)
  return copy
end
resumed(changed(function() end))()
refused("checksum does not fit", resumed(changed(function(state) state.lists.x[1] = 3 end)))
refused("checksum does not fit", resumed(changed(function(state) state.lists.x = nil end)))
refused("checksum does not fit", resumed(changed(function(state) state.step_s = 1 end)))
refused("entry that is no number", resumed(changed(function(state) state.lists.x[1] = "warm" end)))
refused("has no system", resumed(changed(function(state) state.system = nil end)))
refused("format is \"2\"", resumed(changed(function(state) state.format = "2" end)))
refused("has no format", resumed(3))
refused("of another system, or of other parameters", resumed(first.state))
refused("of another system, or of other parameters", resumed(earlier.state, { parameters = { R = 3 } }))
refused("start cannot stand beside resume", resumed(earlier.state, { start = {} }))
refused("start_time_s cannot stand beside resume", resumed(earlier.state, { start_time_s = 3 }))
refused("end_time_s = 5 s, must be after the start at 1000 s", function()
  tb.run_system { system = thermostat, end_time_s = 5, resume = earlier.state }
end)
refused("duration_s is missing", function() tb.run_system { system = thermostat } end)
refused("duration_s and end_time_s say both", resumed(earlier.state, { end_time_s = 3000 }))
refused("start_time_s = -1 s", function()
  tb.run_system { system = thermostat, duration_s = 1, start_time_s = -1 }
end)

-- A counter, x' = n, with a sample each 0.1 s: `resume` takes the one at the end of the first run once, a new run
-- begins with those that are due, so that it takes that one again, unless the first run ended between two samples.
local each_tenth = tb.system { states = { x = 0 }, discrete = { n = 0 }, der = function(s) return { x = s.n } end,
  sample = { { period_s = 0.1, set = function(s) return { n = s.n + 1 } end } } }
local function halves(stop, again)
  local old = tb.run_system { system = each_tenth, duration_s = stop }
  local options = again(old)
  options.system, options.end_time_s = each_tenth, 2
  return tb.run_system(options).final
end
local function started(old) return { start = old.final, start_time_s = old.t_end } end
for count, final in pairs {
  [21] = halves(1, function(old) return { resume = old.state } end), [22] = halves(1, started),
} do
  assert(final.n == count)
  near(final.x, count, 1e-12)
end
assert(halves(0.95, started).n == 21)
near(halves(0.95, started).x, 21, 1e-12)
print("ok")
