#include "tribode/effect/candidate.hpp"

#include <algorithm>

namespace tribode::effects {

// First in the amplifier; the recorded u is before it.
extern const EffectKind thrust_saturation = {
    .name = "thrust_saturation",
    .summary = "The amplifier limits the thrust.",
    .order = 160,
    .equation = "abs(u) limited in the amplifier",
    .parameters =
        {
            {.name = "limit",
             .unit = "N",
             .meaning = "the limit",
             .allowed = Allowed::positive,
             .plausible_min = 1,
             .plausible_max = 1000},
        },
    .example = R"({"limit": 6})",
    .affine = true,
    .drawn_against = DrawnAgainst::thrust,
    .apply = [](const Effect& e,
                ServoAxis& axis) { axis.amplifier.limit = std::min(axis.amplifier.limit, e.number("limit")); },
    .lua = R"lua(
m.amplifier.limit = math.min(m.amplifier.limit or math.huge, p.limit)
)lua",
    .forms = [](const Clues& c) -> std::vector<EffectForm> {
        std::vector<std::vector<double>> probes;
        // The reference of a controller that integrates at the limit goes far beyond it.
        for (const double share : geometric(1e-3, 0.98, 70)) probes.push_back({share * c.max_thrust});
        return {{.parameters = {factor("limit", 5e-4 * c.max_thrust, c.max_thrust)}, .probes = probes}};
    },
    .fit_order = 140,
};

} // namespace tribode::effects
