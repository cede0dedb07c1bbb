#include "tribode/diagnosis/normal_equations.hpp"

#include <Eigen/Cholesky>
#include <Eigen/Eigenvalues>

namespace tribode {

Eigen::MatrixXd bounded_inverse(const Eigen::MatrixXd& normal) {
    const Eigen::SelfAdjointEigenSolver<Eigen::MatrixXd> parts(normal);
    const double least = 1e-14 * parts.eigenvalues().maxCoeff();
    const auto& axes = parts.eigenvectors();
    return axes * parts.eigenvalues().cwiseMax(least).cwiseInverse().asDiagonal() * axes.transpose();
}

NormalEquations::NormalEquations(const Eigen::MatrixXd& j, Eigen::Index parameters,
                                 const std::vector<Eigen::Index>& ends)
    : jacobian_(j) {
    const auto records = static_cast<Eigen::Index>(ends.size());
    const bool is_apart = records > 1 && ends.back() == j.rows() && (j.cols() - parameters) % records == 0;
    if (!is_apart || j.cols() == parameters) {
        parameters_ = j.transpose() * j;
        return;
    }
    ends_ = ends;
    const Eigen::Index starts = (j.cols() - parameters) / records;
    parameters_ = j.leftCols(parameters).transpose() * j.leftCols(parameters);
    Eigen::Index row = 0, column = parameters;
    for (const Eigen::Index end : ends) {
        const auto own = j.block(row, column, end - row, starts), all = j.block(row, 0, end - row, parameters);
        starts_.push_back({own.transpose() * own, all.transpose() * own});
        row = end;
        column += starts;
    }
}

Eigen::MatrixXd NormalEquations::product(const Eigen::Ref<const Eigen::MatrixXd>& errors) const {
    const Eigen::Index parameters = parameters_.rows();
    Eigen::MatrixXd y(jacobian_.cols(), errors.cols());
    y.topRows(parameters).noalias() = jacobian_.leftCols(parameters).transpose() * errors;
    Eigen::Index row = 0, place = parameters;
    for (std::size_t r = 0; r < starts_.size(); ++r) {
        const Eigen::Index rows = ends_[r] - row, starts = starts_[r].own.rows();
        y.middleRows(place, starts).noalias() =
            jacobian_.block(row, place, rows, starts).transpose() * errors.middleRows(row, rows);
        row = ends_[r];
        place += starts;
    }
    return y;
}

Eigen::VectorXd NormalEquations::damped_solution(double damping, const Eigen::VectorXd& right) const {
    const Eigen::Index parameters = parameters_.rows();
    Eigen::MatrixXd schur = parameters_;
    schur.diagonal().array() += damping;
    Eigen::VectorXd rest = right.head(parameters), x(right.size());
    std::vector<Eigen::LDLT<Eigen::MatrixXd>> solvers;
    Eigen::Index place = parameters;
    for (const auto& [own, shared] : starts_) {
        Eigen::MatrixXd damped = own;
        damped.diagonal().array() += damping;
        const auto& solver = solvers.emplace_back(damped);
        schur.noalias() -= shared * solver.solve(shared.transpose());
        rest.noalias() -= shared * solver.solve(right.segment(place, own.rows()));
        place += own.rows();
    }
    x.head(parameters) = schur.ldlt().solve(rest);
    place = parameters;
    for (std::size_t r = 0; r < starts_.size(); ++r) {
        const auto& [own, shared] = starts_[r];
        x.segment(place, own.rows()) =
            solvers[r].solve(right.segment(place, own.rows()) - shared.transpose() * x.head(parameters));
        place += own.rows();
    }
    return x;
}

Eigen::VectorXd NormalEquations::times(const Eigen::VectorXd& x) const {
    const Eigen::Index parameters = parameters_.rows();
    Eigen::VectorXd y(x.size());
    y.head(parameters) = parameters_ * x.head(parameters);
    Eigen::Index place = parameters;
    for (const auto& [own, shared] : starts_) {
        const auto here = x.segment(place, own.rows());
        y.head(parameters) += shared * here;
        y.segment(place, own.rows()) = shared.transpose() * x.head(parameters) + own * here;
        place += own.rows();
    }
    return y;
}

Eigen::MatrixXd NormalEquations::matrix() const {
    const Eigen::Index parameters = parameters_.rows();
    Eigen::MatrixXd all = Eigen::MatrixXd::Zero(jacobian_.cols(), jacobian_.cols());
    all.topLeftCorner(parameters, parameters) = parameters_;
    Eigen::Index place = parameters;
    for (const auto& [own, shared] : starts_) {
        all.block(place, place, own.rows(), own.cols()) = own;
        all.block(0, place, parameters, own.cols()) = shared;
        all.block(place, 0, own.rows(), parameters) = shared.transpose();
        place += own.rows();
    }
    return all;
}

} // namespace tribode
