#pragma once
#include <Eigen/Core>

namespace tribode {

// The x >= 0 that makes abs(A x - b)^2 least, from gram = A^T A (n x n, symmetric) and moment = A^T b (n), so that
// records of any length cost the same. Active-set method [Lawson 1974, chapter 23] on columns scaled to length one.
//
// The result satisfies the conditions of the minimum: x >= 0, the gradient gram x - moment is zero where x > 0 and not
// negative elsewhere, to rounding (1e-11 of the scaled moment). A column of zeros gets zero; of columns that depend on
// one another one is chosen. Squaring costs half of the digits: with columns whose condition number is c, x is good to
// about 1e-16 c^2.
Eigen::VectorXd nonnegative_least_squares(const Eigen::MatrixXd& gram, const Eigen::VectorXd& moment);

} // namespace tribode
