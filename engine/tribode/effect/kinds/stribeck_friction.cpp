#include "tribode/effect/candidate.hpp"
#include "tribode/effect/friction_law_parameters.hpp"

#include <algorithm>
#include <cmath>

namespace tribode::effects {

// A Stribeck curve above the Coulomb level, in place of the machine's own. A Coulomb level added later lifts it.
extern const EffectKind stribeck_friction = {
    .name = "stribeck_friction",
    .summary = "Dry friction rises toward rest, from the Coulomb level to a static level.",
    .order = 30,
    .equation = "dry level(v) = Fc + dFs exp(-(abs(v)/velocity)^exponent)",
    .parameters =
        {
            {.name = "dFs",
             .unit = "N",
             .meaning = "static level above the Coulomb level",
             .plausible_min = 0.1,
             .plausible_max = 30},
            stribeck_velocity_parameter(),
            stribeck_exponent_parameter("exponent", 1),
        },
    .example = R"({"dFs": 3, "velocity": 0.01})",
    .affine = false,
    .drawn_against = DrawnAgainst::velocity,
    .neutral = {{"dFs", 0}},
    .apply =
        [](const Effect& e, ServoAxis& axis) {
            DryFriction& dry = axis.plant.dry;
            dry.stribeck = {dry.coulomb + e.number("dFs"), e.number("velocity"), e.number("exponent")};
        },
    .lua = R"lua(
m.friction.static = m.friction.coulomb + p.dFs
m.friction.velocity, m.friction.exponent = p.velocity, p.exponent
)lua",
    .forms = [](const Clues& c) -> std::vector<EffectForm> {
        struct Start {
            double explained, level, velocity, exponent;
        };
        const Signal& v = c.velocity;
        std::vector<Start> starts;
        for (const double velocity : geometric(std::max(1e-3 * c.max_speed, 1e-4), 0.7 * c.max_speed, 9)) {
            for (const double exponent : {1.0, 2.0}) {
                Signal shape(v.size());
                for (std::size_t k = 0; k < v.size(); ++k) {
                    shape[k] = -c.direction[k] * std::exp(-std::pow(std::abs(v[k]) / velocity, exponent));
                }
                const Regression fit = regress({shape}, c.force);
                if (fit.coefficients[0] > 0) starts.push_back({fit.explained, fit.coefficients[0], velocity, exponent});
            }
        }
        std::sort(starts.begin(), starts.end(), [](const auto& a, const auto& b) { return a.explained > b.explained; });
        std::vector<std::vector<double>> points;
        for (const auto& start : starts) {
            if (points.size() == 3) break;
            points.push_back({std::max(start.level, 0.05 * c.typical_force()), start.velocity, start.exponent});
        }
        // Near rest the residual force is that of the noise in the velocity: sizes are sought by simulation, too.
        std::vector<std::vector<double>> probes;
        for (const double velocity : geometric(std::max(1e-3 * c.max_speed, 1e-4), 0.3 * c.max_speed, 8)) {
            probes.push_back({0.2 * c.typical_force(), velocity, 1});
        }
        return {{.parameters = {factor("dFs", 1e-3 * c.typical_force(), c.max_force()), factor("velocity", 1e-5, 3),
                                factor("exponent", 0.3, 4)},
                 .starts = points,
                 .probes = probes,
                 .size = 0,
                 .tried = 3}};
    },
    .fit_order = 50,
    .simpler = {"coulomb_friction"},
};

} // namespace tribode::effects
