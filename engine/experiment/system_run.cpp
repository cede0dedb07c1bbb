#include "experiment/system_run.hpp"
#include "base/error.hpp"
#include "solver/simulator.hpp"

#include <algorithm>
#include <cmath>
#include <fmt/format.h>

namespace tribode {

namespace {

constexpr double most_rows = 1e7;

class SystemRecorder final : public Observer {
  public:
    SystemRecorder(const EquationSystem& system, Table& table)
        : system_(system),
          table_(table),
          outputs_(system.equations().outputs.size()) {}

    void output(const SystemState& state) override {
        auto column = table_.columns.begin();
        (column++)->values.push_back(state.t);
        for (const double value : state.x) (column++)->values.push_back(value);
        for (const double value : system_.discrete(state)) (column++)->values.push_back(value);
        system_.outputs(state, outputs_);
        for (const double value : outputs_) (column++)->values.push_back(value);
    }

    void sampled(ClockId, long, const SystemState& state) override {
        for (const int when : system_.fired_by_sample(state)) events_.push_back({state.t, when, 0});
    }

    // Those of samples.
    const EventLog& events() const { return events_; }

  private:
    const EquationSystem& system_;
    Table& table_;
    std::vector<double> outputs_;
    EventLog events_;
};

Table empty_table(const Equations& equations) {
    Table table;
    table.add("t", "s", {});
    for (const auto& state : equations.states) table.add(state.name, state.unit, {});
    for (const auto& discrete : equations.discrete) table.add(discrete.name, discrete.unit, {});
    for (const auto& output : equations.outputs) table.add(output.name, output.unit, {});
    return table;
}

// Multiples of the step, and the end.
std::vector<double> grid_of(const SystemRunOptions& options) {
    const double step = options.output_step > 0 ? options.output_step : options.duration / 1000;
    const double count = std::floor(options.duration / step * (1 + 1e-12));
    if (!(count < most_rows)) {
        throw InputError(fmt::format("{} s in steps of {} s are more than {} rows", options.duration, step, most_rows));
    }
    std::vector<double> grid;
    for (double k = 0; k <= count; ++k) grid.push_back(std::min(k * step, options.duration));
    if (grid.back() < options.duration * (1 - 1e-12)) {
        grid.push_back(options.duration);
    } else {
        grid.back() = options.duration;
    }
    return grid;
}

} // namespace

SystemRun run_system(const EquationSystem& system, const SystemRunOptions& options, const RunControl& control) {
    SystemRun result;
    result.table = empty_table(system.equations());
    result.method = resolved(options.solver.method, system);
    Simulator run(system, options.solver, control);
    SystemRecorder recorder(system, result.table);
    run.observe(&recorder);
    run.set_output_grid(grid_of(options));
    result.outcome = run.advance_to(options.duration);
    result.statistics = run.statistics();

    // At one instant the guards come before the samples.
    result.events = run.events();
    result.events.insert(result.events.end(), recorder.events().begin(), recorder.events().end());
    std::stable_sort(result.events.begin(), result.events.end(),
                     [](const Event& a, const Event& b) { return a.t < b.t; });
    result.final_states = run.state().x;
    const auto discrete = system.discrete(run.state());
    result.final_discrete.assign(discrete.begin(), discrete.end());

    if (const auto& culprit = result.outcome.not_finite) {
        const auto& state = system.equations().states[culprit->state];
        const std::string line = state.where.empty() ? "" : fmt::format(" ({})", state.where);
        result.outcome.message =
            fmt::format("der({}){} is not a finite number at t = {:.9g} s; the last good state is that of t = {:.9g} s",
                        state.name, line, culprit->t, result.outcome.t);
    }
    return result;
}

} // namespace tribode
