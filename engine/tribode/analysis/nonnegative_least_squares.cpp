#include "tribode/analysis/nonnegative_least_squares.hpp"

#include <Eigen/Cholesky>
#include <algorithm>
#include <cassert>
#include <cmath>
#include <vector>

namespace tribode {

namespace {

using Indices = std::vector<Eigen::Index>;

// The unconstrained minimum in the free variables, the others zero.
Eigen::VectorXd minimum_in(const Indices& free, const Eigen::MatrixXd& gram, const Eigen::VectorXd& moment) {
    const Eigen::VectorXd part = gram(free, free).ldlt().solve(Eigen::VectorXd(moment(free)));
    Eigen::VectorXd x = Eigen::VectorXd::Zero(moment.size());
    x(free) = part;
    return x;
}

// From x >= 0 towards `goal` until the first free variable reaches zero; those at zero are free no longer.
void step_to_bound(Eigen::VectorXd& x, const Eigen::VectorXd& goal, Indices& free) {
    double share = 1;
    Eigen::Index first = free.front();
    for (const auto i : free) {
        if (goal[i] > 0) continue;
        const double reach = x[i] / (x[i] - goal[i]);
        if (reach <= share) {
            share = reach;
            first = i;
        }
    }
    x += share * (goal - x);
    x[first] = 0; // exactly, so that each step sets at least one free variable to zero
    std::erase_if(free, [&](Eigen::Index i) {
        if (x[i] > 0) return false;
        x[i] = 0;
        return true;
    });
}

bool all_positive(const Eigen::VectorXd& x, const Indices& free) {
    return std::all_of(free.begin(), free.end(), [&](Eigen::Index i) { return x[i] > 0; });
}

} // namespace

Eigen::VectorXd nonnegative_least_squares(const Eigen::MatrixXd& gram, const Eigen::VectorXd& moment) {
    const Eigen::Index n = moment.size();
    assert(gram.rows() == n && gram.cols() == n);
    const Eigen::VectorXd scale =
        gram.diagonal().unaryExpr([](double square) { return square > 0 ? 1 / std::sqrt(square) : 0.0; });
    const Eigen::MatrixXd g = scale.asDiagonal() * gram * scale.asDiagonal();
    const Eigen::VectorXd m = scale.cwiseProduct(moment);
    const double negligible = 1e-11 * (n > 0 ? m.cwiseAbs().maxCoeff() : 0.0);

    Eigen::VectorXd x = Eigen::VectorXd::Zero(n);
    Indices free;
    std::vector<bool> refused(static_cast<std::size_t>(n), false); // entered, and would at once have become negative
    // In exact arithmetic the sum of squares falls with each round, which ends the search; the bound is against
    // rounding that takes the same variable in and out.
    for (Eigen::Index round = 0; round < 10 * n; ++round) {
        const Eigen::VectorXd descent = m - g * x;
        Eigen::Index entering = -1;
        for (Eigen::Index i = 0; i < n; ++i) {
            if (refused[static_cast<std::size_t>(i)] || std::find(free.begin(), free.end(), i) != free.end()) continue;
            if (descent[i] > negligible && (entering < 0 || descent[i] > descent[entering])) entering = i;
        }
        if (entering < 0) break;
        free.push_back(entering);
        Eigen::VectorXd goal = minimum_in(free, g, m);
        if (!(goal[entering] > 0)) {
            free.pop_back();
            refused[static_cast<std::size_t>(entering)] = true;
            continue;
        }
        while (!free.empty() && !all_positive(goal, free)) {
            step_to_bound(x, goal, free);
            goal = minimum_in(free, g, m);
        }
        x = goal;
        refused.assign(refused.size(), false);
    }
    return scale.cwiseProduct(x);
}

} // namespace tribode
