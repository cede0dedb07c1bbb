#pragma once
#include <cstddef>
#include <cstdint>
#include <vector>

namespace tribode {

// Points of the Sobol sequence as functions of their index alone, with the direction numbers of [Joe 2008].
// Index in its natural order: any 2^k points from a multiple of 2^k on are evenly spread.
class SobolSequence {
  public:
    static constexpr std::size_t max_dimensions = 40;
    static constexpr int bits = 52;

    enum class Scramble {
        none,
        shift, // each dimension is XORed with random bits
        owen   // each bit is flipped by chance, by the bits before it [Owen 1995]: the spread of the points stays, and
               // each of them is uniform
    };

    // 1 <= dimensions <= max_dimensions.
    explicit SobolSequence(std::size_t dimensions, Scramble scramble = Scramble::owen, std::uint64_t seed = 0);

    std::size_t dimensions() const { return directions_.size() / bits; }

    // In (0, 1): the middle of a cell of 2^-52. index < 2^52.
    double coordinate(std::uint64_t index, std::size_t dimension) const;

  private:
    std::uint64_t scrambled(std::uint64_t x, std::size_t dimension) const;

    Scramble scramble_;
    std::uint64_t seed_;
    std::vector<std::uint64_t> directions_; // (dimensions x bits)
};

} // namespace tribode
