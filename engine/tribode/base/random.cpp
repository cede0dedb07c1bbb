#include "tribode/base/random.hpp"

#include <bit>
#include <cmath>
#include <numbers>

namespace tribode {

static std::uint64_t mix(std::uint64_t z) {
    z = (z ^ (z >> 30)) * 0xbf58476d1ce4e5b9ULL;
    z = (z ^ (z >> 27)) * 0x94d049bb133111ebULL;
    return z ^ (z >> 31);
}

std::uint64_t random_bits(std::uint64_t seed, std::uint64_t stream, std::uint64_t index) {
    constexpr std::uint64_t golden = 0x9e3779b97f4a7c15ULL;
    return mix(mix(mix(seed + golden) + stream + golden) + index * golden + golden);
}

std::uint64_t derived_seed(std::uint64_t seed, std::uint64_t index) {
    constexpr std::uint64_t stream = 0x5eed; // apart from the streams that a run draws from
    return random_bits(seed, stream, index);
}

double uniform(std::uint64_t seed, std::uint64_t stream, std::uint64_t index) {
    // The upper 52 bits, in the middle of their cell: with one bit more the last middle would round to 1.
    return (static_cast<double>(random_bits(seed, stream, index) >> 12) + 0.5) * 0x1p-52;
}

std::uint64_t permuted(std::uint64_t index, std::uint64_t count, std::uint64_t key) {
    // Eight rounds: with four, small domains show in the correlation of two permutations.
    constexpr std::uint64_t rounds = 8;
    if (count < 2) return 0;
    const int half = (std::bit_width(count - 1) + 1) / 2;
    const std::uint64_t mask = (std::uint64_t{1} << half) - 1;
    do {
        std::uint64_t left = index >> half, right = index & mask;
        for (std::uint64_t round = 0; round < rounds; ++round) {
            const std::uint64_t mixed = left ^ (random_bits(key, round, right) & mask);
            left = right;
            right = mixed;
        }
        index = left << half | right;
    } while (index >= count);
    return index;
}

double standard_normal(std::uint64_t seed, std::uint64_t stream, std::uint64_t index) {
    const double radius = std::sqrt(-2.0 * std::log(uniform(seed, stream, 2 * index)));
    return radius * std::cos(2.0 * std::numbers::pi * uniform(seed, stream, 2 * index + 1));
}

} // namespace tribode
