#include "solver/cvode_integrator.hpp"

#include <algorithm>
#include <cvode/cvode.h>
#include <sunlinsol/sunlinsol_dense.h>
#include <sunmatrix/sunmatrix_dense.h>
#include <sunnonlinsol/sunnonlinsol_fixedpoint.h>

namespace tribode {

CvodeIntegrator::CvodeIntegrator(const HybridSystem& system, const SolverOptions& options)
    : SundialsIntegrator(system, options) {
    memory_ = CVodeCreate(options.method == Method::bdf ? CV_BDF : CV_ADAMS, context_);
    check(memory_ ? 0 : -1, "CVodeCreate");
    check(CVodeSetErrHandlerFn(memory_, message_callback, this), "CVodeSetErrHandlerFn");
    check(CVodeInit(memory_, derivative_callback, 0.0, vector_.get()), "CVodeInit");
    check(CVodeSetUserData(memory_, this), "CVodeSetUserData");
    check(CVodeSVtolerances(memory_, options.relative_tolerance, tolerance_.get()), "CVodeSVtolerances");
    if (options.method == Method::bdf) {
        const sunindextype n = N_VGetLength(vector_.get());
        matrix_.reset(SUNDenseMatrix(n, n, context_));
        linear_solver_.reset(SUNLinSol_Dense(vector_.get(), matrix_.get(), context_));
        check(CVodeSetLinearSolver(memory_, linear_solver_.get(), matrix_.get()), "CVodeSetLinearSolver");
        if (has_jacobian_) check(CVodeSetJacFn(memory_, jacobian_callback), "CVodeSetJacFn");
    } else {
        nonlinear_solver_.reset(SUNNonlinSol_FixedPoint(vector_.get(), 0, context_));
        check(CVodeSetNonlinearSolver(memory_, nonlinear_solver_.get()), "CVodeSetNonlinearSolver");
    }
    if (const auto guards = static_cast<int>(system.guard_count()); guards > 0) {
        check(CVodeRootInit(memory_, guards, guard_callback), "CVodeRootInit");
        std::vector<int> falling(system.guard_count(), -1);
        check(CVodeSetRootDirection(memory_, falling.data()), "CVodeSetRootDirection");
        check(CVodeSetNoInactiveRootWarn(memory_), "CVodeSetNoInactiveRootWarn");
    }
}

CvodeIntegrator::~CvodeIntegrator() { CVodeFree(&memory_); }

void CvodeIntegrator::native_restart(double t, double h) {
    check(CVodeReInit(memory_, t, vector_.get()), "CVodeReInit");
    check(CVodeSetInitStep(memory_, h), "CVodeSetInitStep");
}

SundialsIntegrator::Native CvodeIntegrator::native_step(double t_stop, double& t) {
    check(CVodeSetStopTime(memory_, t_stop), "CVodeSetStopTime");
    switch (CVode(memory_, t_stop, vector_.get(), &t, CV_ONE_STEP)) {
    case CV_SUCCESS: return t == t_stop ? Native::stopped : Native::stepped;
    case CV_TSTOP_RETURN: t = t_stop; return Native::stopped;
    case CV_ROOT_RETURN: return Native::root;
    default: return Native::failed;
    }
}

void CvodeIntegrator::native_roots(int* found) const { CVodeGetRootInfo(memory_, found); }

long CvodeIntegrator::native_rejected_steps() const {
    long failures = 0;
    CVodeGetNumErrTestFails(memory_, &failures);
    return failures;
}

double CvodeIntegrator::kept_step(bool first, bool cut) const {
    // After the first step the controller still works at order one: the size it proposes suits the next restart.
    if (!first) return kept_step_;
    double next = 0;
    CVodeGetCurrentStep(memory_, &next);
    return cut ? std::max(next, kept_step_) : next;
}

void CvodeIntegrator::interpolate(double t, std::span<double> x) {
    check(CVodeGetDky(memory_, t, 0, dense_.get()), "CVodeGetDky");
    std::copy_n(N_VGetArrayPointer(dense_.get()), size_, x.begin());
}

} // namespace tribode
