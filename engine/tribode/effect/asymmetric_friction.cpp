#include "tribode/effect/kinds.hpp"

namespace tribode::effects {

// Friction that depends on the direction of motion. In stick each side has its own level.
const EffectKind asymmetric_friction = {
    .name = "asymmetric_friction",
    .equation = "dry level += dF_pos (v > 0), dF_neg (v < 0); D_v += dD_pos, dD_neg",
    .parameters =
        {
            {.name = "dF_pos",
             .unit = "N",
             .meaning = "added to the dry level forward",
             .plausible_min = 0.1,
             .plausible_max = 30,
             .fallback = 0},
            {.name = "dF_neg",
             .unit = "N",
             .meaning = "added to the dry level backward",
             .plausible_min = 0.1,
             .plausible_max = 30,
             .fallback = 0},
            {.name = "dD_pos",
             .unit = "N s/m",
             .meaning = "added to the viscous friction forward",
             .plausible_min = 0.1,
             .plausible_max = 300,
             .fallback = 0},
            {.name = "dD_neg",
             .unit = "N s/m",
             .meaning = "added to the viscous friction backward",
             .plausible_min = 0.1,
             .plausible_max = 300,
             .fallback = 0},
        },
    .affine = true,
    .drawn_against = DrawnAgainst::velocity,
    .neutral = {{"dF_pos", 0}, {"dF_neg", 0}, {"dD_pos", 0}, {"dD_neg", 0}},
    .apply =
        [](const Effect& e, ServoAxis& axis) {
            axis.plant.forward.level += e.number("dF_pos");
            axis.plant.forward.viscous += e.number("dD_pos");
            axis.plant.backward.level += e.number("dF_neg");
            axis.plant.backward.viscous += e.number("dD_neg");
        },
};

} // namespace tribode::effects
