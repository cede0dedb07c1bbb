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
    derivative_.reset(N_VClone(vector_.get()));
    if (options.max_step > 0) check(CVodeSetMaxStep(memory_, options.max_step), "CVodeSetMaxStep");
    // A solution may need steps of a few roundings of the time; whether they get on is seen in SundialsIntegrator.
    check(CVodeSetMaxHnilWarns(memory_, -1), "CVodeSetMaxHnilWarns");
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

// The derivatives of the polynomial that the method's history is, and the ends as they are: a state may move by more than
// its rounding within the rounding of the time.
void CvodeIntegrator::native_polynomial(std::span<const double> x0, StepPolynomial& polynomial) {
    int order = 0;
    check(CVodeGetLastOrder(memory_, &order), "CVodeGetLastOrder");
    polynomial.resize(size_, order);
    double factor = 1;
    for (int k = 0; k <= order; ++k) {
        if (k > 0) factor *= polynomial.h / k;
        check(CVodeGetDky(memory_, polynomial.t0, k, derivative_.get()), "CVodeGetDky");
        const double* derivative = N_VGetArrayPointer(derivative_.get());
        for (std::size_t i = 0; i < size_; ++i) polynomial.term(k)[i] = factor * derivative[i];
    }
    const std::span<const double> x1 = values(vector_.get());
    for (std::size_t i = 0; i < size_; ++i) {
        double end = 0;
        for (int k = order; k >= 0; --k) end += polynomial.term(k)[i];
        const double shift = x0[i] - polynomial.term(0)[i];
        polynomial.term(0)[i] = x0[i];
        polynomial.term(1)[i] += x1[i] - end - shift;
    }
}

} // namespace tribode
