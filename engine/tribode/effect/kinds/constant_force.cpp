#include "tribode/effect/candidate.hpp"

namespace tribode::effects {

extern const EffectKind constant_force = {
    .name = "constant_force",
    .summary = "A constant force pushes one way, such as a weight or a cable.",
    .order = 90,
    .equation = "+ F",
    .parameters =
        {
            {.name = "F", .unit = "N", .meaning = "the force", .plausible_min = 0.05, .plausible_max = 50},
        },
    .example = R"({"F": 4})",
    .affine = true,
    .drawn_against = DrawnAgainst::velocity,
    .neutral = {{"F", 0}},
    .apply = [](const Effect& e, ServoAxis& axis) { axis.plant.constant_force += e.number("F"); },
    .lua = R"lua(
m.add_force { force = function() return p.F end }
)lua",
    .forms = [](const Clues& c) -> std::vector<EffectForm> {
        const double mean = regress({Signal(c.force.size(), 1.0)}, c.force).coefficients[0];
        const double bound = c.max_force();
        return {{.parameters = {{"F", -bound, bound, false, 1e-3 * c.typical_force() + 1e-9 * bound}},
                 .starts = {{c.noticeable(mean)}}}};
    },
    .fit_order = 10,
};

} // namespace tribode::effects
