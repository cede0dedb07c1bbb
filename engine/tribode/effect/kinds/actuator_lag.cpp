#include "tribode/effect/candidate.hpp"

namespace tribode::effects {

// In place of the machine's own current loop.
extern const EffectKind actuator_lag = {
    .name = "actuator_lag",
    .summary = "The current loop is slower or faster.",
    .order = 200,
    .equation = "current_loop_hz of the machine is this one",
    .parameters =
        {
            {.name = "current_loop_hz",
             .unit = "Hz",
             .meaning = "corner frequency of the thrust",
             .allowed = Allowed::positive,
             .plausible_min = 20,
             .plausible_max = 5000},
        },
    .example = R"({"current_loop_hz": 120})",
    .affine = true,
    .drawn_against = DrawnAgainst::frequency,
    .apply = [](const Effect& e, ServoAxis& axis) { axis.plant.current_loop_hz = e.number("current_loop_hz"); },
    .lua = R"lua(
m.amplifier.lag_hz = p.current_loop_hz
)lua",
    .forms = [](const Clues& c) -> std::vector<EffectForm> {
        const double present = c.axis.plant.current_loop_hz > 0 ? c.axis.plant.current_loop_hz : 2000;
        std::vector<std::vector<double>> probes;
        for (const double share : {0.85, 0.6, 0.4, 0.25, 0.15, 0.08, 1.3}) probes.push_back({share * present});
        return {{.parameters = {factor("current_loop_hz", 5, 20 * present)}, .probes = probes}};
    },
    .fit_order = 180,
};

} // namespace tribode::effects
