#pragma once
#include "tribode/solver/integrator.hpp"

#include <vector>

namespace tribode {

// Methods with a fixed step h, as a student or a signal processor would integrate. Guards are looked at after each step
// only, so an event is handled up to one step late, and what happens within a step is missed. For comparison.
//
//   fixed                classical Runge-Kutta, order 4
//   euler                x+ = x + h f(x), order 1
//   semi_implicit_euler  states that are no positions as by euler; positions p+ = p + h v+ with the new velocity; order 1
//   zoh                  x+ = x + Psi f(x), Psi = integral of exp(L s) over [0, h]: the linear part L of the system is
//                        discretized by zero-order hold, all other forces keep their value of the step's beginning
class FixedStepIntegrator final : public Integrator {
  public:
    FixedStepIntegrator(const HybridSystem& system, Method method, double step);
    void restart(SystemState& state) override { state_ = &state; }
    Progress step(double t_stop) override;
    void interpolate(double t, std::span<double> x) override; // cubic Hermite for fixed, else a straight line
    RunStatistics statistics() const override { return counts_; }

  private:
    struct Propagator {
        double h;
        std::vector<double> psi; // column-major
    };

    void slope(double t, const std::vector<double>& x, std::vector<double>& dxdt);
    void runge_kutta(double h);
    void semi_implicit_euler(double h);
    void zero_order_hold(double h);
    const std::vector<double>& propagator(double h);

    const HybridSystem& system_;
    Method method_;
    double step_; // [s]
    SystemState* state_ = nullptr;
    double t_before_ = 0;
    std::vector<double> x_before_, next_, k1_, k2_, k3_, k4_, guards_;
    std::vector<double> linear_; // L, column-major
    std::vector<Propagator> propagators_;
    RunStatistics counts_;
};

// Psi = integral of exp(L s) over [0, h] of a column-major square matrix of n rows, to rounding.
std::vector<double> integral_of_exponential(const std::vector<double>& l, std::size_t n, double h);

} // namespace tribode
