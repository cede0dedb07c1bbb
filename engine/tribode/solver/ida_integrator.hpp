#pragma once
#include "tribode/solver/multistep_integrator.hpp"

namespace tribode {

// IDA: backward differentiation formulas of variable order for 0 = F(t, x, dx/dt), here dx/dt - f of states and the equation
// of each algebraic variable. Serves systems without algebraic variables too.
class IdaIntegrator final : public MultistepIntegrator {
  public:
    IdaIntegrator(const HybridSystem& system, const SolverOptions& options);

  private:
    static int residual_callback(double t, N_Vector x, N_Vector dxdt, N_Vector residual, void* self);
    static int jacobian_callback(double t, double weight, N_Vector x, N_Vector dxdt, N_Vector residual,
                                 SUNMatrix matrix, void* self, N_Vector, N_Vector, N_Vector);
    void native_restart(double t) override;
    Native native_step(double t_stop, double& t) override;
    void watch_order();

    const double max_step_;       // [s]; 0: none
    int held_steps_ = 0;          // for which the step must not grow
    int low_steps_ = 0;           // at order one or two, more where they failed
    long failures_ = 0;           // of the error test, since the last restart
    bool slope_is_finite_ = true; // at the last restart
    Owned<N_Vector> slope_;
};

} // namespace tribode
