#include "tribode/diagnosis/response.hpp"
#include "tribode/base/error.hpp"

#include <algorithm>
#include <cmath>

namespace tribode {

namespace {

// Within one sample: a machine as it is takes hundreds at most, where it slips and sticks. Parameters with which it slips and
// sticks without end are none of a machine.
constexpr long max_steps_of_a_sample = 2500;

// Errors stay a hundredth of an encoder step and less.
ServoRunOptions options_of(std::uint64_t seed) {
    return {.solver = {.relative_tolerance = 1e-5, .absolute_tolerance = 1e-10, .max_steps = max_steps_of_a_sample},
            .seed = seed,
            .channels = {.t = false, .r = false, .motion = false},
            .purpose = Purpose::search};
}

MachineModel without_noise(MachineModel machine) {
    machine.noise_rms = 0;
    machine.process_noise_rms = 0;
    machine.encoder_resolution = 0;
    const auto rounds = [](const Effect& effect) { return effect.kind().is_rounding; };
    if (std::none_of(machine.effects.begin(), machine.effects.end(), rounds)) return machine;
    std::vector<Effect> others = machine.effects;
    std::erase_if(others, rounds);
    return machine.with_effects(std::move(others));
}

} // namespace

std::optional<SimulatedSignals> simulated_signals(const MachineModel& machine, const Measurement& measurement,
                                                  std::optional<std::uint64_t> noise_seed) {
    ServoRun run = driven_run(noise_seed ? machine : without_noise(machine), measurement.drive,
                              options_of(noise_seed.value_or(0)));
    const auto [low, high] = std::minmax_element(measurement.position().begin(), measurement.position().end());
    const double bound = 100 * std::max({std::abs(*low), std::abs(*high), *high - *low});
    // In parts, so that an unstable loop is left early, and one whose parameters make it far stiffer than a sampled loop.
    constexpr long part = 500;
    constexpr long max_steps = 25; // per sample; machines as they are take one to ten
    const auto last = static_cast<long>(measurement.size()) - 1;
    for (long k = 0; k != last;) {
        k = std::min(k + part, last);
        const RunOutcome outcome = run.advance_to(k);
        if (!outcome.ok() || !(std::abs(run.trace().y.back()) < bound)) return std::nullopt;
        const RunStatistics work = run.statistics();
        if (work.steps + work.rejected_steps > max_steps * k) return std::nullopt;
    }
    return SimulatedSignals{run.trace().y, run.trace().u};
}

std::optional<std::vector<double>> simulated_position(const MachineModel& machine, const Measurement& measurement,
                                                      std::optional<std::uint64_t> noise_seed) {
    auto signals = simulated_signals(machine, measurement, noise_seed);
    if (!signals) return std::nullopt;
    return std::move(signals->position);
}

} // namespace tribode
