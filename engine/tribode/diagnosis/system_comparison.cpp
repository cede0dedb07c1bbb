#include "tribode/diagnosis/system_comparison.hpp"
#include "tribode/diagnosis/prediction_statistics.hpp"
#include "tribode/diagnosis/system_record.hpp"

#include <algorithm>
#include <cmath>
#include <fmt/format.h>

namespace tribode {

namespace {

// Of a validation record, the part that its start values are fitted to.
constexpr double start_share = 0.1;
constexpr std::size_t start_samples = 20; // at least
constexpr int iterations_of_starts = 40;
constexpr double far_off = 3; // times the noise, for start values to be sought elsewhere

} // namespace

std::vector<double> SystemComparison::errors(const std::vector<std::vector<double>>& simulated,
                                             const std::vector<double>& scale) const {
    std::vector<double> all;
    for (std::size_t o = 0; o < record.outputs.size(); ++o) {
        for (std::size_t k = first; k < record.size(); ++k) {
            all.push_back((record.outputs[o][k] - simulated[o][k]) / scale[o]);
        }
    }
    return all;
}

SystemComparison compared(const ModelWithValues& before, const ModelWithValues& after, const SystemRecord& record,
                          std::size_t first, const std::vector<double>& scale, Interpolation between) {
    SystemComparison c{.record = record, .first = first};
    const std::vector<SystemRecord> records = {record};
    const SystemFit fit(records, scale, between, {record.size()});
    const std::size_t outputs = record.outputs.size();
    // The gap of one output is in its own unit.
    const std::vector<double> unit = outputs > 1 ? scale : std::vector<double>{1};
    const std::vector<std::vector<double>> none(outputs, std::vector<double>(record.size(), NAN));
    const auto run = [&](const ModelWithValues& one, std::vector<std::vector<double>>& simulated) {
        auto trace = fit.simulate(one.model, one.values, 0, record.size());
        if (!trace) {
            simulated = none;
            return static_cast<double>(INFINITY);
        }
        simulated = std::move(trace->outputs);
        return rms_of_errors(c.errors(simulated, unit));
    };
    c.gap.before = run(before, c.before);
    c.gap.after = run(after, c.after);
    // The noise of a signal that moves from sample to sample is seen in what a model leaves of it.
    double floor = 0;
    for (std::size_t o = 0; o < outputs; ++o) {
        const std::vector<double> part(record.outputs[o].begin() + static_cast<std::ptrdiff_t>(first),
                                       record.outputs[o].end());
        double noise = white_noise(part), rounding = rounding_noise(part);
        for (const auto* simulated : {&c.before, &c.after}) {
            if (std::isnan((*simulated)[o][first])) continue; // the model cannot be simulated
            std::vector<double> left = part;
            for (std::size_t k = 0; k < left.size(); ++k) left[k] -= (*simulated)[o][first + k];
            noise = std::min(noise, white_noise(left));
            rounding = std::min(rounding, rounding_noise(part, left));
        }
        noise = std::max({noise, rounding, solvers_errors * scale[o]});
        floor += noise * noise / (unit[o] * unit[o]);
    }
    c.gap.floor = std::sqrt(floor / static_cast<double>(outputs));
    return c;
}

namespace {

// To how many samples of a validation record its start values are fitted.
std::size_t samples_of_start(const SystemRecord& record) {
    const auto share = static_cast<std::size_t>(start_share * static_cast<double>(record.size()));
    return std::min(record.size(), std::max(share, start_samples));
}

} // namespace

std::vector<double> with_starts(const SystemModel& model, const std::vector<double>& values, const SystemRecord& record,
                                const std::vector<double>& scale, Interpolation between,
                                const std::function<bool()>& ended) {
    std::vector<double> all(values.begin(), values.begin() + static_cast<std::ptrdiff_t>(model.parameters.size()));
    if (model.starts.empty()) return all;
    SystemModel starts = model;
    for (std::size_t i = 0; i < model.parameters.size(); ++i) {
        starts.equations.parameters[model.parameters[i].place].value = values[i];
    }
    starts.parameters.clear();
    const std::vector<SystemRecord> records = {record};
    const SystemFit fit(records, scale, between, {samples_of_start(record)});
    auto result = fit.fit_growing(starts, starts.values(1), iterations_of_starts, ended);
    // A sensor may not tell the direction: then the opposite values are another minimum, with another way on from there.
    if (rms_of_errors(result.errors) > far_off * fit.noise()) {
        std::vector<double> opposite = result.values;
        for (double& value : opposite) value = -value;
        auto other = fit.fit(starts, std::move(opposite), iterations_of_starts, ended);
        if (other.sum < result.sum) result = std::move(other);
    }
    all.insert(all.end(), result.values.begin(), result.values.end());
    return all;
}

double prediction_uncertainty(const SystemModel& model, const std::vector<double>& values, const SystemRecord& record,
                              std::size_t first, const std::vector<double>& scale, Interpolation between,
                              const Eigen::MatrixXd& covariance, double noise) {
    const std::vector<SystemRecord> records = {record};
    const SystemFit fit(records, scale, between, {record.size()});
    const auto errors = fit.errors(model, values);
    if (errors.empty()) return 0;
    const Eigen::MatrixXd all = fit.jacobian(model, values, errors);
    const auto parameters = static_cast<Eigen::Index>(model.parameters.size()), starts = all.cols() - parameters;
    Eigen::MatrixXd of_parameters = all.leftCols(parameters);
    Eigen::MatrixXd by_noise = Eigen::MatrixXd::Zero(all.rows(), starts);
    // Start values of a record that was fitted from its beginning have their part of the covariance.
    const bool is_fitted = covariance.cols() == all.cols();
    if (is_fitted) {
        of_parameters = all;
    } else if (starts > 0) {
        // Start values follow the parameters, to fit the beginning of the record.
        const auto rows = static_cast<Eigen::Index>(record.size());
        const auto fitted = static_cast<Eigen::Index>(samples_of_start(record));
        Eigen::MatrixXd beginning(fitted * static_cast<Eigen::Index>(record.outputs.size()), all.cols());
        for (Eigen::Index o = 0; o < static_cast<Eigen::Index>(record.outputs.size()); ++o) {
            beginning.middleRows(o * fitted, fitted) = all.middleRows(o * rows, fitted);
        }
        const Eigen::MatrixXd own = beginning.rightCols(starts);
        const Eigen::MatrixXd inverse = inverse_of_normal(own);
        by_noise = all.rightCols(starts) * inverse * own.transpose();
        of_parameters -= by_noise * beginning.leftCols(parameters);
    }
    const Eigen::VectorXd variance = (of_parameters * covariance).cwiseProduct(of_parameters).rowwise().sum() +
                                     noise * noise * by_noise.rowwise().squaredNorm();
    double sum = 0, count = 0;
    for (std::size_t o = 0; o < record.outputs.size(); ++o) {
        const double unit = record.outputs.size() > 1 ? 1 : scale[o];
        for (std::size_t k = first; k < record.size(); ++k, ++count) {
            sum += unit * unit * variance[static_cast<Eigen::Index>(o * record.size() + k)];
        }
    }
    return std::sqrt(std::max(sum, 0.0) / std::max(count, 1.0));
}

std::string where_the_gap_is(const SystemComparison& comparison, const SystemModel& model) {
    const auto& record = comparison.record;
    const std::size_t n = record.size();
    const auto& output = model.equations.outputs[model.measured[0]];
    if (!std::isfinite(comparison.gap.before)) {
        return fmt::format("Without anything added the model cannot be simulated on {}.", record.source);
    }
    const bool several = model.measured.size() > 1;
    std::string text = fmt::format("Without anything added the simulated {} from {} by {:.3g}{} rms.",
                                   several ? "outputs differ" : measured_name(model, 0) + " differs", record.source,
                                   comparison.gap.before,
                                   several               ? " standard deviations of the fitted records"
                                   : output.unit.empty() ? ""
                                                         : " " + output.unit);
    std::vector<double> square(n, 0);
    double total = 0;
    for (std::size_t k = comparison.first; k < n; ++k) {
        const double e = record.outputs[0][k] - comparison.before[0][k];
        square[k] = e * e;
        total += square[k];
    }
    if (!(total > 0) || !std::isfinite(total)) return text;
    // The fifth of a variable's range that holds most for its time.
    constexpr std::size_t parts = 5;
    constexpr double min_time = 0.02, worth_saying = 1.5;
    struct Most {
        double excess = 0;
        std::string name;
        double low = 0, high = 0;
    } most;
    const auto look = [&](const std::string& name, const std::vector<double>& values) {
        const auto [least, greatest] = std::minmax_element(values.begin(), values.end());
        const double low = *least, width = (*greatest - *least) / parts;
        if (!(width > 0)) return;
        double sums[parts] = {}, counts[parts] = {};
        for (std::size_t k = comparison.first; k < n; ++k) {
            const auto part = std::min(parts - 1, static_cast<std::size_t>((values[k] - low) / width));
            sums[part] += square[k];
            counts[part] += 1;
        }
        for (std::size_t b = 0; b < parts; ++b) {
            if (counts[b] < min_time * static_cast<double>(n)) continue;
            const double excess = sums[b] / total / (counts[b] / static_cast<double>(n - comparison.first));
            if (excess <= most.excess) continue;
            most = {excess, name, low + static_cast<double>(b) * width, low + static_cast<double>(b + 1) * width};
        }
    };
    look(measured_name(model, 0), record.outputs[0]);
    for (std::size_t i = 0; i < record.inputs.size(); ++i) {
        if (!record.inputs[i].empty()) look(model.equations.inputs[i].name, record.inputs[i]);
    }
    look("t", record.t);
    if (most.excess > worth_saying) {
        text += fmt::format(" The squared error is {:.1f} times its mean where {} is between {:.4g} and {:.4g}.",
                            most.excess, most.name, most.low, most.high);
    }
    return text;
}

} // namespace tribode
