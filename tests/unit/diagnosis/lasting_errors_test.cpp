#include "tribode/base/random.hpp"
#include "tribode/diagnosis/lasting_errors.hpp"

#include <Eigen/LU>

#include <cmath>
#include <gtest/gtest.h>

namespace tribode {
namespace {

// White noise of deviation one and `size` times a motion that keeps `memory` of itself from sample to sample, of deviation one; smooth:
// the same once more behind it, not scaled.
Eigen::VectorXd errors_of(std::uint64_t seed, Eigen::Index n, double size, double memory, bool smooth = false) {
    Eigen::VectorXd errors(n);
    double motion = standard_normal(seed, 1, 0), behind = 0;
    const double kick = std::sqrt(1 - memory * memory);
    for (Eigen::Index k = -1000; k < n; ++k) {
        const auto place = static_cast<std::size_t>(k + 2000);
        motion = memory * motion + kick * standard_normal(seed, 1, place);
        behind = memory * behind + (1 - memory) * motion;
        if (k >= 0) errors[k] = standard_normal(seed, 2, place) + size * (smooth ? behind : motion);
    }
    return errors;
}

Eigen::MatrixXd line(Eigen::Index n) {
    Eigen::MatrixXd slopes(n, 2);
    for (Eigen::Index k = 0; k < n; ++k) slopes.row(k) << 1, 1e-3 * static_cast<double>(k);
    return slopes;
}

GeneralizedFit fit_of(const Eigen::VectorXd& errors, const Eigen::MatrixXd& slopes) {
    return generalized_fit({{errors, slopes, {static_cast<std::size_t>(errors.size())}}});
}

// Of lines through errors about nothing: how often the values are within the bounds of 90 %, and those of least squares within theirs
// for white errors; and how much nearer they are, by the root of the mean square.
struct Lines {
    double within = 0, within_white = 0, nearer = 0;
};
Lines lines(double size, double memory, bool smooth) {
    const Eigen::Index n = 300;
    const Eigen::MatrixXd slopes = line(n), inverse = (slopes.transpose() * slopes).inverse();
    Lines result;
    double squares = 0, of_least = 0;
    const std::uint64_t trials = 150;
    for (std::uint64_t seed = 1; seed <= trials; ++seed) {
        const Eigen::VectorXd y = errors_of(seed, n, size, memory, smooth);
        const Eigen::VectorXd least = inverse * slopes.transpose() * y, left = y - slopes * least;
        const GeneralizedFit fit = fit_of(left, slopes);
        const Eigen::VectorXd values = least + fit.step;
        for (Eigen::Index i = 0; i < 2; ++i) {
            const double white = left.squaredNorm() / static_cast<double>(n - 2) * inverse(i, i), share = 0.5 / trials;
            if (std::abs(values[i]) < 1.6449 * std::sqrt(fit.covariance(i, i))) result.within += share;
            if (std::abs(least[i]) < 1.6449 * std::sqrt(white)) result.within_white += share;
            squares += values[i] * values[i] / inverse(i, i);
            of_least += least[i] * least[i] / inverse(i, i);
        }
    }
    result.nearer = std::sqrt(of_least / squares);
    return result;
}

TEST(LastingErrors, BoundsHoldWhereTheFitHasFollowedTheMotion) {
    const Lines white = lines(0, 0, false), rough = lines(1, 0.95, false), smooth = lines(3, 0.95, true);
    EXPECT_GT(white.within, 0.87);
    EXPECT_GT(white.within_white, 0.85); // of means and slopes bounds are wide: a slow motion would be like them
    EXPECT_NEAR(white.nearer, 1, 0.05);
    for (const auto& lasting : {rough, smooth}) {
        EXPECT_GT(lasting.within, 0.80);
        EXPECT_LT(lasting.within, 0.97);
        EXPECT_LT(lasting.within_white, 0.45);
    }
}

// Where what is slow in the output tells little, and what is fast much.
TEST(LastingErrors, ValuesComeNearerToTheTrueOnes) {
    const Eigen::Index n = 400;
    Eigen::MatrixXd slopes(n, 1);
    for (Eigen::Index k = 0; k < n; ++k) {
        slopes(k, 0) = std::sin(0.02 * static_cast<double>(k)) + std::sin(1.2 * static_cast<double>(k));
    }
    double squares = 0, of_least = 0, variance = 0;
    const std::uint64_t trials = 50;
    for (std::uint64_t seed = 1; seed <= trials; ++seed) {
        const Eigen::VectorXd y = errors_of(seed, n, 10, 0.95);
        const double least = slopes.col(0).dot(y) / slopes.squaredNorm();
        const GeneralizedFit fit = fit_of(y - slopes * least, slopes);
        squares += std::pow(least + fit.step[0], 2);
        of_least += least * least;
        variance += fit.covariance(0, 0);
    }
    EXPECT_LT(squares, 0.5 * of_least);
    EXPECT_NEAR(squares / variance, 1, 0.4);
}

// Of the mean of many errors the variance is known.
TEST(LastingErrors, ManyErrorsTellHowTheyFollowEachOther) {
    const Eigen::Index n = 20000;
    const Eigen::MatrixXd ones = Eigen::MatrixXd::Ones(n, 1);
    const double memory = 0.9, known = (1 + 4 * (1 + memory) / (1 - memory)) / n;
    const Eigen::VectorXd y = errors_of(1, n, 2, memory);
    EXPECT_NEAR(fit_of(y.array() - y.mean(), ones).covariance(0, 0) / known, 1, 0.3);
    // White ones, of an oscillation.
    Eigen::MatrixXd oscillates(n, 1);
    for (Eigen::Index k = 0; k < n; ++k) oscillates(k, 0) = std::sin(0.2 * static_cast<double>(k));
    EXPECT_NEAR(fit_of(errors_of(2, n, 0, 0), oscillates).covariance(0, 0) * (n / 2), 1, 0.05);
}

// Two records with a parameter each: nothing is correlated across the border.
TEST(LastingErrors, RecordsAreCorrelatedEachWithinItself) {
    const Eigen::Index n = 100;
    Eigen::MatrixXd apart = Eigen::MatrixXd::Zero(2 * n, 2);
    apart.col(0).head(n).setOnes();
    apart.col(1).tail(n).setOnes();
    Eigen::VectorXd errors = errors_of(3, 2 * n, 2, 0.9);
    errors.head(n).array() -= errors.head(n).mean();
    errors.tail(n).array() -= errors.tail(n).mean();
    const auto two = generalized_fit({{errors, apart, {100, 100}}}), one = generalized_fit({{errors, apart, {200}}});
    EXPECT_LT(std::abs(two.covariance(0, 1)), 0.1 * two.covariance(0, 0));
    EXPECT_GT(std::abs(one.covariance(0, 1)), 2 * std::abs(two.covariance(0, 1)));
}

// Each output has noise of its own, and tells as much as that leaves.
TEST(LastingErrors, OutputsTellAsMuchAsTheirErrorsLeave) {
    const Eigen::Index n = 400;
    Eigen::MatrixXd slopes(n, 1);
    for (Eigen::Index k = 0; k < n; ++k) slopes(k, 0) = std::sin(0.4 * static_cast<double>(k));
    const Eigen::VectorXd fine = 0.1 * errors_of(1, n, 0, 0), coarse = errors_of(2, n, 0, 0);
    const auto both = generalized_fit({{fine, slopes, {400}}, {coarse, slopes, {400}}});
    const auto of_fine = fit_of(fine, slopes), of_coarse = fit_of(coarse, slopes);
    EXPECT_NEAR(1 / both.covariance(0, 0), 1 / of_fine.covariance(0, 0) + 1 / of_coarse.covariance(0, 0),
                0.05 / both.covariance(0, 0));
    EXPECT_NEAR(both.step[0], of_fine.step[0], 0.2 * std::sqrt(of_fine.covariance(0, 0)));
    // The same error again is no news, whatever its unit; and what one output sees the other way round is averaged out.
    const auto twice = generalized_fit({{fine, slopes, {400}}, {10 * fine, 10 * slopes, {400}}}),
               opposite = generalized_fit({{fine, slopes, {400}}, {-fine, slopes, {400}}});
    EXPECT_NEAR(twice.covariance(0, 0) / of_fine.covariance(0, 0), 1, 0.01);
    EXPECT_NEAR(twice.step[0], of_fine.step[0], 1e-5);
    EXPECT_LT(opposite.covariance(0, 0), 0.05 * of_fine.covariance(0, 0));
}

TEST(LastingErrors, ParametersThatDoNothingAndErrorsThatAreNoneAreNoDivisionByZero) {
    const Eigen::Index n = 60;
    Eigen::MatrixXd slopes = Eigen::MatrixXd::Zero(n, 3);
    slopes.leftCols(2) = line(n);
    const Eigen::VectorXd errors = errors_of(4, n, 1, 0.9);
    const auto with = fit_of(errors, slopes), without = fit_of(errors, line(n));
    EXPECT_EQ(with.covariance.col(2).norm(), 0);
    EXPECT_EQ(with.step[2], 0);
    EXPECT_LT((with.covariance.topLeftCorner(2, 2) - without.covariance).norm(), 1e-6 * without.covariance.norm());
    EXPECT_LT((with.step.head(2) - without.step).norm(), 1e-6 * without.step.norm());
    for (const auto& one : {fit_of(Eigen::VectorXd::Zero(n), slopes), fit_of(Eigen::VectorXd(0), Eigen::MatrixXd(0, 3)),
                            fit_of(errors, Eigen::MatrixXd::Zero(n, 3))}) {
        EXPECT_EQ(one.covariance.norm(), 0);
        EXPECT_EQ(one.step.norm(), 0);
    }
    EXPECT_TRUE(fit_of(errors.head(4), slopes.topRows(4)).covariance.allFinite()); // too few
}

} // namespace
} // namespace tribode
