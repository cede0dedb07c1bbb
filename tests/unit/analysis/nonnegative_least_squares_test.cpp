#include "tribode/analysis/nonnegative_least_squares.hpp"

#include "tribode/base/random.hpp"

#include <Eigen/Dense>
#include <gtest/gtest.h>

namespace tribode {
namespace {

// Rows of normal numbers, the columns correlated by a common part.
Eigen::MatrixXd random_matrix(Eigen::Index rows, Eigen::Index columns, double common, std::uint64_t seed) {
    Eigen::MatrixXd a(rows, columns);
    for (Eigen::Index i = 0; i < rows; ++i) {
        const auto row = static_cast<std::uint64_t>(i);
        for (Eigen::Index j = 0; j < columns; ++j) {
            a(i, j) =
                standard_normal(seed, static_cast<std::uint64_t>(j) + 1, row) + common * standard_normal(seed, 0, row);
        }
    }
    return a;
}

Eigen::VectorXd solve(const Eigen::MatrixXd& a, const Eigen::VectorXd& b) {
    return nonnegative_least_squares(a.transpose() * a, a.transpose() * b);
}

// The least sum of squares over all sets of free columns whose unconstrained minimum is not negative.
double least_by_trying_all_sets(const Eigen::MatrixXd& a, const Eigen::VectorXd& b) {
    double least = b.squaredNorm();
    for (unsigned set = 1; set < (1u << a.cols()); ++set) {
        std::vector<Eigen::Index> columns;
        for (Eigen::Index j = 0; j < a.cols(); ++j) {
            if (set >> j & 1u) columns.push_back(j);
        }
        const Eigen::MatrixXd part = a(Eigen::all, columns);
        const Eigen::VectorXd x = part.colPivHouseholderQr().solve(b);
        if (x.minCoeff() >= 0) least = std::min(least, (part * x - b).squaredNorm());
    }
    return least;
}

TEST(NonnegativeLeastSquares, FindsTheMinimumAmongAllSets) {
    for (std::uint64_t seed = 1; seed <= 50; ++seed) {
        const Eigen::MatrixXd a = random_matrix(12, 6, seed % 2 ? 0.0 : 3.0, seed);
        const Eigen::VectorXd b = random_matrix(12, 1, 0, seed + 1000);
        const Eigen::VectorXd x = solve(a, b);
        EXPECT_GE(x.minCoeff(), 0);
        // Rounding of squared columns with a condition number below 100.
        EXPECT_NEAR((a * x - b).squaredNorm(), least_by_trying_all_sets(a, b), 1e-10 * b.squaredNorm());
    }
}

TEST(NonnegativeLeastSquares, GivesBackANonnegativeCombinationOfAnyScale) {
    Eigen::MatrixXd a = random_matrix(40, 4, 1, 7);
    a.col(1) *= 1e9;
    a.col(2) *= 1e-9;
    const Eigen::Vector4d wanted(2, 3e-9, 4e9, 0);
    const Eigen::VectorXd x = solve(a, a * wanted);
    for (Eigen::Index i = 0; i < 3; ++i) EXPECT_NEAR(x[i] / wanted[i], 1, 1e-10); // rounding
    EXPECT_NEAR(x[3], 0, 1e-10);
}

TEST(NonnegativeLeastSquares, IsZeroWhereEveryColumnPointsAway) {
    const Eigen::MatrixXd a = Eigen::MatrixXd::Identity(3, 3);
    EXPECT_EQ(solve(a, Eigen::Vector3d(-1, -2, -3)), Eigen::Vector3d::Zero());
    EXPECT_EQ(solve(a, Eigen::Vector3d::Zero()), Eigen::Vector3d::Zero());
}

TEST(NonnegativeLeastSquares, BearsZeroAndEqualColumns) {
    Eigen::MatrixXd a(3, 3);
    a << 1, 0, 1, 1, 0, 1, 0, 0, 0;
    const Eigen::VectorXd x = solve(a, Eigen::Vector3d(2, 2, 5));
    EXPECT_EQ(x[1], 0);
    EXPECT_NEAR(x[0] + x[2], 2, 1e-12); // rounding
    EXPECT_GE(x.minCoeff(), 0);
}

} // namespace
} // namespace tribode
