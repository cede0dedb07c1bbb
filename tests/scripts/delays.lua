-- tb.delay of inputs and functions of the time, and what an equation cannot contain.
local tb = require "tribode"

local check = require "lib.check"
local near, refused = check.near, check.refused

-- x' = u(t - tau), so x is the integral of u up to then; before t = 0 the input has its own value, 7.
local delayed = tb.system {
  parameters = { tau = { value = 0.3, unit = "s" } },
  inputs = { u = { value = 7, unit = "m/s" } },
  states = { x = { unit = "m" }, y = { unit = "m" } },
  der = function(s) return { x = tb.delay(s.u, s.tau), y = s.u } end,
  outputs = function(s) return { seen = { tb.delay(2 * s.u, 0.1), unit = "m/s" }, soon = tb.delay(s.t ^ 2, 0.5) } end,
}
for _, solver in ipairs { "erk", "bdf" } do
  local run = tb.run_system { system = delayed, duration_s = 2, inputs = { u = math.sin }, solver = solver,
    output_step_s = 0.25 }
  near(run.final.x, 7 * 0.3 + 1 - math.cos(1.7), 1e-7, solver)
  near(run.final.y, 1 - math.cos(2), 1e-7, solver)
  for i, t in ipairs(run.t) do
    near(run.values.seen[i], t < 0.1 and 14 or 2 * math.sin(t - 0.1), 1e-14)
    near(run.values.soon[i], (t - 0.5) ^ 2, 1e-14)
  end
end
-- A jump of the input comes exactly when it should, by `exact` too.
local run = tb.run_system { system = delayed, duration_s = 2, inputs = { u = function(t) return 1 + t end } }
assert(run.solver == "exact")
near(run.final.x, 7 * 0.3 + 1.7 + 1.7 ^ 2 / 2, 1e-14)
run = tb.run_system { system = delayed, duration_s = 2, parameters = { tau = 0 }, inputs = { u = math.sin } }
near(run.final.x, run.final.y, 1e-12)
-- A number has always been there.
run = tb.run_system { system = delayed, duration_s = 2, inputs = { u = 4 } }
near(run.final.x, 8, 1e-14)
near(tb.run_system { system = delayed, duration_s = 2 }.final.x, 14, 1e-14)
-- Samples, held and joined by lines: 1, 3, 2 from t = 0.4 s on, one each second.
for between, wanted in pairs { hold = 7 * 0.7 + 1 + 3 + 2 * 0.3, linear = 7 * 0.7 + 2 + 2.5 + 2 * 0.3 } do
  run = tb.run_system { system = delayed, duration_s = 3, output_step_s = 0.1,
    inputs = { u = { sample_time_s = 1, offset_s = 0.4, values = { 1, 3, 2 }, interpolation = between } } }
  assert(run.solver == "exact")
  near(run.final.x, wanted, 1e-13, between)
  near(run.final.y, wanted + 0.3 * (2 - 7), 1e-13, between)
end
-- A run that begins later, and one that is continued in the delay, see what was there before.
run = tb.run_system { system = delayed, start_time_s = 1, duration_s = 1, inputs = { u = math.sin } }
near(run.final.x, math.cos(0.7) - math.cos(1.7), 1e-7)
local u = { sample_time_s = 0.25, values = { 1, 3, 2, 5, 4, 0 }, interpolation = "linear" }
local whole = tb.run_system { system = delayed, duration_s = 2, inputs = { u = u } }
local first = tb.run_system { system = delayed, duration_s = 0.21, inputs = { u = u } }
local second = tb.run_system { system = delayed, end_time_s = 2, inputs = { u = u }, resume = first.state }
near(second.final.x, whole.final.x, 1e-14)
near(tb.run_system { system = delayed, start_time_s = 0.21, end_time_s = 2, inputs = { u = u },
  start = first.final }.final.x, whole.final.x, 1e-13)
-- Delays of delays add up, in parts too, where an input becomes another one.
local part = tb.system { inputs = { a = 0 }, states = { z = 0 },
  der = function(s) return { z = tb.delay(s.a + 3 * tb.delay(s.a, 0.1), 0.2) } end }
local both = tb.system { parts = { p = part, q = part }, inputs = { w = 0 },
  connect = function(s) return { ["p.a"] = tb.delay(s.w, 0.5), ["q.a"] = 2 * s.w } end }
run = tb.run_system { system = both, duration_s = 2, inputs = { w = function(t) return t end } }
near(run.final["p.z"], 1.3 ^ 2 / 2 + 3 * 1.2 ^ 2 / 2, 1e-14)
near(run.final["q.z"], 1.8 ^ 2 + 3 * 1.7 ^ 2, 1e-14)
-- A delayed input in a condition: it is an event.
local switch = tb.system { inputs = { u = 0 }, discrete = { on = 0 },
  when = { { name = "on", condition = function(s) return tb.greater(tb.delay(s.u, 0.25), 0.5) end,
    set = function() return { on = 1 } end } } }
run = tb.run_system { system = switch, duration_s = 2, inputs = { u = function(t) return t ^ 2 end }, solver = "erk" }
near(run.events[1].t, 0.25 + math.sqrt(0.5), 1e-13)
-- No linear system has a delay, and says so.
local linear = tb.linearize { system = delayed }
assert(linear.left_out[1]:find("delay(u, tau)", 1, true) and linear.B[1][1] == 1)
near(tb.steady_state { system = tb.system { inputs = { u = 3 }, states = { x = 0 },
  der = function(s) return { x = tb.delay(s.u, 1) - s.x } end } }.start.x, 3, 1e-14)

-- What is refused.
local function with(der, more)
  return function()
    local fields = { name = "s", inputs = { u = 0 }, states = { x = 0 }, parameters = { T = 1 }, der = der }
    return tb.run_system { system = tb.system(fields), duration_s = 1, parameters = more }
  end
end
refused("tb.delay: the delay is -0.1 s, must be finite and not negative",
  with(function(s) return { x = tb.delay(s.u, -0.1) } end))
refused("the delay T is -2 s, must be finite and not negative",
  with(function(s) return { x = tb.delay(s.u, s.T) } end, { T = -2 }))
refused("the delay t must be a number or a parameter", with(function(s) return { x = tb.delay(s.u, s.t) } end))
refused("tb.delay of 2*x, which depends on the state x", with(function(s) return { x = tb.delay(2 * s.x, 0.1) } end))
refused("which depends on the state p.z", function()
  tb.system { parts = { p = part }, connect = function(s) return { ["p.a"] = s.p.z } end }
end)
refused("needs a time, but", function()
  tb.system { inputs = { u = { unit = "m" } }, states = { x = 0 },
    der = function(s) return { x = tb.delay(s.u, s.u) } end }
end)
refused("tb.delay belongs into an equation", function() tb.delay(1, 2) end)
refused("tb.delay belongs into an equation", function()
  tb.system { inputs = { u = 0 }, discrete = { d = 0 },
    sample = { { period_s = 1, call = function(s) return { d = tb.delay(s.u, 1) } end } } }
end)
-- What gives another number at each call is recorded once only, so it is refused.
refused("math.random would give one number for the whole run", with(function() return { x = math.random() } end))
refused("os.clock and os.time would give one number", with(function() return { x = os.clock() } end))
refused("tb.standard_normal would give one number", with(function() return { x = tb.standard_normal(1, 1, 1) } end))
refused("math.random would give", function()
  tb.run_system { system = delayed, duration_s = 1, inputs = { u = function() return math.random() end } }
end)
assert(math.random() < 1 and os.time() > 0)
print("ok")
