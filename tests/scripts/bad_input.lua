-- What is wrong with tables, delays, steady states, vectors and continued runs is refused with one sentence.
local tb = require "tribode"

local function refused(message, make, ...)
  local ok, text = pcall(make, ...)
  assert(not ok, "it is accepted: " .. message)
  text = tostring(text)
  assert(text:find(message, 1, true) and not text:find "\n", text)
end
local nan = 0 / 0

-- ---- responses ----------------------------------------------------------------------------------------------------

local still, moving = {}, {}
for k = 1, 1024 do still[k], moving[k] = 0, math.sin(k * k) end
refused("input is the same number throughout", tb.frf, { input = still, output = moving, sample_time_s = 1 })
refused("excitation is the same number throughout", tb.frf,
  { input = moving, output = moving, excitation = still, sample_time_s = 1 })

-- ---- tables -------------------------------------------------------------------------------------------------------

local square = { { 1, 2 }, { 3, 4 } }
for _, case in ipairs {
  { { x = { 0, 1, 1, 2 }, y = { 1, 2, 3, 4 } }, "x[3] = 1 stands behind 1, the values of x must increase" },
  { { x = { 0, 2, 1 }, y = { 1, 2, 3 } }, "x[3] = 1 stands behind 2" },
  { { x = { 0 }, y = { 1 } }, "x has 1 values, must have at least 2" },
  { { x = { 0, 1 }, y = { 1, 2, 3 } }, "y has 3 values, must have 2, as x" },
  { { x = { 0, 1 } }, "y has 0 values" },
  { { x = { 0, 1 }, y = { 1, nan } }, "must be finite" },
  { { x = { 0, math.huge }, y = { 1, 2 } }, "x[2] = inf, must be finite" },
  { { x = { 0, "1" }, y = { 1, 2 } }, "x[2] = \"1\", must be a number" },
  { { x = { 0, 1 }, y = { 1, 2 }, interpolation = "cubic" }, "interpolation = \"cubic\", must be one of" },
  { { x = { 0, 1 }, y = { 1, 2 }, extrapolation = "clip" }, "extrapolation = \"clip\", must be one of" },
  { 3, "found a number, must be a table of options" },
} do refused(case[2], tb.table1, case[1]) end
for _, case in ipairs {
  { { x = { 0, 1, 2 }, y = { 0, 1 }, z = square }, "z has 2 rows, must have 3, one for each x" },
  { { x = { 0, 1 }, y = { 0, 1 }, z = { { 1, 2 }, { 3 } } }, "z[2] has 1 values, must have 2, one for each y" },
  { { x = { 0, 1 }, y = { 0, 1 }, z = { 1, 2 } }, "must be a list" },
  { { x = { 0, 1 }, y = { 1, 1 }, z = square }, "y[2] = 1 stands behind 1, the values of y must increase" },
  { { x = { 0, 1 }, y = { 0, 1 } }, "z must be a list of rows, one for each x" },
  { { x = { 0, 1 }, y = { 0, 1 }, z = square, interpolation = "pchip" }, "is for tables of one variable" },
} do refused(case[2], tb.table2, case[1]) end
local line = tb.table1 { x = { 0, 1 }, y = { 1, 2 } }
refused("lies beyond the abscissas, from 0 to 1", line, 3)
refused("argument x: found a string", line, "a")
refused("argument x: found a nil", line)

-- ---- delays -------------------------------------------------------------------------------------------------------

local function delayed(seconds, x)
  return tb.system {
    inputs = { u = 1 }, parameters = { T = 0.1 }, states = { x = 0 },
    der = function(s) return { x = tb.delay(x and x(s) or s.u, seconds(s)) - s.x } end,
  }
end
for _, seconds in ipairs { -1, math.huge, nan } do
  refused("must be finite and not negative", delayed, function() return seconds end)
end
refused("found a string, must be a number", delayed, function() return "a" end)
for _, name in ipairs { "x", "u", "t" } do
  refused("the delay " .. name .. " must be a number or a parameter", delayed, function(s) return s[name] end)
end
refused("depends on the state x", delayed, function() return 1 end, function(s) return s.x end)
refused("tb.delay belongs into an equation", tb.delay, 1, 1)
local by_parameter = delayed(function(s) return s.T end)
refused("the delay T is -0.5 s", tb.run_system, { system = by_parameter, duration_s = 1, parameters = { T = -0.5 },
  inputs = { u = math.sin } })
refused("T = inf, must be finite", tb.run_system, { system = by_parameter, duration_s = 1,
  parameters = { T = math.huge } })

-- ---- steady states ------------------------------------------------------------------------------------------------

local lag = tb.system { inputs = { u = 1 }, states = { x = 0 }, der = function(s) return { x = s.u - s.x } end }
local none = tb.system { states = { x = 0 }, der = function(s) return { x = 1 + s.x ^ 2 } end }
for _, case in ipairs {
  { {}, "system is missing" },
  { { system = lag, free = { "y" } }, "free names y, which is neither a state nor an input nor a parameter" },
  { { system = lag, free = { "x", "x" } }, "names x twice" },
  { { system = lag, free = 3 }, "free = 3, must be a list of texts" },
  { { system = lag, free = {} }, "no variable is free, must be one at least" },
  { { system = lag, free = { "x", "u" } }, "2 variables are free, must be at most" },
  { { system = lag, at = { y = 1 } }, "at: y is not a known field" },
  { { system = lag, at = { x = nan } }, "must be finite" },
  { { system = lag, inputs = { u = math.sin } }, "must be plain data" },
  { { system = none }, "no steady state is found from these values" },
} do refused(case[2], tb.steady_state, case[1]) end
refused("no steady state is found", tb.run_system, { system = none, duration_s = 1, start = "steady" })

-- ---- where a run begins -------------------------------------------------------------------------------------------

local run = tb.run_system { system = lag, duration_s = 1 }
for _, case in ipairs {
  { { start = "steedy" }, "start is \"steedy\", must be" },
  { { start = 3 }, "start is 3, must be" },
  { { start = true }, "start is true, must be" },
  { { start = { 1, 2 } }, "start is a list, must be" },
  { { start = run }, "is not a known field" },
  { { start = run.state }, "is not a known field" },
  { { start = { x = "a" } }, "x = \"a\", must be a number" },
  { { start = { x = math.huge } }, "x = inf, must be finite" },
  { { resume = run.final }, "resume is damaged or no state of a run" },
  { { resume = run }, "resume is damaged or no state of a run" },
  { { resume = "state.json" }, "resume is damaged or no state of a run" },
  { { resume = {} }, "resume is damaged or no state of a run" },
  { { resume = run.state, start = run.final }, "cannot stand beside resume" },
  { { start_time_s = -1 }, "start_time_s = -1 s, must be" },
  { { start_time_s = math.huge }, "start_time_s = inf s, must be" },
  { { end_time_s = 2 }, "duration_s and end_time_s" },
} do
  case[1].system, case[1].duration_s = lag, 1
  refused(case[2], tb.run_system, case[1])
end
refused("duration_s is missing", tb.run_system, { system = lag })
refused("end_time_s = 0.5 s, must be after the start at 1 s", tb.run_system,
  { system = lag, resume = run.state, end_time_s = 0.5 })
local thermostat = require "systems.thermostat"
refused("mode = \"hot\", must be one of heating, waiting", tb.run_system,
  { system = thermostat, duration_s = 1, start = { mode = "hot" } })
refused("mode = 1, must be a text", tb.run_system, { system = thermostat, duration_s = 1, start = { mode = 1 } })

-- ---- vectors ------------------------------------------------------------------------------------------------------

local function vector(x, der)
  return tb.system { states = { x = x }, der = der or function(s) return { x = s.x } end }
end
for _, case in ipairs {
  { { size = 0 }, "size = 0, must be a whole number" }, { { size = -1 }, "size = -1, must be a whole number" },
  { { size = 1.5 }, "size = 1.5, must be a whole number" }, { { size = 1e9 }, "must be a whole number" },
  { { size = "3" }, "size is a string" }, { { size = 2, start = { 1, 2, 3 } }, "start has 3 values, must have 2" },
  { { size = 2, start = { 1, "a" } }, "start of element 2 is a string" },
  { { size = 2, start = function() return "a" end }, "start of element 1 is a string" },
} do refused(case[2], vector, case[1]) end
for _, case in ipairs {
  { function(s) return { x = { s.x[1] } } end, "x has 1 values, must have 2" },
  { function() return { x = { 1, 2, 3 } } end, "x has 3 values, must have 2" },
  { function() return { x = 1 } end, "x is not a state (did you mean \"x[1]\"?)" },
  { function() return { ["x[1]"] = 1, ["x[3]"] = 1 } end, "x[3] is not a state" },
  { function(s) return { x = { s.x[0], 1 } } end, "x[0] is not there: x has the elements 1 to 2" },
  { function(s) return { x = { s.x[4], 1 } } end, "x[4] is not there" },
  { function(s) return { x = { s.x[s.x[1]], 1 } } end, "x is indexed by a symbolic value" },
} do refused(case[2], vector, { size = 2 }, case[1]) end
local two = vector { size = 2, start = { 1, 2 } }
for _, case in ipairs {
  { { 1 }, "start: x has 1 values, must have 2" }, { { 1, 2, 3 }, "start: x has 3 values, must have 2" },
  { 1, "start: x is not a known field (did you mean \"x[1]\"?)" },
} do refused(case[2], tb.run_system, { system = two, duration_s = 1, start = { x = case[1] } }) end
refused("at: x has 1 values, must have 2", tb.linearize, { system = two, at = { x = { 1 } } })
-- A vector of the system is a list that may be returned as it is.
local grown = tb.run_system { system = two, duration_s = 1 }
assert(math.abs(grown.final.x[2] - 2 * math.exp(1)) < 1e-12)
local inputs = tb.system { inputs = { u = { size = 2 } }, states = { x = 0 },
  der = function(s) return { x = s.u[1] + s.u[2] } end }
for _, u in ipairs { 1, { 1, 2, 3 } } do
  refused("inputs.u must be a list of 2 inputs", tb.run_system, { system = inputs, duration_s = 1, inputs = { u = u } })
end
refused("inputs.u[2] must be a finite number", tb.run_system,
  { system = inputs, duration_s = 1, inputs = { u = { 1, "a" } } })

-- ---- equations ----------------------------------------------------------------------------------------------------

refused("what is nil is none, such as a list at a symbolic value", tb.system,
  { states = { x = 0 }, der = function(s) local list = { 1, 2 } return { x = list[s.x] } end })
refused("a table that is indexed by a symbolic value gives nil", tb.system,
  { states = { x = 0 }, der = function(s) local list = { 1, 2 } return { x = 2 * list[s.x] } end })

-- A root has an infinite slope at zero; implicit methods go on from there.
for _, solver in ipairs { "erk", "adams", "bdf" } do
  local root = tb.system { states = { h = 0 }, der = function(s) return { h = 1 - s.h ^ 0.5 } end }
  local filled = tb.run_system { system = root, duration_s = 2, solver = solver }
  -- t = -2 (sqrt h + ln(1 - sqrt h))
  local q = math.sqrt(filled.final.h)
  assert(filled.ok and math.abs(-2 * (q + math.log(1 - q)) - 2) < 1e-5, solver .. filled.final.h)
end
local signed = tb.system { states = { h = 0 }, der = function(s)
  return { h = 0.5 - tb.no_event(tb.where(tb.less(s.h, 0), -1, 1) * math.abs(s.h) ^ 0.5) }
end }
for _, solver in ipairs { "erk", "bdf" } do
  local risen = tb.run_system { system = signed, duration_s = 20, solver = solver }
  assert(risen.ok and math.abs(risen.final.h - 0.25) < 1e-4, solver .. risen.final.h)
end
