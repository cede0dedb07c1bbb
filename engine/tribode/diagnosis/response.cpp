#include "tribode/diagnosis/response.hpp"
#include "tribode/base/error.hpp"
#include "tribode/solver/simulator.hpp"

#include <algorithm>
#include <cmath>

namespace tribode {

namespace {

// The fastest method that can: errors stay a hundredth of an encoder step and less.
SolverOptions diagnosis_solver(const ServoSystem& system) {
    SolverOptions options;
    options.method = !system.why_not_affine()          ? Method::exact
                     : !system.why_not_nearly_affine() ? Method::collocation
                                                       : Method::erk;
    options.relative_tolerance = 1e-5;
    options.absolute_tolerance = 1e-10;
    return options;
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

class SignalObserver final : public Observer {
  public:
    explicit SignalObserver(std::size_t samples) {
        signals.position.reserve(samples);
        signals.thrust.reserve(samples);
    }
    void sampled(ClockId clock, long, const SystemState& state) override {
        if (clock != ServoSystem::controller) return;
        const auto& values = ServoSystem::values(state);
        signals.position.push_back(values.detected);
        signals.thrust.push_back(values.thrust);
    }
    SimulatedSignals signals;
};

} // namespace

std::optional<SimulatedSignals> simulated_signals(const MachineModel& machine, const Measurement& measurement,
                                                  std::optional<std::uint64_t> noise_seed) {
    const ServoSystem system = noise_seed ? driven_system(machine, measurement.drive, *noise_seed)
                                          : driven_system(without_noise(machine), measurement.drive, 0);
    Simulator simulator(system, diagnosis_solver(system));
    SignalObserver observer(measurement.size());
    simulator.observe(&observer);
    const auto [low, high] = std::minmax_element(measurement.position().begin(), measurement.position().end());
    const double bound = 100 * std::max({std::abs(*low), std::abs(*high), *high - *low});
    // In parts, so that a loop that runs away is left early, and one whose numbers make it far stiffer than a sampled loop
    // is worth.
    constexpr std::size_t part = 500;
    constexpr long max_steps = 60; // per sample; machines as they are take one to ten
    const std::size_t last = measurement.size() - 1;
    for (std::size_t k = 0; k != last;) {
        k = std::min(k + part, last);
        const RunOutcome outcome = simulator.advance_to(static_cast<double>(k) * machine.sample_time);
        if (!outcome.ok() || !(std::abs(observer.signals.position.back()) < bound)) return std::nullopt;
        const RunStatistics work = simulator.statistics();
        if (work.steps + work.rejected_steps > max_steps * static_cast<long>(k)) return std::nullopt;
    }
    return std::move(observer.signals);
}

std::optional<std::vector<double>> simulated_position(const MachineModel& machine, const Measurement& measurement,
                                                      std::optional<std::uint64_t> noise_seed) {
    auto signals = simulated_signals(machine, measurement, noise_seed);
    if (!signals) return std::nullopt;
    return std::move(signals->position);
}

} // namespace tribode
