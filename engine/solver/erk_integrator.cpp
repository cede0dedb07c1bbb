#include "solver/erk_integrator.hpp"

#include <algorithm>
#include <arkode/arkode_erkstep.h>
#include <cmath>

namespace tribode {

ErkIntegrator::ErkIntegrator(const HybridSystem& system, const SolverOptions& options)
    : SundialsIntegrator(system, options) {
    memory_ = ERKStepCreate(derivative_callback, 0.0, vector_.get(), context_);
    check(memory_ ? 0 : -1, "ERKStepCreate");
    check(ERKStepSetUserData(memory_, this), "ERKStepSetUserData");
    check(ERKStepSetErrHandlerFn(memory_, message_callback, this), "ERKStepSetErrHandlerFn");
    check(ERKStepSetTableNum(memory_, ARKODE_DORMAND_PRINCE_7_4_5), "ERKStepSetTableNum");
    check(ERKStepSVtolerances(memory_, options.relative_tolerance, tolerance_.get()), "ERKStepSVtolerances");
    check(ERKStepSetAdaptivityFn(memory_, choose_step, this), "ERKStepSetAdaptivityFn");
    if (const auto guards = static_cast<int>(system.guard_count()); guards > 0) {
        check(ERKStepRootInit(memory_, guards, guard_callback), "ERKStepRootInit");
        std::vector<int> falling(system.guard_count(), -1);
        check(ERKStepSetRootDirection(memory_, falling.data()), "ERKStepSetRootDirection");
        check(ERKStepSetNoInactiveRootWarn(memory_), "ERKStepSetNoInactiveRootWarn");
    }
}

ErkIntegrator::~ErkIntegrator() { ERKStepFree(&memory_); }

void ErkIntegrator::native_restart(double t, double h) {
    check(ERKStepReset(memory_, t, vector_.get()), "ERKStepReset");
    check(ERKStepSetInitStep(memory_, h), "ERKStepSetInitStep");
}

SundialsIntegrator::Native ErkIntegrator::native_step(double t_stop, double& t) {
    check(ERKStepSetStopTime(memory_, t_stop), "ERKStepSetStopTime");
    switch (ERKStepEvolve(memory_, t_stop, vector_.get(), &t, ARK_ONE_STEP)) {
    case ARK_SUCCESS: return t == t_stop ? Native::stopped : Native::stepped;
    case ARK_TSTOP_RETURN: t = t_stop; return Native::stopped;
    case ARK_ROOT_RETURN: return Native::root;
    default: return Native::failed;
    }
}

void ErkIntegrator::native_roots(int* found) const { ERKStepGetRootInfo(memory_, found); }

long ErkIntegrator::native_rejected_steps() const {
    long failures = 0;
    ERKStepGetNumErrTestFails(memory_, &failures);
    return failures;
}

// The step that would have met the tolerance: the error grows with its fifth power. The library shortens what it
// proposes to the stop time, so the proposal is kept from here.
int ErkIntegrator::choose_step(N_Vector, double, double h, double, double, double error, double, double, int,
                               int embedded_order, double* proposed, void* self) {
    constexpr double safety = 0.9, least_error = 1e-6; // chosen; at most 16 times the last step
    *proposed = safety * h * std::pow(std::max(error, least_error), -1.0 / (embedded_order + 1));
    static_cast<ErkIntegrator*>(self)->proposed_step_ = *proposed;
    return 0;
}

double ErkIntegrator::kept_step(bool, bool cut) const {
    // A step cut short by a sample instant says little of how long a step may be.
    return cut ? std::max(proposed_step_, kept_step_) : proposed_step_;
}

void ErkIntegrator::interpolate(double t, std::span<double> x) {
    check(ERKStepGetDky(memory_, t, 0, dense_.get()), "ERKStepGetDky");
    std::copy_n(N_VGetArrayPointer(dense_.get()), size_, x.begin());
}

} // namespace tribode
