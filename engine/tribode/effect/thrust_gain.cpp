#include "tribode/effect/kinds.hpp"

namespace tribode::effects {

// Last in the amplifier.
const EffectKind thrust_gain = {
    .name = "thrust_gain",
    .equation = "Fm times gain",
    .parameters =
        {
            {.name = "gain",
             .meaning = "the gain",
             .allowed = Allowed::positive,
             .plausible_min = 0.5,
             .plausible_max = 1.5},
        },
    .affine = true,
    .drawn_against = DrawnAgainst::thrust,
    .neutral = {{"gain", 1}},
    .apply = [](const Effect& e, ServoAxis& axis) { axis.amplifier.gain *= e.number("gain"); },
};

} // namespace tribode::effects
