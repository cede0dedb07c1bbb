#include "tribode/effect/kinds.hpp"

namespace tribode::effects {

const EffectKind resonant_mode = {
    .name = "resonant_mode",
    .equation = "one more vibration mode",
    .parameters =
        {
            {.name = "gain",
             .unit = "m/(N s^2)",
             .meaning = "modal gain",
             .allowed = Allowed::positive,
             .plausible_min = 1e-4,
             .plausible_max = 1},
            {.name = "freq_hz",
             .unit = "Hz",
             .meaning = "natural frequency",
             .allowed = Allowed::positive,
             .plausible_min = 5,
             .plausible_max = 500},
            {.name = "zeta",
             .meaning = "damping ratio",
             .allowed = Allowed::non_negative,
             .plausible_min = 1e-3,
             .plausible_max = 0.2},
        },
    .affine = true,
    .drawn_against = DrawnAgainst::frequency,
    .neutral = {},
    .apply =
        [](const Effect& e, ServoAxis& axis) {
            axis.plant.modes.push_back({e.number("gain"), e.number("freq_hz"), e.number("zeta")});
        },
};

} // namespace tribode::effects
