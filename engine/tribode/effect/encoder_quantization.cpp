#include "tribode/effect/kinds.hpp"

namespace tribode::effects {

// In place of the machine's own resolution.
const EffectKind encoder_quantization = {
    .name = "encoder_quantization",
    .equation = "encoder_resolution_m of the machine is this one",
    .parameters =
        {
            {.name = "resolution_m",
             .unit = "m",
             .meaning = "rounding to its multiples",
             .allowed = Allowed::positive,
             .plausible_min = 1e-9,
             .plausible_max = 1e-4},
        },
    .affine = true,
    .drawn_against = DrawnAgainst::position,
    .neutral = {},
    .apply = [](const Effect& e, ServoAxis& axis) { axis.encoder_resolution = e.number("resolution_m"); },
};

} // namespace tribode::effects
