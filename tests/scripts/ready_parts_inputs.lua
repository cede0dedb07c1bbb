-- Ready parts that act on an input, which moves by a function of the time, by samples joined by lines or by the state
-- of another part: as with the same motion written in their options, and as in closed form.
local tb = require "tribode"

local function near(found, wanted, tolerance, what)
  assert(math.abs(found - wanted) <= tolerance, string.format("%s: %.17g, not %.17g", what, found, wanted))
end

-- Samples of 1 ms, joined by lines.
local function lines(f)
  local values = {}
  for i = 0, 3000 do values[i + 1] = f(i * 1e-3) end
  return { sample_time_s = 1e-3, values = values, interpolation = "linear" }
end
local function there_and_back(t) return 2 * t - t ^ 2 end

local cases = {
  -- A block that sticks on a belt moves with it; the belt's acceleration of 0.5 takes far less than the level.
  { name = "a belt", motion = function(t) return 0.5 * t end, duration_s = 2, column = "v", value = 1, events = "",
    states = { x = 0, v = 0 },
    part = function(u) return tb.parts.coulomb { velocity = function(s) return s.v - u(s) end, level = 10 } end,
    der = function(s) return { x = s.v, v = -s.f.force } end },
  -- A ball on a platform that rises with 2.
  { name = "a platform", motion = function(t) return 2 * t end, duration_s = 2, column = "h", value = 4,
    events = "f.rests",
    states = { h = 0, v = 0 },
    part = function(u) return tb.parts.impact { gap = function(s) return s.h - u(s) end, restitution = 0 } end,
    der = function(s) return { h = s.v, v = -10 + s.f.force } end },
  -- Taken along from u = 0.5 on, left at u = 1, taken back from u = 0 on.
  { name = "play", motion = there_and_back, duration_s = 2.5, column = "f.output", value = -0.75,
    events = "f.takes along f.lets go f.takes along",
    part = function(u) return tb.parts.play { input = u, width = 1 } end },
  -- It slips with 5 from u = 0.5 on, and from the reversal at u = 1 on its force falls by 10 (1 - u).
  { name = "a Maxwell element", motion = there_and_back, duration_s = 1.5, column = "f.force", value = 2.5,
    events = "f.slips f.sticks",
    part = function(u) return tb.parts.maxwell { position = u, stiffness = 10, level = 5 } end },
  -- 10 (2 - 0.5), and 2 by the damper.
  { name = "backlash", motion = function(t) return 2 * t end, duration_s = 1, column = "f.force", value = 17,
    events = "f.touches",
    part = function(u) return tb.parts.backlash { distance = u, gap = 1, stiffness = 10, damping = 1 } end },
}
for _, case in ipairs(cases) do
  local function system(u)
    return tb.system { inputs = { u = 0 }, states = case.states, parts = { f = case.part(u) }, der = case.der }
  end
  local inside = system(function(s) return case.motion(s.t) end)
  local outside = system(function(s) return s.u end)
  -- A part of a system in which it is connected to a state, with the rate of the motion.
  local mover = tb.system { states = { x = 0 }, der = function(s)
    return { x = case.motion == there_and_back and 2 - 2 * s.t or case.motion(1) }
  end }
  local within = tb.system { parts = { a = outside, m = mover }, connect = function(s) return { ["a.u"] = s.m.x } end }
  for _, solver in ipairs { "exact", "erk" } do
    local function check(how, which, prefix, inputs, tolerance)
      local what = string.format("%s, %s, %s", case.name, how, solver)
      local run = tb.run_system { system = which, duration_s = case.duration_s, solver = solver, inputs = inputs }
      assert(run.ok, what .. ": " .. run.message)
      near(run.values[prefix .. case.column][#run.t], case.value, tolerance, what)
      local names = {}
      for i, event in ipairs(run.events) do names[i] = event.name:sub(#prefix + 1) end
      -- The speed of a motion that begins at once has to be reached first.
      if prefix == "" then assert(table.concat(names, " ") == case.events, what .. ": " .. table.concat(names, " ")) end
    end
    check("its own", inside, "", nil, 1e-9)
    check("a function", outside, "", { u = case.motion }, 1e-9)
    check("lines", outside, "", { u = lines(case.motion) }, case.motion == there_and_back and 1e-2 or 1e-9)
    check("a state", within, "a.", nil, 1e-6)
  end
end

-- A rate of change that depends on the force it gives.
local ok, message = pcall(tb.system, {
  states = { v = 0 },
  parts = { f = tb.parts.backlash { distance = "v", gap = 1, stiffness = 1, damping = 1 } },
  der = function(s) return { v = 1 - s.f.force } end,
})
assert(not ok and tostring(message):find("rate(v) needs itself", 1, true), tostring(message))
