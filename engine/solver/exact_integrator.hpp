#pragma once
#include "solver/integrator.hpp"

#include <vector>

namespace tribode {

// The solution of a piecewise-affine system to rounding error: between events dx/dt = A x + b(t) has the Taylor series
//
//     x(t0 + s h) = sum c_n s^n,   c_0 = x(t0),   c_{n+1} = h/(n+1) (A c_n + b_n)
//
// which is carried until two terms in a row are below half a unit in the last place of every state; where 40 terms do
// not do, h is halved. The guards are then polynomials in s of known coefficients, and their first fall through zero is
// found safely: a Bernstein bound excludes most steps at a glance, and where it does not, subdivision isolates the
// first sign change before Newton's method and bisection close in on it. No fall is missed, however short.
class ExactIntegrator final : public Integrator {
  public:
    // Throws InputError, with the reason, where the system is not piecewise affine.
    explicit ExactIntegrator(const HybridSystem& system);

    void restart(SystemState& state) override { state_ = &state; }
    Progress step(double t_stop) override;
    void interpolate(double t, std::span<double> x) const override;
    RunStatistics statistics() const override { return counts_; }

  private:
    static constexpr int most_terms = 40;

    bool expand(double h);
    double first_fall();
    void evaluate(double s, std::span<double> x) const;
    double* term(int n) { return terms_.data() + static_cast<std::size_t>(n) * size_; }
    const double* term(int n) const { return terms_.data() + static_cast<std::size_t>(n) * size_; }

    const HybridSystem& system_;
    const std::size_t size_, guard_count_;
    SystemState* state_ = nullptr;
    double t0_ = 0, h_ = 0; // of the last step [s]
    int order_ = 0;
    std::vector<double> terms_;          // (most_terms + 1) x states: c_n
    std::vector<double> guard_terms_;    // (most_terms + 1) x guards
    std::vector<double> slope_, largest_;
    std::vector<double> polynomial_;     // of one guard
    RunStatistics counts_;
};

// The first s in [0, 1] at which the polynomial sum p_n s^n falls below zero after having been zero or above (s = 0
// where it begins below), or 2 where there is none. Exact up to rounding of the evaluation.
double first_fall_below_zero(std::span<const double> p);

} // namespace tribode
