#include "tribode/batch/sobol_sequence.hpp"
#include "tribode/base/random.hpp"

#include <array>
#include <bit>
#include <cassert>

namespace tribode {

namespace {

// Primitive polynomial of degree s with the inner coefficients a, and the first s direction numbers.
struct Dimension {
    int s;
    unsigned a;
    std::array<unsigned, 8> m;
};

// Dimensions 2 to 40 of new-joe-kuo-6 [Joe 2008]; dimension 1 is the van der Corput sequence.
constexpr std::array<Dimension, SobolSequence::max_dimensions - 1> table = {{
    {1, 0, {1}},
    {2, 1, {1, 3}},
    {3, 1, {1, 3, 1}},
    {3, 2, {1, 1, 1}},
    {4, 1, {1, 1, 3, 3}},
    {4, 4, {1, 3, 5, 13}},
    {5, 2, {1, 1, 5, 5, 17}},
    {5, 4, {1, 1, 5, 5, 5}},
    {5, 7, {1, 1, 7, 11, 19}},
    {5, 11, {1, 1, 5, 1, 1}},
    {5, 13, {1, 1, 1, 3, 11}},
    {5, 14, {1, 3, 5, 5, 31}},
    {6, 1, {1, 3, 3, 9, 7, 49}},
    {6, 13, {1, 1, 1, 15, 21, 21}},
    {6, 16, {1, 3, 1, 13, 27, 49}},
    {6, 19, {1, 1, 1, 15, 7, 5}},
    {6, 22, {1, 3, 1, 15, 13, 25}},
    {6, 25, {1, 1, 5, 5, 19, 61}},
    {7, 1, {1, 3, 7, 11, 23, 15, 103}},
    {7, 4, {1, 3, 7, 13, 13, 15, 69}},
    {7, 7, {1, 1, 3, 13, 7, 35, 63}},
    {7, 8, {1, 3, 5, 9, 1, 25, 53}},
    {7, 14, {1, 3, 1, 13, 9, 35, 107}},
    {7, 19, {1, 3, 1, 5, 27, 61, 31}},
    {7, 21, {1, 1, 5, 11, 19, 41, 61}},
    {7, 28, {1, 3, 5, 3, 3, 13, 69}},
    {7, 31, {1, 1, 7, 13, 1, 19, 1}},
    {7, 32, {1, 3, 7, 5, 13, 19, 59}},
    {7, 37, {1, 1, 3, 9, 25, 29, 41}},
    {7, 41, {1, 3, 5, 13, 23, 1, 55}},
    {7, 42, {1, 3, 7, 3, 13, 59, 17}},
    {7, 50, {1, 3, 1, 3, 5, 53, 69}},
    {7, 55, {1, 1, 5, 5, 23, 33, 13}},
    {7, 56, {1, 1, 7, 7, 1, 61, 123}},
    {7, 59, {1, 1, 7, 9, 13, 61, 49}},
    {7, 62, {1, 3, 3, 5, 3, 55, 33}},
    {8, 14, {1, 3, 1, 15, 31, 13, 49, 245}},
    {8, 21, {1, 3, 5, 15, 31, 59, 63, 97}},
    {8, 22, {1, 3, 1, 11, 11, 11, 77, 249}},
}};

} // namespace

SobolSequence::SobolSequence(std::size_t dimensions, Scramble scramble, std::uint64_t seed)
    : scramble_(scramble),
      seed_(seed),
      directions_(dimensions * bits) {
    assert(dimensions >= 1 && dimensions <= max_dimensions);
    for (std::size_t d = 0; d < dimensions; ++d) {
        std::uint64_t* v = &directions_[d * bits];
        const int s = d == 0 ? bits : table[d - 1].s;
        for (int k = 0; k < bits; ++k) {
            if (k < s) {
                const std::uint64_t m = d == 0 ? 1 : table[d - 1].m[static_cast<std::size_t>(k)];
                v[k] = m << (bits - 1 - k);
                continue;
            }
            v[k] = v[k - s] ^ (v[k - s] >> s);
            for (int i = 1; i < s; ++i) {
                if (table[d - 1].a >> (s - 1 - i) & 1U) v[k] ^= v[k - i];
            }
        }
    }
}

double SobolSequence::coordinate(std::uint64_t index, std::size_t dimension) const {
    const std::uint64_t* v = &directions_[dimension * bits];
    std::uint64_t x = 0;
    for (; index != 0; index &= index - 1) x ^= v[std::countr_zero(index)];
    return (static_cast<double>(scrambled(x, dimension)) + 0.5) * 0x1p-52;
}

std::uint64_t SobolSequence::scrambled(std::uint64_t x, std::size_t dimension) const {
    if (scramble_ == Scramble::none) return x;
    const std::uint64_t key = random_bits(seed_, 0x50b01, dimension);
    if (scramble_ == Scramble::shift) return x ^ (key >> (64 - bits));
    // The first 32 bits one by one. Up to 2^32 points differ in them, so the rest may be drawn at once.
    constexpr int first = 32;
    std::uint64_t flips = random_bits(key, first, x >> (bits - first)) >> (64 - bits + first);
    for (int b = 0; b < first; ++b) {
        flips |= (random_bits(key, static_cast<std::uint64_t>(b), x >> (bits - b)) >> 63) << (bits - 1 - b);
    }
    return x ^ flips;
}

} // namespace tribode
