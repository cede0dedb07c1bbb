#include "tribode/base/random.hpp"
#include "tribode/batch/sobol_sequence.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <set>
#include <vector>

namespace tribode {
namespace {

using Scramble = SobolSequence::Scramble;
constexpr double half_cell = 0x1p-53;

using Points = std::vector<std::vector<double>>; // (points x dimensions)

Points points_of(const SobolSequence& sequence, std::size_t count) {
    Points points(count, std::vector<double>(sequence.dimensions()));
    for (std::size_t i = 0; i < count; ++i) {
        for (std::size_t d = 0; d < sequence.dimensions(); ++d) points[i][d] = sequence.coordinate(i, d);
    }
    return points;
}

// The centred L2 discrepancy [Hickernell 1998], as its formula stands.
double discrepancy(const Points& points) {
    const double n = static_cast<double>(points.size());
    double once = 0, twice = 0;
    for (const auto& x : points) {
        double product = 1;
        for (const double a : x) product *= 1 + 0.5 * std::abs(a - 0.5) - 0.5 * (a - 0.5) * (a - 0.5);
        once += product;
        for (const auto& y : points) {
            product = 1;
            for (std::size_t d = 0; d < x.size(); ++d) {
                product *= 1 + 0.5 * std::abs(x[d] - 0.5) + 0.5 * std::abs(y[d] - 0.5) - 0.5 * std::abs(x[d] - y[d]);
            }
            twice += product;
        }
    }
    return std::sqrt(std::pow(13.0 / 12, static_cast<double>(points[0].size())) - 2 / n * once + twice / n / n);
}

// Points 1 to 6 of the sequence of [Joe 2008] in dimensions 1 to 4 as SciPy 1.17 gives them; there they stand in
// the order of the Gray code.
TEST(SobolSequence, IsThatOfJoeAndKuo) {
    const SobolSequence sequence(4, Scramble::none);
    const Points gray = {{0.5, 0.5, 0.5, 0.5},         {0.75, 0.25, 0.25, 0.25},     {0.25, 0.75, 0.75, 0.75},
                         {0.375, 0.375, 0.625, 0.875}, {0.875, 0.875, 0.125, 0.375}, {0.625, 0.125, 0.875, 0.625}};
    for (std::size_t i = 0; i < gray.size(); ++i) {
        const std::uint64_t index = (i + 1) ^ ((i + 1) >> 1);
        for (std::size_t d = 0; d < 4; ++d) EXPECT_EQ(sequence.coordinate(index, d), gray[i][d] + half_cell);
    }
}

// A checksum over 1024 points of all dimensions, made from those of SciPy 1.17: sum of (d + 1) (i mod 37) x.
TEST(SobolSequence, AllDimensionsAreThoseOfJoeAndKuo) {
    const SobolSequence sequence(40, Scramble::none);
    double sum = 0;
    for (std::size_t d = 0; d < 40; ++d) {
        for (std::uint64_t i = 0; i < 1024; ++i) {
            const std::uint64_t gray = i ^ (i >> 1);
            sum += static_cast<double>((d + 1) * (i % 37)) * (sequence.coordinate(gray, d) - half_cell);
        }
    }
    EXPECT_EQ(sum, 7489798.8984375); // dyadic numbers: exact
}

TEST(SobolSequence, EachDimensionMeetsEachCellOnce) {
    for (const Scramble scramble : {Scramble::none, Scramble::shift, Scramble::owen}) {
        const SobolSequence sequence(SobolSequence::max_dimensions, scramble, 5);
        for (std::size_t d = 0; d < sequence.dimensions(); ++d) {
            std::set<int> cells;
            for (std::uint64_t i = 256; i < 512; ++i) cells.insert(static_cast<int>(sequence.coordinate(i, d) * 256));
            EXPECT_EQ(cells.size(), 256U) << d;
        }
    }
}

// Dimensions 1 and 2 are a (0, m, 2)-net: each box of area 2^-8 holds one of 256 points. Scrambling keeps that.
TEST(SobolSequence, TheFirstTwoDimensionsAreANet) {
    for (const Scramble scramble : {Scramble::none, Scramble::shift, Scramble::owen}) {
        const SobolSequence sequence(2, scramble, 11);
        for (int k = 0; k <= 8; ++k) {
            std::set<std::pair<int, int>> boxes;
            for (std::uint64_t i = 0; i < 256; ++i) {
                boxes.insert({static_cast<int>(sequence.coordinate(i, 0) * (1 << k)),
                              static_cast<int>(sequence.coordinate(i, 1) * (1 << (8 - k)))});
            }
            EXPECT_EQ(boxes.size(), 256U) << k;
        }
    }
}

// 512 random points in 6 dimensions have sqrt(((5/4)^6 - (13/12)^6)/512) = 0.066 on average; that of the Sobol points is
// SciPy's figure for them.
TEST(SobolSequence, IsFarMoreEvenThanChance) {
    Points random(512, std::vector<double>(6));
    for (std::size_t i = 0; i < random.size(); ++i) {
        for (std::size_t d = 0; d < 6; ++d) random[i][d] = uniform(1, d, i);
    }
    const double by_chance = discrepancy(random);
    EXPECT_NEAR(by_chance, 0.066, 0.02);
    EXPECT_NEAR(discrepancy(points_of(SobolSequence(6, Scramble::none), 512)), 0.013561819440, 1e-12);
    for (const Scramble scramble : {Scramble::shift, Scramble::owen}) {
        EXPECT_LT(discrepancy(points_of(SobolSequence(6, scramble, 2), 512)), by_chance / 3);
    }
}

// The mean of prod (1 + (x_d - 1/2)) is 1. Scrambled nets gain at least a factor of 100 in variance on it; by the
// smoothness of the function the error falls faster than 1/N.
TEST(SobolSequence, ScrambledMeansScatterLittleAndHaveNoBias) {
    constexpr int repeats = 50;
    constexpr std::size_t count = 256, dimensions = 5;
    double sum = 0, squares = 0;
    for (int r = 0; r < repeats; ++r) {
        const SobolSequence sequence(dimensions, Scramble::owen, static_cast<std::uint64_t>(r));
        double mean = 0;
        for (const auto& x : points_of(sequence, count)) {
            double product = 1;
            for (const double a : x) product *= 0.5 + a;
            mean += product / count;
        }
        sum += mean - 1;
        squares += (mean - 1) * (mean - 1);
    }
    const double by_chance = (std::pow(13.0 / 12, dimensions) - 1) / count; // variance of a random mean
    EXPECT_LT(squares / repeats, by_chance / 100);
    EXPECT_LT(std::abs(sum / repeats), 4 * std::sqrt(squares / repeats / repeats));
}

// By Owen's scrambling each single point is uniform: over 2000 seeds its mean and variance are those of the uniform
// distribution, to four standard errors.
TEST(SobolSequence, AScrambledPointIsUniform) {
    constexpr int repeats = 2000;
    for (const std::uint64_t index : {0U, 1U, 77U}) {
        double sum = 0, squares = 0;
        for (int r = 0; r < repeats; ++r) {
            const double x = SobolSequence(3, Scramble::owen, static_cast<std::uint64_t>(r)).coordinate(index, 2) - 0.5;
            sum += x;
            squares += x * x;
        }
        EXPECT_LT(std::abs(sum / repeats), 4 * std::sqrt(1.0 / 12 / repeats));
        EXPECT_NEAR(squares / repeats, 1.0 / 12, 4 * std::sqrt(1.0 / 180 / repeats));
    }
}

} // namespace
} // namespace tribode
