#pragma once
#include "tribode/solver/first_crossing.hpp"
#include "tribode/solver/integrator.hpp"

#include <array>
#include <cstdint>
#include <unordered_map>
#include <vector>

namespace tribode {

// The solution of a piecewise-affine system to rounding error. Between events dx/dt = A x + b has the Taylor series
//
//     x(t0 + s h) = sum c_n s^n,   c_0 = x(t0),   c_{n+1} = h/(n+1) (A c_n + b_n)
//
// which is carried until two terms in a row are below half a unit in the last place of every state; where it does not
// come to an end h is halved. The guards are then polynomials in s of known coefficients, and their first fall through
// zero is found safely: bounds exclude most at a glance, and where they do not, subdivision in Bernstein form isolates
// the first sign change before Newton's method and bisection close in on it. No fall is missed, however short.
//
// Steps of a length that comes again (from sample to sample) in a pattern that comes again (the same elements in slip)
// need no series: with b constant x(t0 + h) = x + Psi f(x), Psi = integral of exp(A s) over [0, h], prepared once, and
// rows prepared beside it bound how far a guard can fall meanwhile. docs/decisions/0006 has the measurements.
class ExactIntegrator final : public Integrator {
  public:
    // Throws InputError, with the reason, where the system is not piecewise affine.
    explicit ExactIntegrator(const HybridSystem& system);

    void restart(SystemState& state) override;
    Progress step(double t_stop) override;
    void interpolate(double t, std::span<double> x) override;
    RunStatistics statistics() const override { return counts_; }

  private:
    static constexpr int max_terms = 30;
    static constexpr std::size_t max_patterns = 2000, max_regular = 4, most_recent = 8;

    // Columns of states are padded with zeros to `height_` numbers, a multiple of eight, which the processor adds and
    // multiplies at one time.
    using Columns = std::vector<double>; // (height x columns); of a matrix, height columns, the last ones zero

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

    // What is known of one A and G.
    struct Pattern {
        Columns a, square;                 // A, A^2
        double decay;                      // see fastest_decay [1/s]
        std::vector<std::vector<Entry>> g; // (guards)
        int series = 0;                    // steps of a regular length that were not prepared
        std::vector<Prepared> prepared;
    };

    using Key = std::array<std::uint64_t, std::tuple_size_v<AffinePattern>>; // an AffinePattern's bits
    struct Hash {
        std::size_t operator()(const Key& key) const;
    };

    void make_pattern(Pattern& pattern);
    double fastest_decay(const Columns& a) const;
    Prepared prepare(const Pattern& pattern, double h) const;
    bool same_length(double a, double b) const;
    const Prepared* prepared_for(double h) const;
    bool is_regular(double h);
    void learn(double h);
    double begin(double t_stop);
    void end(double span);
    bool propagate(const Prepared& prepared);
    bool expand(double h);
    double first_crossing();
    void evaluate(double s, std::span<double> x);
    double* term(int n) { return terms_.data() + static_cast<std::size_t>(n) * height_; }
    const double* term(int n) const { return terms_.data() + static_cast<std::size_t>(n) * height_; }

    const HybridSystem& system_;
    const std::size_t size_, height_, guard_count_;     // states, length of a padded column, guards
    const std::size_t propagator_height_, rest_height_; // see Prepared
    SystemState* state_ = nullptr;
    std::unordered_map<Key, Pattern, Hash> patterns_;
    std::vector<Key> oldest_; // keys of patterns_, as they came
    std::size_t replaced_ = 0;
    Key key_{};
    Pattern* pattern_ = nullptr;           // the present one; null where b varies
    std::vector<double> regular_, recent_; // step lengths that come again, and those met last [s]
    std::size_t next_recent_ = 0;
    double t0_ = 0, h_ = 0; // of the last step [s]
    // A propagated step takes a length for one that differs by rounding. Lest these differences add up, x counts as that of the time
    // state.t - behind_, and the next step makes up for it; lag_ is what the last step began with.
    double behind_ = 0, lag_ = 0;     // [s]
    int order_ = 0;                   // of its series; 0: a propagated step
    Columns terms_;                   // (height x max_terms + 1): c_n
    std::vector<double> work_;        // (height)
    std::vector<double> least_;       // (height): sizes of the states below which nothing counts
    std::vector<double> limit_;       // (height): sizes of terms below which they do not count
    std::vector<double> end_;         // (height): x where the series ends
    std::vector<double> travel_;      // (height): how far each state can go in the step
    std::vector<double> moved_;       // (propagator_height): propagator times f
    std::vector<double> speed_;       // (height): abs(f)
    std::vector<double> rest_;        // (rest_height): rest times abs(f)
    std::vector<double> guard_terms_; // (max_terms + 1) x guards
    std::vector<double> polynomial_;
    RunStatistics counts_;
};

} // namespace tribode
