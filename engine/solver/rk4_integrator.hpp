#pragma once
#include "solver/integrator.hpp"

namespace tribode {

// Classical Runge-Kutta method of order 4 with a fixed step, as one would write it on a signal processor: guards are
// looked at after each step only, so an event is handled up to one step late. For comparison, not for accuracy.
class Rk4Integrator final : public Integrator {
  public:
    Rk4Integrator(const HybridSystem& system, double step);
    void restart(SystemState& state) override;
    Progress step(double t_stop) override;
    void interpolate(double t, std::span<double> x) override; // cubic Hermite
    RunStatistics statistics() const override { return counts_; }

  private:
    void slope(double t, const std::vector<double>& x, std::vector<double>& dxdt);

    const HybridSystem& system_;
    double step_; // [s]
    SystemState* state_ = nullptr;
    double t_before_ = 0;
    std::vector<double> x_before_, k1_, k2_, k3_, k4_, stage_, guards_;
    RunStatistics counts_;
};

} // namespace tribode
