#pragma once
#include "tribode/hybrid/piecewise_affine.hpp"

#include <memory>
#include <mutex>
#include <span>
#include <unordered_map>
#include <utility>
#include <vector>

namespace tribode {

// What the exact solver has prepared of one system, kept for further runs of it or of equal ones, which then need not prepare
// it again. All of it follows from the key of the pattern and, bit by bit, from the length of the step; so the results of a
// run do not depend on what others have left here. For any number of runs and threads at a time.
class PreparedSteps {
  public:
    using Columns = std::vector<double>; // as in SeriesIntegrator

    // A guard's row of G without its zeros.
    struct Entry {
        std::size_t column;
        double value;
    };

    // Of a pattern.
    struct Matrices {
        Columns a, square;              // A, A^2 (height x height)
        double decay;                   // see ExactIntegrator::fastest_decay [1/s]
        std::vector<Entry> entries;     // of G, row by row
        std::vector<std::size_t> first; // (guards + 1): of each row, its first entry
        Columns moving;                 // (guard_room): -1 where the row is not empty

        std::span<const Entry> row(GuardId guard) const {
            return {entries.data() + first[guard], first[guard + 1] - first[guard]};
        }
    };

    // Of a pattern, for steps of one length, with f the derivative at their beginning.
    struct Propagation {
        // Times f: how far x moves, Psi f, then the guards' first and second coefficients, in groups. Empty: the length is
        // too long for its series.
        Columns propagator; // (height + 2 guard_room x height)
        // Times abs(f): a bound for all further coefficients of each guard together.
        Columns rest; // (guard_room x height)
    };

    // What is there, or what make() returns, which is kept.
    template <class Make>
    std::shared_ptr<const Matrices> matrices(const AffineKey& key, const Make& make) {
        if (auto known = known_matrices(key)) return known;
        return keep(key, std::make_shared<const Matrices>(make()));
    }
    template <class Make>
    std::shared_ptr<const Propagation> propagation(const AffineKey& key, double h, const Make& make) {
        if (auto known = known_propagation(key, h)) return known;
        return keep(key, h, std::make_shared<const Propagation>(make()));
    }

  private:
    // Patterns and lengths that never recur must not fill the memory: what comes later is not kept.
    static constexpr std::size_t max_patterns = 2000, max_lengths = 64;

    struct Pattern {
        std::shared_ptr<const Matrices> matrices;
        std::vector<std::pair<double, std::shared_ptr<const Propagation>>> propagations; // with their lengths
    };

    std::shared_ptr<const Matrices> known_matrices(const AffineKey& key) const;
    std::shared_ptr<const Propagation> known_propagation(const AffineKey& key, double h) const;
    std::shared_ptr<const Matrices> keep(const AffineKey& key, std::shared_ptr<const Matrices> made);
    std::shared_ptr<const Propagation> keep(const AffineKey& key, double h, std::shared_ptr<const Propagation> made);

    mutable std::mutex mutex_;
    std::unordered_map<AffineKey, Pattern, AffineKey::Hash> patterns_;
};

} // namespace tribode
