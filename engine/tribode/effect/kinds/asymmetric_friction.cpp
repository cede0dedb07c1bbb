#include "tribode/effect/candidate.hpp"

#include <algorithm>

namespace tribode::effects {

// Friction that depends on the direction of motion. In stick each side has its own level.
extern const EffectKind asymmetric_friction = {
    .name = "asymmetric_friction",
    .summary = "Friction differs between the two directions of motion.",
    .order = 50,
    .equation = "dry level += dF_pos (v > 0), dF_neg (v < 0); D_v += dD_pos, dD_neg",
    .parameters =
        {
            {.name = "dF_pos",
             .unit = "N",
             .meaning = "added to the dry level forward",
             .plausible_min = 0.1,
             .plausible_max = 30,
             .fallback = 0},
            {.name = "dF_neg",
             .unit = "N",
             .meaning = "added to the dry level backward",
             .plausible_min = 0.1,
             .plausible_max = 30,
             .fallback = 0},
            {.name = "dD_pos",
             .unit = "N s/m",
             .meaning = "added to the viscous friction forward",
             .plausible_min = 0.1,
             .plausible_max = 300,
             .fallback = 0},
            {.name = "dD_neg",
             .unit = "N s/m",
             .meaning = "added to the viscous friction backward",
             .plausible_min = 0.1,
             .plausible_max = 300,
             .fallback = 0},
        },
    .example = R"({"dF_pos": 4, "dF_neg": 1})",
    .affine = true,
    .drawn_against = DrawnAgainst::velocity,
    .neutral = {{"dF_pos", 0}, {"dF_neg", 0}, {"dD_pos", 0}, {"dD_neg", 0}},
    .apply =
        [](const Effect& e, ServoAxis& axis) {
            axis.plant.forward.level += e.number("dF_pos");
            axis.plant.forward.viscous += e.number("dD_pos");
            axis.plant.backward.level += e.number("dF_neg");
            axis.plant.backward.viscous += e.number("dD_neg");
        },
    .lua = R"lua(
local ahead, behind = m.friction.forward, m.friction.backward
ahead.level, ahead.viscous = ahead.level + p.dF_pos, ahead.viscous + p.dD_pos
behind.level, behind.viscous = behind.level + p.dF_neg, behind.viscous + p.dD_neg
)lua",
    .forms = [](const Clues& c) -> std::vector<EffectForm> {
        const Signal forward = map(c.direction, [](double s) { return -std::max(s, 0.0); });
        const Signal backward = map(c.direction, [](double s) { return std::max(-s, 0.0); });
        const Signal v_forward = map(c.velocity, [](double v) { return -std::max(v, 0.0); });
        const Signal v_backward = map(c.velocity, [](double v) { return std::max(-v, 0.0); });
        const double typical = c.typical_force(), damping = typical / c.max_speed;
        const auto levels = regress({forward, backward}, c.force).coefficients;
        const auto both = regress({forward, backward, v_forward, v_backward}, c.force).coefficients;
        const double min_level = -c.axis.plant.dry.coulomb, min_damping = -c.axis.plant.viscous;
        const FitParameter dF_pos{"dF_pos", min_level, c.max_force(), false, 1e-3 * typical};
        const FitParameter dF_neg{"dF_neg", min_level, c.max_force(), false, 1e-3 * typical};
        const FitParameter dD_pos{"dD_pos", min_damping, 1e3 * damping + 1e3, false, 1e-3 * damping};
        const FitParameter dD_neg{"dD_neg", min_damping, 1e3 * damping + 1e3, false, 1e-3 * damping};
        return {{.form = "one direction, forward",
                 .parameters = {dF_pos},
                 .starts = {{c.noticeable(regress({forward}, c.force).coefficients[0])}}},
                {.form = "one direction, backward",
                 .parameters = {dF_neg},
                 .starts = {{c.noticeable(regress({backward}, c.force).coefficients[0])}}},
                {.form = "levels",
                 .parameters = {dF_pos, dF_neg},
                 .starts = {{c.noticeable(levels[0]), c.noticeable(levels[1])}}},
                {.form = "levels and damping",
                 .parameters = {dF_pos, dF_neg, dD_pos, dD_neg},
                 .starts = {both, {levels[0], levels[1], 0, 0}}}};
    },
    .fit_order = 40,
    .simpler = {"coulomb_friction", "viscous_friction", "constant_force"},
};

} // namespace tribode::effects
