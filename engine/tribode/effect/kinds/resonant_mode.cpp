#include "tribode/effect/candidate.hpp"

#include <algorithm>

namespace tribode::effects {

extern const EffectKind resonant_mode = {
    .name = "resonant_mode",
    .summary = "The structure has one more vibration mode.",
    .order = 210,
    .equation = "one more vibration mode",
    .parameters =
        {
            {.name = "gain",
             .unit = "m/(N s^2)",
             .meaning = "modal gain",
             .allowed = Allowed::positive,
             .plausible_min = 1e-4,
             .plausible_max = 1},
            {.name = "freq_hz",
             .unit = "Hz",
             .meaning = "natural frequency",
             .allowed = Allowed::positive,
             .plausible_min = 5,
             .plausible_max = 500},
            {.name = "zeta",
             .meaning = "damping ratio",
             .allowed = Allowed::non_negative,
             .plausible_min = 1e-3,
             .plausible_max = 0.2},
        },
    .example = R"({"gain": 0.01, "freq_hz": 60, "zeta": 0.02})",
    .affine = true,
    .drawn_against = DrawnAgainst::frequency,
    .apply =
        [](const Effect& e, ServoAxis& axis) {
            axis.plant.modes.push_back({e.number("gain"), e.number("freq_hz"), e.number("zeta")});
        },
    .lua = R"lua(
table.insert(m.plant.modes, p)
)lua",
    .forms = [](const Clues& c) -> std::vector<EffectForm> {
        std::vector<std::vector<double>> probes;
        for (const double f : geometric(6, std::min(400.0, 0.3 / c.sample_time), 120)) {
            probes.push_back({0.03 * c.gain, f, 0.02});
        }
        return {{.parameters = {factor("gain", 1e-5 * c.gain, 20 * c.gain), factor("freq_hz", 2, 0.45 / c.sample_time),
                                factor("zeta", 5e-4, 0.7)},
                 .probes = probes,
                 .size = 0,
                 .tried = 3,
                 .on_beginnings = true}};
    },
    .fit_order = 190,
};

} // namespace tribode::effects
