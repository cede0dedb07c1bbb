#include "tribode/base/random.hpp"
#include "tribode/system/root_finder.hpp"

#include <cmath>
#include <gtest/gtest.h>

namespace tribode {
namespace {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;

// Of a full matrix, all entries.
std::vector<MatrixPlace> all_places(Index n) {
    std::vector<MatrixPlace> places;
    for (Index j = 0; j < n; ++j) {
        for (Index i = 0; i < n; ++i) places.push_back({static_cast<std::size_t>(i), static_cast<std::size_t>(j)});
    }
    return places;
}

MatrixXd random_matrix(Index n, std::uint64_t draw) {
    MatrixXd matrix(n, n);
    for (Index i = 0; i < n * n; ++i) matrix(i) = 2 * uniform(7, draw, static_cast<std::uint64_t>(i)) - 1;
    return matrix;
}

TEST(Factors, SolveOnEveryScaleAndSize) {
    for (const Index n : {1, 2, 7, 64, 65, 100}) { // dense, and sparse beyond 64
        MatrixXd matrix = random_matrix(n, static_cast<std::uint64_t>(n));
        VectorXd sizes = VectorXd::Ones(n), x(n);
        for (Index i = 0; i < n; ++i) {
            sizes(i) = std::pow(10.0, static_cast<double>(i % 13) - 6);
            matrix.col(i) /= sizes(i);
            matrix.row(i) *= std::pow(10.0, static_cast<double>((5 * i) % 17) - 8);
            x(i) = sizes(i) * (1 + static_cast<double>(i % 3));
        }
        const std::vector<double> values(matrix.data(), matrix.data() + n * n);
        const Factors factors(all_places(n), values, sizes);
        ASSERT_FALSE(factors.singular()) << n;
        const VectorXd solved = factors.solve(matrix * x);
        EXPECT_LT((solved - x).cwiseQuotient(sizes).cwiseAbs().maxCoeff(), 1e-9) << n;
        EXPECT_GE((factors.amplify((matrix * x).cwiseAbs()) - 0.999 * x.cwiseAbs()).minCoeff(), n > 64 ? -1e9 : 0) << n;
    }
}

TEST(Factors, AreSingularWhereTheMatrixIs) {
    const auto singular = [](const MatrixXd& matrix) {
        const std::vector<double> values(matrix.data(), matrix.data() + matrix.size());
        return Factors(all_places(matrix.rows()), values, VectorXd::Ones(matrix.rows())).singular();
    };
    EXPECT_TRUE(singular(MatrixXd::Zero(1, 1)));
    EXPECT_TRUE(singular(MatrixXd::Ones(2, 2)));
    EXPECT_TRUE(singular(MatrixXd::Constant(1, 1, std::nan(""))));
    MatrixXd without_row = random_matrix(80, 1);
    without_row.row(17).setZero();
    EXPECT_TRUE(singular(without_row));
    EXPECT_FALSE(singular(1e-300 * MatrixXd::Identity(3, 3)));
}

RootProblem of_one(const std::function<double(double)>& f, const std::function<double(double)>& slope,
                   double nominal = 1) {
    return {[f](const VectorXd& z, VectorXd& value) { value(0) = f(z(0)); },
            {{0, 0}},
            [slope](const VectorXd& z, std::vector<double>& entry) { entry[0] = slope(z(0)); },
            VectorXd::Constant(1, nominal)};
}

// A diode behind a resistor: i R + v = U, i = I (exp(v/0.026) - 1). From v = 0 the first full step would be to exp(U/0.026).
TEST(FindRoot, GetsAlongWithAnExponential) {
    for (const double voltage : {0.1, 1.0, 12.0}) {
        const auto problem = of_one([&](double v) { return 1e-12 * std::expm1(v / 0.026) - (voltage - v) / 100; },
                                    [&](double v) { return 1e-12 / 0.026 * std::exp(v / 0.026) + 1.0 / 100; });
        for (const double start : {0.0, -3.0, 0.9, voltage}) {
            const Root root = find_root(problem, VectorXd::Constant(1, start));
            ASSERT_EQ(root.end, Root::End::found) << voltage << " " << start;
            // The voltage to a few roundings.
            const auto miss = [&](double v) { return 1e-12 * std::expm1(v / 0.026) - (voltage - v) / 100; };
            EXPECT_LT(miss(root.z(0) * (1 - 1e-15)), 0);
            EXPECT_GT(miss(root.z(0) * (1 + 1e-15)), 0);
        }
    }
}

TEST(FindRoot, IsAccurateOnEveryScale) {
    for (const double scale : {1e-12, 1e-3, 1.0, 1e9}) {
        const auto problem = of_one([&](double z) { return z * z * z - 8 * scale * scale * scale; },
                                    [](double z) { return 3 * z * z; }, scale);
        const Root root = find_root(problem, VectorXd::Constant(1, scale));
        ASSERT_EQ(root.end, Root::End::found);
        EXPECT_NEAR(root.z(0) / scale, 2, 1e-15);
        EXPECT_LT(root.uncertain(0) / scale, 1e-14);
    }
}

TEST(FindRoot, SaysWhyThereIsNone) {
    const auto square = of_one([](double z) { return z * z + 1; }, [](double z) { return 2 * z; });
    EXPECT_NE(find_root(square, VectorXd::Constant(1, 3)).end, Root::End::found);
    EXPECT_EQ(find_root(square, VectorXd::Constant(1, 0)).end, Root::End::singular);
    const auto none = of_one([](double) { return std::nan(""); }, [](double) { return 1; });
    EXPECT_EQ(find_root(none, VectorXd::Constant(1, 0)).end, Root::End::not_finite);
    const auto growing = of_one([](double z) { return std::exp(z); }, [](double z) { return std::exp(z); });
    EXPECT_NE(find_root(growing, VectorXd::Constant(1, 0)).end, Root::End::found);
    // The function that is furthest from zero is named: the second, of 1 + z1^2.
    const RootProblem two{[](const VectorXd& z, VectorXd& f) { f << z(0) - 1, 1 + z(1) * z(1); },
                          {{0, 0}, {1, 1}},
                          [](const VectorXd& z, std::vector<double>& entries) {
                              entries = {1, 2 * z(1)};
                          },
                          VectorXd::Ones(2)};
    const Root root = find_root(two, VectorXd::Constant(2, 2));
    EXPECT_NE(root.end, Root::End::found);
    EXPECT_EQ(root.worst, 1);
}

} // namespace
} // namespace tribode
