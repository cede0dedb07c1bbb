#include "tribode/effect/kinds.hpp"

#include <utility>

namespace tribode::effects {

// Maxwell-slip elements besides those the machine has.
const EffectKind presliding_hysteresis = {
    .name = "presliding_hysteresis",
    .equation = "Maxwell-slip elements added; replace_coulomb: Fc = 0",
    .parameters =
        {
            {.name = "elements",
             .meaning = "the elements",
             .type = EffectParameter::Type::records,
             .fields = {{.name = "K",
                         .unit = "N/m",
                         .meaning = "stiffness",
                         .allowed = Allowed::positive,
                         .plausible_min = 1e2,
                         .plausible_max = 1e7},
                        {.name = "F",
                         .unit = "N",
                         .meaning = "half the swing of a full loop",
                         .allowed = Allowed::positive,
                         .plausible_min = 0.05,
                         .plausible_max = 20},
                        {.name = "D",
                         .unit = "N s/m",
                         .meaning = "damping in stick",
                         .allowed = Allowed::non_negative,
                         .plausible_min = 0,
                         .plausible_max = 100,
                         .fallback = 0}}},
            {.name = "replace_coulomb",
             .meaning = "whether the Coulomb level goes, the elements being what it stood for",
             .type = EffectParameter::Type::flag,
             .fallback = 0},
        },
    .affine = true,
    .drawn_against = DrawnAgainst::distance_since_reversal,
    .neutral = {},
    .apply =
        [](const Effect& e, ServoAxis& axis) {
            auto elements = axis.plant.rolling.elements();
            for (const auto& record : e.records("elements")) elements.push_back({record[0], record[1], record[2]});
            axis.plant.rolling = RollingFriction(std::move(elements));
            if (!e.flag("replace_coulomb")) return;
            axis.plant.dry.static_level -= axis.plant.dry.coulomb;
            axis.plant.dry.coulomb = 0;
        },
};

} // namespace tribode::effects
