#include "tribode/system/root_finder.hpp"

#include <algorithm>
#include <cmath>
#include <limits>

namespace tribode {

namespace {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;

constexpr Index max_dense = 64;
constexpr double min_condition = 1e-14; // reciprocal, of the scaled matrix

} // namespace

Factors::Factors(const std::vector<MatrixPlace>& places, const std::vector<double>& values, const VectorXd& sizes)
    : sizes_(sizes),
      rows_(VectorXd::Zero(sizes.size())) {
    const Index n = sizes.size();
    const auto row = [&](std::size_t k) { return static_cast<Index>(places[k].row); };
    const auto column = [&](std::size_t k) { return static_cast<Index>(places[k].column); };
    for (std::size_t k = 0; k < places.size(); ++k) {
        rows_(row(k)) = std::max(rows_(row(k)), std::abs(values[k]) * sizes(column(k)));
    }
    if (!((rows_.array() > 0).all() && rows_.allFinite())) {
        singular_ = true;
        return;
    }
    VectorXd columns = VectorXd::Zero(n);
    for (std::size_t k = 0; k < places.size(); ++k) {
        const double entry = std::abs(values[k]) * sizes(column(k)) / rows_(row(k));
        columns(column(k)) = std::max(columns(column(k)), entry);
    }
    if (!(columns.array() > 0).all()) {
        singular_ = true;
        return;
    }
    sizes_ = sizes_.cwiseQuotient(columns);
    const auto scaled = [&](std::size_t k) { return values[k] * sizes_(column(k)) / rows_(row(k)); };
    if (n <= max_dense) {
        MatrixXd matrix = MatrixXd::Zero(n, n);
        for (std::size_t k = 0; k < places.size(); ++k) matrix(row(k), column(k)) += scaled(k);
        dense_.compute(matrix);
        singular_ = !(dense_.rcond() > min_condition);
        return;
    }
    std::vector<Eigen::Triplet<double>> entries;
    for (std::size_t k = 0; k < places.size(); ++k) entries.emplace_back(row(k), column(k), scaled(k));
    Eigen::SparseMatrix<double> matrix(n, n);
    matrix.setFromTriplets(entries.begin(), entries.end());
    sparse_.compute(matrix);
    singular_ = sparse_.info() != Eigen::Success;
}

VectorXd Factors::solve(const VectorXd& b) const {
    const VectorXd scaled = b.cwiseQuotient(rows_);
    const VectorXd solved =
        sizes_.size() <= max_dense ? VectorXd(dense_.solve(scaled)) : VectorXd(sparse_.solve(scaled));
    return solved.cwiseProduct(sizes_);
}

VectorXd Factors::amplify(const VectorXd& b) const {
    if (sizes_.size() > max_dense) return solve(b).cwiseAbs();
    return (dense_.inverse().cwiseAbs() * b.cwiseQuotient(rows_)).cwiseProduct(sizes_);
}

Root find_root(const RootProblem& problem, VectorXd z) {
    constexpr int max_iterations = 500; // a diode may take one for every 25 mV
    constexpr double near = 1e-8;       // steps below this are at the root, and are made until they get no shorter
    const Index n = z.size();
    Root root;
    VectorXd f(n), there(n);
    std::vector<double> entries(problem.places.size());
    problem.functions(z, f);
    double part = 1, before = std::numeric_limits<double>::infinity();
    bool was_whole = false;
    const auto ended = [&](Root::End end) {
        root.end = end;
        root.z = z;
        return root;
    };
    for (int iteration = 0; iteration < max_iterations; ++iteration) {
        for (Index i = 0; i < n; ++i) {
            root.worst = i;
            root.residual = f(i);
            if (!std::isfinite(f(i))) return ended(Root::End::not_finite);
        }
        const VectorXd sizes = z.cwiseAbs().cwiseMax(problem.nominal);
        problem.jacobian(z, entries);
        const Factors factors(problem.places, entries, sizes);
        root.worst = 0;
        for (Index i = 1; i < n; ++i) {
            const auto miss = [&](Index row) {
                return factors.row_size(row) > 0 ? std::abs(f(row)) / factors.row_size(row) : std::abs(f(row));
            };
            if (miss(i) > miss(root.worst)) root.worst = i;
        }
        root.residual = f(root.worst);
        if (factors.singular()) return ended(Root::End::singular);
        const VectorXd step = factors.solve(-f);
        if (!step.allFinite()) return ended(Root::End::singular);
        const auto length = [&](const VectorXd& v) { return v.cwiseQuotient(sizes).cwiseAbs().maxCoeff(); };
        const double reach = length(step);
        // What rounding of the terms leaves of the functions moves the root by so much.
        VectorXd terms = VectorXd::Zero(n);
        for (std::size_t k = 0; k < entries.size(); ++k) {
            const auto [row, column] = problem.places[k];
            terms(static_cast<Index>(row)) += std::abs(entries[k] * z(static_cast<Index>(column)));
        }
        const VectorXd rounding = 2 * std::numeric_limits<double>::epsilon() * (z.cwiseAbs() + factors.amplify(terms));
        if ((step.cwiseAbs().array() <= rounding.array()).all() ||
            (was_whole && reach <= near && reach >= before / 4)) {
            z += step;
            root.uncertain = 2 * step.cwiseAbs() + rounding;
            return ended(Root::End::found);
        }
        for (part = std::min(1.0, 4 * part);; part /= 2) {
            const VectorXd next = z + part * step;
            if (next == z) return ended(Root::End::none_near);
            problem.functions(next, there);
            if (!there.allFinite()) continue;
            const double left = length(factors.solve(-there));
            if (!(left <= (1 - part / 4) * reach) && !(reach <= near && part == 1 && std::isfinite(left))) continue;
            z = next;
            f = there;
            break;
        }
        was_whole = part == 1;
        before = reach;
    }
    return ended(Root::End::none_near);
}

} // namespace tribode
