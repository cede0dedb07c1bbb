#include "tribode/effect/candidate.hpp"

#include <algorithm>

namespace tribode::effects {

// Last in the amplifier.
extern const EffectKind thrust_gain = {
    .name = "thrust_gain",
    .summary = "The motor force is larger or smaller than the thrust reference.",
    .order = 170,
    .equation = "Fm times gain",
    .parameters =
        {
            {.name = "gain",
             .meaning = "the gain",
             .allowed = Allowed::positive,
             .plausible_min = 0.5,
             .plausible_max = 1.5},
        },
    .example = R"({"gain": 1.2})",
    .affine = true,
    .drawn_against = DrawnAgainst::thrust,
    .neutral = {{"gain", 1}},
    .apply = [](const Effect& e, ServoAxis& axis) { axis.amplifier.gain *= e.number("gain"); },
    .lua = R"lua(
m.amplifier.gain = m.amplifier.gain * p.gain
)lua",
    .forms = [](const Clues& c) -> std::vector<EffectForm> {
        const double gain = 1 + regress({c.residual.thrust}, c.force).coefficients[0];
        return {{.parameters = {factor("gain", 0.05, 20)},
                 .starts = {{std::clamp(gain, 0.3, 3.0)}, {gain > 1 ? 1.1 : 0.9}}}};
    },
    .fit_order = 150,
    .simpler = {"payload_mass"}, // which does the same but for friction and other forces
};

} // namespace tribode::effects
