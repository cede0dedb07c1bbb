#pragma once
#include "tribode/solver/sundials_integrator.hpp"

namespace tribode {

// CVODE's multistep methods. Every restart begins again at order one with a short step, of which the size is kept.
class CvodeIntegrator final : public SundialsIntegrator {
  public:
    // options.method: adams or bdf.
    CvodeIntegrator(const HybridSystem& system, const SolverOptions& options);
    ~CvodeIntegrator() override;

  private:
    void native_restart(double t, double h) override;
    Native native_step(double t_stop, double& t) override;
    void native_polynomial(std::span<const double> x0, StepPolynomial& polynomial) override;
    long native_rejected_steps() const override;
    bool counters_restart() const override { return true; }
    double kept_step(bool first, bool cut) const override;
    bool keeps_step_at_events() const override { return false; }

    static int jacobian_callback(double t, N_Vector x, N_Vector fx, SUNMatrix matrix, void* self, N_Vector, N_Vector,
                                 N_Vector);

    void* memory_ = nullptr;
    Owned<N_Vector> derivative_;
    Owned<SUNNonlinearSolver> nonlinear_solver_;
};

} // namespace tribode
