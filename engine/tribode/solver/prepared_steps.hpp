#pragma once
#include "tribode/hybrid/piecewise_affine.hpp"
#include "tribode/solver/series_kernels.hpp"

#include <algorithm>
#include <memory>
#include <mutex>
#include <span>
#include <unordered_map>
#include <utility>
#include <vector>

namespace tribode {

// What the exact solver has prepared, kept for further runs, of the same system or of others, which then need not prepare it
// again. All of it follows from the matrices of a pattern and the length of a step, and is given only to a run that has the same
// ones, to the bit; so the results of a run do not depend on what others have left here. For any number of runs and threads at a
// time.
class PreparedSteps {
  public:
    using Columns = std::vector<double>; // as in SeriesIntegrator

    // A guard's row of G without its zeros.
    struct Entry {
        std::size_t column;
        double value;
    };

    // Of a pattern, from its form.
    struct Matrices {
        Columns powers;                 // A, A^2, ..., see power_count() (height x height each)
        double decay;                   // see ExactIntegrator::fastest_decay [1/s]
        std::vector<Entry> entries;     // of G, row by row
        std::vector<std::size_t> first; // (guards + 1): of each row, its first entry
        std::vector<GuardId> moving;    // whose row is not empty

        // Of the guards that move, in whole groups, one at least.
        std::size_t groups() const { return std::max<std::size_t>((moving.size() + guard_group - 1) / guard_group, 1); }

        std::span<const Entry> row(GuardId guard) const {
            return {entries.data() + first[guard], first[guard + 1] - first[guard]};
        }
    };

    // From matrices, for steps of one length, with f the derivative at their beginning. Guards are those that move.
    struct Propagation {
        // Times f: how far x moves, Psi f, then the guards' first and second coefficients, in groups. Empty: the length is
        // too long for its series.
        Columns propagator; // (height + 2 guards in groups x height)
        // Times abs(f): a bound for all further coefficients of each guard together.
        Columns rest; // (guards in groups x height)
    };

    // Matrices and what has been prepared from them.
    class Pattern {
      public:
        explicit Pattern(Matrices made) : matrices(std::move(made)) {}

        const Matrices matrices;

        // What is there, or what make() returns, which is kept.
        template <class Make>
        std::shared_ptr<const Propagation> propagation(double h, const Make& make) {
            if (auto known = known_propagation(h)) return known;
            return keep(h, std::make_shared<const Propagation>(make()));
        }

      private:
        std::shared_ptr<const Propagation> known_propagation(double h) const;
        std::shared_ptr<const Propagation> keep(double h, std::shared_ptr<const Propagation> made);

        mutable std::mutex mutex_;
        std::vector<std::pair<double, std::shared_ptr<const Propagation>>> propagations_; // with their lengths
    };

    // The pattern of this form; make() returns the matrices of one that is not there. Systems that are not equal may have
    // several of one key.
    template <class Make>
    std::shared_ptr<Pattern> pattern(const AffineKey& key, const AffineForm& form, const Make& make) {
        if (auto known = known_pattern(key, form)) return known;
        return keep(key, form, std::make_shared<Pattern>(make()));
    }

  private:
    // Patterns and lengths that never recur must not fill the memory: what comes later is not kept.
    static constexpr std::size_t max_patterns = 2000, max_lengths = 64, max_forms = 8;

    struct Known {
        AffineForm form;
        std::shared_ptr<Pattern> pattern;
    };

    std::shared_ptr<Pattern> known_pattern(const AffineKey& key, const AffineForm& form) const;
    std::shared_ptr<Pattern> keep(const AffineKey& key, const AffineForm& form, std::shared_ptr<Pattern> made);

    mutable std::mutex mutex_;
    std::unordered_map<AffineKey, std::vector<Known>, AffineKey::Hash> patterns_; // of each key, up to max_forms
    std::size_t count_ = 0;                                                       // of all
};

} // namespace tribode
