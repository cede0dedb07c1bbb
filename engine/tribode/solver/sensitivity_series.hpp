#pragma once
#include "tribode/hybrid/piecewise_affine.hpp"
#include "tribode/solver/recurring_lengths.hpp"

#include <cstddef>
#include <span>
#include <unordered_map>
#include <vector>

namespace tribode {

// Sensitivities s_p = dx/dp of a system that is affine between events, with b constant there:
//
//     x' = A x + b,   s_p' = A s_p + A_p x + b_p
//
// Value and derivative have one Taylor series, carried to rounding. Steps of a length that recurs are products with matrices
// prepared from these series, as those of ExactIntegrator:
//
//     x(h) = x + Psi f,   s_p(h) = s_p + Psi (A s_p + q_p) + Psi_p f,   f = A x + b,   q_p = A_p x + b_p,   Psi_p = dPsi/dp
class SensitivitySeries {
  public:
    struct Prepared {
        double h;
        std::vector<double> move, psi; // Psi A, Psi (height x height)
        std::vector<double> psi_p;     // Psi_p, one after the other
    };

    // Of one A and its derivatives A_p.
    struct Pattern {
        std::vector<double> a; // (height x height)
        double decay = 0;      // the fastest of a state that decays by itself [1/s]
        // The A_p as sums of products u v^T: u (height each), and v, as the rows of a matrix.
        std::vector<double> left, right;
        std::vector<std::size_t> first; // where those of c (none) and of each parameter begin, and the end
        std::size_t rows = 0;           // of the matrix, filled up with zeros
        std::vector<double> met;        // lengths that recur, and how often the pattern has met them
        std::vector<int> times;
        std::vector<Prepared> prepared;
    };

    SensitivitySeries(std::size_t states, std::size_t parameters);

    std::size_t height() const { return height_; } // of a column, padded with zeros

    // The pattern of the key; make(pattern) fills a new one by set_matrices().
    template <class Make>
    Pattern& pattern(const AffineKey& key, const Make& make) {
        const auto known = patterns_.find(key);
        if (known != patterns_.end()) return known->second;
        if (patterns_.size() == max_patterns) patterns_.clear();
        Pattern& pattern = patterns_[key];
        make(pattern);
        return pattern;
    }

    // From matrices of states x states: A, and A_p one after the other.
    void set_matrices(Pattern& pattern, std::span<const double> a, std::span<const double> partial) const;

    // The columns s over a step of h [s] from t, with f and q at its beginning: (height) and (height x parameters).
    void propagate(Pattern& pattern, double t, double h, const double* f, const double* q, double* s);

  private:
    static constexpr std::size_t max_patterns = 2000;

    void expand(const Pattern& pattern, double h, const double* f, const double* q, double* s);
    const Prepared* prepared_for(Pattern& pattern, double t, double h);
    Prepared prepare(const Pattern& pattern, double h);

    const std::size_t states_, parameters_, height_;
    std::unordered_map<AffineKey, Pattern, AffineKey::Hash> patterns_;
    RecurringLengths recurring_{4};
    std::vector<double> room_, sums_; // (height x 1 + parameters), room_ four of them
    std::vector<double> values_;      // of each product
};

} // namespace tribode
