#pragma once
#include "solver/sundials_integrator.hpp"

namespace tribode {

// Dormand-Prince 5(4) of ARKODE's ERKStep, with Hermite interpolation of degree 4. A one-step method loses nothing at
// a restart but its step size, and that is kept: the method of choice in a sampled loop.
class ErkIntegrator final : public SundialsIntegrator {
  public:
    ErkIntegrator(const HybridSystem& system, const SolverOptions& options);
    ~ErkIntegrator() override;
    void interpolate(double t, std::span<double> x) override;

  private:
    void native_restart(double t, double h) override;
    Native native_step(double t_stop, double& t) override;
    void native_roots(int* found) const override;
    long native_rejected_steps() const override;
    bool counters_restart() const override { return false; }
    double kept_step(bool first, bool cut) const override;

    static int choose_step(N_Vector x, double t, double h, double, double, double error, double, double, int order,
                           int embedded_order, double* proposed, void* self);

    void* memory_ = nullptr;
    double proposed_step_ = 0; // after the last step, whatever time it has to stop at [s]
};

} // namespace tribode
