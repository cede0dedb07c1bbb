#include "tribode/effect/kinds.hpp"

namespace tribode::effects {

// Added before noise and rounding.
const EffectKind encoder_periodic_error = {
    .name = "encoder_periodic_error",
    .equation = "y read as y + A sin(2 pi y/period_m + phase) + A2 sin(4 pi y/period_m + phase2)",
    .parameters =
        {
            {.name = "A", .unit = "m", .meaning = "amplitude", .plausible_min = 1e-9, .plausible_max = 1e-4},
            {.name = "period_m",
             .unit = "m",
             .meaning = "period",
             .allowed = Allowed::positive,
             .plausible_min = 1e-6,
             .plausible_max = 0.1},
            {.name = "phase",
             .unit = "rad",
             .meaning = "phase",
             .plausible_min = 0,
             .plausible_max = 6.2832,
             .fallback = 0},
            {.name = "A2",
             .unit = "m",
             .meaning = "amplitude of the second harmonic",
             .plausible_min = 0,
             .plausible_max = 5e-5,
             .fallback = 0},
            {.name = "phase2",
             .unit = "rad",
             .meaning = "phase",
             .plausible_min = 0,
             .plausible_max = 6.2832,
             .fallback = 0},
        },
    .affine = true,
    .drawn_against = DrawnAgainst::position,
    .neutral = {{"A", 0}, {"A2", 0}},
    .apply =
        [](const Effect& e, ServoAxis& axis) {
            axis.encoder_errors.push_back(
                {e.number("A"), e.number("period_m"), e.number("phase"), e.number("A2"), e.number("phase2")});
        },
};

} // namespace tribode::effects
