#pragma once
#include "tribode/solver/multistep_integrator.hpp"

namespace tribode {

// CVODE's multistep methods.
class CvodeIntegrator final : public MultistepIntegrator {
  public:
    // options.method: adams or bdf.
    CvodeIntegrator(const HybridSystem& system, const SolverOptions& options);

  private:
    void native_restart(double t) override;
    Native native_step(double t_stop, double& t) override;

    static int jacobian_callback(double t, N_Vector x, N_Vector fx, SUNMatrix matrix, void* self, N_Vector, N_Vector,
                                 N_Vector);
};

} // namespace tribode
