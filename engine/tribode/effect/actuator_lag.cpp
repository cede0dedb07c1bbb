#include "tribode/effect/kinds.hpp"

namespace tribode::effects {

// In place of the machine's own current loop.
const EffectKind actuator_lag = {
    .name = "actuator_lag",
    .equation = "current_loop_hz of the machine is this one",
    .parameters =
        {
            {.name = "current_loop_hz",
             .unit = "Hz",
             .meaning = "corner frequency of the thrust",
             .allowed = Allowed::positive,
             .plausible_min = 20,
             .plausible_max = 5000},
        },
    .affine = true,
    .drawn_against = DrawnAgainst::frequency,
    .neutral = {},
    .apply = [](const Effect& e, ServoAxis& axis) { axis.plant.current_loop_hz = e.number("current_loop_hz"); },
};

} // namespace tribode::effects
