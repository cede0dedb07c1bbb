#include "tribode/effect/candidate.hpp"

namespace tribode::effects {

// In place of the machine's own resolution.
extern const EffectKind encoder_quantization = {
    .name = "encoder_quantization",
    .summary = "The encoder has another resolution.",
    .order = 220,
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
    .example = R"({"resolution_m": 5e-6})",
    .affine = true,
    .drawn_against = DrawnAgainst::position,
    .apply = [](const Effect& e, ServoAxis& axis) { axis.encoder_resolution = e.number("resolution_m"); },
    .lua = R"lua(
m.encoder.resolution = p.resolution_m
)lua",
    // A diagnosis reads it from the measured values, which are multiples of it: there is nothing to fit.
    .is_rounding = true,
};

} // namespace tribode::effects
