#include "tribode/diagnosis/lane_fit.hpp"
#include "tribode/diagnosis/prediction_statistics.hpp"

#include <algorithm>
#include <cmath>
#include <functional>

namespace tribode {

namespace {

constexpr std::size_t most_substeps = 32; // of a sample; where more are needed the equations are stiff
// What steps may leave: of the noise, of the errors, and of the outputs' deviation, which is what other solvers leave.
constexpr double of_noise = 0.02, of_errors = 1e-3, of_outputs = 1e-7;
constexpr double of_errors_in_search = 0.01;
constexpr std::size_t most_thinned = 32, least_samples = 500; // of a record, where every n-th sample counts
constexpr double difference_step = 1e-6;                      // of a value or its scale

double rms_of_difference(const std::vector<double>& a, const std::vector<double>& b) {
    double sum = 0;
    for (std::size_t k = 0; k < a.size(); ++k) sum += (a[k] - b[k]) * (a[k] - b[k]);
    return std::sqrt(sum / static_cast<double>(std::max<std::size_t>(a.size(), 1)));
}

bool all_finite(const std::vector<double>& values) {
    return std::all_of(values.begin(), values.end(), [](double value) { return std::isfinite(value); });
}

} // namespace

LaneFit::LaneFit(const SystemFit& fit, const SystemModel& model, FixedSteps steps)
    : fit_(fit),
      model_(model),
      steps_(std::move(steps)),
      noise_(fit.noise()) {
    lay_out(1);
}

void LaneFit::lay_out(std::size_t every) {
    every_ = every;
    courses_.clear();
    order_.clear();
    first_row_.assign(1, 0);
    for (std::size_t r = 0; r < fit_.records().size(); ++r) {
        courses_.push_back(steps_.course(fit_.records()[r], fit_.used()[r], fit_.interpolation(), every));
        if (courses_[r].samples > 0) order_.push_back(r);
        std::size_t row = first_row_.back();
        for (const auto& measured : fit_.records()[r].outputs) {
            for (std::size_t k = 0; k < courses_[r].samples; ++k) row += std::isnan(measured[k * every]) ? 0 : 1;
        }
        first_row_.push_back(row);
    }
    std::ranges::stable_sort(order_, std::greater(), [&](std::size_t r) { return courses_[r].intervals.size(); });
    std::vector<std::size_t> leaders; // of the groups
    for (const std::size_t r : order_) {
        const auto leader =
            std::ranges::find_if(leaders, [&](std::size_t longer) { return courses_[longer].begins_as(courses_[r]); });
        courses_[r].group = static_cast<std::size_t>(leader - leaders.begin());
        if (leader == leaders.end()) leaders.push_back(r);
    }
    std::ranges::stable_sort(order_, {}, [&](std::size_t r) { return courses_[r].group; });
}

std::optional<LaneFit> LaneFit::of(const SystemFit& fit, const SystemModel& model, const std::vector<double>& values,
                                   std::size_t substeps) {
    if (!all_finite(values)) return std::nullopt;
    auto steps = FixedSteps::of(model.with(values));
    if (!steps) return std::nullopt;
    LaneFit made(fit, model, *std::move(steps));
    if (made.steps_.is_static()) {
        if (made.errors_with(values, 1).empty()) return std::nullopt;
    } else if (substeps > 0) {
        made.substeps_ = substeps;
    } else if (!made.shorten(values)) {
        return std::nullopt;
    }
    return made;
}

std::vector<std::vector<double>> LaneFit::errors_of(const std::vector<OfRecord>& runs, std::size_t substeps) const {
    std::vector<FixedSteps::Simulation> simulations;
    for (const auto& run : runs) simulations.push_back({&courses_[run.record], &run.values});
    std::vector<std::vector<double>> all(runs.size());
    const auto simulated = steps_.outputs(simulations, substeps);
    for (std::size_t n = 0; n < runs.size(); ++n) {
        const auto& measured = fit_.records()[runs[n].record].outputs;
        const std::size_t outputs = steps_.measured(), samples = courses_[runs[n].record].samples;
        all[n].reserve(outputs * samples);
        const double* y = simulated[n].data();
        for (std::size_t o = 0; o < outputs; ++o) {
            for (std::size_t k = 0; k < samples; ++k, ++y) {
                const double here = measured[o][k * every_];
                if (!std::isnan(here)) all[n].push_back((here - *y) / fit_.scale()[o]);
            }
        }
        if (!all_finite(all[n])) all[n].clear();
    }
    return all;
}

std::vector<std::vector<double>> LaneFit::errors(const std::vector<std::vector<double>>& sets,
                                                 std::size_t substeps) const {
    std::vector<OfRecord> runs;
    for (const std::size_t r : order_) {
        for (const auto& values : sets) runs.push_back({r, model_.values_of(values, r)});
    }
    const auto errors = errors_of(runs, substeps);
    std::vector<std::size_t> place(courses_.size()); // of the first run of a record
    for (std::size_t n = 0; n < order_.size(); ++n) place[order_[n]] = n * sets.size();
    std::vector<std::vector<double>> all(sets.size());
    for (std::size_t l = 0; l < sets.size(); ++l) {
        for (std::size_t r = 0; r < courses_.size(); ++r) {
            if (courses_[r].samples == 0) continue;
            const auto& own = errors[place[r] + l];
            if (own.size() < first_row_[r + 1] - first_row_[r]) { // the run is not finite
                all[l].clear();
                break;
            }
            all[l].insert(all[l].end(), own.begin(), own.end());
        }
    }
    return all;
}

double LaneFit::negligible(const std::vector<double>& errors) const {
    const double share = fit_.is_search() ? of_errors_in_search : of_errors;
    return std::max({of_noise * noise_, share * rms_of_errors(errors), of_outputs});
}

bool LaneFit::halve(const std::vector<double>& values) {
    if (substeps_ >= most_substeps) return false;
    substeps_ *= 2;
    return substeps_ == most_substeps || shorten(values);
}

bool LaneFit::are_short_enough(const std::vector<double>& values, const std::vector<double>& errors,
                               double times) const {
    const auto fine = errors_with(values, 2 * substeps_);
    return !fine.empty() && rms_of_difference(errors, fine) < times * negligible(fine);
}

bool LaneFit::shorten(const std::vector<double>& values) {
    for (auto coarse = errors_with(values, substeps_); substeps_ < most_substeps;) {
        substeps_ *= 2;
        auto fine = errors_with(values, substeps_);
        if (!coarse.empty() && !fine.empty() && rms_of_difference(coarse, fine) < negligible(fine)) {
            // The longer steps do: of a method of fourth order, they are off by little more than they differ.
            substeps_ /= 2;
            return true;
        }
        coarse = std::move(fine);
    }
    return false;
}

void LaneFit::lengthen(const std::vector<double>& values) {
    if (steps_.is_static() || substeps_ == 1) return;
    for (auto fine = errors_with(values, substeps_); substeps_ > 1; substeps_ /= 2) {
        auto coarse = errors_with(values, substeps_ / 2);
        if (fine.empty() || coarse.empty() || !(rms_of_difference(coarse, fine) < negligible(fine))) return;
        fine = std::move(coarse);
    }
}

bool LaneFit::thin_out(const std::vector<double>& values) {
    if (steps_.is_static() || substeps_ > 1) return false;
    const auto fine = errors_with(values, 1);
    if (fine.empty()) return false;
    std::size_t kept = 1;
    for (std::size_t n = 2; n <= most_thinned; n *= 2) {
        std::vector<double> common; // of the errors of all samples
        std::size_t row = 0;
        bool is_enough = true;
        for (std::size_t r = 0; r < fit_.records().size(); ++r) {
            const std::size_t used = fit_.used()[r];
            is_enough = is_enough && (used == 0 || used / n >= least_samples);
            for (const auto& measured : fit_.records()[r].outputs) {
                for (std::size_t k = 0; k < used; ++k) {
                    if (std::isnan(measured[k])) continue;
                    if (k % n == 0) common.push_back(fine[row]);
                    ++row;
                }
            }
        }
        if (!is_enough) break;
        lay_out(n);
        const auto errors = errors_with(values, 1);
        if (errors.empty() || !(rms_of_difference(errors, common) < negligible(errors))) break;
        kept = n;
    }
    if (kept < every_) lay_out(kept);
    return kept > 1;
}

Eigen::MatrixXd LaneFit::jacobian(const std::vector<double>& values, const std::vector<double>& errors) const {
    Eigen::MatrixXd matrix =
        Eigen::MatrixXd::Zero(static_cast<Eigen::Index>(errors.size()), static_cast<Eigen::Index>(values.size()));
    const std::size_t parameters = model_.parameters.size(), starts = model_.starts.size();
    std::vector<OfRecord> runs; // of each value of a record
    std::vector<double> moves;
    for (const std::size_t r : order_) {
        const auto here = model_.values_of(values, r);
        for (std::size_t i = 0; i < parameters + starts; ++i) {
            double scale = std::abs(here[i]), move = 0;
            if (i < parameters) {
                scale = std::max(scale, model_.parameters[i].scale);
                move = difference_step * (scale > 0 ? scale : 1);
                if (here[i] + move > model_.parameters[i].high) move = -move;
            } else {
                const auto& state = model_.equations.states[model_.starts[i - parameters]];
                scale = std::max({scale, std::abs(state.start), 1e-3 * state.nominal});
                move = difference_step * (scale > 0 ? scale : 1);
            }
            runs.push_back({r, here});
            runs.back().values[i] += move;
            moves.push_back(runs.back().values[i] - here[i]);
        }
    }
    const auto moved = errors_of(runs, substeps_);
    for (std::size_t n = 0; n < runs.size(); ++n) {
        if (moves[n] == 0) continue;
        const std::size_t r = runs[n].record, i = n % (parameters + starts);
        const std::size_t place = i < parameters ? i : i + r * starts; // of all values
        for (std::size_t k = 0; k < moved[n].size(); ++k) {
            matrix(static_cast<Eigen::Index>(first_row_[r] + k), static_cast<Eigen::Index>(place)) =
                (errors[first_row_[r] + k] - moved[n][k]) / moves[n];
        }
    }
    return matrix;
}

} // namespace tribode
