#include "tribode/effect/candidate.hpp"

namespace tribode::effects {

extern const EffectKind viscous_friction = {
    .name = "viscous_friction",
    .summary = "The viscous friction is higher or lower.",
    .order = 20,
    .equation = "D_v += dD",
    .parameters =
        {
            {.name = "dD",
             .unit = "N s/m",
             .meaning = "added to the viscous friction",
             .plausible_min = 0.1,
             .plausible_max = 500},
        },
    .example = R"({"dD": 40})",
    .affine = true,
    .drawn_against = DrawnAgainst::velocity,
    .neutral = {{"dD", 0}},
    .apply = [](const Effect& e, ServoAxis& axis) { axis.plant.viscous += e.number("dD"); },
    .lua = R"lua(
m.friction.viscous = m.friction.viscous + p.dD
)lua",
    .forms = [](const Clues& c) -> std::vector<EffectForm> {
        const double damping = -regress({c.velocity}, c.force).coefficients[0];
        const double typical = c.typical_force() / c.max_speed;
        return {{.parameters = {{"dD", -c.axis.plant.viscous, 1e3 * typical + 1e3, false, 1e-3 * typical}},
                 .starts = {{Clues::at_least(0.02 * typical, damping)}}}};
    },
    .fit_order = 30,
};

} // namespace tribode::effects
