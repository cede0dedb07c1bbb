#include "tribode/diagnosis/lane_fit.hpp"
#include "tribode/diagnosis/prediction_statistics.hpp"

#include <algorithm>
#include <cmath>

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

// Every n-th sample; an input that holds its value between samples has its mean over those that are left out.
SystemRecord thinned(const SystemRecord& record, std::size_t used, std::size_t n, Interpolation between) {
    SystemRecord made{.source = record.source, .inputs = {}, .outputs = {}};
    const auto each = [&](const std::vector<double>& values, bool mean) {
        std::vector<double> some;
        for (std::size_t k = 0; k < std::min(used, values.size()); k += n) {
            double sum = 0;
            const std::size_t end = mean ? std::min(k + n, used) : k + 1;
            for (std::size_t i = k; i < end; ++i) sum += values[i];
            some.push_back(sum / static_cast<double>(end - k));
        }
        return some;
    };
    made.t = each(record.t, false);
    for (const auto& values : record.inputs) made.inputs.push_back(each(values, between == Interpolation::hold));
    for (const auto& values : record.outputs) made.outputs.push_back(each(values, false));
    return made;
}

} // namespace

LaneFit::LaneFit(const SystemFit& fit, const SystemModel& model, FixedSteps steps)
    : fit_(fit),
      model_(model),
      steps_(std::move(steps)),
      noise_(fit.noise()) {
    lay_out();
}

void LaneFit::lay_out() {
    courses_.clear();
    for (std::size_t r = 0; r < fit_.records().size(); ++r) {
        courses_.push_back(
            steps_.course(record(r), thinned_.empty() ? fit_.used()[r] : thinned_[r].size(), fit_.interpolation()));
    }
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

std::vector<std::vector<double>> LaneFit::errors_of_record(std::size_t r, const std::vector<std::vector<double>>& sets,
                                                           std::size_t substeps) const {
    const auto& measured = record(r).outputs;
    const std::size_t samples = courses_[r].samples, outputs = steps_.measured();
    std::vector<std::vector<double>> all;
    for (std::size_t first = 0; first < sets.size(); first += FixedSteps::most_lanes) {
        const std::size_t count = std::min(FixedSteps::most_lanes, sets.size() - first);
        const auto simulated = steps_.outputs(courses_[r], std::span(sets).subspan(first, count), substeps);
        for (std::size_t l = 0; l < count; ++l) {
            auto& errors = all.emplace_back();
            errors.reserve(outputs * samples);
            const double* y = &simulated[l * outputs * samples];
            for (std::size_t o = 0; o < outputs; ++o) {
                for (std::size_t k = 0; k < samples; ++k, ++y) {
                    if (!std::isnan(measured[o][k])) errors.push_back((measured[o][k] - *y) / fit_.scale()[o]);
                }
            }
            if (!all_finite(errors)) errors.clear();
        }
    }
    return all;
}

std::vector<std::vector<double>> LaneFit::errors(const std::vector<std::vector<double>>& sets) const {
    std::vector<std::vector<double>> all(sets.size());
    std::vector<bool> runs(sets.size(), true);
    for (std::size_t r = 0; r < courses_.size(); ++r) {
        if (courses_[r].samples == 0) continue;
        std::vector<std::vector<double>> own;
        for (const auto& values : sets) own.push_back(model_.values_of(values, r));
        const auto errors = errors_of_record(r, own, substeps_);
        for (std::size_t l = 0; l < sets.size(); ++l) {
            runs[l] = runs[l] && !errors[l].empty();
            all[l].insert(all[l].end(), errors[l].begin(), errors[l].end());
        }
    }
    for (std::size_t l = 0; l < sets.size(); ++l) {
        if (!runs[l]) all[l].clear();
    }
    return all;
}

std::vector<double> LaneFit::errors_with(const std::vector<double>& values, std::size_t substeps) const {
    std::vector<double> all;
    for (std::size_t r = 0; r < courses_.size(); ++r) {
        if (courses_[r].samples == 0) continue;
        const auto errors = errors_of_record(r, {model_.values_of(values, r)}, substeps)[0];
        if (errors.empty()) return {};
        all.insert(all.end(), errors.begin(), errors.end());
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

bool LaneFit::are_short_enough(const std::vector<double>& values, const std::vector<double>& errors) const {
    const auto fine = errors_with(values, 2 * substeps_);
    return !fine.empty() && rms_of_difference(errors, fine) < negligible(fine);
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

bool LaneFit::thin_out(const std::vector<double>& values) {
    if (steps_.is_static()) return false;
    const auto fine = errors_with(values, substeps_);
    const std::size_t substeps = substeps_;
    if (fine.empty()) return false;
    for (std::size_t n = most_thinned; n > 1; n /= 2) {
        std::vector<SystemRecord> some;
        std::vector<double> common; // of the errors of all samples
        std::size_t row = 0;
        bool is_enough = true;
        for (std::size_t r = 0; r < fit_.records().size(); ++r) {
            const std::size_t used = fit_.used()[r];
            is_enough = is_enough && (used == 0 || used / n >= least_samples);
            some.push_back(thinned(fit_.records()[r], used, n, fit_.interpolation()));
            for (const auto& measured : fit_.records()[r].outputs) {
                for (std::size_t k = 0; k < used; ++k) {
                    if (std::isnan(measured[k])) continue;
                    if (k % n == 0) common.push_back(fine[row]);
                    ++row;
                }
            }
        }
        if (!is_enough) continue;
        thinned_ = std::move(some);
        lay_out();
        for (substeps_ = 1; substeps_ < n * substeps; substeps_ *= 2) {
            const auto errors = errors_with(values, substeps_);
            if (!errors.empty() && rms_of_difference(errors, common) < negligible(errors)) return true;
        }
    }
    thinned_.clear();
    substeps_ = substeps;
    lay_out();
    return false;
}

Eigen::MatrixXd LaneFit::jacobian(const std::vector<double>& values, const std::vector<double>& errors) const {
    Eigen::MatrixXd matrix =
        Eigen::MatrixXd::Zero(static_cast<Eigen::Index>(errors.size()), static_cast<Eigen::Index>(values.size()));
    const std::size_t parameters = model_.parameters.size(), starts = model_.starts.size();
    Eigen::Index row = 0;
    for (std::size_t r = 0; r < courses_.size(); ++r) {
        if (courses_[r].samples == 0) continue;
        const auto here = model_.values_of(values, r);
        std::vector<double> moves(parameters + starts);
        std::vector<std::vector<double>> sets(parameters + starts, here);
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
            sets[i][i] += move;
            moves[i] = sets[i][i] - here[i];
        }
        auto moved = errors_of_record(r, sets, substeps_);
        const auto rows = static_cast<Eigen::Index>(record(r).measured(courses_[r].samples));
        for (std::size_t i = 0; i < parameters + starts; ++i) {
            if (moved[i].empty() || moves[i] == 0) continue;
            const std::size_t place = i < parameters ? i : i + r * starts; // of all values
            for (Eigen::Index k = 0; k < rows; ++k) {
                matrix(row + k, static_cast<Eigen::Index>(place)) =
                    (errors[static_cast<std::size_t>(row + k)] - moved[i][static_cast<std::size_t>(k)]) / moves[i];
            }
        }
        row += rows;
    }
    return matrix;
}

} // namespace tribode
