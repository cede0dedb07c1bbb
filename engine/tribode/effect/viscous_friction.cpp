#include "tribode/effect/kinds.hpp"

namespace tribode::effects {

const EffectKind viscous_friction = {
    .name = "viscous_friction",
    .equation = "D_v += dD",
    .parameters =
        {
            {.name = "dD",
             .unit = "N s/m",
             .meaning = "added to the viscous friction",
             .plausible_min = 0.1,
             .plausible_max = 500},
        },
    .affine = true,
    .drawn_against = DrawnAgainst::velocity,
    .neutral = {{"dD", 0}},
    .apply = [](const Effect& e, ServoAxis& axis) { axis.plant.viscous += e.number("dD"); },
};

} // namespace tribode::effects
