#include "tribode/effect/kinds.hpp"

#include <algorithm>

namespace tribode::effects {

// First in the amplifier; the recorded u is before it.
const EffectKind thrust_saturation = {
    .name = "thrust_saturation",
    .equation = "abs(u) limited in the amplifier",
    .parameters =
        {
            {.name = "limit",
             .unit = "N",
             .meaning = "the limit",
             .allowed = Allowed::positive,
             .plausible_min = 1,
             .plausible_max = 1000},
        },
    .affine = true,
    .drawn_against = DrawnAgainst::thrust,
    .neutral = {},
    .apply = [](const Effect& e,
                ServoAxis& axis) { axis.amplifier.limit = std::min(axis.amplifier.limit, e.number("limit")); },
};

} // namespace tribode::effects
