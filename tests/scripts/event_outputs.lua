-- Events that end a run, events at the start, and both sides of an event in the results.
local tb = require "tribode"
local solvers = { "exact", "erk", "adams", "bdf" }

local function near(found, wanted, tolerance, what)
  assert(math.abs(found - wanted) <= tolerance, string.format("%s: %.17g, not %.17g", what, found, wanted))
end

-- A ball that bounces with 0.7; the run ends at the second impact, at 3.8/1.4 = 2.4 times the fall's sqrt(2/g).
local function ball(stop)
  return tb.system {
    states = { h = 1, v = 0 },
    discrete = { impacts = 0 },
    der = function(s) return { h = s.v, v = -9.81 } end,
    when = {
      { name = "impact", crossing = function(s) return s.h end,
        set = function(s) return { h = 0, v = -0.7 * s.v, impacts = s.impacts + 1 } end },
      { name = "second impact", condition = function(s) return tb.greater(s.impacts, 1.5) end, stop = stop },
    },
  }
end
local fall = math.sqrt(2 / 9.81)
for _, solver in ipairs(solvers) do
  local run = tb.run_system { system = ball(true), duration_s = 2, solver = solver }
  assert(run.ok and run.message == "" and run.ended_by == "second impact", solver)
  near(run.t_end, 2.4 * fall, 1e-6, solver)
  near(run.final.v, 0.49 * math.sqrt(2 * 9.81), 1e-5, solver)
  -- The last row is that instant, before the impact.
  assert(run.t[#run.t] == run.t_end and run.values.impacts[#run.t] == 1, solver)
  near(run.values.v[#run.t], -0.7 * math.sqrt(2 * 9.81), 1e-5, solver)
  -- And on, as if it had not stopped: without an event that ends it, by the same instants.
  local on = tb.run_system { system = ball(true), resume = run.state, end_time_s = 1.5, solver = solver }
  local whole = tb.run_system { system = ball(false), duration_s = 1.5, solver = solver }
  assert(on.ok and on.ended_by == nil and whole.ended_by == nil and on.t_end == 1.5, solver)
  near(on.final.h, whole.final.h, 1e-6, solver)
  assert(#run.events + #on.events == #whole.events and on.final.impacts == whole.final.impacts)
end
-- By a sample, and by a condition of the time at the end of the run: there it is the event that ends it.
local sampled = tb.system {
  states = { x = 0 }, discrete = { k = 0 }, der = function() return { x = 1 } end,
  sample = { { period_s = 0.1, set = function(s) return { k = s.k + 1 } end } },
  when = { { name = "seventh", condition = function(s) return tb.greater(s.k, 6.5) end, stop = true } },
}
local seventh = tb.run_system { system = sampled, duration_s = 10 }
assert(seventh.ended_by == "seventh" and seventh.final.k == 7)
near(seventh.t_end, 0.6, 1e-15, "seventh")

-- What is true at the start is an event where the `when` says so.
local function begins(at_start, stop)
  return tb.system {
    states = { x = 2 }, discrete = { n = 0 }, der = function() return { x = -1 } end,
    when = { { name = "above", condition = function(s) return tb.greater(s.x, 1) end, at_start = at_start, stop = stop,
      set = function(s) return { n = s.n + 1 } end } },
  }
end
for _, solver in ipairs(solvers) do
  local late = tb.run_system { system = begins(false), duration_s = 0.5, solver = solver }
  assert(#late.events == 0 and late.final.n == 0)
  local run = tb.run_system { system = begins(true), duration_s = 0.5, start_time_s = 3, solver = solver }
  assert(#run.events == 1 and run.events[1].t == 3 and run.final.n == 1, solver)
  -- A run that goes on does not start again.
  local on = tb.run_system { system = begins(true), resume = run.state, end_time_s = 4, solver = solver }
  assert(#on.events == 0 and on.final.n == 1)
  local none = tb.run_system { system = begins(true, true), duration_s = 0.5, solver = solver }
  assert(none.ok and none.t_end == 0 and none.ended_by == "above" and #none.t == 1 and none.values.n[1] == 0)
end

-- Both sides: a sawtooth that falls from 1 to 0, by events and by samples, and what is held.
local saw = tb.system {
  states = { x = 0 }, discrete = { n = 0, k = 0 }, der = function() return { x = 1 } end,
  when = { { name = "over", crossing = function(s) return 1 - s.x end,
    set = function(s) return { x = 0, n = s.n + 1 } end } },
  sample = { { period_s = 0.7, offset_s = 0.7, set = function(s) return { k = s.k + 1 } end } },
}
for _, solver in ipairs(solvers) do
  local plain = tb.run_system { system = saw, duration_s = 3.5, output_step_s = 0.25, solver = solver }
  local run = tb.run_system { system = saw, duration_s = 3.5, output_step_s = 0.25, output_events = true,
    solver = solver }
  -- Without them the results are what they are with them, row by row.
  local row = 0
  for i = 1, #plain.t do
    repeat row = row + 1 until run.t[row] == plain.t[i]
    for _, name in ipairs { "x", "n", "k" } do assert(run.values[name][row] == plain.values[name][i], solver) end
  end
  -- 15 of the grid; pairs at 1, 2, 3 and 0.7 … 3.5, where six of those rows are of the grid already.
  local jumps = 0
  for i = 2, #run.t do
    assert(run.t[i] >= run.t[i - 1])
    if run.t[i] == run.t[i - 1] then
      jumps = jumps + 1
      assert(run.values.n[i] + run.values.k[i] > run.values.n[i - 1] + run.values.k[i - 1], solver)
      if run.values.n[i] > run.values.n[i - 1] then
        near(run.values.x[i - 1], 1, 1e-9, solver)
        assert(run.values.x[i] == 0)
      end
    else
      -- Between jumps what is held does not change.
      assert(run.values.n[i] == run.values.n[i - 1] and run.values.k[i] == run.values.k[i - 1], solver)
    end
  end
  assert(jumps == 8, solver .. jumps)
  assert(#run.columns[1].values == #run.t)
end

local function refused(message, make, ...)
  local ok, text = pcall(make, ...)
  assert(not ok and tostring(text):find(message, 1, true), tostring(text))
end
refused("when[1]: stop is a string, must be true or false", tb.system,
  { states = { x = 0 }, der = function() return { x = 1 } end,
    when = { { crossing = function(s) return s.x end, stop = "yes" } } })
refused("output_events", tb.run_system, { system = saw, duration_s = 1, output_events = 3 })
