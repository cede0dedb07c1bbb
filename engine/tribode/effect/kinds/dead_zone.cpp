#include "tribode/effect/candidate.hpp"

#include <algorithm>
#include <cmath>
#include <utility>

namespace tribode::effects {

// In the amplifier, after a saturation and before a gain.
extern const EffectKind dead_zone = {
    .name = "dead_zone",
    .summary = "The actuator ignores small thrust references.",
    .order = 150,
    .equation = "actuator gives 0 for abs(u) < half_width, else u -+ half_width",
    .parameters =
        {
            {.name = "half_width",
             .unit = "N",
             .meaning = "half the width",
             .allowed = Allowed::non_negative,
             .plausible_min = 0.05,
             .plausible_max = 20},
        },
    .example = R"({"half_width": 1.5})",
    .affine = true,
    .drawn_against = DrawnAgainst::thrust,
    .neutral = {{"half_width", 0}},
    .apply =
        [](const Effect& e, ServoAxis& axis) {
            axis.amplifier.half_width += e.number("half_width"); // one after the other they add up
        },
    .lua = R"lua(
m.amplifier.half_width = m.amplifier.half_width + p.half_width
)lua",
    .forms = [](const Clues& c) -> std::vector<EffectForm> {
        // The thrust that such an amplifier makes of u, less u: the force that is missing.
        std::vector<std::pair<double, std::vector<double>>> starts;
        for (const double width : geometric(0.005 * c.max_thrust, 0.8 * c.max_thrust, 30)) {
            double sum = 0;
            for (std::size_t k = 0; k < c.force.size(); ++k) {
                const double left = c.force[k] + std::clamp(c.residual.reference_thrust[k], -width, width);
                sum += left * left;
            }
            starts.push_back({sum, {width}});
        }
        std::sort(starts.begin(), starts.end());
        return {{.parameters = {factor("half_width", 1e-3 * c.max_thrust, 2 * c.max_thrust)},
                 .starts = {starts[0].second, starts[1].second}}};
    },
    .fit_order = 130,
};

} // namespace tribode::effects
