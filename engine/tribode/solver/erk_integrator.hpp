#pragma once
#include "tribode/solver/sundials_integrator.hpp"

#include <array>

namespace tribode {

// Dormand-Prince 5(4) of ARKODE's ERKStep. Between its steps x is the method's own continuous extension of order 4
// [Hairer 1993, II.6], made of the slopes that the step has evaluated anyway. A one-step method loses nothing at
// a restart but its step size, and that is kept: the method of choice in a sampled loop.
class ErkIntegrator final : public SundialsIntegrator {
  public:
    ErkIntegrator(const HybridSystem& system, const SolverOptions& options);

    // The last step times the rate by which its last two stages, both at its end, differ [Hairer 1996, IV.2]. On a stiff
    // problem it stays near 3.3, where the method ceases to be stable; where accuracy asks for the steps it is well below.
    double stability_number() const;

  private:
    static constexpr std::size_t stages = 7;

    void native_restart(double t) override;
    Native native_step(double t_stop, double& t) override;
    void native_polynomial(std::span<const double> x0, StepPolynomial& polynomial) override;
    void derivative_seen(std::span<const double> slope) override;
    bool counters_restart() const override { return false; }
    double kept_step(bool first, bool cut) const override;
    bool keeps_step_at_events() const override { return true; }

    static int choose_step(N_Vector x, double t, double h, double, double, double error, double, double, int order,
                           int embedded_order, double* proposed, void* self);

    // k1, then k2 ... k7 of the last step.
    std::array<const double*, stages> slopes() const;

    const double relative_tolerance_;
    std::vector<double> start_;                               // the slope at the beginning of the step
    std::array<std::vector<double>, stages - 1> last_slopes_; // those seen last, a ring
    std::size_t next_slope_ = 0;
    bool start_awaited_ = true; // the next slope is that of a beginning
    bool stepped_ = false;      // since the last restart
    double proposed_step_ = 0;  // after the last step, whatever time it has to stop at [s]
};

} // namespace tribode
