#pragma once
#include <Eigen/Dense>
#include <Eigen/Sparse>
#include <cstddef>
#include <functional>
#include <vector>

namespace tribode {

struct MatrixPlace {
    std::size_t row, column;
};

// LU factors of a square matrix given by its entries. They are made with the object and belong to this matrix alone, so
// there is nothing to solve with before they are there. Rows and columns are scaled; up to 64 rows the matrix is dense.
class Factors {
  public:
    // Columns are taken over these sizes.
    Factors(const std::vector<MatrixPlace>& places, const std::vector<double>& values, const Eigen::VectorXd& sizes);

    bool singular() const { return singular_; }            // then there is no solve()
    Eigen::VectorXd solve(const Eigen::VectorXd& b) const; // A x = b
    Eigen::VectorXd
    amplify(const Eigen::VectorXd& b) const; // how large x may be for the signs of b's entries; sparse: |x|
    double row_size(Eigen::Index row) const { return rows_(row); } // its greatest entry times the size of its column

  private:
    Eigen::VectorXd sizes_, rows_;
    bool singular_ = false;
    Eigen::PartialPivLU<Eigen::MatrixXd> dense_;
    Eigen::SparseLU<Eigen::SparseMatrix<double>> sparse_;
};

// F(z) = 0: as many functions as unknowns, with the entries of their Jacobian.
struct RootProblem {
    std::function<void(const Eigen::VectorXd& z, Eigen::VectorXd& f)> functions;
    std::vector<MatrixPlace> places;
    std::function<void(const Eigen::VectorXd& z, std::vector<double>& values)> jacobian;
    Eigen::VectorXd nominal; // sizes of the unknowns
};

struct Root {
    enum class End { found, singular, not_finite, none_near };
    End end = End::none_near;
    Eigen::VectorXd z, uncertain; // and how far off each may be, by rounding
    Eigen::Index worst = 0;       // the function that is furthest from zero, for its size, where none was found
    double residual = 0;          // its value
};

// Newton's method from z, by steps as short as Deuflhard's natural monotonicity test wants them: the simplified Newton step at
// the new point must be shorter than the step was. It is not misled by the scales of functions or unknowns, and by no
// exponential of a diode [Deuflhard 2011]. It goes on down to rounding.
Root find_root(const RootProblem& problem, Eigen::VectorXd z);

} // namespace tribode
