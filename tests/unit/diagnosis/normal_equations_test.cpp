#include "tribode/diagnosis/normal_equations.hpp"

#include <Eigen/Cholesky>
#include <cstdlib>
#include <gtest/gtest.h>

namespace tribode {
namespace {

// Two parameters, then two start values of each of three records.
Eigen::MatrixXd jacobian_of_three_records() {
    Eigen::MatrixXd j = Eigen::MatrixXd::Zero(15, 8);
    std::srand(7);
    j.leftCols(2) = Eigen::MatrixXd::Random(15, 2);
    j.block(0, 2, 4, 2) = Eigen::MatrixXd::Random(4, 2);
    j.block(4, 4, 6, 2) = Eigen::MatrixXd::Random(6, 2);
    j.block(10, 6, 5, 2) = Eigen::MatrixXd::Random(5, 2);
    return j;
}

void expect_as_whole(const Eigen::MatrixXd& j, const NormalEquations& equations) {
    const Eigen::MatrixXd whole = j.transpose() * j;
    const Eigen::VectorXd errors = Eigen::VectorXd::LinSpaced(j.rows(), -1, 2);
    const Eigen::VectorXd x = Eigen::VectorXd::LinSpaced(j.cols(), 3, -1);
    EXPECT_LT((equations.product(errors) - j.transpose() * errors).norm(), 1e-14);
    const Eigen::MatrixXd several = Eigen::MatrixXd::Random(j.rows(), 3);
    EXPECT_LT((equations.product(several) - j.transpose() * several).norm(), 1e-14);
    EXPECT_LT((equations.times(x) - whole * x).norm(), 1e-13);
    EXPECT_LT((equations.matrix() - whole).norm(), 1e-14);
    for (const double damping : {1e-6, 0.3}) {
        Eigen::MatrixXd damped = whole;
        damped.diagonal().array() += damping;
        const Eigen::VectorXd solution = damped.ldlt().solve(x);
        EXPECT_LT((equations.damped_solution(damping, x) - solution).norm(), 1e-11 * solution.norm());
    }
}

TEST(NormalEquations, start_values_are_eliminated_record_by_record) {
    const auto j = jacobian_of_three_records();
    expect_as_whole(j, NormalEquations(j, 2, {4, 10, 15}));
}

TEST(NormalEquations, of_one_record_or_of_other_rows_is_the_whole_matrix) {
    const auto j = jacobian_of_three_records();
    expect_as_whole(j, NormalEquations(j, 2, {15}));
    expect_as_whole(j, NormalEquations(j, 2, {4, 10, 20})); // rows of more samples than were counted
    expect_as_whole(j, NormalEquations(j, 8, {4, 10, 15})); // no start values
}

} // namespace
} // namespace tribode
