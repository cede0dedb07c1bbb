// What one sample of a sampled run costs, and how exact it is, method by method.
//
// The golden run g1 (tests/golden): the linear-motor-driven table in open loop, u = 15 N sin(2 pi 10 Hz t)
// sampled and held at 500 us, 0.5 s from rest, no delay, no lag, no rounding. Beside the engine, in the same
// program, what one would write by hand: classical Runge-Kutta at 50 us with the friction elements clipped
// after each step. error_m: largest error of the position at the golden instants.

#include "experiment/simulation.hpp"
#include "ratio_report.hpp"
#include "record/csv.hpp"
#include "script/machine_file.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <fmt/format.h>
#include <numbers>

namespace tribode {
namespace {

constexpr std::size_t sample_count = 1001;
constexpr std::size_t golden_stride = 10; // samples per row of the golden file

MachineModel golden_machine() {
    const std::string file = TRIBODE_SOURCE_DIR "/models/linear_motor_table.lua";
    MachineModel machine = MachineModel::from_description(read_description(file), file);
    machine.input_delay = machine.output_delay = machine.current_loop_hz = machine.encoder_resolution = 0;
    machine.closed_loop = false;
    return machine;
}

DriveRecord golden_drive(const MachineModel& machine) {
    DriveRecord record;
    for (std::size_t k = 0; k < sample_count; ++k) {
        record.t.push_back(static_cast<double>(k) * machine.sample_time);
        record.u.push_back(15 * std::sin(2 * std::numbers::pi * 10 * record.t.back()));
    }
    return record;
}

double largest_error(const std::vector<double>& x) {
    static const std::vector<double> golden = read_csv(TRIBODE_SOURCE_DIR "/tests/golden/g1.csv")["x"].values;
    double worst = 0;
    for (std::size_t i = 0; i < golden.size(); ++i) {
        worst = std::max(worst, std::abs(x.at(i * golden_stride) - golden[i]));
    }
    return worst;
}

void report(benchmark::State& state, const std::vector<double>& x, long steps, long events) {
    state.counters["s_per_sample"] =
        benchmark::Counter(static_cast<double>(state.iterations()) * sample_count,
                           benchmark::Counter::kIsRate | benchmark::Counter::kInvert);
    state.counters["error_m"] = largest_error(x);
    state.counters["steps"] = static_cast<double>(steps);
    state.counters["events"] = static_cast<double>(events);
}

void engine(benchmark::State& state, const SolverOptions& solver) {
    const MachineModel machine = golden_machine();
    const DriveRecord record = golden_drive(machine);
    Simulation result;
    for (auto _ : state) {
        result = simulate(machine, record, solver, 0);
        benchmark::DoNotOptimize(result.trace.x.data());
    }
    if (!result.outcome.ok()) {
        state.SkipWithError(result.outcome.message.c_str());
        return;
    }
    report(state, result.trace.x, result.statistics.steps, result.statistics.events);
}

// The hand-written loop: a rigid body, two modes, twenty elements; no events, every array of fixed size.
class HandWrittenLoop {
  public:
    static constexpr int steps_per_sample = 10; // of 50 us

    explicit HandWrittenLoop(const MachineModel& machine) : machine_(machine) {
        gain_[0] = machine.rigid_gain;
        for (std::size_t j = 1; j < bodies; ++j) {
            const VibrationMode& mode = machine.modes.at(j - 1);
            const double omega = 2 * std::numbers::pi * mode.freq_hz;
            gain_[j] = mode.gain;
            damping_[j] = 2 * mode.zeta * omega;
            stiffness_[j] = omega * omega;
        }
        for (std::size_t i = 0; i < elements; ++i) limit_[i] = machine.elements.at(i).limit();
    }

    // The position at each sample instant.
    std::vector<double> run(const std::vector<double>& u) const {
        const double h = machine_.sample_time / steps_per_sample;
        State x{};
        std::vector<double> position;
        position.reserve(u.size());
        for (const double thrust : u) {
            position.push_back(sum(x, 0));
            for (int step = 0; step < steps_per_sample; ++step) {
                const State k1 = derivative(x, thrust), k2 = derivative(moved(x, k1, h / 2), thrust),
                            k3 = derivative(moved(x, k2, h / 2), thrust),
                            k4 = derivative(moved(x, k3, h), thrust);
                for (std::size_t i = 0; i < x.size(); ++i)
                    x[i] += h / 6 * (k1[i] + 2 * k2[i] + 2 * k3[i] + k4[i]);
                for (std::size_t i = 0; i < elements; ++i) {
                    x[2 * bodies + i] = std::clamp(x[2 * bodies + i], -limit_[i], limit_[i]);
                }
            }
        }
        return position;
    }

  private:
    static constexpr std::size_t bodies = 3, elements = 20;
    using State = std::array<double, 2 * bodies + elements>; // position and velocity of each body, then z

    static double sum(const State& x, std::size_t first) { return x[first] + x[first + 2] + x[first + 4]; }

    static State moved(State x, const State& slope, double h) {
        for (std::size_t i = 0; i < x.size(); ++i) x[i] += h * slope[i];
        return x;
    }

    State derivative(const State& x, double thrust) const {
        State slope{};
        const double v = sum(x, 1);
        double friction = machine_.viscous * v;
        for (std::size_t i = 0; i < elements; ++i) {
            const double z = x[2 * bodies + i];
            const bool sticks = std::abs(z) < limit_[i] || z * v < 0;
            slope[2 * bodies + i] = sticks ? v : 0;
            friction += machine_.elements[i].stiffness * z + (sticks ? machine_.elements[i].damping * v : 0);
        }
        for (std::size_t j = 0; j < bodies; ++j) {
            slope[2 * j] = x[2 * j + 1];
            slope[2 * j + 1] =
                gain_[j] * (thrust - friction) - damping_[j] * x[2 * j + 1] - stiffness_[j] * x[2 * j];
        }
        return slope;
    }

    const MachineModel& machine_;
    std::array<double, bodies> gain_{}, damping_{}, stiffness_{};
    std::array<double, elements> limit_{};
};

void hand_written(benchmark::State& state) {
    const MachineModel machine = golden_machine();
    const DriveRecord record = golden_drive(machine);
    const HandWrittenLoop loop(machine);
    std::vector<double> x;
    for (auto _ : state) {
        x = loop.run(record.u);
        benchmark::DoNotOptimize(x.data());
    }
    report(state, x, HandWrittenLoop::steps_per_sample * static_cast<long>(sample_count), 0);
}

} // namespace
} // namespace tribode

int main(int argc, char** argv) {
    using namespace tribode;
    benchmark::RegisterBenchmark("hand_written_rk4", hand_written)->Unit(benchmark::kMillisecond);
    for (const auto& name : SolverOptions::method_names()) {
        if (name == "auto") continue; // stands for one of the others
        SolverOptions solver{.method = method_named(name)};
        if (name == "exact" || name == "fixed") {
            benchmark::RegisterBenchmark(name.c_str(), engine, solver)->Unit(benchmark::kMillisecond);
            continue;
        }
        for (const double tolerance : {1e-6, 1e-8}) {
            solver.relative_tolerance = tolerance;
            solver.absolute_tolerance = 1e-4 * tolerance; // the run's displacement is of the order of 1e-4 m
            benchmark::RegisterBenchmark(fmt::format("{}_{:.0e}", name, tolerance).c_str(), engine, solver)
                ->Unit(benchmark::kMillisecond);
        }
    }
    return run_with_ratios(argc, argv, "hand_written_rk4", Time::processor);
}
