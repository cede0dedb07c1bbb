#include "by_hand/loop.hpp"
#include "by_hand/sundials_handles.hpp"
#include "contender.hpp"

#include <algorithm>
#include <array>
#include <cvode/cvode.h>
#include <fmt/format.h>
#include <numbers>
#include <sunlinsol/sunlinsol_dense.h>
#include <sunmatrix/sunmatrix_dense.h>
#include <sunnonlinsol/sunnonlinsol_fixedpoint.h>

namespace tribode::bench {

namespace {

// Seven states as in ReducedTable, then the deflection of each of twenty elements. Whether an element slips is decided
// in the right side.
class FullTable {
  public:
    static constexpr std::size_t bodies = 3, elements = 20, first_element = 7, size = first_element + elements;

    explicit FullTable(const problems::ServoProblem& table) : table_(table), lag_(2 * std::numbers::pi * table.lag_hz) {
        for (std::size_t i = 0; i < elements; ++i) limit_[i] = table.elements.at(i).F / table.elements[i].K;
        for (std::size_t j = 1; j < bodies; ++j) omega_[j] = 2 * std::numbers::pi * table.modes.at(j - 1).freq_hz;
    }

    double reference = 0; // thrust reference [N]

    static double position(const double* x) { return x[0] + x[2] + x[4]; }

    void derivative(const double* x, double* dxdt) const {
        const double v = x[1] + x[3] + x[5];
        double friction = table_.viscous * v;
        for (std::size_t i = 0; i < elements; ++i) {
            const double z = x[first_element + i];
            const bool slips = std::abs(z) >= limit_[i] && z * v > 0;
            dxdt[first_element + i] = slips ? 0 : v;
            friction += table_.elements[i].K * std::clamp(z, -limit_[i], limit_[i]);
            if (!slips) friction += table_.elements[i].D * v;
        }
        const double effective = (lag_ > 0 ? x[6] : reference) - friction;
        dxdt[0] = x[1];
        dxdt[1] = table_.rigid_gain * effective;
        for (std::size_t j = 1; j < bodies; ++j) {
            const auto& mode = table_.modes[j - 1];
            dxdt[2 * j] = x[2 * j + 1];
            dxdt[2 * j + 1] =
                mode.gain * effective - 2 * mode.zeta * omega_[j] * x[2 * j + 1] - omega_[j] * omega_[j] * x[2 * j];
        }
        dxdt[6] = lag_ * (reference - x[6]);
    }

    void clamp(double* x) const {
        for (std::size_t i = 0; i < elements; ++i) {
            x[first_element + i] = std::clamp(x[first_element + i], -limit_[i], limit_[i]);
        }
    }

  private:
    const problems::ServoProblem& table_;
    double lag_;
    std::array<double, elements> limit_{};
    std::array<double, bodies> omega_{};
};

int derivative(double, N_Vector x, N_Vector dxdt, void* table) {
    static_cast<const FullTable*>(table)->derivative(NV_DATA_S(x), NV_DATA_S(dxdt));
    return 0;
}

Run run_cvode(const Scenario& scenario, Multistep family, double relative_tolerance) {
    FullTable table(scenario.table);
    Loop loop(scenario);
    SundialsVectors vectors(FullTable::size);
    vectors.set_tolerance(1e-3 * relative_tolerance);
    double* x = NV_DATA_S(vectors.x);

    void* memory = CVodeCreate(family == Multistep::bdf ? CV_BDF : CV_ADAMS, vectors.context);
    check(CVodeInit(memory, derivative, 0, vectors.x), "CVodeInit");
    check(CVodeSVtolerances(memory, relative_tolerance, vectors.tolerance), "CVodeSVtolerances");
    check(CVodeSetUserData(memory, &table), "CVodeSetUserData");
    check(CVodeSetMaxNumSteps(memory, 1'000'000), "CVodeSetMaxNumSteps");
    SUNMatrix matrix = nullptr;
    SUNLinearSolver linear = nullptr;
    SUNNonlinearSolver fixed_point = nullptr;
    if (family == Multistep::bdf) {
        matrix = SUNDenseMatrix(FullTable::size, FullTable::size, vectors.context);
        linear = SUNLinSol_Dense(vectors.x, matrix, vectors.context);
        check(CVodeSetLinearSolver(memory, linear, matrix), "CVodeSetLinearSolver");
    } else {
        fixed_point = SUNNonlinSol_FixedPoint(vectors.x, 0, vectors.context);
        check(CVodeSetNonlinearSolver(memory, fixed_point), "CVodeSetNonlinearSolver");
    }

    Run result;
    result.x.reserve(scenario.samples + 1);
    result.x.push_back(0);
    double t = 0;
    for (std::size_t k = 0; k < scenario.samples; ++k) {
        table.reference = loop.thrust(result.x.back());
        const double end = static_cast<double>(k + 1) * scenario.table.sample_time;
        check(CVodeReInit(memory, t, vectors.x), "CVodeReInit");
        check(CVodeSetStopTime(memory, end), "CVodeSetStopTime");
        check(CVode(memory, end, vectors.x, &t, CV_NORMAL), "CVode");
        long steps = 0;
        check(CVodeGetNumSteps(memory, &steps), "CVodeGetNumSteps");
        result.steps += steps;
        t = end;
        table.clamp(x);
        result.x.push_back(FullTable::position(x));
    }
    result.samples = static_cast<long>(scenario.samples);
    CVodeFree(&memory);
    if (fixed_point) SUNNonlinSolFree(fixed_point);
    if (linear) SUNLinSolFree(linear);
    if (matrix) SUNMatDestroy(matrix);
    return result;
}

} // namespace

Contender cvode_by_hand(Multistep family, double relative_tolerance) {
    return {fmt::format("CVODE {} {:.0e} by hand", family == Multistep::bdf ? "BDF" : "Adams", relative_tolerance),
            [=](const Scenario& scenario) { return run_cvode(scenario, family, relative_tolerance); }};
}

} // namespace tribode::bench
