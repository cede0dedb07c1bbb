#include "tribode/effect/kinds.hpp"

namespace tribode::effects {

const EffectKind constant_force = {
    .name = "constant_force",
    .equation = "+ F",
    .parameters =
        {
            {.name = "F", .unit = "N", .meaning = "the force", .plausible_min = 0.05, .plausible_max = 50},
        },
    .affine = true,
    .drawn_against = DrawnAgainst::velocity,
    .neutral = {{"F", 0}},
    .apply = [](const Effect& e, ServoAxis& axis) { axis.plant.constant_force += e.number("F"); },
};

} // namespace tribode::effects
