#pragma once
#include <Eigen/Core>
#include <vector>

namespace tribode {

// Inverse of a symmetric matrix j^T j, j of columns of norm about one: large, but finite, in directions that j hardly tells.
Eigen::MatrixXd bounded_inverse(const Eigen::MatrixXd& normal);

// j^T j of a Jacobian whose rows are records and whose columns are parameters and then the start values of each record. The errors of a
// record do not depend on the start values of others: where records are segments most of the matrix is zero.
class NormalEquations {
  public:
    // The Jacobian must outlive it. `parameters`: how many of its columns. `ends`: behind the last row of each record, each of which
    // has as many start values. Of one record, or of ends that do not go with the matrix, all columns count as parameters.
    NormalEquations(const Eigen::MatrixXd& jacobian, Eigen::Index parameters, const std::vector<Eigen::Index>& ends);

    Eigen::MatrixXd product(const Eigen::Ref<const Eigen::MatrixXd>& errors) const; // j^T errors, of all rows
    Eigen::VectorXd times(const Eigen::VectorXd& x) const;                          // j^T j x, of all columns
    Eigen::MatrixXd matrix() const;                                                 // j^T j

    // Of (j^T j + damping I) x = right. Start values are eliminated, record by record.
    Eigen::VectorXd damped_solution(double damping, const Eigen::VectorXd& right) const;

  private:
    struct Starts {
        Eigen::MatrixXd own, shared; // j_s^T j_s and j_p^T j_s, of the start values s and the parameters p
    };
    const Eigen::MatrixXd& jacobian_;
    std::vector<Eigen::Index> ends_; // of the records, where start values stand apart
    Eigen::MatrixXd parameters_;     // j_p^T j_p
    std::vector<Starts> starts_;     // of each record
};

} // namespace tribode
