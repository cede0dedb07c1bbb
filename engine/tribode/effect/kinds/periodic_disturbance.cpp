#include "tribode/effect/candidate.hpp"

#include <algorithm>

namespace tribode::effects {

// Carried by two states of the machine, which keeps it affine.
extern const EffectKind periodic_disturbance = {
    .name = "periodic_disturbance",
    .summary = "A force is periodic in time.",
    .order = 130,
    .equation = "F sin(2 pi freq_hz t + phase)",
    .parameters =
        {
            {.name = "F", .unit = "N", .meaning = "amplitude", .plausible_min = 0.05, .plausible_max = 20},
            {.name = "freq_hz",
             .unit = "Hz",
             .meaning = "frequency",
             .allowed = Allowed::positive,
             .plausible_min = 0.1,
             .plausible_max = 200},
            phase_parameter(),
        },
    .example = R"({"F": 2, "freq_hz": 7})",
    .affine = true,
    .drawn_against = DrawnAgainst::time,
    .neutral = {{"F", 0}},
    .apply =
        [](const Effect& e, ServoAxis& axis) {
            axis.plant.sine_forces.push_back({e.number("F"), e.number("freq_hz"), e.number("phase")});
        },
    .lua = R"lua(
-- Carried by two states, so that the axis stays affine.
local w = 2 * math.pi * p.freq_hz
m.add_force {
  states = { sine = p.F * math.sin(p.phase), cosine = p.F * math.cos(p.phase) },
  rates = function(_, own) return { sine = w * own.cosine, cosine = -w * own.sine } end,
  force = function(_, own) return own.sine end,
  nominal = 1e6,
}
)lua",
    .forms = [](const Clues& c) -> std::vector<EffectForm> {
        const double typical = c.typical_force(), Ts = c.sample_time;
        std::vector<std::vector<double>> points;
        const double shortest = 1 / (1.2 * c.residual.bandwidth);
        for (const auto& one : sinusoids(c.residual.time, c.force, {}, shortest, c.duration / 2, 3)) {
            points.push_back({std::max(one.amplitude, 0.02 * typical), 1 / one.period, one.phase});
        }
        // Above the band of the residual force the errors themselves show it.
        Signal time(c.whitened.size());
        for (std::size_t k = 0; k < time.size(); ++k) time[k] = static_cast<double>(k) * Ts;
        for (const auto& one : sinusoids(time, c.whitened, {}, 4 * Ts, 0.1, 1)) {
            for (const double phase : {0.0, 2.0, 4.0}) points.push_back({typical, 1 / one.period, phase});
        }
        return {{.parameters = {factor("F", 1e-4 * typical, 3 * c.max_force()),
                                factor("freq_hz", 0.5 / c.duration, 0.45 / Ts), angle("phase")},
                 .probes = points}};
    },
    .fit_order = 200,
};

} // namespace tribode::effects
