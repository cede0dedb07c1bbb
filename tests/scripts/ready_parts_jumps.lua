-- Ready parts and what jumps while they slip or rest, by whatever it does: an input, a clock, a function that a clock
-- calls, a `when`, the time. Against closed forms.
local tb = require "tribode"

local function near(found, wanted, what)
  assert(math.abs(found - wanted) <= 1e-6, string.format("%s: %.17g, not %.17g", what, found, wanted))
end

-- Each of these makes something jump from `from` to `to` at `at`; `build` gets the value, as a function of s.
local ways = { "time", "floor", "samples", "function", "clock", "call", "when" }
local function jumping(way, from, to, at, build)
  local d = { inputs = {}, discrete = {} }
  local value
  if way == "time" then
    value = function(s) return tb.where(tb.less(s.t, at), from, to) end
  elseif way == "floor" then
    value = function(s) return from + (to - from) * math.min(math.floor(s.t / at), 1) end
  elseif way == "samples" or way == "function" then
    d.inputs.u = from
    value = function(s) return s.u end
  else
    d.discrete.d = from
    value = function(s) return s.d end
    local function set() return { d = to } end
    if way == "when" then
      d.when = { { name = "jump", condition = function(s) return tb.greater_equal(s.t, at) end, set = set } }
    else
      d.sample = { { period_s = 100, offset_s = at, [way == "call" and "call" or "set"] = set } }
    end
  end
  for key, entry in pairs(build(value)) do d[key] = entry end
  local inputs = way == "samples" and { u = { sample_time_s = at, values = { from, to } } }
    or way == "function" and { u = function(t) return tb.where(tb.less(t, at), from, to) end } or nil
  return tb.system(d), inputs
end
local function each(from, to, at, duration_s, solvers, build, check)
  for _, way in ipairs(ways) do
    local system, inputs = jumping(way, from, to, at, build)
    for _, solver in ipairs(solvers) do
      local run = tb.run_system { system = system, inputs = inputs, duration_s = duration_s, solver = solver }
      local what = string.format("%s, %s", way, solver)
      assert(run.ok, what .. ": " .. run.message)
      check(run, what)
    end
  end
end

-- ---- dry friction -------------------------------------------------------------------------------------------------

-- A block (m = 1, level 1) slips on a belt with -0.5 as that turns round at 0.5 s, from 1 to -1: it slips on, now with
-- 1.5, and sticks at 2 s: x = 1/8 + 3/4 - 9/8 - 1.
each(1, -1, 0.5, 3, { "exact", "erk", "bdf" }, function(belt)
  return { states = { x = 0, v = 0 },
    parts = { f = tb.parts.coulomb { velocity = function(s) return s.v - belt(s) end, level = 1 } },
    der = function(s) return { x = s.v, v = -s.f.force } end }
end, function(run, what)
  near(run.final.x, -1.25, what)
  local last = run.events[#run.events]
  assert(last.name == "f.sticks", what)
  near(last.t, 2, what)
end)

-- Its own velocity is turned round at 0.5 s by a function: from 1.5 to -1.5, so that it sticks at 2 s where it was at
-- -1/4.
local turned = tb.system {
  states = { x = 0, v = 2 },
  parts = { f = tb.parts.coulomb { velocity = "v", level = 1 } },
  der = function(s) return { x = s.v, v = -s.f.force } end,
  sample = { { period_s = 100, offset_s = 0.5, call = function(s) return { v = -s.v } end } },
}
for _, solver in ipairs { "exact", "erk", "bdf" } do
  near(tb.run_system { system = turned, duration_s = 5, solver = solver }.final.x, -0.25, solver)
end

-- On a belt whose speed is measured, and alternates, no more than the level acts: dv is 2 in a second at most.
local values = {}
for i = 1, 40 do values[i] = i % 4 < 2 and 0.5 or -0.5 end
local measured = tb.system {
  inputs = { belt = 0 },
  states = { x = 0, v = 0 },
  parts = { f = tb.parts.coulomb { velocity = function(s) return s.v - s.belt end, level = 4 } },
  der = function(s) return { x = s.v, v = -s.f.force / 2 } end,
}
for _, solver in ipairs { "exact", "erk" } do
  local run = tb.run_system { system = measured, duration_s = 4, solver = solver, output_step_s = 0.001,
    inputs = { belt = { sample_time_s = 0.1, values = values } } }
  for i = 2, #run.t do assert(math.abs(run.values.v[i] - run.values.v[i - 1]) < 0.0020001, solver) end
end

-- A belt that starts at any instant drags the block along, and one that turns round does not stop it.
for i = 1, 60 do
  local start = 0.037 * i
  for _, case in ipairs { { 0, 1, 1, 0.5 }, { 2, -2, 0.1, 0.1 * (start - 0.5) } } do
    local from, to, level, v = table.unpack(case)
    local moved = tb.system {
      states = { x = 0, v = 0 },
      parts = { f = tb.parts.coulomb { level = level,
        velocity = function(s) return s.v - tb.where(tb.less(s.t, start), from, to) end } },
      der = function(s) return { x = s.v, v = -s.f.force } end,
    }
    near(tb.run_system { system = moved, duration_s = start + 0.5, solver = "exact" }.final.v, v, "at " .. start)
  end
end

-- ---- impact -------------------------------------------------------------------------------------------------------

-- A ball rests on a shelf that is pulled away at 1 s: it falls 2 m, and rests there from 1 + sqrt(0.4) s on.
each(0, -2, 1, 3, { "exact", "erk", "bdf" }, function(shelf)
  return { states = { h = 0, v = 0 },
    parts = { f = tb.parts.impact { gap = function(s) return s.h - shelf(s) end, restitution = 0 } },
    der = function(s) return { h = s.v, v = -10 + s.f.force } end }
end, function(run, what)
  near(run.final.h, -2, what)
  near(run.events[#run.events].t, 1 + math.sqrt(0.4), what)
end)
-- And one on a shelf that is pushed up is lifted.
each(0, 0.5, 1, 2, { "exact", "erk", "bdf" }, function(shelf)
  return { states = { h = 0, v = 0 },
    parts = { f = tb.parts.impact { gap = function(s) return s.h - shelf(s) end, restitution = 0 } },
    der = function(s) return { h = s.v, v = -10 + s.f.force } end }
end, function(run, what) near(run.final.h, 0.5, what) end)
-- A platform that is a table of the time rises with 2 m/s and stops at 1 s: the ball flies on, 0.2 m up to 1.2 s.
local heights = tb.table1 { x = { 0, 1, 2, 3 }, y = { 0, 2, 2, 2 }, extrapolation = "hold" }
local thrown = tb.system {
  states = { h = 0, v = 0 },
  parts = { f = tb.parts.impact { gap = function(s) return s.h - heights(s.t) end, restitution = 0 } },
  der = function(s) return { h = s.v, v = -10 + s.f.force } end,
}
for _, solver in ipairs { "exact", "erk" } do
  near(tb.run_system { system = thrown, duration_s = 1.2, solver = solver }.final.h, 2.2, solver)
end

-- ---- play ---------------------------------------------------------------------------------------------------------

-- Play, and a Maxwell element in slip, whose position t jumps by J at 1 s: what they drag stays where it was, unless
-- the jump goes beyond it on the other side.
for _, J in ipairs { 0.2, -0.2, -0.8, -2 } do
  local held, dragged = 0, 0
  for _, x in ipairs { 1, 1 + J, 1.1 + J } do
    held = math.min(math.max(held, x - 0.5), x + 0.5)
    dragged = math.min(math.max(dragged, x - 0.3), x + 0.3)
  end
  each(0, J, 1, 1.1, { "exact", "erk" }, function(jump)
    local function position(s) return s.x + jump(s) end
    return { states = { x = 0 }, der = function() return { x = 1 } end,
      parts = { m = tb.parts.maxwell { position = position, stiffness = 10, level = 5 },
        p = tb.parts.play { input = position, width = 0.6 } } }
  end, function(run, what)
    near(run.values["m.force"][#run.t], 10 * (1.1 + J - held), what .. J)
    near(run.values["p.output"][#run.t], dragged, what .. J)
  end)
end
-- Mirrored: x = -t, which jumps by 0.2 at 1 s.
each(0, 0.2, 1, 1.1, { "exact", "erk" }, function(jump)
  local function position(s) return s.x + jump(s) end
  return { states = { x = 0 }, der = function() return { x = -1 } end,
    parts = { m = tb.parts.maxwell { position = position, stiffness = 10, level = 5 } } }
end, function(run, what) near(run.values["m.force"][#run.t], -4, what) end)
