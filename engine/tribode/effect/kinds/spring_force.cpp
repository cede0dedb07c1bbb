#include "tribode/effect/candidate.hpp"

#include <algorithm>

namespace tribode::effects {

extern const EffectKind spring_force = {
    .name = "spring_force",
    .summary = "A linear spring pulls toward a position.",
    .order = 100,
    .equation = "- k (y - y0)",
    .parameters =
        {
            {.name = "k", .unit = "N/m", .meaning = "stiffness", .plausible_min = 1, .plausible_max = 1e4},
            relaxed_position(),
        },
    .example = R"({"k": 300})",
    .affine = true,
    .drawn_against = DrawnAgainst::position,
    .neutral = {{"k", 0}},
    .apply =
        [](const Effect& e, ServoAxis& axis) {
            axis.plant.spring += e.number("k");
            axis.plant.constant_force += e.number("k") * e.number("y0");
        },
    .lua = R"lua(
m.add_force { force = function(s) return -p.k * (s.y - p.y0) end }
)lua",
    .forms = [](const Clues& c) -> std::vector<EffectForm> {
        const Regression fit =
            regress({map(c.position, [](double y) { return -y; }), Signal(c.position.size(), 1.0)}, c.force);
        const double typical = c.typical_force() / c.reach;
        const double stiffness = Clues::at_least(0.02 * typical, fit.coefficients[0]);
        const double middle =
            std::clamp(fit.coefficients[1] / stiffness, c.min_position - c.stroke, c.max_position + c.stroke);
        const FitParameter k{"k", -1e3 * typical, 1e3 * typical, false, 1e-3 * typical};
        const FitParameter y0{"y0", c.min_position - 2 * c.stroke, c.max_position + 2 * c.stroke, false,
                              1e-3 * c.stroke};
        return {{.form = "about zero", .parameters = {k}, .starts = {{stiffness}}},
                {.parameters = {k, y0}, .starts = {{stiffness, middle}}}};
    },
    .fit_order = 100,
};

} // namespace tribode::effects
