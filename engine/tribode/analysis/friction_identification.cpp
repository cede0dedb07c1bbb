#include "tribode/analysis/friction_identification.hpp"
#include "tribode/analysis/nonnegative_least_squares.hpp"
#include "tribode/base/error.hpp"
#include "tribode/base/text.hpp"

#include <algorithm>
#include <cmath>
#include <fmt/format.h>

namespace tribode {

namespace {

constexpr double grid_per_decade = 24; // steps of 10 % in displacement: finer ones change the error by little
constexpr Eigen::Index block = 512;    // rows of regressors at a time

std::vector<double> geometric(double from, double to, std::size_t count) {
    std::vector<double> list(count, to);
    for (std::size_t i = 0; i + 1 < count; ++i) {
        list[i] = from * std::pow(to / from, static_cast<double>(i) / static_cast<double>(count - 1));
    }
    return list;
}

// Sums over the fitted samples, from which the sum of squares of any combination of the candidates follows.
struct Sums {
    Eigen::MatrixXd gram;   // sum z_i z_j
    Eigen::VectorXd moment; // sum z_i f
    double force = 0;       // sum f^2
};

Sums sums_of(std::span<const double> position, std::span<const double> force, const std::vector<double>& limits,
             std::size_t first) {
    const auto n = static_cast<Eigen::Index>(limits.size());
    Sums sums{Eigen::MatrixXd::Zero(n, n), Eigen::VectorXd::Zero(n), 0};
    const Eigen::Map<const Eigen::ArrayXd> limit(limits.data(), n);
    Eigen::ArrayXd z = Eigen::ArrayXd::Zero(n);
    Eigen::MatrixXd rows(n, block);
    Eigen::VectorXd forces(block);
    Eigen::Index filled = 0;
    const auto add_block = [&] {
        sums.gram.selfadjointView<Eigen::Lower>().rankUpdate(rows.leftCols(filled));
        sums.moment += rows.leftCols(filled) * forces.head(filled);
        filled = 0;
    };
    for (std::size_t k = 0; k < position.size(); ++k) {
        if (k > 0) z = (z + (position[k] - position[k - 1])).max(-limit).min(limit);
        if (k < first) continue;
        rows.col(filled) = z;
        forces[filled++] = force[k];
        sums.force += force[k] * force[k];
        if (filled == block) add_block();
    }
    add_block();
    sums.gram = Eigen::MatrixXd(sums.gram.selfadjointView<Eigen::Lower>());
    return sums;
}

using Chosen = std::vector<Eigen::Index>; // indices of candidates

Eigen::VectorXd stiffness_of(const Sums& sums, const Chosen& chosen) {
    return nonnegative_least_squares(sums.gram(chosen, chosen), sums.moment(chosen));
}

// The sum of squares that the best combination of the chosen leaves.
double cost_of(const Sums& sums, const Chosen& chosen) {
    const Eigen::VectorXd stiffness = stiffness_of(sums, chosen);
    const Eigen::MatrixXd gram = sums.gram(chosen, chosen);
    const Eigen::VectorXd moment = sums.moment(chosen);
    return sums.force - 2 * moment.dot(stiffness) + stiffness.dot(gram * stiffness);
}

// Moves each of the chosen in turn to where the cost is least, until a round moves none. The cost falls with each move
// and there are finitely many choices, so it ends.
void exchange(const Sums& sums, Chosen& chosen) {
    double cost = cost_of(sums, chosen);
    for (bool moved = true; moved;) {
        moved = false;
        for (std::size_t i = 0; i < chosen.size(); ++i) {
            const Eigen::Index before = chosen[i];
            Eigen::Index best = before;
            for (Eigen::Index candidate = 0; candidate < sums.moment.size(); ++candidate) {
                if (candidate != before && std::find(chosen.begin(), chosen.end(), candidate) != chosen.end()) continue;
                chosen[i] = candidate;
                const double found = cost_of(sums, chosen);
                if (found < cost * (1 - 1e-6)) { // less is rounding, or not worth another round
                    cost = found;
                    best = candidate;
                }
            }
            chosen[i] = best;
            moved = moved || best != before;
        }
    }
    std::sort(chosen.begin(), chosen.end());
}

void check(std::span<const double> position, std::span<const double> force, const FrictionFitOptions& options,
           const std::string& where) {
    if (position.size() != force.size()) {
        throw InputError(fmt::format("{}: {} positions and {} forces, must be as many of each", where, position.size(),
                                     force.size()));
    }
    if (options.first_fitted >= position.size()) {
        throw InputError(fmt::format("{}: first_fitted = {}, must be one of the {} samples", where,
                                     options.first_fitted + 1, position.size()));
    }
    const auto finite = [](double value) { return std::isfinite(value); };
    if (!std::all_of(position.begin(), position.end(), finite) || !std::all_of(force.begin(), force.end(), finite)) {
        throw InputError(where + ": a position or force is not finite, all must be");
    }
}

double range_of(std::span<const double> values) {
    const auto [least, greatest] = std::minmax_element(values.begin(), values.end());
    return *greatest - *least;
}

} // namespace

std::vector<double> rolling_force(std::span<const MaxwellSlipElement> elements, std::span<const double> position) {
    std::vector<double> force(position.size(), 0.0), z(elements.size(), 0.0);
    for (std::size_t k = 1; k < position.size(); ++k) {
        for (std::size_t i = 0; i < elements.size(); ++i) {
            const double limit = elements[i].limit();
            z[i] = std::clamp(z[i] + position[k] - position[k - 1], -limit, limit);
            force[k] += elements[i].stiffness * z[i];
        }
    }
    return force;
}

FrictionFit fit_friction(std::span<const double> position, std::span<const double> force,
                         const FrictionFitOptions& options, const std::string& where) {
    check(position, force, options, where);
    const double longest = options.longest > 0 ? options.longest : range_of(position.subspan(options.first_fitted));
    if (!(longest > options.shortest)) {
        throw InputError(fmt::format("{}: the greatest displacement from a reversal is {} m, must be above the least "
                                     "break point, {} m",
                                     where, to_text(longest), to_text(options.shortest)));
    }
    // Break points, as limits X = half the displacement from a reversal.
    const auto count = static_cast<std::size_t>(options.elements);
    const double decades = std::log10(longest / options.shortest);
    const bool optimized = options.break_points == FrictionFitOptions::BreakPoints::optimized;
    const std::size_t candidates =
        optimized ? std::max(4 * count, static_cast<std::size_t>(grid_per_decade * decades) + 1) : count;
    const std::vector<double> limits = geometric(options.shortest / 2, longest / 2, candidates);
    const Sums sums = sums_of(position, force, limits, options.first_fitted);
    Chosen chosen;
    for (std::size_t i = 0; i < count; ++i) {
        chosen.push_back(static_cast<Eigen::Index>((2 * i + 1) * candidates / (2 * count)));
    }
    if (optimized) exchange(sums, chosen);

    FrictionFit fit;
    const Eigen::VectorXd stiffness = stiffness_of(sums, chosen);
    for (std::size_t i = 0; i < count; ++i) {
        const double k = stiffness[static_cast<Eigen::Index>(i)];
        if (k > 0) fit.elements.push_back({k, k * limits[static_cast<std::size_t>(chosen[i])], 0});
    }
    const std::vector<double> model = rolling_force(fit.elements, position);
    double squares = 0;
    for (std::size_t k = options.first_fitted; k < force.size(); ++k) {
        const double residual = force[k] - model[k];
        squares += residual * residual;
        fit.residual_max = std::max(fit.residual_max, std::abs(residual));
    }
    fit.residual_rms = std::sqrt(squares / static_cast<double>(force.size() - options.first_fitted));
    return fit;
}

} // namespace tribode
