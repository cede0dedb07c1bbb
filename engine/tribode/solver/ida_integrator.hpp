#pragma once
#include "tribode/solver/sundials_integrator.hpp"

namespace tribode {

// IDA: backward differentiation formulas of variable order for 0 = F(t, x, dx/dt), here dx/dt - f of states and the equation
// of each algebraic variable. Serves systems without algebraic variables too.
class IdaIntegrator final : public SundialsIntegrator {
  public:
    IdaIntegrator(const HybridSystem& system, const SolverOptions& options);
    ~IdaIntegrator() override;

  private:
    static int residual_callback(double t, N_Vector x, N_Vector dxdt, N_Vector residual, void* self);
    static int jacobian_callback(double t, double weight, N_Vector x, N_Vector dxdt, N_Vector residual,
                                 SUNMatrix matrix, void* self, N_Vector, N_Vector, N_Vector);
    void native_restart(double t, double h) override;
    Native native_step(double t_stop, double& t) override;
    void native_polynomial(std::span<const double> x0, StepPolynomial& polynomial) override;
    long native_rejected_steps() const override;
    bool counters_restart() const override { return true; }
    double kept_step(bool first, bool cut) const override;
    bool keeps_step_at_events() const override { return false; }
    void watch_order();

    const double max_step_;       // [s]; 0: none
    int held_steps_ = 0;          // for which the step must not grow
    int low_steps_ = 0;           // at order one or two, more where they failed
    long failures_ = 0;           // of the error test, since the last restart
    bool slope_is_finite_ = true; // at the last restart
    void* memory_ = nullptr;
    Owned<N_Vector> slope_, derivative_;
};

} // namespace tribode
