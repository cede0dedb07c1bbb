#include "tribode/base/error.hpp"
#include "tribode/effect/candidate.hpp"

namespace tribode::effects {

using Type = EffectParameter::Type;

// A force of the user's own, as text: then it is plain data as all of a machine is, can be hashed, and every run on
// every thread makes its own of it.
extern const EffectKind own_force = {
    .name = "own_force",
    .summary = "A force that you write in Lua.",
    .order = 240,
    .equation = "the number that the Lua text `force` returns, of y, v, t, the states and the constants",
    .parameters = {{.name = "force", .meaning = "Lua text that returns the force [N]", .type = Type::text},
                   {.name = "states", .meaning = "names of its own states, zero at the start", .type = Type::texts},
                   {.name = "rates",
                    .meaning = "Lua text that returns the rate of each state",
                    .type = Type::text,
                    .fallback = 0},
                   {.name = "constants", .meaning = "named numbers", .type = Type::constants}},
    .example = R"json({"force": "return -strength * math.sin(y / pitch) * (1 + flux)", "states": ["flux"],
        "rates": "return (y / pitch - flux) / 0.02", "constants": {"strength": 2, "pitch": 0.01}})json",
    .affine = false,
    .drawn_against = DrawnAgainst::position,
    .apply =
        [](const Effect& e, ServoAxis& axis) {
            const ForceCompiler compile = force_compiler();
            if (!compile) throw InputError("own_force: this program has no interpreter for it");
            axis.plant.forces.push_back(compile(e));
        },
    .lua = R"lua(
-- The text as a function of named values.
local function compiled(text, values)
  local names, list = {}, {}
  for name in pairs(values) do names[#names + 1] = name end
  table.sort(names)
  for i, name in ipairs(names) do list[i] = values[name] end
  local body, message = load("local " .. table.concat(names, ", ") .. " = ...; " .. text, "=own_force")
  if not body then error(message, 0) end
  return body(table.unpack(list))
end
local function values(s, own)
  local all = { y = s.y, v = s.v, t = s.t }
  for name, value in pairs(p.constants or {}) do all[name] = value end
  for name, value in pairs(own) do all[name] = value end
  return all
end
local states, names = {}, p.states or {}
for _, name in ipairs(names) do states[name] = 0 end
m.add_force {
  states = states,
  rates = function(s, own)
    local returned = #names > 0 and table.pack(compiled(p.rates, values(s, own))) or {}
    local rates = {}
    for i, name in ipairs(names) do rates[name] = returned[i] end
    return rates
  end,
  force = function(s, own) return compiled(p.force, values(s, own)) end,
}
)lua",
};

} // namespace tribode::effects
