#include "tribode/effect/kinds.hpp"

namespace tribode::effects {

// The dry level, set-valued at v = 0; a Stribeck curve moves with it.
const EffectKind coulomb_friction = {
    .name = "coulomb_friction",
    .equation = "dry level += dF, set-valued at v = 0",
    .parameters =
        {
            {.name = "dF", .unit = "N", .meaning = "added to the dry level", .plausible_min = 0.1, .plausible_max = 50},
        },
    .affine = true,
    .drawn_against = DrawnAgainst::velocity,
    .neutral = {{"dF", 0}},
    .apply =
        [](const Effect& e, ServoAxis& axis) {
            axis.plant.dry.coulomb += e.number("dF");
            axis.plant.dry.static_level += e.number("dF");
        },
};

} // namespace tribode::effects
