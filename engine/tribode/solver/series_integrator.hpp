#pragma once
#include "tribode/hybrid/piecewise_affine.hpp"
#include "tribode/solver/first_crossing.hpp"
#include "tribode/solver/integrator.hpp"
#include "tribode/solver/recurring_lengths.hpp"
#include "tribode/solver/series_kernels.hpp"

#include <array>
#include <cmath>
#include <unordered_map>
#include <vector>

namespace tribode {

// What the solvers by Taylor series have in common: ExactIntegrator and CollocationIntegrator. Over a step of length h from t0
//
//     x(t0 + s h) = sum c_n s^n,  0 <= s <= 1,
//
// so the guards are polynomials in s, and their first zero crossing is found safely. Steps of a length that recurs (from
// sample to sample) at an A that recurs are propagated: products with matrices that were prepared once.
class SeriesIntegrator : public Integrator {
  public:
    RunStatistics statistics() const final { return counts_; }

  protected:
    // Columns of states are padded with zeros to `height_` numbers. (height x columns)
    using Columns = std::vector<double>;

    // What is known of one A, B, C and G. Prepared is of one step length, `h`.
    template <class Prepared>
    struct Pattern {
        int series = 0; // steps of a regular length that were not prepared
        std::vector<Prepared> prepared;
    };

    // Patterns that never recur must not fill the memory, nor keep it busy: the oldest is replaced.
    template <class Known>
    class Patterns {
      public:
        template <class Make>
        Known& find(const AffineKey& key, const Make& make) {
            // Mostly it is the one that followed the last one before: an element slips after its predecessor.
            Entry* const next = last_ ? last_->second.next : nullptr;
            if (!next || next->first != key) {
                Entry& found = look_up(key, make);
                if (last_) last_->second.next = &found;
                last_ = &found;
            } else {
                last_ = next;
            }
            return last_->second;
        }

      private:
        struct Followed;
        using Entry = std::pair<const AffineKey, Followed>;
        struct Followed : Known {
            Entry* next = nullptr; // the one that was found after this one
        };
        static constexpr std::size_t max_patterns = 2000;

        template <class Make>
        Entry& look_up(const AffineKey& key, const Make& make) {
            auto known = patterns_.find(key);
            if (known != patterns_.end()) return *known;
            if (patterns_.size() < max_patterns) {
                known = patterns_.try_emplace(key).first;
                oldest_.push_back(key);
            } else {
                AffineKey& oldest = oldest_[replaced_++ % max_patterns];
                auto node = patterns_.extract(oldest);
                node.key() = oldest = key;
                known = patterns_.insert(std::move(node)).position; // at the same address
            }
            make(known->second);
            return *known;
        }

        std::unordered_map<AffineKey, Followed, AffineKey::Hash> patterns_;
        Entry* last_ = nullptr;         // found last
        std::vector<AffineKey> oldest_; // keys of patterns_, as they came
        std::size_t replaced_ = 0;
    };

    static constexpr int max_terms = 30;

    // max_regular: how many lengths may count as recurring.
    SeriesIntegrator(const HybridSystem& system, std::size_t max_regular);

    // Whether the pattern of the state is another than at the last restart.
    bool is_new_pattern(const DiscreteState& d) {
        next_key_.clear();
        affine_.append_affine_key(d, next_key_);
        const bool is_same = next_key_ == key_;
        if (!is_same) key_.swap(next_key_);
        return !is_same;
    }

    template <class Prepared>
    const Prepared* prepared_for(const Pattern<Prepared>& pattern, double h) const {
        for (const auto& prepared : pattern.prepared) {
            if (same_length(prepared.h, h, state_->t)) return &prepared;
        }
        return nullptr;
    }
    // A pattern that has met a regular length for the second time will meet it again: that pays for preparing.
    template <class Prepared>
    bool is_worth_preparing(Pattern<Prepared>& pattern, double h) {
        return recurring_.met(h, state_->t) && ++pattern.series > 1;
    }

    // Where a step begins. Returns its whole length.
    double begin(double t_stop) {
        t0_ = state_->t;
        lag_ = behind_;
        order_ = 0;
        std::copy(state_->x.begin(), state_->x.end(), term(0));
        return t_stop - t0_ + lag_;
    }
    // Where it ends: at the zero crossing s h of a step of `whole`, at the end of a shorter step h, or at t_stop, where the
    // length differs by `behind` from the one that was prepared. x is that of t0 + span; time does not run back by the lag.
    Progress cross(double s, double h, double whole, double t_stop);
    Progress stop(double h, double whole, double t_stop, double behind) {
        if (h == whole) {
            state_->t = t_stop;
            behind_ = behind;
            return Progress::stopped;
        }
        const double span = h - lag_;
        state_->t = t0_ + std::max(span, 0.0);
        behind_ = std::max(-span, 0.0);
        return Progress::stepped;
    }

    // Terms from c_1 on, `next(n)` putting A c_n + b_n in the place of c_{n+1}, until two in a row are below half a unit in
    // the last place; false where they do not come to an end. largest: sizes of the states below which nothing counts; set
    // to the sizes of their terms.
    template <class Next>
    bool add_terms(double h, std::vector<double>& largest, const Next& next) {
        for (std::size_t i = 0; i < size_; ++i) {
            largest[i] = std::max({largest[i], std::abs(term(0)[i]), std::abs(term(1)[i])});
        }
        bool last_was_small = false;
        for (int n = 1; n < max_terms; ++n) {
            next(n);
            bool small = true;
            for (std::size_t i = 0; i < size_; ++i) {
                double& c = term(n + 1)[i];
                c *= h / (n + 1);
                const double size = std::abs(c);
                largest[i] = std::max(largest[i], size);
                small = small && size <= half_ulp * largest[i] && std::isfinite(size);
            }
            // b is a polynomial of degree 3 at most in what there is; its terms have all come by then.
            if (small && last_was_small && n > 5) {
                order_ = n + 1;
                return true;
            }
            last_was_small = small;
        }
        return false;
    }

    // The earliest zero crossing of a guard within the step; its guards are put into crossed_. polynomial(guard) puts the
    // guard's coefficients into polynomial_ and returns the last power, or nothing where it cannot cross zero.
    template <class Polynomial>
    double first_crossing(const Polynomial& polynomial) {
        crossed_.clear();
        double first = no_crossing;
        for (GuardId guard = 0; guard < guard_count_; ++guard) {
            const std::optional<std::size_t> last = polynomial(guard);
            if (!last) continue;
            const double s = first_crossing_below_zero({polynomial_.data(), *last + 1});
            if (s == no_crossing || s > first) continue;
            if (s < first) crossed_.clear();
            first = s;
            crossed_.push_back(guard);
        }
        return first;
    }
    // Fills guard_terms_ from power 1 on, where the input varies.
    void find_guard_terms();
    double* guard_term(std::size_t n) { return guard_terms_.data() + n * guard_count_; }

    // Whether a guard stays above zero that begins at g0 and moves by first s + second s^2 and by at most `rest` besides. s
    // and s^2 lie between 0 and 1, up to rounding, which the margin covers.
    static bool stays_positive(double g0, double first, double second, double rest) {
        const double least = g0 + std::min(0.0, first + std::min(0.0, second)) - rest;
        const double margin = 1e-12 * (std::abs(first) + std::abs(second) + rest);
        return least > margin;
    }

    Progress fail(std::optional<NotFinite> not_finite);

    double* term(int n) { return terms_.data() + static_cast<std::size_t>(n) * height_; }
    const double* term(int n) const { return terms_.data() + static_cast<std::size_t>(n) * height_; }

    const HybridSystem& system_;
    const PiecewiseAffine& affine_;
    const std::size_t size_, height_, guard_count_; // states, length of a padded column, guards
    SystemState* state_ = nullptr;
    AffineKey key_;         // of the present pattern
    double t0_ = 0, h_ = 0; // of the last step [s]
    // A propagated step takes a length for one that differs by rounding. So that these differences do not add up, x counts as
    // that of the time state.t - behind_, and the next step makes up for it; lag_ is what the last step began with.
    double behind_ = 0, lag_ = 0;     // [s]
    int order_ = 0;                   // of its series; 0: there is none yet
    Columns terms_;                   // (height x max_terms + 3): c_n, and room for two that do not count
    std::vector<double> guard_terms_; // (guards x max_terms + 1)
    std::array<double, max_polynomial_terms> polynomial_{};
    RunStatistics counts_;

  private:
    AffineKey next_key_;
    RecurringLengths recurring_;
};

} // namespace tribode
