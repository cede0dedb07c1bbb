#include "tribode/effect/kinds.hpp"

namespace tribode::effects {

// Less than zero is allowed as long as the whole delay is not.
const EffectKind input_delay = {
    .name = "input_delay",
    .equation = "input_delay_s += extra_s",
    .parameters =
        {
            {.name = "extra_s",
             .unit = "s",
             .meaning = "extra dead time",
             .plausible_min = -1e-3,
             .plausible_max = 5e-3},
        },
    .affine = true,
    .drawn_against = DrawnAgainst::frequency,
    .neutral = {{"extra_s", 0}},
    .apply = [](const Effect& e, ServoAxis& axis) { axis.input_delay += e.number("extra_s"); },
};

} // namespace tribode::effects
