#include "tribode/solver/cvode_integrator.hpp"

#include <cvode/cvode.h>
#include <sunnonlinsol/sunnonlinsol_fixedpoint.h>

namespace tribode {

namespace {

constexpr MultistepLibrary cvode = {{CVodeFree, CVodeSetErrHandlerFn, CVodeSetUserData, CVodeSVtolerances,
                                     CVodeSetMaxStep, CVodeSetInitStep, CVodeSetStopTime, CVodeGetNumErrTestFails},
                                    CVodeGetLastOrder,
                                    CVodeGetCurrentStep,
                                    CVodeGetDky};

} // namespace

CvodeIntegrator::CvodeIntegrator(const HybridSystem& system, const SolverOptions& options)
    : MultistepIntegrator(system, options, cvode) {
    take_memory(CVodeCreate(options.method == Method::bdf ? CV_BDF : CV_ADAMS, context_.get()), "CVodeCreate");
    check(CVodeInit(memory(), derivative_callback, 0.0, vector_.get()), "CVodeInit");
    set_up(options);
    if (options.method == Method::bdf) {
        const bool analytic = make_jacobian();
        check(CVodeSetLinearSolver(memory(), linear_solver_.get(), matrix_.get()), "CVodeSetLinearSolver");
        if (analytic) check(CVodeSetJacFn(memory(), jacobian_callback), "CVodeSetJacFn");
    } else {
        nonlinear_solver_ = own(SUNNonlinSol_FixedPoint(vector_.get(), 0, context_.get()), "SUNNonlinSol_FixedPoint");
        check(CVodeSetNonlinearSolver(memory(), nonlinear_solver_.get()), "CVodeSetNonlinearSolver");
    }
    // A solution may need steps of a few roundings of the time; whether they get on is seen in SundialsIntegrator.
    check(CVodeSetMaxHnilWarns(memory(), -1), "CVodeSetMaxHnilWarns");
}

int CvodeIntegrator::jacobian_callback(double t, N_Vector x, N_Vector, SUNMatrix matrix, void* self, N_Vector, N_Vector,
                                       N_Vector) {
    return static_cast<CvodeIntegrator*>(self)->put_jacobian(t, x, matrix);
}

void CvodeIntegrator::native_restart(double t) { check(CVodeReInit(memory(), t, vector_.get()), "CVodeReInit"); }

SundialsIntegrator::Native CvodeIntegrator::native_step(double t_stop, double& t) {
    return solve(t_stop, t, [&] { return CVode(memory(), t_stop, vector_.get(), &t, CV_ONE_STEP); });
}

} // namespace tribode
