#include "tribode/base/error.hpp"
#include "tribode/effect/candidate.hpp"

#include <algorithm>
#include <cmath>
#include <functional>
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
        // The thrust that such an amplifier makes of u is all force there is: in proportion to a power of u, and the factor is its
        // size.
        const Signal& u = c.residual.reference_thrust;
        Signal thrust = c.force;
        for (std::size_t k = 0; k < u.size(); ++k) thrust[k] += u[k];
        struct Start {
            double explained, exponent, size;
        };
        std::vector<Start> starts;
        for (const double exponent : {0.5, 0.6, 0.7, 0.8, 0.9, 1.1, 1.2, 1.3, 1.45, 1.6, 1.8, 2.1, 2.4}) {
            const Signal shape = map(u, [&](double one) {
                return std::copysign(c.max_thrust * std::pow(std::abs(one) / c.max_thrust, exponent), one);
            });
            const Regression fit = regress({shape}, thrust);
            const double of_most = std::pow(std::max(fit.coefficients[0], 1e-3), 1 / (1 - exponent));
            starts.push_back({fit.explained, exponent, c.max_thrust * std::clamp(of_most, 0.05, 20.0)});
        }
        std::ranges::stable_sort(starts, std::ranges::greater{}, &Start::explained);
        // The two best, and the best on the other side of a gain: no fit leads through an exponent of one.
        std::vector<std::vector<double>> tried;
        bool below = false, above = false;
        for (const auto& [explained, exponent, size] : starts) {
            bool& is_known = exponent < 1 ? below : above;
            if (tried.size() < 2 || !is_known) tried.push_back({exponent, size});
            is_known = true;
        }
        // In an open loop a start that is a tenth off leads the whole motion away, but not its beginning.
        return {{.parameters = {factor("exponent", 0.2, 5), factor("size", 0.05 * c.max_thrust, 20 * c.max_thrust)},
                 .starts = std::move(tried),
                 .tried = 3,
                 .on_beginnings = true}};
    },
    .fit_order = 135,
    .simpler = {"thrust_gain"},
};

} // namespace tribode::effects
