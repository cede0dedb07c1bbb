// What it costs to carry the reference machine's seven states over one sample time in which no guard crosses zero: by the
// series of the exact solver, by its prepared step with the guards' bounds, and by matrix exponentials made anew at
// each step, as one needs them where the step's length is not known beforehand. docs/decisions/0006.

#include "tribode/machine/servo_system.hpp"
#include "tribode/script/machine_file.hpp"
#include "tribode/solver/exact_integrator.hpp"
#include "tribode/solver/fixed_step_integrator.hpp"

#include <Eigen/Dense>
#include <benchmark/benchmark.h>
#include <cmath>
#include <unsupported/Eigen/MatrixFunctions>

namespace tribode {
namespace {

using Eigen::MatrixXd;
using Eigen::VectorXd;

// All elements in stick, in motions of some per cent of the way to the first limit.
class StuckTable {
  public:
    StuckTable() : system_(model(), OpenLoop{}) {
        SystemState start = system_.initial_state();
        const double amplitude[] = {1e-8, 5e-6, 5e-9, 2e-6, 2e-9, 1e-6, 0.05}; // y, v, q1, q1', q2, q2', Fm
        for (int i = 0; i < count; ++i) {
            for (std::size_t j = 0; j < start.x.size(); ++j) start.x[j] = amplitude[j] * std::cos(1.7 * i + double(j));
            starts_.push_back(start);
        }
        const auto n = static_cast<Eigen::Index>(start.x.size());
        const AffineForm form = system_.affine_form(*start.discrete);
        matrix_ = Eigen::Map<const MatrixXd>(form.a.data(), n, n);
    }

    static constexpr int count = 64;
    const ServoSystem& system() const { return system_; }
    double sample_time() const { return system_.sample_time(); }
    const std::vector<SystemState>& starts() const { return starts_; }
    const MatrixXd& matrix() const { return matrix_; } // A of dx/dt = A x + b

  private:
    static MachineModel model() {
        const std::string file = TRIBODE_SOURCE_DIR "/models/linear_motor_table.lua";
        return MachineModel::from_description(read_description(file), file);
    }

    ServoSystem system_;
    std::vector<SystemState> starts_;
    MatrixXd matrix_;
};

// One step of the exact solver from each start in turn. `stretch` makes the lengths differ, so that none comes again.
void exact_steps(benchmark::State& state, double stretch) {
    const StuckTable table;
    ExactIntegrator integrator(table.system());
    SystemState now = table.starts().front();
    double fraction = 0;
    std::size_t at = 0;
    for (auto _ : state) {
        const SystemState& start = table.starts()[at++ % StuckTable::count];
        now.t = 0;
        std::copy(start.x.begin(), start.x.end(), now.x.begin());
        integrator.restart(now);
        fraction = std::fmod(fraction + 0.6180339887498949, 1.0);
        if (integrator.step(table.sample_time() * (1 + stretch * fraction)) != Integrator::Progress::stopped) {
            state.SkipWithError("a guard crossed zero");
            return;
        }
        benchmark::DoNotOptimize(now.x.data());
    }
}

void series(benchmark::State& state) { exact_steps(state, 1e-3); }
void prepared_step(benchmark::State& state) { exact_steps(state, 0); }

// x+ = x + Psi f, the exponential of the augmented matrix [A I; 0 0] made by Eigen: Pade approximant, scaling and
// squaring.
void eigen_exponential(benchmark::State& state) {
    const StuckTable table;
    const auto n = table.matrix().rows();
    MatrixXd augmented = MatrixXd::Zero(n + 1, n + 1);
    augmented.topLeftCorner(n, n) = table.matrix();
    VectorXd f(n), x(n);
    double fraction = 0;
    std::size_t at = 0;
    for (auto _ : state) {
        const SystemState& start = table.starts()[at++ % StuckTable::count];
        table.system().derivative(0, start.x, *start.discrete, {f.data(), start.x.size()});
        augmented.topRightCorner(n, 1) = f;
        fraction = std::fmod(fraction + 0.6180339887498949, 1.0);
        const MatrixXd all = augmented * (table.sample_time() * (1 + 1e-3 * fraction));
        x = Eigen::Map<const VectorXd>(start.x.data(), n) + all.exp().topRightCorner(n, 1);
        benchmark::DoNotOptimize(x.data());
    }
}

// The same with the series and doublings that make the propagator of the fixed-step zero-order hold.
void doubled_series(benchmark::State& state) {
    const StuckTable table;
    const auto n = table.matrix().rows();
    const std::vector<double> a(table.matrix().data(), table.matrix().data() + table.matrix().size());
    VectorXd f(n), x(n);
    double fraction = 0;
    std::size_t at = 0;
    for (auto _ : state) {
        const SystemState& start = table.starts()[at++ % StuckTable::count];
        table.system().derivative(0, start.x, *start.discrete, {f.data(), start.x.size()});
        fraction = std::fmod(fraction + 0.6180339887498949, 1.0);
        const auto psi =
            integral_of_exponential(a, static_cast<std::size_t>(n), table.sample_time() * (1 + 1e-3 * fraction));
        x = Eigen::Map<const VectorXd>(start.x.data(), n) + Eigen::Map<const MatrixXd>(psi.data(), n, n) * f;
        benchmark::DoNotOptimize(x.data());
    }
}

// For comparison: what every method pays at least.
void one_derivative(benchmark::State& state) {
    const StuckTable table;
    VectorXd f(table.matrix().rows());
    std::size_t at = 0;
    for (auto _ : state) {
        const SystemState& start = table.starts()[at++ % StuckTable::count];
        table.system().derivative(0, start.x, *start.discrete, {f.data(), start.x.size()});
        benchmark::DoNotOptimize(f.data());
    }
}

BENCHMARK(prepared_step);
BENCHMARK(series);
BENCHMARK(doubled_series);
BENCHMARK(eigen_exponential);
BENCHMARK(one_derivative);

} // namespace
} // namespace tribode

BENCHMARK_MAIN();
