#include "tribode/base/random.hpp"
#include "tribode/diagnosis/prediction_statistics.hpp"

#include <Eigen/Cholesky>

#include <cmath>
#include <gtest/gtest.h>
#include <utility>

namespace tribode {
namespace {

std::vector<double> noise(std::uint64_t seed, std::size_t count, double size) {
    std::vector<double> values;
    for (std::size_t k = 0; k < count; ++k) values.push_back(size * standard_normal(seed, 0, k));
    return values;
}

// Each value is the last one times `memory` and noise.
std::vector<double> correlated(std::uint64_t seed, std::size_t count, double memory) {
    auto values = noise(seed, count, std::sqrt(1 - memory * memory));
    for (std::size_t k = 1; k < count; ++k) values[k] += memory * values[k - 1];
    return values;
}

TEST(PredictionStatistics, NoiseIsSeenBesideWhatMovesSlowly) {
    auto values = noise(1, 20000, 0.01);
    EXPECT_NEAR(white_noise(values), 0.01, 3e-4);
    for (std::size_t k = 0; k < values.size(); ++k) values[k] += 5 * std::sin(0.01 * static_cast<double>(k));
    EXPECT_NEAR(white_noise(values), 0.01, 3e-4);
    EXPECT_EQ(white_noise({1, 2, 3}), 0);
    for (std::size_t k = 0; k < values.size(); k += 20) values[k] = NAN;
    EXPECT_NEAR(white_noise(values), 0.01, 3e-4);
}

TEST(PredictionStatistics, NoiseOfASignalOfStepsIsThatOfItsRounding) {
    // Slow, rounded to 0.1: fourth differences are nothing in the median.
    std::vector<double> rounded, rests;
    for (int k = 0; k < 5000; ++k) {
        const double slow = 5 * std::sin(0.001 * k);
        rounded.push_back(0.1 * std::round(slow / 0.1));
        rests.push_back(k / 1000 % 2 == 0 ? 1 : slow); // at rest half of the time
    }
    EXPECT_LT(white_noise(rounded), 1e-12);
    EXPECT_NEAR(rounding_noise(rounded), 0.1 / std::sqrt(12.0), 1e-12);
    EXPECT_EQ(rounding_noise(rests), 0);
    EXPECT_EQ(rounding_noise(noise(1, 5000, 0.01)), 0);
    EXPECT_EQ(rounding_noise({1, 1, 2, 2}), 0);
    // Of what a smooth model leaves, and of what one leaves that rounds as well.
    std::vector<double> smooth = rounded, steps(rounded.size(), 0.03);
    for (std::size_t k = 0; k < smooth.size(); ++k) smooth[k] -= 5 * std::sin(0.001 * static_cast<double>(k));
    EXPECT_NEAR(rounding_noise(rounded, smooth), 0.1 / std::sqrt(12.0), 1e-12);
    EXPECT_EQ(rounding_noise(rounded, steps), 0);
}

// An axis that goes to its place by many counts a sample, and rests there.
TEST(PredictionStatistics, RoundingShowsInValuesThatAreOnAGrid) {
    std::vector<double> encoder, smooth, two;
    for (int k = 0; k < 400; ++k) {
        const double x = k < 150 ? 0.6 * (1 - std::cos(0.02 * k)) : 0.6 * (1 - std::cos(0.02 * 150));
        encoder.push_back(0.0015 * std::round(x / 0.0015));
        smooth.push_back(x);
        two.push_back(k % 150 < 100 ? 0 : 1);
    }
    EXPECT_NEAR(rounding_noise(encoder), 0.0015 / std::sqrt(12.0), 1e-9);
    EXPECT_EQ(rounding_noise(smooth), 0);
    EXPECT_EQ(rounding_noise(two), 0);
}

TEST(PredictionStatistics, CorrelationHasTheLengthOfItsMemory) {
    EXPECT_NEAR(correlation_length(noise(2, 20000, 1)), 1, 0.1);
    // Both ways: (1 + a)/(1 - a) of correlations a^k, less those below a twentieth.
    EXPECT_NEAR(correlation_length(correlated(3, 200000, 0.9)), 19, 3);
    EXPECT_EQ(correlation_length({1, 1, 1, 1, 1}), 1);
}

TEST(PredictionStatistics, NoiseIsWhiteAndWhatIsLeftInItIsNot) {
    int white = 0;
    for (std::uint64_t seed = 100; seed < 200; ++seed) white += is_white(noise(seed, 300, 0.01)) ? 1 : 0;
    EXPECT_GE(white, 95);
    EXPECT_FALSE(is_white(correlated(7, 300, 0.5)));
    // A tenth of the noise, that lasts, shows in a long record.
    auto values = noise(8, 30000, 1);
    EXPECT_TRUE(is_white(values));
    for (std::size_t k = 0; k < values.size(); ++k) values[k] += 0.15 * std::sin(0.01 * static_cast<double>(k));
    EXPECT_FALSE(is_white(values));
    EXPECT_FALSE(is_white({1, -1, 1}));
}

// Of white noise twice the logarithm of the ratio of normal densities, each at its own deviation: N ln(squares of the first / second).
TEST(PredictionStatistics, LikelihoodOfWhiteErrorsIsThatOfTheirSize) {
    const auto first = noise(11, 4000, 1);
    auto second = first;
    for (std::size_t k = 1000; k < 4000; ++k) second[k] *= 0.5;
    const std::vector<Stretch> stretches = {{0, 1000}, {1, 3000}}; // each output has a size of its own
    EXPECT_NEAR(likelihood_gain(first, second, stretches), 3000 * std::log(4.0), 1e-9);
    EXPECT_NEAR(likelihood_gain(second, first, stretches), -3000 * std::log(4.0), 1e-9);
    EXPECT_LT(likelihood_gain(first, second, {{0, 4000}}), 3000 * std::log(4.0) - 100);
}

// What follows from the errors before says little, however large it is; what does not, says all.
TEST(PredictionStatistics, LikelihoodCountsWhatDoesNotFollowFromTheErrorsBefore) {
    // An autoregression of the first order has innovations of 1 - memory^2 of its variance.
    const auto slow = correlated(12, 20000, 0.95), white = noise(13, 20000, std::sqrt(1 - 0.95 * 0.95));
    EXPECT_NEAR(likelihood_gain(slow, white, {{0, 20000}}) / 20000, 0, 0.02);
    auto smaller = slow;
    for (double& e : smaller) e *= 0.5;
    EXPECT_NEAR(likelihood_gain(slow, smaller, {{0, 20000}}) / 20000, std::log(4.0), 1e-9);
    // From stretch to stretch nothing follows.
    std::vector<double> steps = noise(14, 2000, 0.01), level = steps;
    std::vector<Stretch> stretches;
    for (std::size_t begin = 0; begin < 2000; begin += 100) {
        stretches.push_back({0, 100});
        for (std::size_t k = begin; k < begin + 100; ++k) steps[k] += begin % 200 == 0 ? 1 : -1;
    }
    const double each = likelihood_gain(steps, level, stretches) / 2000;
    EXPECT_LT(each, 0.15);
    EXPECT_GT(likelihood_gain(steps, level, {{0, 2000}}) / 2000, 2.0);
    EXPECT_EQ(likelihood_gain({}, {}, {{0, 2000}}), 0);
}

TEST(PredictionStatistics, AGainIsSureOnlyWhereItIsMoreThanChance) {
    const auto first = correlated(4, 4000, 0.95), same = correlated(5, 4000, 0.95);
    std::vector<double> smaller = first;
    for (double& e : smaller) e *= 0.8;
    EXPECT_GT(probability_of_gain(first, smaller), 0.99);
    EXPECT_LT(probability_of_gain(smaller, first), 0.01);
    const double chance = probability_of_gain(first, same);
    EXPECT_GT(chance, 0.02);
    EXPECT_LT(chance, 0.98);
    EXPECT_EQ(probability_of_gain({}, {}), 0);
    EXPECT_EQ(rms_of_errors({3, -4}), std::sqrt(12.5));
    EXPECT_TRUE(std::isinf(rms_of_errors({})));
}

// The mean of correlated values has a variance that is known, and least squares with white errors gives a twentieth of it.
TEST(PredictionStatistics, BoundsHoldForErrorsOfAnyCorrelation) {
    for (const double memory : {0.0, 0.9}) {
        const std::size_t n = 2000;
        const double known = (1 + memory) / (1 - memory) / static_cast<double>(n);
        double within = 0, variance = 0;
        const std::uint64_t trials = 1000;
        for (std::uint64_t seed = 1; seed <= trials; ++seed) {
            const auto values = correlated(1000 + seed, n, memory);
            const Eigen::Map<const Eigen::VectorXd> y(values.data(), static_cast<Eigen::Index>(n));
            const double mean = y.mean();
            const Eigen::MatrixXd inverse = Eigen::MatrixXd::Constant(1, 1, 1 / static_cast<double>(n));
            const double covariance = covariance_of_correlated_errors(inverse, y.array() - mean, {n})(0, 0);
            variance += covariance / static_cast<double>(trials);
            within += std::abs(mean) < 1.6449 * std::sqrt(covariance) ? 1 : 0;
        }
        EXPECT_GT(within / static_cast<double>(trials), 0.87) << memory;
        EXPECT_LT(within / static_cast<double>(trials), 0.93) << memory;
        EXPECT_NEAR(variance / known, 1.1, 0.2) << memory;
    }
}

// Twice the same record: nothing is correlated across the border. An independent error adds its square.
TEST(PredictionStatistics, RecordsAreCorrelatedEachWithinItself) {
    Eigen::MatrixXd scores(20, 2);
    for (Eigen::Index k = 0; k < 20; ++k) {
        scores.row(k) << std::cos(0.7 * static_cast<double>(k % 10)), std::sin(static_cast<double>(k % 10));
    }
    const Eigen::MatrixXd one = Eigen::MatrixXd::Identity(2, 2);
    const auto both = covariance_of_correlated_errors(one, scores, {10, 10});
    const auto first = covariance_of_correlated_errors(one, scores.topRows(10), {10});
    EXPECT_LT((both - 2 * first).norm(), 1e-12);
    const auto with_rest = covariance_of_correlated_errors(one, scores.topRows(11), {10});
    EXPECT_LT((with_rest - first - scores.row(10).transpose() * scores.row(10)).norm(), 1e-12);
}

// Of a mean: what is left out is seen from the mean of the rest, but for the twentieth of all that stays known.
TEST(PredictionStatistics, WhatIsLeftOutIsPredictedFromTheRest) {
    const Eigen::Index n = 100;
    Eigen::VectorXd errors = Eigen::VectorXd::LinSpaced(n, -1, 1);
    const Eigen::VectorXd predicted = errors_of_left_out_parts(Eigen::MatrixXd::Ones(n, 1), errors, {100});
    for (Eigen::Index begin = 0; begin < n; begin += 10) {
        const double part = errors.segment(begin, 10).sum();
        for (Eigen::Index k = begin; k < begin + 10; ++k) {
            EXPECT_NEAR(predicted[k], errors[k] + part / (1.05 * 100 - 10), 1e-12) << k;
        }
    }
    // What only one part shows stays as it was fitted, and errors behind the records stay as they are.
    Eigen::MatrixXd slopes = Eigen::MatrixXd::Zero(n, 1);
    slopes.topRows(5).setOnes();
    errors.head(5) << 1, -1, 2, -2, 0;
    EXPECT_LT((errors_of_left_out_parts(slopes, errors, {90}) - errors).norm(), 1e-12);
}

// Errors that last make a parameter that does nothing look worth many units of chi square in the fit, and none in prediction.
TEST(PredictionStatistics, ANeedlessParameterDoesNotPredict) {
    const Eigen::Index n = 4000;
    Eigen::MatrixXd rich(n, 2);
    for (Eigen::Index k = 0; k < n; ++k) rich.row(k) << 1, std::sin(0.01 * static_cast<double>(k));
    const auto left_of = [&](const Eigen::MatrixXd& slopes, const Eigen::VectorXd& y) {
        const Eigen::VectorXd fitted = (slopes.transpose() * slopes).ldlt().solve(slopes.transpose() * y);
        return std::pair{Eigen::VectorXd(y - slopes * fitted),
                         errors_of_left_out_parts(slopes, y - slopes * fitted, {2000, 2000})};
    };
    double fitted_gain = 0;
    int sure = 0, found = 0;
    for (std::uint64_t seed = 300; seed < 400; ++seed) {
        const auto values = correlated(seed, static_cast<std::size_t>(n), 0.95);
        for (const double size : {0.0, 1.0}) {
            const Eigen::VectorXd y = Eigen::Map<const Eigen::VectorXd>(values.data(), n) + size * rich.col(1);
            const auto [simple_fit, simple] = left_of(rich.leftCols(1), y);
            const auto [rich_fit, richer] = left_of(rich, y);
            const bool is_sure = gain_in_deviations(simple, richer, {2000, 2000}) > 2;
            if (size > 0) {
                found += is_sure ? 1 : 0;
            } else {
                sure += is_sure ? 1 : 0;
                fitted_gain += (simple_fit.squaredNorm() - rich_fit.squaredNorm()) / 100;
            }
        }
    }
    EXPECT_GT(fitted_gain, 15); // on average, where ln N is 8
    EXPECT_LE(sure, 2);
    EXPECT_GE(found, 98);
}

} // namespace
} // namespace tribode
