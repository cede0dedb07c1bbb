#include "tribode/solver/cvode_integrator.hpp"

#include <algorithm>
#include <cvode/cvode.h>
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
        const bool analytic = make_jacobian();
        check(CVodeSetLinearSolver(memory_, linear_solver_.get(), matrix_.get()), "CVodeSetLinearSolver");
        if (analytic) check(CVodeSetJacFn(memory_, jacobian_callback), "CVodeSetJacFn");
    } else {
        nonlinear_solver_.reset(SUNNonlinSol_FixedPoint(vector_.get(), 0, context_));
        check(CVodeSetNonlinearSolver(memory_, nonlinear_solver_.get()), "CVodeSetNonlinearSolver");
    }
    derivative_.reset(N_VClone(vector_.get()));
    if (options.max_step > 0) check(CVodeSetMaxStep(memory_, options.max_step), "CVodeSetMaxStep");
    // A solution may need steps of a few roundings of the time; whether they get on is seen in SundialsIntegrator.
    check(CVodeSetMaxHnilWarns(memory_, -1), "CVodeSetMaxHnilWarns");
}

int CvodeIntegrator::jacobian_callback(double t, N_Vector x, N_Vector, SUNMatrix matrix, void* self, N_Vector, N_Vector,
                                       N_Vector) {
    return static_cast<CvodeIntegrator*>(self)->put_jacobian(t, x, matrix);
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
    default: return Native::failed;
    }
}

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

void CvodeIntegrator::native_polynomial(std::span<const double> x0, StepPolynomial& polynomial) {
    int order = 0;
    check(CVodeGetLastOrder(memory_, &order), "CVodeGetLastOrder");
    const auto derivative = [&](int k) {
        check(CVodeGetDky(memory_, polynomial.t0, k, derivative_.get()), "CVodeGetDky");
        return values(derivative_.get());
    };
    polynomial_of_derivatives(order, derivative, x0, values(vector_.get()), polynomial);
}

} // namespace tribode
