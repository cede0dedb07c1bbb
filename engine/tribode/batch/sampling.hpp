#pragma once
#include "tribode/base/json.hpp"
#include "tribode/batch/distribution.hpp"
#include "tribode/batch/sobol_sequence.hpp"

#include <cstdint>
#include <optional>
#include <string>
#include <vector>

namespace tribode {

// A quantity that a design varies: a field of a machine ("friction.elements[3].K") or anything else with a name.
struct Factor {
    std::string name;
    std::vector<Json> values;                 // of a grid, a list or a choice; empty: a distribution of numbers
    std::optional<Distribution> distribution; // absent: the design runs through `values`
    bool named = false;                       // some of the values is no number: a row holds its place from 1
    bool whole = false;                       // all of the values are whole numbers
};

// The points of an experiment: row `index` is a function of the description and the index alone, so any part of a design
// can be made by itself, in any order, in any process, and no row is kept in memory.
//
// A description is plain data, {design=, ...}, as `description()` gives it back with every default:
//
//   grid             factors {name, values}: every combination, the last factor fastest
//   list             points: a list of tables with the same names
//   monte_carlo      factors, count, seed: independent draws
//   latin_hypercube  factors, count, seed: of `count` equal shares of each factor, each is met once
//   sobol            factors, count, seed, scramble = "owen" | "shift" | "none": evenly spread in all factors together
//   saltelli         factors, base_count, seed: for Sobol indices. Group g of d + 2 rows is A, B, and A with factor i
//                    from B for i = 1 .. d, where (A, B) is point g of a scrambled Sobol sequence of 2 d dimensions
//   one_at_a_time    factors, share: the medians, then for each factor in turn its quantiles `share` and 1 - share with
//                    the other factors at their medians
//
// Factors of all but grid and list have a distribution, see Distribution::read. A factor of a random design takes numbers
// of a stream of its own, by its place in the list: one more at the end leaves the others as they were.
class Design {
  public:
    // Throws InputError with the path of the field.
    static Design from_description(const Json& description, const std::string& where);

    const Json& description() const { return description_; }
    std::uint64_t count() const { return count_; }
    const std::vector<Factor>& factors() const { return factors_; }
    std::vector<std::string> names() const;

    // One number for each factor. Requires index < count().
    std::vector<double> row(std::uint64_t index) const;

    // What the number in a row stands for: itself, a whole number where all values are, or the value that is no number.
    Json value(std::size_t factor, double in_row) const;

    // The row as a table {name = value, ...}.
    Json point(std::uint64_t index) const;

  private:
    enum class Kind { grid, list, monte_carlo, latin_hypercube, sobol, saltelli, one_at_a_time };

    void read_factors(FieldReader& fields);
    void read_points(FieldReader& fields);
    double probability(std::uint64_t index, std::size_t factor) const;
    double listed(const Factor& factor, std::size_t position) const;

    Kind kind_ = Kind::grid;
    Json description_;
    std::uint64_t count_ = 0, seed_ = 0;
    double share_ = 0; // of one_at_a_time
    std::vector<Factor> factors_;
    std::optional<SobolSequence> sequence_;
};

} // namespace tribode
