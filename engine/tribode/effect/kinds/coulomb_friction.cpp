#include "tribode/effect/candidate.hpp"

namespace tribode::effects {

// The dry level, set-valued at v = 0; a Stribeck curve moves with it.
extern const EffectKind coulomb_friction = {
    .name = "coulomb_friction",
    .summary = "The dry friction is higher or lower.",
    .order = 10,
    .equation = "dry level += dF, set-valued at v = 0",
    .parameters =
        {
            {.name = "dF", .unit = "N", .meaning = "added to the dry level", .plausible_min = 0.1, .plausible_max = 50},
        },
    .example = R"({"dF": 5})",
    .affine = true,
    .drawn_against = DrawnAgainst::velocity,
    .neutral = {{"dF", 0}},
    .apply =
        [](const Effect& e, ServoAxis& axis) {
            DryFriction& dry = axis.plant.dry;
            dry.coulomb += e.number("dF");
            if (dry.stribeck) dry.stribeck->static_level += e.number("dF");
        },
    .lua = R"lua(
m.friction.coulomb = m.friction.coulomb + p.dF
m.friction.static = m.friction.static + p.dF
)lua",
    .forms = [](const Clues& c) -> std::vector<EffectForm> {
        const double level = -regress({c.direction}, c.force).coefficients[0];
        std::vector<std::vector<double>> starts{{c.noticeable(level)}};
        if (level > 0) starts.push_back({0.5 * level});
        return {{.parameters = {{"dF", -c.axis.plant.dry.coulomb, c.max_force(), false, 1e-3 * c.typical_force()}},
                 .starts = starts}};
    },
    .fit_order = 20,
};

} // namespace tribode::effects
