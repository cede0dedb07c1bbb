#include "tribode/analysis/sensitivity.hpp"
#include "tribode/base/error.hpp"
#include "tribode/base/random.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <functional>
#include <limits>
#include <numbers>

namespace tribode {
namespace {

using Point = std::vector<double>;
using Function = std::function<double(const Point&)>;

// Results of a design saltelli in independent random points: A, B and A with one factor from B.
std::vector<double> saltelli(const Function& f, std::size_t factors, std::size_t groups, std::uint64_t seed) {
    std::vector<double> values;
    for (std::size_t g = 0; g < groups; ++g) {
        Point a(factors), b(factors);
        for (std::size_t i = 0; i < factors; ++i) {
            a[i] = uniform(seed, i, g);
            b[i] = uniform(seed, 100 + i, g);
        }
        values.push_back(f(a));
        values.push_back(f(b));
        for (std::size_t i = 0; i < factors; ++i) {
            Point mixed = a;
            mixed[i] = b[i];
            values.push_back(f(mixed));
        }
    }
    return values;
}

// sin x1 + 7 sin^2 x2 + 0.1 x3^4 sin x1, x in (-pi, pi) [Ishigami 1990]. x3 acts only together with x1.
double ishigami(const Point& u) {
    const double pi = std::numbers::pi;
    const double x1 = pi * (2 * u[0] - 1), x2 = pi * (2 * u[1] - 1), x3 = pi * (2 * u[2] - 1);
    return std::sin(x1) + 7 * std::sin(x2) * std::sin(x2) + 0.1 * std::pow(x3, 4) * std::sin(x1);
}

// Variance and shares in closed form, with a = 7 and b = 0.1.
struct Truth {
    double variance;
    std::vector<double> first, total;
};

Truth ishigami_truth() {
    const double a = 7, b = 0.1, pi4 = std::pow(std::numbers::pi, 4);
    const double v1 = 0.5 * std::pow(1 + b * pi4 / 5, 2), v2 = a * a / 8, v13 = 8 * b * b * pi4 * pi4 / 225;
    const double v = v1 + v2 + v13;
    return {v, {v1 / v, v2 / v, 0}, {(v1 + v13) / v, v2 / v, v13 / v}};
}

// prod (|4 u_i - 2| + a_i)/(1 + a_i), Sobol's G function [Saltelli 2010].
const Point g_coefficients = {0, 0.5, 3, 9, 99, 99};

double g_function(const Point& u) {
    double product = 1;
    for (std::size_t i = 0; i < u.size(); ++i) {
        product *= (std::abs(4 * u[i] - 2) + g_coefficients[i]) / (1 + g_coefficients[i]);
    }
    return product;
}

Truth g_truth() {
    Truth truth{1, {}, {}};
    for (const double a : g_coefficients) truth.variance *= 1 + 1 / (3 * (1 + a) * (1 + a));
    const double all = truth.variance;
    truth.variance -= 1;
    for (const double a : g_coefficients) {
        const double own = 1 / (3 * (1 + a) * (1 + a));
        truth.first.push_back(own / truth.variance);
        truth.total.push_back(own * all / (1 + own) / truth.variance);
    }
    return truth;
}

// Within four of the standard errors that the estimate itself states, and these are of the size that 2^14 groups promise.
void expect_indices(const Function& f, const Truth& truth) {
    const std::size_t factors = truth.first.size(), groups = 1 << 14;
    const SobolIndices found = sobol_indices(saltelli(f, factors, groups, 5), factors);
    EXPECT_EQ(found.groups, groups);
    EXPECT_NEAR(found.variance / truth.variance, 1, 0.03); // kurtosis up to 7 over 2^15 values: four times 0.0075
    for (std::size_t i = 0; i < factors; ++i) {
        EXPECT_NEAR(found.first[i], truth.first[i], 4 * found.first_error[i]) << i;
        EXPECT_NEAR(found.total[i], truth.total[i], 4 * found.total_error[i]) << i;
        EXPECT_LT(found.first_error[i], 3 / std::sqrt(groups)) << i;
        EXPECT_LT(found.total_error[i], 3 / std::sqrt(groups)) << i;
    }
}

TEST(SobolIndices, AreThoseOfTheIshigamiFunction) { expect_indices(ishigami, ishigami_truth()); }

TEST(SobolIndices, AreThoseOfTheGFunction) { expect_indices(g_function, g_truth()); }

// Over 100 seeds the errors scatter as the bootstrap says. The scatter of 100 is known to 7 %; and the bootstrap of 200
// replicates, averaged, to less. A quarter either way.
TEST(SobolIndices, StandardErrorsAreTheScatter) {
    const Truth truth = ishigami_truth();
    constexpr int repeats = 100;
    std::vector<double> first(3), total(3), first_stated(3), total_stated(3);
    for (int r = 0; r < repeats; ++r) {
        const auto found = sobol_indices(saltelli(ishigami, 3, 256, 1000 + static_cast<std::uint64_t>(r)), 3, 100);
        for (std::size_t i = 0; i < 3; ++i) {
            first[i] += std::pow(found.first[i] - truth.first[i], 2) / repeats;
            total[i] += std::pow(found.total[i] - truth.total[i], 2) / repeats;
            first_stated[i] += std::pow(found.first_error[i], 2) / repeats;
            total_stated[i] += std::pow(found.total_error[i], 2) / repeats;
        }
    }
    for (std::size_t i = 0; i < 3; ++i) {
        EXPECT_NEAR(std::sqrt(first_stated[i] / first[i]), 1, 0.25) << i;
        EXPECT_NEAR(std::sqrt(total_stated[i] / total[i]), 1, 0.25) << i;
    }
}

TEST(SobolIndices, DoNotDependOnTheMeanOfTheResult) {
    auto values = saltelli(ishigami, 3, 200, 1);
    const auto before = sobol_indices(values, 3, 10);
    for (double& value : values) value = 1e6 + 3 * value;
    const auto after = sobol_indices(values, 3, 10);
    for (std::size_t i = 0; i < 3; ++i) { // 1e6 leaves ten digits
        EXPECT_NEAR(after.first[i], before.first[i], 1e-8);
        EXPECT_NEAR(after.total[i], before.total[i], 1e-8);
    }
}

TEST(SobolIndices, LeaveOutGroupsWithAFailedRun) {
    auto values = saltelli(ishigami, 3, 100, 1);
    const auto without = sobol_indices(std::span(values).subspan(5), 3, 10);
    values[3] = std::numeric_limits<double>::quiet_NaN();
    const auto found = sobol_indices(values, 3, 10);
    EXPECT_EQ(found.groups, 99U);
    EXPECT_EQ(found.dropped, 1U);
    EXPECT_EQ(found.first, without.first);
    EXPECT_THROW(sobol_indices(std::span(values).subspan(1), 3), InputError);
    EXPECT_TRUE(std::isnan(sobol_indices(std::vector<double>(50, 2.0), 3, 10).total[0]));
}

// ---- regression and tornado ----------------------------------------------------------------------------------------

FactorColumns random_factors(std::size_t factors, std::size_t rows) {
    FactorColumns columns(factors, std::vector<double>(rows));
    for (std::size_t f = 0; f < factors; ++f) {
        for (std::size_t i = 0; i < rows; ++i) columns[f][i] = standard_normal(8, f, i);
    }
    return columns;
}

// y = 3 x1 - 4 x2 + 12 e: coefficients 3/13, -4/13, and R^2 = 25/169. Five times 1/sqrt(rows).
TEST(StandardizedRegression, FindsTheSharesOfALinearFunction) {
    const auto columns = random_factors(3, 10000);
    std::vector<double> y(10000);
    for (std::size_t i = 0; i < y.size(); ++i) {
        y[i] = 100 + 3 * columns[0][i] - 4 * columns[1][i] + 12 * standard_normal(9, 0, i);
    }
    const auto found = standardized_regression(columns, y);
    const std::vector<double> truth = {3.0 / 13, -4.0 / 13, 0};
    for (std::size_t f = 0; f < 3; ++f) {
        EXPECT_NEAR(found.coefficients[f], truth[f], 5 * found.standard_errors[f]);
        EXPECT_NEAR(found.standard_errors[f], 12.0 / 13 / 100, 0.001); // residual over the square root of the rows
    }
    EXPECT_NEAR(found.r_squared, 25.0 / 169, 0.03);
}

TEST(StandardizedRegression, RanksSeeAnyRisingFunction) {
    auto columns = random_factors(2, 2000);
    std::vector<double> y(2000);
    for (std::size_t i = 0; i < y.size(); ++i) y[i] = std::exp(5 * columns[0][i]);
    EXPECT_LT(standardized_regression(columns, y).r_squared, 0.5);
    const auto found = standardized_regression(columns, y, true);
    EXPECT_NEAR(found.coefficients[0], 1, 1e-9);
    EXPECT_NEAR(found.r_squared, 1, 1e-9);
}

TEST(StandardizedRegression, LeavesOutWhatDoesNotVaryOrFailed) {
    auto columns = random_factors(2, 50);
    columns[1].assign(50, 3.0);
    std::vector<double> y = columns[0];
    y[7] = std::numeric_limits<double>::quiet_NaN();
    const auto found = standardized_regression(columns, y);
    EXPECT_EQ(found.rows, 49U);
    EXPECT_NEAR(found.coefficients[0], 1, 1e-12);
    EXPECT_TRUE(std::isnan(found.coefficients[1]));
    EXPECT_THROW(standardized_regression({{1, 2}}, Point{1, 2}), InputError);
    EXPECT_THROW(standardized_regression({{1, 2, 3}}, Point{1, 2}), InputError);
}

// y = x1 + 10 x2 with x uniform in (0, 1): the tenth at each end has the means 0.05 and 0.95.
TEST(Tornado, HasTheMeansAtBothEndsTheWidestFirst) {
    FactorColumns columns(2, std::vector<double>(20000));
    std::vector<double> y(20000);
    for (std::size_t i = 0; i < y.size(); ++i) {
        columns[0][i] = uniform(1, 0, i);
        columns[1][i] = uniform(1, 1, i);
        y[i] = columns[0][i] + 10 * columns[1][i];
    }
    const auto bars = tornado(columns, y);
    ASSERT_EQ(bars.size(), 2U);
    EXPECT_EQ(bars[0].factor, 1U);
    EXPECT_NEAR(bars[0].low, 0.5 + 0.5, 5 * bars[0].low_error);
    EXPECT_NEAR(bars[0].high, 0.5 + 9.5, 5 * bars[0].high_error);
    EXPECT_NEAR(bars[1].low, 0.05 + 5, 5 * bars[1].low_error);
    EXPECT_NEAR(bars[1].low_error, 10 / std::sqrt(12) / std::sqrt(2000), 0.005);
    EXPECT_THROW(tornado({{1, 2, 3}}, Point{1, 2, 3}), InputError);
}

} // namespace
} // namespace tribode
