#include "tribode/effect/kinds.hpp"

namespace tribode::effects {

// Carried by two states of the machine, which keeps it affine.
const EffectKind periodic_disturbance = {
    .name = "periodic_disturbance",
    .equation = "F sin(2 pi freq_hz t + phase)",
    .parameters =
        {
            {.name = "F", .unit = "N", .meaning = "amplitude", .plausible_min = 0.05, .plausible_max = 20},
            {.name = "freq_hz",
             .unit = "Hz",
             .meaning = "frequency",
             .allowed = Allowed::positive,
             .plausible_min = 0.1,
             .plausible_max = 200},
            {.name = "phase",
             .unit = "rad",
             .meaning = "phase",
             .plausible_min = 0,
             .plausible_max = 6.2832,
             .fallback = 0},
        },
    .affine = true,
    .drawn_against = DrawnAgainst::time,
    .neutral = {{"F", 0}},
    .apply =
        [](const Effect& e, ServoAxis& axis) {
            axis.plant.sine_forces.push_back({e.number("F"), e.number("freq_hz"), e.number("phase")});
        },
};

} // namespace tribode::effects
