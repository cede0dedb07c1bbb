#pragma once
#include "tribode/base/lanes.hpp"
#include "tribode/hybrid/piecewise_affine.hpp"
#include "tribode/solver/recurring_lengths.hpp"
#include "tribode/solver/series_kernels.hpp"

#include <cstddef>
#include <span>
#include <unordered_map>
#include <utility>
#include <vector>

namespace tribode {

// Sensitivities s_p = dx/dp of a system that is affine between events, with b constant there, by up to lane_count parameters:
//
//     x' = A x + b,   s_p' = A s_p + A_p x + b_p
//
// Value and derivative have one Taylor series, carried to rounding. Steps of a length that recurs are products with matrices
// prepared from these series, as those of ExactIntegrator:
//
//     x(h) = x + Psi f,   s_p(h) = s_p + Psi (A s_p + q_p) + Psi_p f,   f = A x + b,   q_p = A_p x + b_p,   Psi_p = dPsi/dp
//
// All parameters advance together: an operation on one state is one on Lanes. A has few entries, and the derivatives by one
// parameter are those of one or two of its parts, so that a term of eight parameters costs little more than that of x.
class SensitivitySeries {
  public:
    struct Prepared {
        double h;
        std::vector<double> psi; // (height x height), row by row
        std::vector<Lanes> psi_p;
    };

    // Of one A and its derivatives A_p; see SensitivityMatrices.
    struct Pattern {
        std::vector<double> a, full;
        std::vector<std::size_t> full_row;
        std::vector<SensitivityMatrices::Single> single;
        std::vector<Lanes> left, right;
        double decay = 0;
        std::vector<double> met; // lengths that recur, and how often the pattern has met them
        std::vector<int> times;
        std::vector<Prepared> prepared;
    };

    // parameters: as many of the lanes are in use, and the others zero.
    explicit SensitivitySeries(std::size_t states, std::size_t parameters = lane_count);

    // The pattern of the key; make(pattern) fills a new one by set_matrices().
    template <class Make>
    Pattern& pattern(const AffineKey& key, const Make& make) {
        // Mostly it is the one that followed the last one before.
        Entry* found = last_ ? last_->second.next : nullptr;
        if (!found || found->first != key) {
            found = &look_up(key, make);
            if (last_) last_->second.next = found;
        }
        last_ = found;
        return found->second;
    }

    std::size_t height() const { return height_; } // states, filled up with zeros

    // From matrices of states x states, by columns: A, and the A_p side by side.
    void set_matrices(Pattern& pattern, std::span<const double> a, std::span<const Lanes> partial) const;

    // A s + q
    void rates(const Pattern& pattern, std::span<const Lanes> q, std::span<const Lanes> s,
               std::span<Lanes> rates) const;

    // s over a step of h [s] from t, with f and q at its beginning; each with height() entries.
    void propagate(Pattern& pattern, double t, double h, std::span<const double> f, std::span<const Lanes> q,
                   std::span<Lanes> s);

  private:
    static constexpr std::size_t max_patterns = 2000;
    struct Followed;
    using Entry = std::pair<const AffineKey, Followed>;
    struct Followed : Pattern {
        Entry* next = nullptr; // the one that was found after this one
    };

    template <class Make>
    Entry& look_up(const AffineKey& key, const Make& make) {
        const auto known = patterns_.find(key);
        if (known != patterns_.end()) return *known;
        if (patterns_.size() == max_patterns) {
            patterns_.clear();
            last_ = nullptr;
        }
        Entry& entry = *patterns_.try_emplace(key).first;
        make(entry.second);
        return entry;
    }
    SensitivityMatrices matrices(const Pattern& pattern) const;
    void expand(const Pattern& pattern, double h, std::span<const double> f, std::span<const Lanes> rates,
                std::span<Lanes> s);
    const Prepared* prepared_for(Pattern& pattern, double t, double h);
    Prepared prepare(const Pattern& pattern, double h);
    double* value(std::vector<Lanes>& term) const { return numbers(term.data() + height_); }
    static double* numbers(Lanes* lanes) { return reinterpret_cast<double*>(lanes); }
    static const double* numbers(const Lanes* lanes) { return reinterpret_cast<const double*>(lanes); }

    const std::size_t states_, parameters_, height_, size_; // size: of a term of s and x together, in Lanes
    std::unordered_map<AffineKey, Followed, AffineKey::Hash> patterns_;
    Entry* last_ = nullptr; // found last
    RecurringLengths recurring_{4};
    std::vector<Lanes> rates_, room_, sums_;
};

} // namespace tribode
