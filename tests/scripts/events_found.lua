-- Events within a step: random systems whose events are known in closed form, most of them far shorter than the steps
-- of a solver, of which none may be missed. `count` systems of each kind; 2500 make the 10,000 of
-- docs/hybrid-simulation.md.
local tb = require "tribode"
local o = tb.options { count = 40 }

-- A generator of its own, so that the systems are the same everywhere.
local seed = 1
local function random(low, high)
  seed = (seed * 48271) % 2147483647
  return low + (high - low) * seed / 2147483647
end
local function random_power(low, high) return 10 ^ random(low, high) end

-- Each returns a system, its duration and the instants at which its event becomes true, in order.
local kinds = {}

-- A sine of the time over a level near its maximum: the state does not see it, pulses of 1e-1 to 1e-5 of a period.
function kinds.pulses(state)
  local w, phase, level = random_power(0, 4), random(-1, 1), 1 - random_power(-9, -1)
  local first = (math.asin(level) - phase) / w
  local duration, instants = random(2, 30) * 2 * math.pi / w, {}
  for k = 0, 40 do
    local t = first + k * 2 * math.pi / w
    if t > 0 and t < duration then instants[#instants + 1] = t end
  end
  return state(function(s) return tb.greater(math.sin(w * s.t + phase), level) end), duration, instants
end

-- A short bump anywhere in a long time.
function kinds.bump(state)
  local duration = random_power(0, 3)
  local at, width = random(0.1, 0.9) * duration, random_power(-7, -2) * duration
  return state(function(s) return tb.greater(math.exp(-((s.t - at) / width) ^ 2), 0.5) end), duration,
    { at - width * math.sqrt(math.log(2)) }
end

-- Two zeros of a polynomial in a state, 1e-8 to 1e-1 of the duration apart: x = t.
function kinds.pair(state)
  local duration = random_power(-3, 3)
  local a, gap = random(0.1, 0.8) * duration, random_power(-8, -1) * duration
  return state(function(s) return tb.less((s.x - a) * (s.x - a - gap), 0) end), duration, { a }
end

-- The top of an oscillation of two states over a level just below it.
function kinds.tops()
  local w, level = random_power(-2, 2), 1 - random_power(-7, -1)
  local half = math.acos(level) / w -- before each top
  local duration, instants = random(3, 12) * 2 * math.pi / w, {}
  for k = 1, 12 do
    local t = k * 2 * math.pi / w - half
    if t < duration then instants[#instants + 1] = t end
  end
  return tb.system {
    states = { y = 1, z = 0, n = 0 },
    der = function(s) return { y = w * s.z, z = -w * s.y, n = 1e-9 * s.n ^ 2 } end, -- n: it is not affine
    when = { { condition = function(s) return tb.greater(s.y, level) end } },
  }, duration, instants, true
end

local function moving_slowly(condition)
  return tb.system {
    states = { x = 0, n = 0 },
    der = function(s) return { x = 1, n = 1e-9 * s.n ^ 2 } end,
    when = { { condition = condition } },
  }
end

local systems, events, steps = 0, 0, 0
for _, kind in ipairs { "pulses", "bump", "pair", "tops" } do
  for i = 1, o.count do
    local system, duration, instants, by_state = kinds[kind](moving_slowly)
    for _, solver in ipairs { "erk", "adams", "bdf" } do
      local run = tb.run_system { system = system, duration_s = duration, output_step_s = duration, solver = solver,
        relative_tolerance = 1e-9, absolute_tolerance = 1e-12 }
      assert(run.ok, run.message)
      -- By a state, an event is where the solver's own trajectory has it: those at a top of the wave within its error
      -- of the level are not certain.
      local list = string.format("%s %d by %s: %d of %d events", kind, i, solver, #run.events, #instants)
      if not by_state then
        assert(#run.events == #instants, list)
        for k, event in ipairs(run.events) do
          assert(math.abs(event.t - instants[k]) < 1e-9 * duration, string.format("%s, %.17g", list, event.t))
        end
      elseif solver == "erk" then
        assert(#run.events == #instants, list)
      end
      events = events + #run.events
      steps = steps + run.statistics.steps
    end
    systems = systems + 1
  end
end
print(string.format("%d systems by three solvers: %d events in %d steps", systems, events, steps))
