#include "tribode/base/random.hpp"

#include <gtest/gtest.h>

#include <array>
#include <cmath>
#include <numbers>
#include <utility>
#include <vector>

namespace tribode {
namespace {

constexpr std::size_t count = 100000;
// Of a statistic's standard deviation. The numbers are always the same, so a test passes always or never; an
// honest generator fails one in two million of such bounds.
constexpr double bound = 5;

std::vector<double> normals(std::uint64_t seed, std::uint64_t stream, std::uint64_t first = 0) {
    std::vector<double> x(count);
    for (std::size_t i = 0; i < count; ++i) x[i] = standard_normal(seed, stream, first + i);
    return x;
}

double mean_power(const std::vector<double>& x, int power) {
    double sum = 0;
    for (const double value : x) sum += std::pow(value, power);
    return sum / static_cast<double>(x.size());
}

double correlation(const std::vector<double>& x, const std::vector<double>& y) {
    double sum = 0;
    for (std::size_t i = 0; i < count; ++i) sum += x[i] * y[i];
    return sum / static_cast<double>(count);
}

// From the formulas of SplitMix64 in whole numbers, by a program of its own.
TEST(Uniform, IsTheSameNumberEverywhere) {
    constexpr double cell = 0x1p-52; // a number lies within the cell of its upper bits
    EXPECT_NEAR(uniform(0, 0, 0), 0.13870941014555432, cell);
    EXPECT_NEAR(uniform(1, 2, 3), 0.16492819262929698, cell);
    EXPECT_NEAR(uniform(~std::uint64_t{0}, 7, 1000000000000), 0.06946614291793968, cell);
}

// The two indices at which all 64 bits are one and zero.
TEST(Uniform, IsNeitherZeroNorOneAtTheEndsOfItsRange) {
    EXPECT_LT(uniform(0, 0, 15472850606166485324u), 1.0);
    EXPECT_GT(uniform(0, 0, 15472850606166485324u), 1 - 0x1p-51);
    EXPECT_GT(uniform(0, 0, 7018387773313254028u), 0.0);
    EXPECT_LT(uniform(0, 0, 7018387773313254028u), 0x1p-51);
}

TEST(Uniform, FillsTheIntervalEvenly) {
    std::array<int, 100> cells{};
    for (std::size_t i = 0; i < count; ++i) ++cells.at(static_cast<std::size_t>(100 * uniform(3, 1, i)));
    double chi_squared = 0;
    for (const int n : cells) chi_squared += std::pow(n - 1000.0, 2) / 1000.0;
    EXPECT_NEAR(chi_squared, 99, bound * std::sqrt(2 * 99.0)); // 99 degrees of freedom
}

TEST(StandardNormal, DependsOnSeedStreamAndIndexAlone) {
    const double value = standard_normal(1, 2, 3);
    for (const std::uint64_t other : {0u, 5u, 6u}) standard_normal(other, 2, 9);
    EXPECT_EQ(standard_normal(1, 2, 3), value);
    EXPECT_NE(standard_normal(2, 2, 3), value);
    EXPECT_NE(standard_normal(1, 3, 3), value);
    EXPECT_NE(standard_normal(1, 2, 4), value);
    EXPECT_NE(standard_normal(2, 1, 3), value); // seed and stream are not exchangeable
}

TEST(StandardNormal, HasTheMomentsOfTheNormalDistribution) {
    const auto x = normals(1, 1);
    const double n = static_cast<double>(count);
    EXPECT_NEAR(mean_power(x, 1), 0, bound * std::sqrt(1 / n));
    EXPECT_NEAR(mean_power(x, 2), 1, bound * std::sqrt(2 / n));
    EXPECT_NEAR(mean_power(x, 3), 0, bound * std::sqrt(15 / n)); // E x^6 = 15
    EXPECT_NEAR(mean_power(x, 4), 3, bound * std::sqrt(96 / n)); // E x^8 - 9 = 96
}

TEST(StandardNormal, HasTheTailsOfTheNormalDistribution) {
    std::size_t beyond = 0;
    for (const double value : normals(1, 1)) beyond += std::abs(value) > 3;
    const double expected = static_cast<double>(count) * std::erfc(3 / std::numbers::sqrt2); // 270
    EXPECT_NEAR(static_cast<double>(beyond), expected, bound * std::sqrt(expected));
}

TEST(StandardNormal, NeighborsInSeedStreamAndIndexAreUncorrelated) {
    const auto x = normals(1, 1);
    const double most = bound / std::sqrt(static_cast<double>(count));
    EXPECT_LT(std::abs(correlation(x, normals(2, 1))), most);
    EXPECT_LT(std::abs(correlation(x, normals(1, 2))), most);
    EXPECT_LT(std::abs(correlation(x, normals(2, 0))), most); // the sum of seed and stream is the same
    EXPECT_LT(std::abs(correlation(x, normals(1, 1, 1))), most);
    EXPECT_LT(std::abs(correlation(x, normals(1, 1, 2))), most);
}

// The two uniform numbers behind a normal one belong to it alone: sizes are independent too.
TEST(StandardNormal, SizesOfNeighboursAreUncorrelated) {
    auto x = normals(1, 1), y = normals(1, 1, 1);
    for (auto* numbers : {&x, &y}) {
        for (double& value : *numbers) value = (value * value - 1) / std::numbers::sqrt2; // mean zero, variance one
    }
    EXPECT_LT(std::abs(correlation(x, y)), bound / std::sqrt(static_cast<double>(count)));
}

TEST(Permuted, IsAPermutation) {
    for (const std::uint64_t n : {1U, 2U, 3U, 5U, 16U, 17U, 1000U}) {
        std::vector<bool> hit(n);
        for (std::uint64_t i = 0; i < n; ++i) {
            const std::uint64_t to = permuted(i, n, 42);
            ASSERT_LT(to, n);
            EXPECT_FALSE(hit[to]);
            hit[to] = true;
        }
    }
    constexpr std::uint64_t many = (1ULL << 62) - 5;
    EXPECT_LT(permuted(many - 1, many, 1), many);
}

// Over 60,000 keys each of the 6 orders of 3 is met 10,000 times, to five standard deviations.
TEST(Permuted, AllOrdersAreAsLikely) {
    std::array<int, 27> met{};
    for (std::uint64_t key = 0; key < 60000; ++key) {
        ++met[permuted(0, 3, key) * 9 + permuted(1, 3, key) * 3 + permuted(2, 3, key)];
    }
    int orders = 0;
    for (const int times : met) {
        if (times == 0) continue;
        ++orders;
        EXPECT_NEAR(times, 10000, bound * std::sqrt(60000.0 * 5 / 36));
    }
    EXPECT_EQ(orders, 6);
}

} // namespace
} // namespace tribode
