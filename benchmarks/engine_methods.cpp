#include "contender.hpp"

#include "machine_of.hpp"
#include "tribode/base/error.hpp"
#include "tribode/experiment/simulation.hpp"
#include "tribode/solver/simulator.hpp"

#include <fmt/format.h>

namespace tribode::bench {

MachineModel machine_of(const Scenario& scenario) {
    const problems::ServoProblem& table = scenario.table;
    MachineModel machine;
    machine.sample_time = table.sample_time;
    machine.rigid_gain = table.rigid_gain;
    for (const auto& mode : table.modes) machine.modes.push_back({mode.gain, mode.freq_hz, mode.zeta});
    for (const auto& element : table.elements) machine.elements.push_back({element.K, element.F, element.D});
    machine.viscous = table.viscous;
    machine.current_loop_hz = table.lag_hz;
    if (scenario.loop) {
        machine.closed_loop = true;
        machine.controller = PidController{scenario.loop->kp, scenario.loop->ki, scenario.loop->kd};
        machine.input_delay = scenario.loop->input_delay;
        machine.output_delay = scenario.loop->output_delay;
        machine.encoder_resolution = scenario.loop->encoder_resolution;
    }
    return machine;
}

namespace {

Drive drive_of(const Scenario& scenario) {
    if (scenario.loop) {
        return ClosedLoop{[&](long k) { return LoopInput{0, scenario.excitation(static_cast<std::size_t>(k))}; }};
    }
    return OpenLoop{[&](long k) {
        return std::array{scenario.excitation(static_cast<std::size_t>(k)), 0.0, 0.0, 0.0};
    }};
}

class Positions final : public Observer {
  public:
    explicit Positions(std::size_t count) { x.reserve(count); }
    void sampled(ClockId clock, long, const SystemState& state) override {
        if (clock == ServoSystem::controller) x.push_back(ServoPlant::position(state.x));
    }
    std::vector<double> x;
};

Run run_in_engine(const Scenario& scenario, const SolverOptions& solver) {
    const ServoSystem system(machine_of(scenario), drive_of(scenario));
    Simulator simulator(system, solver);
    Positions positions(scenario.samples + 1);
    simulator.observe(&positions);
    const RunOutcome outcome = simulator.advance_to(static_cast<double>(scenario.samples) * scenario.table.sample_time);
    if (!outcome.ok()) throw Error(outcome.message);
    const RunStatistics statistics = simulator.statistics();
    return {std::move(positions.x), static_cast<long>(scenario.samples), statistics.steps, statistics.events};
}

Contender method(std::string name, const SolverOptions& solver) {
    return {std::move(name), [solver](const Scenario& scenario) { return run_in_engine(scenario, solver); }};
}

} // namespace

std::vector<Contender> engine_methods() {
    using Way = Method;
    std::vector<Contender> all = {method("exact", {.method = Way::exact})};
    for (const Way way : {Way::erk, Way::adams, Way::bdf}) {
        for (const double tolerance : {3e-6, 1e-6, 1e-8}) {
            // The loosest at which S1 is within 1e-9 m: of the multistep methods it is none.
            if (tolerance == 3e-6 && way != Way::erk) continue;
            all.push_back(
                method(fmt::format("{} {:.0e}", name_of(way), tolerance),
                       {.method = way, .relative_tolerance = tolerance, .absolute_tolerance = 1e-3 * tolerance}));
        }
    }
    for (const Way way : {Way::fixed, Way::semi_implicit_euler, Way::zoh, Way::euler}) {
        for (const double step : {50e-6, 5e-6}) {
            // There Euler's method is beyond its limit of stability while the elements stick.
            if (way == Way::euler && step > 5e-6) continue;
            all.push_back(
                method(fmt::format("{} {:g} us", name_of(way), 1e6 * step), {.method = way, .fixed_step = step}));
        }
    }
    return all;
}

Contender engine_with_all_columns() {
    return {"exact with all columns", [](const Scenario& scenario) {
                DriveRecord record;
                for (std::size_t k = 0; k <= scenario.samples; ++k) {
                    record.t.push_back(static_cast<double>(k) * scenario.table.sample_time);
                    (scenario.loop ? record.excitation : record.u).push_back(scenario.excitation(k));
                }
                Simulation result = simulate(machine_of(scenario), record, {.solver = {.method = Method::exact}});
                if (!result.outcome.ok()) throw Error(result.outcome.message);
                return Run{std::move(result.trace.x), static_cast<long>(scenario.samples), result.statistics.steps,
                           result.statistics.events};
            }};
}

} // namespace tribode::bench
