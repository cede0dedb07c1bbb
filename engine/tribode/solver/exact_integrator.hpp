#pragma once
#include "tribode/solver/prepared_steps.hpp"
#include "tribode/solver/series_integrator.hpp"

#include <memory>
#include <vector>

namespace tribode {

// The solution of a piecewise-affine system to rounding error. Between events dx/dt = A x + b has the Taylor series
//
//     x(t0 + s h) = sum c_n s^n,   c_0 = x(t0),   c_{n+1} = h/(n+1) (A c_n + b_n)
//
// which is carried until two terms in a row are below half a unit in the last place of every state; where it does not
// come to an end h is halved. The guards are then polynomials in s of known coefficients, and their first zero crossing
// is found safely: bounds exclude most at a glance, and where they do not, subdivision in Bernstein form isolates the
// first sign change before Newton's method and bisection close in on it. No zero crossing is missed, however short.
//
// Steps of a length that recurs (from sample to sample) in a pattern that recurs (the same elements in slip) need no
// series: with b constant x(t0 + h) = x + Psi f(x), Psi = integral of exp(A s) over [0, h], prepared once, and rows
// prepared beside it bound how far a guard can move meanwhile. docs/decisions/0006 has the measurements.
class ExactIntegrator final : public SeriesIntegrator {
  public:
    // Throws InputError, with the reason, where the system is not piecewise affine.
    // shared: what other runs have prepared, not owned; null: this one alone.
    explicit ExactIntegrator(const HybridSystem& system, PreparedSteps* shared = nullptr);

    void restart(SystemState& state) override;
    Progress step(double t_stop) override;
    void interpolate(double t, std::span<double> x) override;

  private:
    using Matrices = PreparedSteps::Matrices;
    using Propagation = PreparedSteps::Propagation;

    struct Prepared {
        double h;
        std::shared_ptr<const Propagation> step;
    };
    struct AffinePattern : Pattern<Prepared> {
        std::shared_ptr<PreparedSteps::Pattern> known;
    };

    static const HybridSystem& checked(const HybridSystem& system);
    Matrices make_matrices(const AffineForm& form) const;
    double fastest_decay(const Columns& a) const;
    Propagation prepare(double h);
    bool propagate(const Propagation& step);
    bool expand(double h);
    double find_crossing();
    void evaluate(double s, std::span<double> x);

    PreparedSteps* const shared_;
    Patterns<AffinePattern> patterns_;
    AffinePattern* pattern_ = nullptr;   // the present one; null where b varies
    const Matrices* matrices_ = nullptr; // its matrices
    std::vector<double> work_;           // (height)
    std::vector<double> least_;          // (height): sizes of the states below which nothing counts
    std::vector<double> limit_;          // (height): sizes of terms below which they do not count
    std::vector<double> end_;            // (height): x where the series ends
    std::vector<double> travel_;         // (height): how far each state can go in the step
    Columns response_;                   // (height x max_terms + 3): terms of prepare()
    std::vector<double> f_;              // (height): the derivative where the step begins, and
    bool known_at_start_ = false; // whether it and the guards there are known: where the step could not be propagated
    std::vector<double> moved_;   // (height): how far x moves in a propagated step
    std::vector<double> moving_guards_; // in whole groups: those that move, where it begins
};

} // namespace tribode
