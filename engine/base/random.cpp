#include "base/random.hpp"

#include <cmath>
#include <numbers>

namespace tribode {

static std::uint64_t mix(std::uint64_t z) {
    z = (z ^ (z >> 30)) * 0xbf58476d1ce4e5b9ULL;
    z = (z ^ (z >> 27)) * 0x94d049bb133111ebULL;
    return z ^ (z >> 31);
}

static std::uint64_t random_bits(std::uint64_t seed, std::uint64_t stream, std::uint64_t index) {
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

double standard_normal(std::uint64_t seed, std::uint64_t stream, std::uint64_t index) {
    const double radius = std::sqrt(-2.0 * std::log(uniform(seed, stream, 2 * index)));
    return radius * std::cos(2.0 * std::numbers::pi * uniform(seed, stream, 2 * index + 1));
}

} // namespace tribode
