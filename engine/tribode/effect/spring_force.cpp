#include "tribode/effect/kinds.hpp"

namespace tribode::effects {

const EffectKind spring_force = {
    .name = "spring_force",
    .equation = "- k (y - y0)",
    .parameters =
        {
            {.name = "k", .unit = "N/m", .meaning = "stiffness", .plausible_min = 1, .plausible_max = 1e4},
            {.name = "y0",
             .unit = "m",
             .meaning = "where it is relaxed",
             .plausible_min = 0,
             .plausible_max = 0.5,
             .fallback = 0},
        },
    .affine = true,
    .drawn_against = DrawnAgainst::position,
    .neutral = {{"k", 0}},
    .apply =
        [](const Effect& e, ServoAxis& axis) {
            axis.plant.spring += e.number("k");
            axis.plant.constant_force += e.number("k") * e.number("y0");
        },
};

} // namespace tribode::effects
