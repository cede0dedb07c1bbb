-- Friction, impact, play and the like as parts that need no modes of one's own (tb.parts), against closed forms, the
-- modes of models/systems and the servo machine.
local tb = require "tribode"
local solvers = { "exact", "erk", "adams", "bdf", "fixed" }
-- How far results may be off: by rounding, by the tolerances, by a fixed step's lateness.
local off = { exact = 1e-12, erk = 1e-6, adams = 1e-6, bdf = 2e-5, fixed = 5e-3 }

local function near(found, wanted, tolerance, what)
  assert(math.abs(found - wanted) <= tolerance, string.format("%s: %.17g, not %.17g", what, found, wanted))
end
local function names(run)
  local list = {}
  for i, event in ipairs(run.events) do list[i] = event.name end
  return table.concat(list, " ")
end
-- By each solver, whether it may use `exact` or not; the last one is handed back.
local function each(options, check)
  for _, solver in ipairs(options.solvers or solvers) do
    local run = tb.run_system { system = options.system, duration_s = options.duration_s, solver = solver,
      start = options.start, parameters = options.parameters, inputs = options.inputs }
    assert(run.ok, solver .. ": " .. run.message)
    check(run, off[solver], solver)
  end
end

-- ---- dry friction -------------------------------------------------------------------------------------------------

-- It slides under 2 - t, stops while that is below -1 already, and slides back at once.
local block = tb.system {
  states = { x = 0, v = 2 },
  parameters = { Fc = 1, m = 1 },
  parts = { friction = tb.parts.coulomb { velocity = "v", level = "Fc" } },
  der = function(s) return { x = s.v, v = (2 - s.t - s.friction.force) / s.m } end,
}
each({ system = block, duration_s = 5 }, function(run, tolerance, what)
  local stop = 1 + math.sqrt(5)
  assert(names(run) == "friction.slips friction.sticks friction.slips", what .. names(run))
  near(run.events[2].t, stop, tolerance, what)
  near(run.final.v, 3 * (5 - stop) - (25 - stop ^ 2) / 2, tolerance, what)
end)

-- Up an incline: it stops, and stays there to the last bit where friction can hold it, else it slides down.
local g, angle = 9.81, 0.4
local function incline(mu)
  return tb.system {
    states = { x = 0, v = 3 },
    parameters = { m = 2, mu = mu },
    parts = { floor = tb.parts.coulomb { velocity = "v", unit = "N",
      level = function(s) return s.mu * s.m * g * math.cos(angle) end } },
    der = function(s) return { x = s.v, v = -g * math.sin(angle) - s.floor.force / s.m } end,
  }
end
for _, mu in ipairs { 0.5, 0.3 } do
  each({ system = incline(mu), duration_s = 2 }, function(run, tolerance, what)
    local brake, slide = g * (math.sin(angle) + mu * math.cos(angle)), g * (math.sin(angle) - mu * math.cos(angle))
    local stop = 3 / brake
    near(run.events[2].t, stop, tolerance, what)
    near(run.final.x, 4.5 / brake - math.max(0, slide) * (2 - stop) ^ 2 / 2, tolerance, what)
    if mu == 0.3 then return near(run.final.v, -slide * (2 - stop), tolerance, what) end
    assert(run.final.v == 0 and run.final["floor.mode"] == "stick", what)
    near(run.values["floor.force"][#run.t], -2 * g * math.sin(angle), 1e-12, what)
    for i, t in ipairs(run.t) do assert(t < stop + 1e-3 or run.values.x[i] == run.final.x, what) end
  end)
end

-- Under 2 sin t: free where it goes beyond 1, then by 2 (cos t0 - cos t) -+ (t - t0), whose zeros are found by halving.
local driven = tb.system {
  states = { x = 0, v = 0 },
  inputs = { F = 0 },
  parts = { friction = tb.parts.coulomb { velocity = "v", level = 1 } },
  der = function(s) return { x = s.v, v = s.F - s.friction.force } end,
}
local function stop_after(t0, side)
  local function v(t) return side * 2 * (math.cos(t0) - math.cos(t)) - (t - t0) end
  local low, high = t0 + 0.5, t0 + 6
  for _ = 1, 100 do
    local middle = (low + high) / 2
    if v(middle) > 0 then low = middle else high = middle end
  end
  return low
end
local stops, t0, side = {}, math.pi / 6, 1
for i = 1, 5 do
  stops[i] = stop_after(t0, side)
  t0, side = stops[i], -side
end
each({ system = driven, duration_s = 18, solvers = { "erk", "adams", "bdf", "fixed" }, inputs = { F = function(t)
  return 2 * math.sin(t)
end } }, function(run, tolerance, what)
  near(run.events[1].t, math.pi / 6, tolerance, what)
  assert(#run.events == 11, what)
  for i, stop in ipairs(stops) do near(run.events[2 * i].t, stop, 10 * tolerance, what) end
end)

-- A block on a belt, as the modes of models/systems/stick_slip: the same events to rounding.
local by_hand = tb.run_system { system = require "systems.stick_slip", duration_s = 10 }
local belt = tb.system {
  parameters = { m = 1, k = 100, d = 0.5, F_static = 10, F_slip = 6, belt = 0.1 },
  states = { x = 0, v = 0.1 },
  parts = { f = tb.parts.coulomb { velocity = function(s) return s.v - s.belt end, level = "F_slip",
    static = "F_static" } },
  der = function(s) return { x = s.v, v = (-s.k * s.x - s.d * s.v - s.f.force) / s.m } end,
}
each({ system = belt, duration_s = 10 }, function(run, tolerance, what)
  assert(#run.events == #by_hand.events and #run.events == 17, what)
  for i, event in ipairs(by_hand.events) do
    assert(run.events[i].name == "f." .. event.name)
    if what ~= "fixed" then near(run.events[i].t, event.t, tolerance, what) end
  end
end)

-- Two blocks in series: the upper one drags the lower, they stick, both stop and rest. Then with the ground let go:
-- their momentum stays.
local two = tb.system {
  states = { x1 = 0, v1 = 0, x2 = 0, v2 = 3 },
  parameters = { m1 = 1, m2 = 2, F1 = 2, F2 = 5 },
  parts = {
    ground = tb.parts.coulomb { velocity = "v1", level = "F1" },
    between = tb.parts.coulomb { velocity = function(s) return s.v2 - s.v1 end, level = "F2" },
  },
  der = function(s)
    return { x1 = s.v1, v1 = (s.between.force - s.ground.force) / s.m1, x2 = s.v2, v2 = -s.between.force / s.m2 }
  end,
}
each({ system = two, duration_s = 5 }, function(run, tolerance, what)
  near(run.events[3].t, 6 / 11, tolerance, what)
  near(run.events[4].t, 3, tolerance, what)
  assert(run.final.v1 == 0 and run.final.v2 == 0, what)
  local common = 18 / 11 * 27 / 11 / 2
  near(run.final.x1, 18 / 11 * 6 / 11 / 2 + common, tolerance, what)
  near(run.final.x2, (3 + 18 / 11) * 6 / 11 / 2 + common, tolerance, what)
end)
each({ system = two, duration_s = 5, parameters = { F1 = 0 } }, function(run, tolerance, what)
  near(run.final.v1, 2, tolerance, what)
  assert(run.final.v1 == run.final.v2 or what == "bdf" or what == "adams", what)
end)

-- A train of wagons on a rough ground, coupled by dry friction, and of two that are one system, part of another.
local wagon = tb.system {
  inputs = { pull = 0 },
  states = { x = 0, v = 1 },
  parts = { ground = tb.parts.coulomb { velocity = "v", level = 0.5 } },
  der = function(s) return { x = s.v, v = s.pull - s.ground.force } end,
}
local train = tb.system {
  parts = { a = wagon, b = wagon, rope = tb.parts.coulomb { level = 10,
    velocity = function(s) return s.a.v - s.b.v end } },
  connect = function(s) return { ["a.pull"] = 4 - s.rope.force, ["b.pull"] = s.rope.force } end,
}
each({ system = train, duration_s = 2 }, function(run, tolerance, what)
  near(run.final["a.v"], 1 + (4 - 1) / 2 * 2, tolerance, what) -- both under 4 - 2 * 0.5
  near(run.final["b.v"], run.final["a.v"], math.max(tolerance, 1e-15), what)
  near(run.values["rope.force"][500], 2, tolerance, what)
end)

-- A brake beside the bearing, on one shaft: they brake with both levels, and hold up to their sum.
-- How they share the load is open.
local shaft = tb.system {
  states = { w = 3 },
  inputs = { M = 0 },
  parts = { bearing = tb.parts.coulomb { velocity = "w", level = 1 },
    brake = tb.parts.coulomb { velocity = "w", level = 2.5 } },
  der = function(s) return { w = s.M - s.bearing.force - s.brake.force } end,
}
each({ system = shaft, duration_s = 2 }, function(run, _, what)
  near(run.events[#run.events].t, 3 / 3.5, off[what], what)
  assert(run.final.w == 0, what)
end)
-- Loaded up to 3.4 and back to nothing, and then beyond 3.5 at t = 3.5 s.
for _, load in ipairs { { function(t) return 3.4 * math.sin(t) end, 10, 0 },
  { function(t) return t end, 4, 0.5 ^ 2 / 2 } } do
  each({ system = shaft, start = { w = 0 }, duration_s = load[2], inputs = { M = load[1] },
    solvers = { "erk", "adams", "bdf", "fixed" } }, function(run, tolerance, what)
    near(run.final.w, load[3], tolerance, what)
  end)
end

-- Maxwell-slip elements with dry friction are the servo machine's rolling friction.
local elements = { { K = 1e5, F = 0.5 }, { K = 3e4, F = 1 }, { K = 1e4, F = 0.7 } }
local function as_machine(static, solver, tolerance)
  local parts = {}
  for i, e in ipairs(elements) do
    parts["e" .. i] = tb.parts.maxwell { position = "x", stiffness = e.K, level = e.F }
  end
  parts.dry = tb.parts.coulomb { velocity = "v", level = 1.5, static = static,
    stribeck_velocity = static and 0.01, exponent = static and 1.5 }
  local axis = tb.system {
    states = { x = 0, v = 0 }, inputs = { u = 0 }, parts = parts,
    der = function(s)
      local rolling = s.e1.force + s.e2.force + s.e3.force
      return { x = s.v, v = 0.1 * (s.u - rolling - s.dry.force - 10 * s.v) }
    end,
  }
  local u, Ts = {}, 1e-3
  for k = 0, 600 do
    u[k + 1] = 15 * math.sin(2 * math.pi * 11 * k * Ts) + 5 * math.cos(2 * math.pi * 37 * k * Ts)
  end
  local machine = { Ts = Ts, rigid_gain_per_kg = 0.1, friction = { viscous = 10, coulomb = 1.5, elements = elements } }
  if static then machine.effects = { { name = "stribeck_friction",
    parameters = { dFs = static - 1.5, velocity = 0.01, exponent = 1.5 } } } end
  local built_in = tb.simulate { machine = machine, u = u, solver = solver, relative_tolerance = tolerance,
    absolute_tolerance_m = tolerance and tolerance * 1e-3 }
  local run = tb.run_system { system = axis, duration_s = 0.6, output_step_s = Ts, solver = solver,
    inputs = { u = { sample_time_s = Ts, values = u } }, relative_tolerance = tolerance,
    absolute_tolerance = tolerance and tolerance * 1e-3 }
  assert(run.ok and built_in.ok, run.message)
  local worst = 0
  for k, x in ipairs(run.values.x) do
    worst = math.max(worst, math.abs(x - built_in.x[k]), math.abs(run.values.v[k] - built_in.v[k]))
  end
  return worst, run
end
local worst, rolling = as_machine(nil, "exact")
assert(worst < 1e-14 and #rolling.events == 100, worst)
assert(as_machine(nil, "erk", 1e-10) < 1e-10)
assert(as_machine(2.5, "erk", 1e-10) < 1e-9)

-- ---- impact -------------------------------------------------------------------------------------------------------

-- A ball comes to rest after the first impact from which it would rise slower than rest_speed, at h = 0 and v = 0.
local function ball(rest_speed)
  return tb.system {
    states = { h = 1, v = 0 },
    parameters = { m = 0.5, e = 0.7 },
    parts = { floor = tb.parts.impact { gap = "h", restitution = "e", rest_speed = rest_speed } },
    der = function(s) return { h = s.v, v = -g + s.floor.force / s.m } end,
  }
end
for _, rest_speed in ipairs { 0.1, 1e-2, false } do
  local limit = rest_speed or 1e-3
  local speed, time, count = math.sqrt(2 * g), math.sqrt(2 / g), 1
  while 0.7 * speed >= limit do
    speed = 0.7 * speed
    time, count = time + 2 * speed / g, count + 1
  end
  each({ system = ball(rest_speed or nil), duration_s = 5 }, function(run, tolerance, what)
    assert(run.final.h == 0 and run.final.v == 0 and run.events[#run.events].name == "floor.rests", what)
    if what == "fixed" then return end
    assert(#run.events == count, what .. #run.events)
    near(run.events[#run.events].t, time, tolerance, what)
    near(run.values["floor.force"][#run.t], 0.5 * g, 1e-12, what)
    for _, h in ipairs(run.values.h) do assert(h >= -1e-7, what) end
  end)
end
-- Kicked while it rests, it flies; a run that is continued rests on.
local rests = tb.run_system { system = ball(0.1), duration_s = 4 }
local on = tb.run_system { system = ball(0.1), resume = rests.state, end_time_s = 5 }
assert(#on.events == 0 and on.final.h == 0)
local kicked = tb.run_system { system = ball(0.1), start = { h = 0, v = 1, ["floor.mode"] = "rest" }, duration_s = 0.1 }
near(kicked.final.h, 0.1 - g * 0.005, 1e-12, "kicked")
assert(names(kicked) == "floor.leaves")
-- It is lifted by a force that grows beyond its weight at t = 1, and begins on the floor.
local lifted = tb.system {
  states = { h = 0, v = 0 },
  parts = { floor = tb.parts.impact { gap = "h", restitution = 0.5 } },
  der = function(s) return { h = s.v, v = 10 * s.t - 10 + s.floor.force } end,
}
each({ system = lifted, duration_s = 2 }, function(run, tolerance, what)
  near(run.events[#run.events].t, 1, tolerance, what)
  near(run.final.h, 10 / 6, tolerance, what)
end)

-- Friction whose level is the normal force: sliding ends mu g after the first rest.
local thrown = tb.system {
  states = { x = 0, vx = 2, h = 0.5, v = 0 },
  parameters = { mu = 0.3 },
  parts = {
    floor = tb.parts.impact { gap = "h", restitution = 0 },
    friction = tb.parts.coulomb { velocity = "vx", level = function(s) return s.mu * s.floor.force end },
  },
  der = function(s) return { x = s.vx, vx = -s.friction.force, h = s.v, v = -g + s.floor.force } end,
}
each({ system = thrown, duration_s = 3 }, function(run, tolerance, what)
  near(run.final.x, 2 * math.sqrt(1 / g) + 4 / (2 * 0.3 * g), tolerance, what)
  assert(run.final.vx == 0 and run.final.v == 0 and run.final.h == 0, what)
end)

-- A ball strikes a block that sticks: it slides, and stops after v^2 m/(2 Fc). Masses 1 and 2, e = 0.5.
local struck = tb.system {
  states = { x1 = 0, v1 = 3, x2 = 1, v2 = 0 },
  parts = {
    contact = tb.parts.impact { gap = function(s) return s.x2 - s.x1 end, restitution = 0.5 },
    ground = tb.parts.coulomb { velocity = "v2", level = 4 },
  },
  der = function(s)
    return { x1 = s.v1, v1 = -s.contact.force, x2 = s.v2, v2 = (s.contact.force - s.ground.force) / 2 }
  end,
}
each({ system = struck, duration_s = 2 }, function(run, tolerance, what)
  assert(names(run) == "contact.impact ground.sticks", what .. names(run))
  near(run.final.v1, 0, tolerance, what)
  near(run.final.x2, 1 + 1.5 ^ 2 * 2 / 8, tolerance, what)
end)

-- Elastic balls in a row hand the motion on; boxes that fall on one another come to rest as a stack.
local cradle = tb.system {
  states = { x1 = 0, v1 = 1, x2 = 1, v2 = 0, x3 = 2, v3 = 0 },
  parts = {
    a = tb.parts.impact { gap = function(s) return s.x2 - s.x1 - 0.5 end, restitution = 1 },
    b = tb.parts.impact { gap = function(s) return s.x3 - s.x2 - 0.5 end, restitution = 1 },
    wall = tb.parts.impact { gap = function(s) return 3 - s.x3 end, restitution = 1 },
  },
  der = function(s)
    return { x1 = s.v1, v1 = -s.a.force, x2 = s.v2, v2 = s.a.force - s.b.force, x3 = s.v3,
      v3 = s.b.force - s.wall.force }
  end,
}
each({ system = cradle, duration_s = 3.9 }, function(run, tolerance, what)
  assert(names(run) == "a.impact b.impact wall.impact b.impact a.impact", what)
  near(run.final.x1, 0.1, tolerance, what)
  near(run.final.v1, -1, tolerance, what)
end)
local stack = tb.system {
  states = { h1 = 0.5, v1 = 0, h2 = 1.5, v2 = 0 },
  parts = {
    lower = tb.parts.impact { gap = "h1", restitution = 0.5 },
    upper = tb.parts.impact { gap = function(s) return s.h2 - s.h1 - 0.1 end, restitution = 0.3 },
  },
  der = function(s)
    return { h1 = s.v1, v1 = -g + (s.lower.force - s.upper.force) / 2, h2 = s.v2, v2 = -g + s.upper.force / 3 }
  end,
}
each({ system = stack, duration_s = 3 }, function(run, _, what)
  assert(run.final.h1 == 0 and run.final.h2 == 0.1 and run.final.v1 == 0 and run.final.v2 == 0, what)
  near(run.values["upper.force"][#run.t], 3 * g, 1e-12, what)
  near(run.values["lower.force"][#run.t], 5 * g, 1e-12, what)
end)

-- Surfaces that are no plane: a ball in a bowl, x^2 + y^2 = 1. It comes to slide in it, and never through.
local bowl = tb.system {
  states = { x = 0.3, vx = 0, y = 0.2, vy = 0 },
  parts = { wall = tb.parts.impact { gap = function(s) return 1 - s.x ^ 2 - s.y ^ 2 end, restitution = 0.6 } },
  der = function(s)
    return { x = s.vx, vx = -2 * s.x * s.wall.force, y = s.vy, vy = -g - 2 * s.y * s.wall.force }
  end,
  outputs = function(s) return { energy = (s.vx ^ 2 + s.vy ^ 2) / 2 + g * s.y, radius = s.x ^ 2 + s.y ^ 2 } end,
}
each({ system = bowl, duration_s = 4, solvers = { "erk", "adams", "bdf" } }, function(run, tolerance, what)
  assert(run.final["wall.mode"] == "rest", what)
  for _, radius in ipairs(run.values.radius) do assert(radius <= 1 + 10 * tolerance, what .. radius) end
  -- Without friction it swings on: as much energy at the end as when it came to rest.
  local from
  for i, mode in ipairs(run.values["wall.mode"]) do from = from or mode == 1 and i or nil end
  near(run.values.energy[#run.t], run.values.energy[from], 10 * tolerance, what)
end)

-- ---- play, relay, backlash ----------------------------------------------------------------------------------------

-- Play of half a width 1 behind 3 sin t: it follows one behind, and holds from each top on.
local dragged = tb.system {
  states = { x = 0, v = 3 },
  parts = { p = tb.parts.play { input = "x", width = 2 } },
  der = function(s) return { x = s.v, v = -s.x } end,
}
each({ system = dragged, duration_s = 12 }, function(run, tolerance, what)
  assert(#run.events == 8, what .. names(run))
  for i, t in ipairs(run.t) do
    local x = 3 * math.sin(t)
    local want
    if t < math.asin(1 / 3) then
      want = 0
    elseif t % (2 * math.pi) < math.pi / 2 then
      want = math.max(x - 1, t < math.pi / 2 and 0 or -2)
    elseif t % (2 * math.pi) < 1.5 * math.pi then
      want = math.min(x + 1, 2)
    else
      want = math.max(x - 1, -2)
    end
    near(run.values["p.output"][i], want, what == "exact" and 1e-11 or 10 * tolerance, what .. t)
  end
end)
local sampled = tb.system { inputs = { u = 0 }, parts = { p = tb.parts.play { input = "u", width = 2 } } }
local steps = tb.run_system { system = sampled, duration_s = 5.5, output_step_s = 0.5,
  inputs = { u = { sample_time_s = 1, values = { 0, 3, 2.5, 1.5, -1, 5 } } } }
assert(table.concat(steps.values["p.output"], " ") == "0.0 0.0 0.0 2.0 2.0 2.0 2.0 2.0 2.0 0.0 0.0 4.0")

-- A thermostat: from 22 down to 20 in ln(12/10)/0.5 without heat, up in ln(6/4)/0.5 with it.
local room = tb.system {
  states = { T = 18 },
  parts = { cool = tb.parts.relay { input = "T", on = 22, off = 20, high = 0, low = 8 } },
  der = function(s) return { T = 0.5 * (10 - s.T) + s.cool.output } end,
}
each({ system = room, duration_s = 6 }, function(run, tolerance, what)
  local t = 2 * math.log(8 / 4)
  for i, event in ipairs(run.events) do
    assert(event.name == (i % 2 == 1 and "cool.on" or "cool.off"))
    near(event.t, t, 10 * tolerance, what)
    t = t + 2 * (i % 2 == 1 and math.log(12 / 10) or math.log(6 / 4))
  end
  assert(#run.events >= 8)
end)

-- A mass between two springs that it does not touch at first: half a period is gap/v + pi/w.
local between = tb.system {
  states = { x = 0, v = 0.5 },
  parts = { gear = tb.parts.backlash { distance = "x", gap = 0.1, stiffness = 400 } },
  der = function(s) return { x = s.v, v = -s.gear.force / 4 } end,
}
each({ system = between, duration_s = 3 }, function(run, tolerance, what)
  local t = 0.1
  for i, event in ipairs(run.events) do
    assert(event.name == (i % 2 == 1 and "gear.touches" or "gear.leaves"))
    near(event.t, t, 10 * tolerance, what)
    t = t + (i % 2 == 1 and math.pi / 10 or 0.2)
  end
  assert(#run.events == 12, what .. #run.events)
end)
-- With damping: the modes of models/systems/two_mass_drive.
local drive = require "systems.two_mass_drive"
local p = {}
for _, parameter in ipairs(tb.system_variables { system = drive }.parameters) do p[parameter.name] = parameter.value end
local gears = tb.system {
  inputs = { speed = 10, load = 0 },
  states = { w1 = 0, w2 = 0, phi = 0 },
  discrete = { u = 0, integral = 0 },
  parts = { shaft = tb.parts.backlash { distance = "phi", gap = p.gap, stiffness = p.k, damping = p.d } },
  der = function(s)
    local M = s.shaft.force
    return { w1 = (s.u - M - p.d1 * s.w1) / p.J1, w2 = (M - p.d2 * s.w2 - s.load) / p.J2, phi = s.w1 - s.w2 }
  end,
  sample = { { period_s = p.period, set = function(s)
    local e = s.speed - s.w1
    local integral = s.integral + p.ki * p.period * e
    return { integral = integral, u = p.kp * e + integral }
  end } },
}
local modes = tb.run_system { system = drive, duration_s = 0.2 }
local part = tb.run_system { system = gears, duration_s = 0.2 }
assert(part.solver == "exact" and #part.events == #modes.events and #part.events == 4)
for i, event in ipairs(modes.events) do near(part.events[i].t, event.t, 1e-12, "two masses") end
for _, name in ipairs { "phi", "w1", "w2", "u" } do near(part.final[name], modes.final[name], 1e-10, name) end

-- ---- bad input ----------------------------------------------------------------------------------------------------

local function refused(message, make, ...)
  local ok, text = pcall(make, ...)
  assert(not ok and tostring(text):find(message, 1, true), tostring(text))
end
local function with(parts, rates)
  return {
    states = { x = 0, v = 0 }, parameters = { m = { value = 1, unit = "kg" } }, parts = parts,
    der = rates or function(s) return { x = s.v, v = -s.f.force } end,
  }
end
refused("tb.parts.coulomb: level is missing", tb.parts.coulomb, { velocity = "v" })
refused("tb.parts.coulomb: levle", tb.parts.coulomb, { velocity = "v", levle = 1 })
refused("tb.parts.play: found a number", tb.parts.play, 3)
refused("tb.parts.play: width is a boolean", tb.parts.play, { input = "x", width = true })
refused("parts.f: velocity: w is not a variable", tb.system,
  with { f = tb.parts.coulomb { velocity = "w", level = 1 } })
refused("parts.f: level is -1 at the start, must not be negative", tb.system,
  with { f = tb.parts.coulomb { velocity = "v", level = -1 } })
refused("parts.f: static is below level", tb.system,
  with { f = tb.parts.coulomb { velocity = "v", level = 2, static = 1 } })
refused("parts.f: stribeck_velocity needs the static level", tb.system,
  with { f = tb.parts.coulomb { velocity = "v", level = 2, stribeck_velocity = 1 } })
refused("parts.f: restitution is 1.5 at the start, must be from 0 to 1", tb.system,
  with({ f = tb.parts.impact { gap = "x", restitution = 1.5 } },
    function(s) return { x = s.v, v = s.f.force } end))
refused("parts.f: f.force must lower the rate of change of its velocity, but changes it by 1", tb.system,
  with({ f = tb.parts.coulomb { velocity = "v", level = 1 } }, function(s) return { x = s.v, v = s.f.force } end))
refused("parts.f: f.force must raise", tb.system, with { f = tb.parts.impact { gap = "x", restitution = 0 } })
refused("parts.f: f.force must raise", tb.system,
  with({ f = tb.parts.impact { gap = "x", restitution = 0 } }, function(s) return { x = s.v, v = 0 } end))
refused("is not linear in f.force", tb.system, with({ f = tb.parts.coulomb { velocity = "v", level = 1 } },
  function(s) return { x = s.v, v = -s.f.force - s.f.force ^ 3 } end))
refused("must be in kg m/s2", tb.system,
  with { f = tb.parts.coulomb { velocity = "v", level = "m", unit = "N" } })
refused("parts.f: on is below off", tb.system, with({ f = tb.parts.relay { input = "x", on = 1, off = 2 } },
  function(s) return { x = s.v, v = s.f.output } end))
refused("or one of tb.parts", tb.system, with { f = { level = 1 } })
refused("parts.f: gap is -1 at the start", tb.system, with { f = tb.parts.backlash { distance = "x", gap = -1,
  stiffness = 1 } })
-- A friction force that is never used acts on nothing.
refused("must lower the rate of change", tb.system,
  with({ f = tb.parts.coulomb { velocity = "v", level = 1 } }, function(s) return { x = s.v, v = 0 } end))

-- Linearized in a mode; where the part leaves it at once, there is no linear system.
local sliding = { v = 0.5, ["friction.mode"] = "forward" }
local viscous = tb.system {
  states = { x = 0, v = 0 }, inputs = { F = 0 },
  parts = { friction = tb.parts.coulomb { velocity = "v", level = 1 } },
  der = function(s) return { x = s.v, v = (s.F - s.friction.force - 3 * s.v) / 2 } end,
}
local linear = tb.linearize { system = viscous, at = sliding }
assert(linear.A[1][1] == -1.5 and linear.B[1][1] == 0.5)
linear = tb.linearize { system = viscous }
assert(linear.A[1][1] == 0 and linear.B[1][1] == 0)
refused("friction.slips happens there at once", tb.linearize, { system = viscous, at = { v = 0.5 } })
