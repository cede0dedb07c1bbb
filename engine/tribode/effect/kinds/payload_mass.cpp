#include "tribode/base/error.hpp"
#include "tribode/base/text.hpp"
#include "tribode/effect/candidate.hpp"

#include <algorithm>
#include <fmt/format.h>

namespace tribode::effects {

// More mass on the rigid body, or less; the modes stay as they are.
extern const EffectKind payload_mass = {
    .name = "payload_mass",
    .summary = "The moving mass is larger or smaller.",
    .order = 180,
    .equation = "k0 / (1 + ratio)",
    .parameters =
        {
            {.name = "ratio", .meaning = "added mass by the mass", .plausible_min = -0.5, .plausible_max = 2},
        },
    .example = R"({"ratio": 0.3})",
    .affine = true,
    .drawn_against = DrawnAgainst::frequency,
    .neutral = {{"ratio", 0}},
    .apply =
        [](const Effect& e, ServoAxis& axis) {
            if (e.number("ratio") <= -1) {
                throw InputError(fmt::format("payload_mass: ratio = {}, must be above -1", to_text(e.number("ratio"))));
            }
            axis.plant.rigid_gain /= 1 + e.number("ratio");
        },
    .lua = R"lua(
m.plant.rigid_gain = m.plant.rigid_gain / (1 + p.ratio)
)lua",
    .forms = [](const Clues& c) -> std::vector<EffectForm> {
        if (c.axis.plant.rigid_gain == 0) return {};
        const double ratio = -regress({c.residual.inertial}, c.force).coefficients[0];
        return {
            {.parameters = {factor("1 + ratio", 0.1, 20)},
             .convert = [](std::span<const double> values, std::span<double> numbers) { numbers[0] = values[0] - 1; },
             .starts = {{1 + std::clamp(ratio, -0.6, 2.0)}, {ratio > 0 ? 1.1 : 0.9}}}};
    },
    .fit_order = 160,
    .simpler = {"thrust_gain"}, // which does the same but for friction and other forces
};

} // namespace tribode::effects
