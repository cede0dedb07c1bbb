#include "tribode/base/error.hpp"
#include "tribode/base/text.hpp"
#include "tribode/effect/kinds.hpp"

#include <fmt/format.h>

namespace tribode::effects {

// More mass on the rigid body, or less; the modes stay as they are.
const EffectKind payload_mass = {
    .name = "payload_mass",
    .equation = "k0 / (1 + ratio)",
    .parameters =
        {
            {.name = "ratio", .meaning = "added mass by the mass", .plausible_min = -0.5, .plausible_max = 2},
        },
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
};

} // namespace tribode::effects
