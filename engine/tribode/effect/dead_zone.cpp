#include "tribode/effect/kinds.hpp"

namespace tribode::effects {

// In the amplifier, after a saturation and before a gain.
const EffectKind dead_zone = {
    .name = "dead_zone",
    .equation = "actuator gives 0 for abs(u) < half_width, else u -+ half_width",
    .parameters =
        {
            {.name = "half_width",
             .unit = "N",
             .meaning = "half the width",
             .allowed = Allowed::non_negative,
             .plausible_min = 0.05,
             .plausible_max = 20},
        },
    .affine = true,
    .drawn_against = DrawnAgainst::thrust,
    .neutral = {{"half_width", 0}},
    .apply =
        [](const Effect& e, ServoAxis& axis) {
            axis.amplifier.half_width += e.number("half_width"); // one after the other they add up
        },
};

} // namespace tribode::effects
