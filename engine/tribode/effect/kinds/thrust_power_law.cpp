#include "tribode/base/error.hpp"
#include "tribode/effect/candidate.hpp"

#include <algorithm>
#include <cmath>
#include <utility>

namespace tribode::effects {

// In the amplifier, after a dead zone and before a gain. An offset of the input is the constant force that it makes.
extern const EffectKind thrust_power_law = {
    .name = "thrust_power_law",
    .summary = "The motor force is a power of the thrust reference, as that of valves and propellers.",
    .order = 155,
    .equation = "actuator gives size (abs(u)/size)^exponent sign(u)",
    .parameters =
        {
            {.name = "exponent",
             .meaning = "exponent",
             .allowed = Allowed::positive,
             .plausible_min = 0.5,
             .plausible_max = 3},
            {.name = "size",
             .unit = "N",
             .meaning = "where the force is the reference",
             .allowed = Allowed::positive,
             .plausible_min = 1,
             .plausible_max = 1000},
        },
    .example = R"({"exponent": 1.3, "size": 30})",
    .affine = true,
    .drawn_against = DrawnAgainst::thrust,
    .neutral = {{"exponent", 1}},
    .apply =
        [](const Effect& e, ServoAxis& axis) {
            if (axis.amplifier.exponent != 1) {
                throw InputError("thrust_power_law can be there only once");
            }
            axis.amplifier.exponent = e.number("exponent");
            axis.amplifier.size = e.number("size");
        },
    .lua = R"lua(
m.amplifier.exponent, m.amplifier.size = p.exponent, p.size
)lua",
    .forms = [](const Clues& c) -> std::vector<EffectForm> {
        // The thrust that such an amplifier makes of u, less u; the right exponent has the coefficient one.
        std::vector<std::pair<double, double>> starts;
        for (const double exponent : {0.5, 0.7, 0.85, 1.15, 1.4, 1.8, 2.4}) {
            const Signal shape = map(c.residual.reference_thrust, [&](double u) {
                return std::copysign(c.max_thrust * std::pow(std::abs(u) / c.max_thrust, exponent), u) - u;
            });
            starts.push_back({std::abs(regress({shape}, c.force).coefficients[0] - 1), exponent});
        }
        std::sort(starts.begin(), starts.end());
        return {{.parameters = {factor("exponent", 0.2, 5), factor("size", 0.05 * c.max_thrust, 20 * c.max_thrust)},
                 .starts = {{starts[0].second, c.max_thrust}, {starts[1].second, c.max_thrust}}}};
    },
    .fit_order = 135,
    .simpler = {"thrust_gain"},
};

} // namespace tribode::effects
