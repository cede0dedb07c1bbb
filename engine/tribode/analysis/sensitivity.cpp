#include "tribode/analysis/sensitivity.hpp"
#include "tribode/analysis/statistics.hpp"
#include "tribode/base/error.hpp"
#include "tribode/base/random.hpp"

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <fmt/format.h>
#include <limits>
#include <numeric>

namespace tribode {

namespace {

constexpr double unknown = std::numeric_limits<double>::quiet_NaN();

// Rows in which the result and all factors are finite.
std::vector<std::size_t> whole_rows(const FactorColumns& factors, std::span<const double> values) {
    for (const auto& column : factors) {
        if (column.size() == values.size()) continue;
        throw InputError(
            fmt::format("a factor has {} values and the result {}, must have as many", column.size(), values.size()));
    }
    std::vector<std::size_t> rows;
    for (std::size_t i = 0; i < values.size(); ++i) {
        const bool whole =
            std::all_of(factors.begin(), factors.end(), [i](const auto& column) { return std::isfinite(column[i]); });
        if (whole && std::isfinite(values[i])) rows.push_back(i);
    }
    return rows;
}

// Places from 1; equal values share the mean of theirs.
Eigen::VectorXd ranks_of(const Eigen::VectorXd& x) {
    std::vector<Eigen::Index> order(static_cast<std::size_t>(x.size()));
    std::iota(order.begin(), order.end(), 0);
    std::sort(order.begin(), order.end(), [&](Eigen::Index a, Eigen::Index b) { return x[a] < x[b]; });
    Eigen::VectorXd ranks(x.size());
    for (std::size_t from = 0, to = 0; from < order.size(); from = to) {
        while (to < order.size() && x[order[to]] == x[order[from]]) ++to;
        for (std::size_t i = from; i < to; ++i) ranks[order[i]] = 0.5 * static_cast<double>(from + to + 1);
    }
    return ranks;
}

// Less the mean, over the standard deviation; false where it does not vary.
bool standardize(Eigen::VectorXd& x) {
    x.array() -= x.mean();
    const double sd = std::sqrt(x.squaredNorm() / static_cast<double>(x.size() - 1));
    if (!(sd > 0)) return false;
    x /= sd;
    return true;
}

} // namespace

SobolIndices sobol_indices(std::span<const double> values, std::size_t factors, std::size_t replicates,
                           std::uint64_t seed) {
    const std::size_t rows = factors + 2;
    if (factors == 0 || values.size() % rows != 0) {
        throw InputError(fmt::format(
            "there are {} values, must be groups of {} (factors + 2) as tb.saltelli plans them", values.size(), rows));
    }
    std::vector<std::span<const double>> groups;
    for (std::size_t g = 0; g < values.size() / rows; ++g) {
        const auto group = values.subspan(g * rows, rows);
        if (std::all_of(group.begin(), group.end(), [](double x) { return std::isfinite(x); })) groups.push_back(group);
    }
    SobolIndices result;
    result.groups = groups.size();
    result.dropped = values.size() / rows - groups.size();
    if (groups.size() < 2) throw InputError("fewer than two groups of values are complete");

    const double n = static_cast<double>(groups.size());
    for (const auto& group : groups) result.mean += (group[0] + group[1]) / (2 * n);
    const std::size_t d = factors;

    // What each group adds to the sums: a + b, a^2 + b^2, and b (ab - a) and (a - ab)^2 / 2 of each factor.
    Eigen::MatrixXd share(static_cast<Eigen::Index>(2 + 2 * d), static_cast<Eigen::Index>(groups.size()));
    for (std::size_t g = 0; g < groups.size(); ++g) {
        const double a = groups[g][0] - result.mean, b = groups[g][1] - result.mean;
        auto column = share.col(static_cast<Eigen::Index>(g));
        column[0] = a + b;
        column[1] = a * a + b * b;
        for (std::size_t i = 0; i < d; ++i) {
            const double ab = groups[g][2 + i] - result.mean;
            column[static_cast<Eigen::Index>(2 + i)] = b * (ab - a);
            column[static_cast<Eigen::Index>(2 + d + i)] = 0.5 * (a - ab) * (a - ab);
        }
    }
    const auto indices = [&](const Eigen::VectorXd& sums) -> Eigen::VectorXd {
        const double mean = sums[0] / (2 * n), variance = sums[1] / (2 * n) - mean * mean;
        return sums.tail(static_cast<Eigen::Index>(2 * d)) / n / (variance > 0 ? variance : unknown);
    };
    const Eigen::VectorXd sums = share.rowwise().sum();
    const Eigen::VectorXd best = indices(sums);
    result.variance = sums[1] / (2 * n); // the mean of all is taken out already

    // Groups drawn again from themselves.
    Eigen::VectorXd total = Eigen::VectorXd::Zero(best.size()), squares = total;
    for (std::size_t r = 0; r < replicates; ++r) {
        Eigen::VectorXd drawn = Eigen::VectorXd::Zero(sums.size());
        for (std::size_t g = 0; g < groups.size(); ++g) {
            drawn += share.col(static_cast<Eigen::Index>(uniform(seed, r, g) * n));
        }
        const Eigen::VectorXd again = indices(drawn) - best;
        total += again;
        squares += again.cwiseAbs2();
    }
    const double count = static_cast<double>(replicates);
    for (std::size_t i = 0; i < 2 * d; ++i) {
        const auto at = static_cast<Eigen::Index>(i);
        const double error =
            replicates > 1 ? std::sqrt((squares[at] - total[at] * total[at] / count) / (count - 1)) : unknown;
        (i < d ? result.first : result.total).push_back(best[at]);
        (i < d ? result.first_error : result.total_error).push_back(error);
    }
    return result;
}

StandardizedRegression standardized_regression(const FactorColumns& factors, std::span<const double> values,
                                               bool ranks) {
    const auto rows = whole_rows(factors, values);
    if (rows.size() <= factors.size() + 1) {
        throw InputError(
            fmt::format("{} rows are complete, must be more than the {} factors and one", rows.size(), factors.size()));
    }
    const auto count = static_cast<Eigen::Index>(rows.size());
    const auto column_of = [&](std::span<const double> values_of) {
        Eigen::VectorXd x(count);
        for (std::size_t i = 0; i < rows.size(); ++i) x[static_cast<Eigen::Index>(i)] = values_of[rows[i]];
        return ranks ? ranks_of(x) : x;
    };
    StandardizedRegression result;
    result.rows = rows.size();
    result.coefficients.assign(factors.size(), unknown);
    result.standard_errors.assign(factors.size(), unknown);
    result.r_squared = unknown;

    Eigen::VectorXd y = column_of(values);
    std::vector<std::size_t> varied;
    Eigen::MatrixXd x(count, 0);
    for (std::size_t f = 0; f < factors.size(); ++f) {
        Eigen::VectorXd column = column_of(factors[f]);
        if (!standardize(column)) continue;
        varied.push_back(f);
        x.conservativeResize(Eigen::NoChange, x.cols() + 1);
        x.rightCols(1) = column;
    }
    if (!standardize(y) || varied.empty()) return result;

    const Eigen::ColPivHouseholderQR<Eigen::MatrixXd> qr(x);
    const Eigen::VectorXd coefficients = qr.solve(y);
    const double residual = (y - x * coefficients).squaredNorm();
    result.r_squared = 1 - residual / y.squaredNorm();
    const double noise = residual / static_cast<double>(count - x.cols() - 1);
    const Eigen::MatrixXd inverse = (x.transpose() * x).ldlt().solve(Eigen::MatrixXd::Identity(x.cols(), x.cols()));
    for (std::size_t k = 0; k < varied.size(); ++k) {
        const auto at = static_cast<Eigen::Index>(k);
        result.coefficients[varied[k]] = coefficients[at];
        result.standard_errors[varied[k]] = std::sqrt(noise * inverse(at, at));
    }
    return result;
}

std::vector<TornadoBar> tornado(const FactorColumns& factors, std::span<const double> values, double share) {
    auto rows = whole_rows(factors, values);
    const auto end = static_cast<std::size_t>(share * static_cast<double>(rows.size()));
    if (end < 2) throw InputError(fmt::format("{} rows are complete, too few for the ends of a tornado", rows.size()));
    std::vector<TornadoBar> bars;
    for (std::size_t f = 0; f < factors.size(); ++f) {
        std::stable_sort(rows.begin(), rows.end(),
                         [&](std::size_t a, std::size_t b) { return factors[f][a] < factors[f][b]; });
        const auto summary_of = [&](std::size_t from) {
            std::vector<double> part;
            for (std::size_t i = from; i < from + end; ++i) part.push_back(values[rows[i]]);
            return summarize(part, {});
        };
        const Summary low = summary_of(0), high = summary_of(rows.size() - end);
        bars.push_back({f, low.mean, high.mean, low.standard_error, high.standard_error});
    }
    std::stable_sort(bars.begin(), bars.end(), [](const TornadoBar& a, const TornadoBar& b) {
        return std::abs(a.high - a.low) > std::abs(b.high - b.low);
    });
    return bars;
}

} // namespace tribode
