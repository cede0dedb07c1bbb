#include "tribode/base/error.hpp"
#include "tribode/effect/kinds.hpp"

namespace tribode::effects {

using Type = EffectParameter::Type;

// A force of the user's own, as text: then it is plain data as all of a machine is, can be hashed, and every run on
// every thread makes its own of it.
const EffectKind own_force = {
    .name = "own_force",
    .equation = "the number that the Lua text `force` returns, of y, v, t, the states and the constants",
    .parameters = {{.name = "force", .meaning = "Lua text that returns the force [N]", .type = Type::text},
                   {.name = "states", .meaning = "names of its own states, zero at the start", .type = Type::texts},
                   {.name = "rates",
                    .meaning = "Lua text that returns the rate of each state",
                    .type = Type::text,
                    .fallback = 0},
                   {.name = "constants", .meaning = "named numbers", .type = Type::constants}},
    .affine = false,
    .drawn_against = DrawnAgainst::position,
    .neutral = {},
    .apply =
        [](const Effect& e, ServoAxis& axis) {
            const ForceCompiler compile = force_compiler();
            if (!compile) throw InputError("own_force: this program has no interpreter for it");
            axis.plant.forces.push_back(compile(e));
        },
};

} // namespace tribode::effects
