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

// Of lines through errors about nothing: how far the fitted values are off, in standard errors, and their white ones.
struct Coverage {
    double within = 0, within_white = 0;
};
Coverage coverage(double size, double memory, bool smooth) {
    const Eigen::Index n = 300;
    const Eigen::MatrixXd slopes = line(n), inverse = (slopes.transpose() * slopes).inverse();
    Coverage result;
    const std::uint64_t trials = 150;
    for (std::uint64_t seed = 1; seed <= trials; ++seed) {
        const Eigen::VectorXd y = errors_of(seed, n, size, memory, smooth);
        const Eigen::VectorXd fitted = inverse * slopes.transpose() * y, left = y - slopes * fitted;
        const Eigen::MatrixXd covariance =
            inverse * normal_of_lasting_errors(left, slopes, {static_cast<std::size_t>(n)}) * inverse;
        for (Eigen::Index i = 0; i < 2; ++i) {
            const double white = left.squaredNorm() / static_cast<double>(n - 2) * inverse(i, i), share = 0.5 / trials;
            if (std::abs(fitted[i]) < 1.6449 * std::sqrt(covariance(i, i))) result.within += share;
            if (std::abs(fitted[i]) < 1.6449 * std::sqrt(white)) result.within_white += share;
        }
    }
    return result;
}

TEST(LastingErrors, BoundsHoldWhereTheFitHasFollowedTheMotion) {
    const Coverage white = coverage(0, 0, false), rough = coverage(1, 0.95, false), smooth = coverage(3, 0.95, true);
    EXPECT_GT(white.within, 0.87);
    EXPECT_GT(white.within_white, 0.85); // of means and slopes bounds are wide: a slow motion would be like them
    for (const auto& lasting : {rough, smooth}) {
        EXPECT_GT(lasting.within, 0.80);
        EXPECT_LT(lasting.within, 0.97);
        EXPECT_LT(lasting.within_white, 0.45);
    }
}

// Of the mean of many errors the variance is known.
TEST(LastingErrors, ManyErrorsTellHowTheyFollowEachOther) {
    const Eigen::Index n = 20000;
    const Eigen::MatrixXd ones = Eigen::MatrixXd::Ones(n, 1);
    const double memory = 0.9, known = (1 + 4 * (1 + memory) / (1 - memory)) * n;
    const Eigen::VectorXd y = errors_of(1, n, 2, memory);
    const Eigen::VectorXd left = y.array() - y.mean();
    EXPECT_NEAR(normal_of_lasting_errors(left, ones, {20000})(0, 0) / known, 1, 0.3);
    // White ones, of an oscillation.
    Eigen::MatrixXd oscillates(n, 1);
    for (Eigen::Index k = 0; k < n; ++k) oscillates(k, 0) = std::sin(0.2 * static_cast<double>(k));
    const Eigen::VectorXd white = errors_of(2, n, 0, 0);
    EXPECT_NEAR(normal_of_lasting_errors(white, oscillates, {20000})(0, 0) / (n / 2), 1, 0.05);
}

// Twice the same record: nothing is correlated across the border.
TEST(LastingErrors, RecordsAreCorrelatedEachWithinItself) {
    const Eigen::Index n = 100;
    Eigen::MatrixXd apart = Eigen::MatrixXd::Zero(2 * n, 2);
    apart.col(0).head(n).setOnes();
    apart.col(1).tail(n).setOnes();
    const Eigen::VectorXd errors = errors_of(3, 2 * n, 2, 0.9);
    const Eigen::MatrixXd two = normal_of_lasting_errors(errors, apart, {100, 100}),
                          one = normal_of_lasting_errors(errors, apart, {200});
    EXPECT_LT(std::abs(two(0, 1)), 1e-9 * two(0, 0));
    EXPECT_GT(one(0, 1), 0.01 * one(0, 0));
}

TEST(LastingErrors, ParametersThatDoNothingAndErrorsThatAreNoneAreNoDivisionByZero) {
    const Eigen::Index n = 60;
    Eigen::MatrixXd slopes = Eigen::MatrixXd::Zero(n, 3);
    slopes.leftCols(2) = line(n);
    const Eigen::VectorXd errors = errors_of(4, n, 1, 0.9);
    const Eigen::MatrixXd normal = normal_of_lasting_errors(errors, slopes, {60});
    EXPECT_TRUE(normal.allFinite());
    EXPECT_EQ(normal.col(2).norm(), 0);
    EXPECT_LT((normal.topLeftCorner(2, 2) - normal_of_lasting_errors(errors, line(n), {60})).norm(),
              1e-9 * normal.norm());
    EXPECT_EQ(normal_of_lasting_errors(Eigen::VectorXd::Zero(n), slopes, {60}).norm(), 0);
    EXPECT_EQ(normal_of_lasting_errors(Eigen::VectorXd(0), Eigen::MatrixXd(0, 3), {0}).norm(), 0);
    EXPECT_TRUE(normal_of_lasting_errors(errors.head(4), slopes.topRows(4), {4}).allFinite()); // too few
}

} // namespace
} // namespace tribode
