#pragma once
#include "tribode/solver/series_integrator.hpp"

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
    explicit ExactIntegrator(const HybridSystem& system);

    void restart(SystemState& state) override;
    Progress step(double t_stop) override;
    void interpolate(double t, std::span<double> x) override;

  private:
    // A guard's row of G without its zeros.
    struct Entry {
        std::size_t column;
        double value;
    };

    // Of a pattern, for steps of one length h, with f the derivative at their beginning.
    struct Prepared {
        double h;
        // Times f: how far x moves, Psi f, then for each guard its first and second coefficient. Empty: h is too long
        // for its series.
        Columns propagator; // (propagator_height x height)
        // Times abs(f): a bound for all further coefficients of each guard together.
        Columns rest; // (rest_height x height)
    };

    struct AffinePattern : Pattern<Prepared> {
        Columns a, square;              // A, A^2
        double decay;                   // see fastest_decay [1/s]
        std::vector<Entry> entries;     // of G, row by row
        std::vector<std::size_t> first; // (guards + 1): of each row, its first entry

        std::span<const Entry> row(GuardId guard) const {
            return {entries.data() + first[guard], first[guard + 1] - first[guard]};
        }
    };

    static const HybridSystem& checked(const HybridSystem& system);
    void make_pattern(AffinePattern& pattern) const;
    double fastest_decay(const Columns& a) const;
    Prepared prepare(const AffinePattern& pattern, double h);
    bool propagate(const Prepared& prepared);
    bool expand(double h);
    double find_crossing();
    void evaluate(double s, std::span<double> x);

    const std::size_t propagator_height_, rest_height_; // see Prepared
    Patterns<AffinePattern> patterns_;
    AffinePattern* pattern_ = nullptr; // the present one; null where b varies
    std::vector<double> work_;         // (height)
    std::vector<double> least_;        // (height): sizes of the states below which nothing counts
    std::vector<double> limit_;        // (height): sizes of terms below which they do not count
    std::vector<double> end_;          // (height): x where the series ends
    std::vector<double> travel_;       // (height): how far each state can go in the step
    Columns response_;                 // (height x max_terms + 1): terms of prepare()
    std::vector<double> f_;            // (height): the derivative where the step begins, and
    bool known_at_start_ = false; // whether it and the guards there are known: where the step could not be propagated
    std::vector<double> moved_;   // (propagator_height): propagator times f
    std::vector<double> speed_;   // (height): abs(f)
    std::vector<double> rest_;    // (rest_height): rest times abs(f)
};

} // namespace tribode
