#include "tribode/analysis/statistics.hpp"
#include "tribode/base/random.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <numeric>
#include <vector>

namespace tribode {
namespace {

constexpr double nan = std::numeric_limits<double>::quiet_NaN();

TEST(Summary, IsThatOfAHandCalculation) {
    const Summary s = summarize(std::vector<double>{4, nan, 1, 3, 2, INFINITY}, std::vector<double>{0, 0.5, 1, 0.25});
    EXPECT_EQ(s.count, 4U);
    EXPECT_EQ(s.missing, 2U);
    EXPECT_DOUBLE_EQ(s.mean, 2.5);
    EXPECT_DOUBLE_EQ(s.standard_deviation, std::sqrt(5.0 / 3));
    EXPECT_DOUBLE_EQ(s.standard_error, std::sqrt(5.0 / 12));
    EXPECT_NEAR(s.mean_high - s.mean, 3.1824463052837078 * s.standard_error, 1e-12); // t table, 3 degrees
    EXPECT_EQ(s.least, 1);
    EXPECT_EQ(s.greatest, 4);
    EXPECT_EQ(s.quantiles[0].value, 1);
    EXPECT_EQ(s.quantiles[1].value, 2.5);
    EXPECT_EQ(s.quantiles[2].value, 4);
    EXPECT_EQ(s.quantiles[3].value, 1.75);
}

TEST(Summary, SaysNothingOfNothing) {
    const Summary none = summarize(std::vector<double>{nan}, std::vector<double>{0.5});
    EXPECT_EQ(none.count, 0U);
    EXPECT_TRUE(std::isnan(none.mean) && std::isnan(none.quantiles[0].value));
    const Summary one = summarize(std::vector<double>{7}, std::vector<double>{0.5});
    EXPECT_EQ(one.mean, 7);
    EXPECT_EQ(one.quantiles[0].value, 7);
    EXPECT_TRUE(std::isnan(one.standard_deviation) && std::isnan(one.mean_low));
}

// Numbers of SciPy 1.17.
TEST(StudentQuantile, AgreesWithAnotherProgram) {
    EXPECT_NEAR(student_quantile(0.975, 1), 12.706204736174694, 1e-12);
    EXPECT_NEAR(student_quantile(0.975, 2), 4.302652729749462, 1e-12);
    EXPECT_NEAR(student_quantile(0.975, 10), 2.228138851986274, 1e-12);
    EXPECT_NEAR(student_quantile(0.975, 31), 2.0395134463964077, 1e-12);
    EXPECT_NEAR(student_quantile(0.975, 1000), 1.9623390808264083, 1e-12);
    EXPECT_NEAR(student_quantile(0.975, 1001), 1.9623367052808798, 1e-9);
    EXPECT_NEAR(student_quantile(0.995, 5), 4.032142983555228, 1e-12);
    EXPECT_NEAR(student_quantile(0.5, 7), 0, 1e-50);
    EXPECT_DOUBLE_EQ(student_quantile(0.1, 7), -student_quantile(0.9, 7));
}

// Of 2000 intervals of 95 %, 1900 cover the truth, give or take 4 sqrt(2000 0.95 0.05) = 39. The intervals of the quantile
// are rounded outwards: they cover at least as often.
TEST(Summary, IntervalsCoverTheTruthAsOftenAsTheySay) {
    constexpr int repeats = 2000;
    int mean = 0, median = 0;
    for (int r = 0; r < repeats; ++r) {
        std::vector<double> x(40);
        for (std::size_t i = 0; i < x.size(); ++i) x[i] = standard_normal(1, static_cast<std::uint64_t>(r), i);
        const Summary s = summarize(x, std::vector<double>{0.5});
        mean += s.mean_low < 0 && s.mean_high > 0;
        median += s.quantiles[0].low < 0 && s.quantiles[0].high > 0;
    }
    EXPECT_NEAR(mean, 1900, 39);
    EXPECT_GE(median, 1900 - 39);
    EXPECT_LE(median, 1990);
}

// The quantiles of 100,000 exponential draws; standard error sqrt(p (1 - p)/n)/density, five of them.
TEST(Summary, QuantilesAreThoseOfTheDistribution) {
    std::vector<double> x(100000);
    for (std::size_t i = 0; i < x.size(); ++i) x[i] = -std::log(uniform(4, 0, i));
    const Summary s = summarize(x, std::vector<double>{0.01, 0.5, 0.9, 0.999});
    for (const auto& q : s.quantiles) {
        const double truth = -std::log(1 - q.probability);
        EXPECT_NEAR(q.value, truth, 5 * std::sqrt(q.probability / (1 - q.probability) / 1e5));
        EXPECT_LT(q.low, q.value);
        EXPECT_GT(q.high, q.value);
    }
}

TEST(Histogram, CountsEveryFiniteValueOnce) {
    const Histogram h = histogram(std::vector<double>{0, 1, 1.5, 2, 10, nan}, 5);
    EXPECT_EQ(h.edges, (std::vector<double>{0, 2, 4, 6, 8, 10}));
    EXPECT_EQ(h.counts, (std::vector<std::size_t>{3, 1, 0, 0, 1}));
    EXPECT_EQ(h.missing, 1U);
    EXPECT_EQ(histogram(std::vector<double>{3, 3, 3}).counts, std::vector<std::size_t>{3});
    EXPECT_TRUE(histogram(std::vector<double>{nan}).counts.empty());
    std::vector<double> x(10000);
    for (std::size_t i = 0; i < x.size(); ++i) x[i] = standard_normal(2, 0, i);
    const Histogram normal = histogram(x);
    EXPECT_EQ(std::accumulate(normal.counts.begin(), normal.counts.end(), std::size_t{0}), x.size());
    EXPECT_GT(normal.counts.size(), 40U); // Freedman and Diaconis: width 2 1.35/21.5 = 0.125 over a range of 7 to 8.5
    EXPECT_LT(normal.counts.size(), 80U);
}

TEST(Histogram, TakesTheLargestNumbers) {
    for (const std::size_t bins : {0, 2}) {
        const Histogram h = histogram(std::vector<double>{1e308, -1e308, 0, 1e308}, bins);
        EXPECT_EQ(std::accumulate(h.counts.begin(), h.counts.end(), std::size_t{0}), 4U);
        EXPECT_EQ(h.edges.front(), -1e308);
        EXPECT_EQ(h.edges.back(), 1e308);
        EXPECT_TRUE(std::is_sorted(h.edges.begin(), h.edges.end()));
    }
    EXPECT_EQ(histogram(std::vector<double>{1e308, -1e308, 0, 1e308}, 2).counts, (std::vector<std::size_t>{1, 3}));
}

TEST(WorstCases, StandInTheirOrder) {
    const std::vector<double> x = {3, nan, 5, 1, 5};
    EXPECT_EQ(worst_cases(x, 3), (std::vector<std::size_t>{2, 4, 0}));
    EXPECT_EQ(worst_cases(x, 9, false), (std::vector<std::size_t>{3, 0, 2, 4}));
}

} // namespace
} // namespace tribode
