#pragma once
#include <Eigen/Core>

#include <cstddef>
#include <vector>

namespace tribode {

// J^T V J of errors with the covariance V: with N = J^T J, least squares give parameters of the covariance N^-1 J^T V J N^-1.
// V is that of white noise and of a motion whose correlation after a time t is e^-x or (1 + x) e^-x, x = t / T. How large and how
// lasting that motion is cannot be read from what a fit leaves, since the fit has followed it; the likelihood of what no
// parameter can follow tells it [Harville 1974], and V is the mean over sizes and T, weighed by that. Errors of one output, in
// samples that follow each other; slopes: J, a row for each error; rows: of each record, one behind the other.
Eigen::MatrixXd normal_of_lasting_errors(const Eigen::VectorXd& errors, const Eigen::MatrixXd& slopes,
                                         const std::vector<std::size_t>& rows);

} // namespace tribode
