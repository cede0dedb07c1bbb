#include "tribode/effect/candidate.hpp"

#include <algorithm>

namespace tribode::effects {

// Less than zero is allowed as long as the whole delay is not.
extern const EffectKind input_delay = {
    .name = "input_delay",
    .summary = "The thrust acts later or earlier.",
    .order = 190,
    .equation = "input_delay_s += extra_s",
    .parameters =
        {
            {.name = "extra_s",
             .unit = "s",
             .meaning = "extra dead time",
             .plausible_min = -1e-3,
             .plausible_max = 5e-3},
        },
    .example = R"({"extra_s": 1e-3})",
    .affine = true,
    .drawn_against = DrawnAgainst::frequency,
    .neutral = {{"extra_s", 0}},
    .apply = [](const Effect& e, ServoAxis& axis) { axis.input_delay += e.number("extra_s"); },
    .lua = R"lua(
m.amplifier.delay = m.amplifier.delay + p.extra_s
)lua",
    .forms = [](const Clues& c) -> std::vector<EffectForm> {
        const double extra = -regress({c.residual.thrust_rate}, c.force).coefficients[0];
        const double shortest = -c.axis.input_delay, longest = 0.01;
        std::vector<std::vector<double>> probes{{std::clamp(extra, 0.9 * shortest, 3e-3)}};
        for (const double other : {2e-4, 6e-4, 1.2e-3, -2e-4}) probes.push_back({std::max(other, 0.9 * shortest)});
        return {{.parameters = {{"extra_s", shortest, longest, false, 2e-6}}, .probes = probes}};
    },
    .fit_order = 170,
};

} // namespace tribode::effects
