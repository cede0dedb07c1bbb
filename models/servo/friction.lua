-- All friction at the driven point of an axis: Maxwell-slip elements, eqs. (11)-(15), viscous and dry friction.
--
--   f = c(t, y) (sum f_i + D_v v + f_dry)
--   f_i = K_i z_i + D_i v with z_i' = v in stick, +-F_i in slip; slips at abs(z_i) = X_i = F_i/K_i, sticks at v = 0
--   f_dry = +-(level + (static - level) exp(-(abs(v)/velocity)^exponent)) in slip; while the axis is held, at v = 0,
--   all that pushes it, as long as that is not above the static level
--
-- Between events the sum of all elements is affine in y and v: force + stiffness (y - reference) + damping v. So no
-- element has a state of its own. Held between events are these three sums, the deflections z_i at the last reversal,
-- and the positions ahead and behind at which the next element slips. What slips, slips one way until the next
-- reversal: modes stick, forward and backward.
--
-- in: y [m], v [m/s] and, with dry friction, push [N]; out: friction [N], held (1 while dry friction holds the axis).
local tb = require "tribode"

local far = 1e9 -- a limit that is not there [m]

-- elements = { { K =, F =, D = }, … }, viscous = D_v, coulomb, static [N], velocity [m/s], exponent,
-- forward, backward = { level =, viscous = }: added in that direction, factor = function c(t, y)
return function(settings)
  local elements, forward, backward = settings.elements, settings.forward, settings.backward
  local is_dry = settings.coulomb > 0 or settings.static > 0 or forward.level ~= 0 or backward.level ~= 0 or
    forward.viscous ~= backward.viscous
  local factor = settings.factor or function() return 1 end
  local level_of_elements, stiffness_of_all, damping_of_all = 0, 0, 0
  for _, e in ipairs(elements) do
    level_of_elements = level_of_elements + e.F
    stiffness_of_all = stiffness_of_all + e.K
    damping_of_all = damping_of_all + (e.D or 0)
  end
  local margin = 1e-12 * (1 + settings.static + math.max(forward.level, backward.level) + level_of_elements)

  -- Where element i slips, the axis going that way (side 1 or -1).
  local function limit(s, i, side) return s.reference + side * (s["X" .. i] - side * s["z" .. i]) end

  -- The axis has come to the next limit of this side: the element there slips, and all whose limits are not beyond.
  local function slip(side)
    local nearer, beyond, within = math.min, math.max, tb.less_equal
    if side < 0 then nearer, beyond, within = math.max, math.min, tb.greater_equal end
    return function(s)
      local reached = beyond(s.y, side > 0 and s.ahead or s.behind)
      local force, stiffness, damping, limits = 0, 0, 0, { side * far }
      for i, e in ipairs(elements) do
        local at = limit(s, i, side)
        local slips = within(at, reached)
        force = force + tb.where(slips, side * e.F, s["K" .. i] * s["z" .. i])
        stiffness = stiffness + tb.where(slips, 0, e.K)
        damping = damping + tb.where(slips, 0, e.D or 0)
        limits[i + 1] = tb.where(slips, side * far, at)
      end
      local next_limit = nearer(table.unpack(limits))
      return {
        force = force, stiffness = stiffness, damping = damping,
        ahead = side > 0 and next_limit or far, behind = side < 0 and next_limit or -far,
      }
    end
  end

  -- A reversal: those that slipped, going that way, are at their limit, and all stick.
  local function stick(side)
    local passed = side > 0 and tb.less or tb.greater
    return function(s)
      local set = { reference = s.y, stiffness = stiffness_of_all, damping = damping_of_all }
      local force, ahead, behind = 0, {}, {}
      for i in ipairs(elements) do
        local X, at = s["X" .. i], limit(s, i, side)
        local z = tb.where(passed(at, side > 0 and s.ahead or s.behind), side * X, s["z" .. i] + (s.y - s.reference))
        set["z" .. i] = z
        force = force + s["K" .. i] * z
        ahead[i], behind[i] = s.y + (X - z), s.y - (X + z)
      end
      set.force, set.ahead, set.behind = force, math.min(table.unpack(ahead)), math.max(table.unpack(behind))
      return set
    end
  end

  local function smooth(s, viscous)
    local sum = (s.viscous + viscous) * s.v
    if #elements > 0 then sum = sum + s.force + s.stiffness * (s.y - s.reference) + s.damping * s.v end
    return sum
  end
  -- In slip; the integrator may look a little beyond the reversal.
  local function level(s, added)
    if settings.static == settings.coulomb then return s.coulomb + added end
    local ratio = tb.no_event(math.abs(s.v)) / s.velocity
    return s.coulomb + (s.static - s.coulomb) * math.exp(-ratio ^ settings.exponent) + added
  end
  local function total(s, way)
    local scale = factor(s.t, s.y / s.metre)
    if way == "stick" then return scale * smooth(s, 0) end
    local direction, side = forward, 1
    if way == "backward" then direction, side = backward, -1 end
    local viscous = is_dry and direction.viscous or 0
    local dry = is_dry and side * level(s, direction.level) or 0
    return scale * (smooth(s, viscous) + dry)
  end

  -- ---- events -----------------------------------------------------------------------------------------------------

  local slips_forward = { -- and goes on in the mode in which it is, unless one is named
    name = "an element slips forward",
    condition = function(s) return tb.greater(s.y, s.ahead) end,
    set = slip(1),
  }
  local slips_backward = {
    name = "an element slips backward",
    condition = function(s) return tb.less(s.y, s.behind) end,
    set = slip(-1),
  }
  local function with_mode(entry, mode)
    return { name = entry.name, condition = entry.condition, set = entry.set, mode = mode }
  end
  -- The axis is let go a little above the static level, so that rounding does not stop it again at once.
  local function release(side, added)
    return function(s)
      local pushed = side * (s.push - total(s, "stick"))
      return tb.greater(pushed, factor(s.t, s.y / s.metre) * (s.static + added + margin))
    end
  end
  local modes = {
    forward = {
      when = {
        { name = "reversal", condition = function(s) return tb.less(s.v, 0) end, mode = "stick",
          set = #elements > 0 and stick(1) or nil },
      },
    },
    backward = {
      when = {
        { name = "reversal", condition = function(s) return tb.greater(s.v, 0) end, mode = "stick",
          set = #elements > 0 and stick(-1) or nil },
      },
    },
    stick = { when = {} },
  }
  if #elements > 0 then
    table.insert(modes.forward.when, slips_forward)
    table.insert(modes.backward.when, slips_backward)
  end
  if is_dry then
    modes.stick.when = {
      { name = "release forward", condition = release(1, forward.level), mode = "forward" },
      { name = "release backward", condition = release(-1, backward.level), mode = "backward" },
    }
    for _, way in ipairs { "forward", "backward" } do
      modes[way].outputs = function(s) return { friction = { total(s, way), unit = "N" }, held = 0 } end
    end
    modes.stick.outputs = function(s) return { friction = { s.push, unit = "N" }, held = 1 } end
  elseif #elements > 0 then
    modes.stick.when = { with_mode(slips_forward, "forward"), with_mode(slips_backward, "backward") }
  end

  local inputs = { y = { unit = "m" }, v = { unit = "m/s" } }
  if is_dry then inputs.push = { unit = "N" } end
  local parameters = {
    viscous = { value = settings.viscous, unit = "N s/m" },
    coulomb = { value = settings.coulomb, unit = "N" },
    static = { value = settings.static, unit = "N" },
    velocity = { value = settings.velocity, unit = "m/s" },
    metre = { value = 1, unit = "m" },
  }
  local discrete
  if #elements > 0 then
    discrete = {
      reference = { unit = "m" }, force = { unit = "N" }, ahead = { start = far, unit = "m" },
      behind = { start = -far, unit = "m" }, stiffness = { start = stiffness_of_all, unit = "N/m" },
      damping = { start = damping_of_all, unit = "N s/m" },
    }
    for i, e in ipairs(elements) do
      discrete["z" .. i] = { unit = "m" }
      parameters["K" .. i] = { value = e.K, unit = "N/m" }
      parameters["X" .. i] = { value = e.F / e.K, unit = "m" }
      discrete.ahead.start = math.min(discrete.ahead.start, e.F / e.K)
      discrete.behind.start = math.max(discrete.behind.start, -e.F / e.K)
    end
  end
  local has_modes = is_dry or #elements > 0
  return tb.system {
    name = "friction",
    parameters = parameters,
    inputs = inputs,
    discrete = discrete,
    modes = has_modes and modes or nil,
    start_mode = has_modes and "stick" or nil,
    outputs = not is_dry and function(s) return { friction = { total(s, "stick"), unit = "N" }, held = 0 } end or nil,
  }
end
