#include "tribode/base/constants.hpp"
#include "tribode/effect/candidate.hpp"

#include <algorithm>
#include <cmath>

namespace tribode::effects {

// Added before noise and rounding.
extern const EffectKind encoder_periodic_error = {
    .name = "encoder_periodic_error",
    .summary = "The encoder reads with an error that is periodic in position.",
    .order = 230,
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
            phase_parameter(),
            {.name = "A2",
             .unit = "m",
             .meaning = "amplitude of the second harmonic",
             .plausible_min = 0,
             .plausible_max = 5e-5,
             .fallback = 0},
            phase_parameter("phase2"),
        },
    .example = R"({"A": 2e-6, "period_m": 1e-3, "A2": 5e-7})",
    .affine = true,
    .drawn_against = DrawnAgainst::position,
    .neutral = {{"A", 0}, {"A2", 0}},
    .apply =
        [](const Effect& e, ServoAxis& axis) {
            axis.encoder_errors.push_back(
                {e.number("A"), e.number("period_m"), e.number("phase"), e.number("A2"), e.number("phase2")});
        },
    .lua = R"lua(
table.insert(m.encoder.errors, p)
)lua",
    .forms = [](const Clues& c) -> std::vector<EffectForm> {
        const double shortest = std::max({4e-6, 4 * c.axis.encoder_resolution, c.stroke / 20000});
        const double longest = std::min(c.stroke, 0.05);
        std::vector<std::vector<double>> one, two;
        for (const auto& found : sinusoids(c.measured, c.whitened, {}, shortest, longest, 3)) {
            const double A = found.amplitude * c.innovation;
            const bool first = two.empty();
            // A loop turns the phase: by how much depends on how fast a period passes.
            for (int quarter = 0; quarter < 4; ++quarter) {
                const double phase = std::remainder(found.phase + quarter * two_pi / 4, two_pi);
                one.push_back({A, found.period, phase});
                if (!first) continue;
                for (const double other : {0.0, 3.0}) {
                    two.push_back({A, found.period, phase, 0.1 * A, other});
                    // A loop follows slow errors, and fast ones remain: it may be the second harmonic.
                    if (2 * found.period < longest) two.push_back({0.1 * A, 2 * found.period, other, A, phase});
                }
            }
        }
        const auto amplitude = [&c](const char* name) { return factor(name, 1e-3 * c.innovation, 0.3 * c.stroke); };
        const FitParameter A = amplitude("A"), period = factor("period_m", shortest / 2, longest);
        return {{.form = "fundamental", .parameters = {A, period, angle("phase")}, .starts = one},
                {.form = "two harmonics",
                 .parameters = {A, period, angle("phase"), amplitude("A2"), angle("phase2")},
                 .starts = two,
                 .tried = 4}};
    },
    .fit_order = 210,
};

} // namespace tribode::effects
