#include "tribode/solver/ida_integrator.hpp"

#include <algorithm>
#include <ida/ida.h>
#include <sunmatrix/sunmatrix_dense.h>
#include <sunmatrix/sunmatrix_sparse.h>

namespace tribode {

namespace {

constexpr MultistepLibrary ida = {{IDAFree, IDASetErrHandlerFn, IDASetUserData, IDASVtolerances, IDASetMaxStep,
                                   IDASetInitStep, IDASetStopTime, IDAGetNumErrTestFails},
                                  IDAGetLastOrder,
                                  IDAGetCurrentStep,
                                  IDAGetDky};

} // namespace

IdaIntegrator::IdaIntegrator(const HybridSystem& system, const SolverOptions& options)
    : MultistepIntegrator(system, options, ida),
      max_step_(options.max_step),
      slope_(own(N_VClone(vector_.get()), "N_VClone")) {
    N_VConst(0.0, slope_.get());
    take_memory(IDACreate(context_.get()), "IDACreate");
    check(IDAInit(memory(), residual_callback, 0.0, vector_.get(), slope_.get()), "IDAInit");
    set_up(options);
    const bool analytic = make_jacobian();
    check(IDASetLinearSolver(memory(), linear_solver_.get(), matrix_.get()), "IDASetLinearSolver");
    if (analytic) check(IDASetJacFn(memory(), jacobian_callback), "IDASetJacFn");
    // What Newton's method leaves of a step's error counts as noise in the estimates of all orders.
    constexpr double of_tolerance = 0.01;
    check(IDASetNonlinConvCoef(memory(), of_tolerance), "IDASetNonlinConvCoef");
}

int IdaIntegrator::residual_callback(double t, N_Vector x, N_Vector dxdt, N_Vector residual, void* self) {
    auto& me = *static_cast<IdaIntegrator*>(self);
    const int flag = derivative_callback(t, x, residual, self);
    double* values = NV_DATA_S(residual);
    const double* slope = NV_DATA_S(dxdt);
    if (me.size_ == 0) values[0] = slope[0];
    for (std::size_t i = 0; i < me.size_; ++i) {
        values[i] = me.system_.states()[i].is_algebraic() ? -values[i] : slope[i] - values[i];
    }
    return flag;
}

// -df/dx, and on the diagonal of the states the weight that the formula gives dx/dt.
int IdaIntegrator::jacobian_callback(double t, double weight, N_Vector x, N_Vector, N_Vector, SUNMatrix matrix,
                                     void* self, N_Vector, N_Vector, N_Vector) {
    auto& me = *static_cast<IdaIntegrator*>(self);
    if (const int flag = me.put_jacobian(t, x, matrix); flag != 0) return flag;
    const bool sparse = me.has_sparse_jacobian();
    double* data = sparse ? SM_DATA_S(matrix) : SM_DATA_D(matrix);
    const std::size_t count = sparse ? me.rows_.size() : me.size_ * me.size_;
    for (std::size_t i = 0; i < count; ++i) data[i] = -data[i];
    for (std::size_t i = 0; i < me.size_; ++i) {
        if (me.system_.states()[i].is_algebraic()) continue;
        data[sparse ? static_cast<std::size_t>(me.diagonal_[i]) : i * me.size_ + i] += weight;
    }
    if (me.size_ == 0) data[0] = weight; // the state that rests
    return 0;
}

void IdaIntegrator::native_restart(double t) {
    const std::span<double> slope(N_VGetArrayPointer(slope_.get()), size_);
    system_.rates(t, values(vector_.get()), *state_->discrete, slope);
    ++counts_.derivative_evaluations;
    slope_is_finite_ = !not_finite_in(slope, t);
    check(IDAReInit(memory(), t, vector_.get(), slope_.get()), "IDAReInit");
    set_max_step(max_step_);
    held_steps_ = 0;
    failures_ = 0;
    low_steps_ = 0;
}

SundialsIntegrator::Native IdaIntegrator::native_step(double t_stop, double& t) {
    constexpr int max_low_steps = 50;
    constexpr double shorter = 0.01;
    if (low_steps_ > max_low_steps) {
        check(IDAGetLastStep(memory(), &kept_step_), "IDAGetLastStep");
        kept_step_ *= shorter;
        restart(*state_);
    }
    if (!slope_is_finite_) {
        derivative_callback(t, vector_.get(), derivative(), this); // notes which one
        return Native::failed;
    }
    const Native result =
        solve(t_stop, t, [&] { return IDASolve(memory(), t_stop, &t, vector_.get(), slope_.get(), IDA_ONE_STEP); });
    if (result != Native::failed) watch_order();
    return result;
}

// IDA doubles its step as soon as its estimate allows, also right after it has failed with the doubled one, and raises the
// order only after equal steps. A problem in which small errors of states are large ones of algebraic variables (an
// amplifier) so keeps it at order one for good. Hence, after a failure, the step stays for as long as raising the
// order takes; and where the order stays low all the same, the method begins anew with a shorter step, as then it raises
// the order with each step.
void IdaIntegrator::watch_order() {
    const long failures = native_rejected_steps();
    const bool failed = failures > failures_;
    failures_ = failures;
    const int last = last_order();
    int next = 0;
    check(IDAGetCurrentOrder(memory(), &next), "IDAGetCurrentOrder");
    low_steps_ = last <= 2 ? low_steps_ + (failed ? 6 : 1) : std::max(0, low_steps_ - 3);
    if (failed) {
        double h = 0;
        check(IDAGetLastStep(memory(), &h), "IDAGetLastStep");
        set_max_step(h);
        held_steps_ = next + 2;
    } else if (held_steps_ > 0 && --held_steps_ == 0) {
        set_max_step(max_step_);
    }
}

} // namespace tribode
