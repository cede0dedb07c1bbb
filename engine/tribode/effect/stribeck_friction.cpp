#include "tribode/effect/kinds.hpp"

namespace tribode::effects {

// A Stribeck curve above the Coulomb level, in place of the machine's own. A Coulomb level added later lifts it.
const EffectKind stribeck_friction = {
    .name = "stribeck_friction",
    .equation = "dry level(v) = Fc + dFs exp(-(abs(v)/velocity)^exponent)",
    .parameters =
        {
            {.name = "dFs",
             .unit = "N",
             .meaning = "static level above the Coulomb level",
             .plausible_min = 0.1,
             .plausible_max = 30},
            {.name = "velocity",
             .unit = "m/s",
             .meaning = "Stribeck velocity",
             .allowed = Allowed::positive,
             .plausible_min = 1e-4,
             .plausible_max = 0.1},
            {.name = "exponent",
             .meaning = "exponent",
             .allowed = Allowed::positive,
             .plausible_min = 0.5,
             .plausible_max = 2,
             .fallback = 1},
        },
    .affine = false,
    .drawn_against = DrawnAgainst::velocity,
    .neutral = {{"dFs", 0}},
    .apply =
        [](const Effect& e, ServoAxis& axis) {
            DryFriction& dry = axis.plant.dry;
            dry.static_level = dry.coulomb + e.number("dFs");
            dry.velocity = e.number("velocity");
            dry.exponent = e.number("exponent");
        },
};

} // namespace tribode::effects
