#include "tribode/analysis/weighted_modal_fit.hpp"
#include "tribode/base/error.hpp"

#include <Eigen/Dense>

#include <algorithm>
#include <cmath>
#include <fmt/format.h>
#include <limits>
#include <numbers>

namespace tribode {

namespace {

using std::numbers::pi;
using Complex = std::complex<double>;

constexpr double loss_scale = 4; // standard deviations

struct Datum {
    double omega;
    Complex value;
    double variance; // of one component of ln H
    double luck = 1; // power of the value over that of the model
};

// Unknowns: logarithms of k0, then of k, w, zeta of each mode; the delay last, where it is free.
class Problem {
  public:
    Problem(std::vector<Datum> data, std::size_t modes, bool free_delay)
        : data_(std::move(data)),
          modes_(modes),
          free_delay_(free_delay) {}

    Eigen::Index unknowns() const { return static_cast<Eigen::Index>(1 + 3 * modes_ + (free_delay_ ? 1 : 0)); }
    std::size_t size() const { return data_.size(); }
    double misfit = 0;

    // Residuals in standard deviations, and their derivatives.
    void evaluate(const Eigen::VectorXd& at, Eigen::VectorXd& residual, Eigen::MatrixXd* jacobian) const {
        const auto rows = static_cast<Eigen::Index>(2 * data_.size());
        residual.resize(rows);
        if (jacobian) jacobian->resize(rows, unknowns());
        for (Eigen::Index i = 0; i < rows / 2; ++i) {
            const Datum& d = data_[static_cast<std::size_t>(i)];
            const double square = d.omega * d.omega;
            Complex sum = -std::exp(at[0]) / square;
            std::vector<Complex> slopes = {sum};
            for (std::size_t j = 0; j < modes_; ++j) {
                const auto base = static_cast<Eigen::Index>(1 + 3 * j);
                const double own = std::exp(at[base + 1]), damp = 2 * std::exp(at[base + 2]) * own;
                const Complex once = 1.0 / Complex(own * own - square, damp * d.omega);
                const Complex part = std::exp(at[base]) * once, damping(0, damp * d.omega);
                sum += part;
                slopes.insert(slopes.end(), {part, -part * once * (2 * own * own + damping), -part * once * damping});
            }
            const double delay = free_delay_ ? at[unknowns() - 1] : 0;
            const Complex model = sum * std::polar(1.0, -d.omega * delay);
            const double scale = 1 / std::sqrt(d.variance * d.luck + misfit * misfit);
            const Complex ratio = d.value / model;
            residual[2 * i] = scale * std::log(std::abs(ratio));
            residual[2 * i + 1] = scale * std::arg(ratio);
            if (!jacobian) continue;
            for (std::size_t j = 0; j < slopes.size(); ++j) {
                const Complex slope = -slopes[j] / sum * scale;
                (*jacobian)(2 * i, static_cast<Eigen::Index>(j)) = slope.real();
                (*jacobian)(2 * i + 1, static_cast<Eigen::Index>(j)) = slope.imag();
            }
            if (free_delay_) {
                (*jacobian)(2 * i, unknowns() - 1) = 0;
                (*jacobian)(2 * i + 1, unknowns() - 1) = scale * d.omega;
            }
        }
    }

    // The variance of a value is relative to it, so one that noise made larger would weigh more, and draw all gains up. From now on
    // it is relative to the model.
    void weigh_by_model(const Eigen::VectorXd& at) {
        Eigen::VectorXd residual;
        evaluate(at, residual, nullptr);
        for (std::size_t i = 0; i < data_.size(); ++i) {
            Datum& d = data_[i];
            const double logarithm = residual[static_cast<Eigen::Index>(2 * i)];
            d.luck = std::exp(2 * logarithm * std::sqrt(d.variance * d.luck + misfit * misfit));
        }
    }

    static double cost(const Eigen::VectorXd& residual) {
        double sum = 0;
        for (Eigen::Index i = 0; i < residual.size(); i += 2) {
            sum += std::log1p(residual.segment<2>(i).squaredNorm() / (loss_scale * loss_scale));
        }
        return sum;
    }

    // Unknowns may go this far from where they start, so that no mode takes over what friction does at low frequencies.
    void bound_around(const Eigen::VectorXd& start) {
        low_ = high_ = start;
        for (Eigen::Index j = 0; j < unknowns(); ++j) {
            const bool is_delay = free_delay_ && j == unknowns() - 1;
            const double reach = is_delay               ? 2e-3
                                 : j == 0 || j % 3 == 1 ? std::log(4.0)
                                 : j % 3 == 2           ? 0.2
                                                        : std::log(20.0);
            low_[j] -= reach;
            high_[j] += reach;
        }
    }
    bool at_bound(const Eigen::VectorXd& at) const {
        return ((at - low_).array() <= 0).any() || ((high_ - at).array() <= 0).any();
    }

    // Levenberg-Marquardt on the weighted least squares of the loss.
    void minimize(Eigen::VectorXd& at) const {
        double damping = 1e-3;
        Eigen::VectorXd residual;
        Eigen::MatrixXd jacobian;
        evaluate(at, residual, &jacobian);
        double now = cost(residual);
        for (int iteration = 0; iteration < 200; ++iteration) {
            for (Eigen::Index i = 0; i < residual.size(); i += 2) {
                const double weight =
                    1 / std::sqrt(1 + residual.segment<2>(i).squaredNorm() / (loss_scale * loss_scale));
                residual.segment<2>(i) *= weight;
                jacobian.middleRows<2>(i) *= weight;
            }
            Eigen::MatrixXd gram = jacobian.transpose() * jacobian;
            const Eigen::VectorXd right = -jacobian.transpose() * residual;
            bool better = false;
            double step_size = 0;
            while (damping < 1e12 && !better) {
                Eigen::MatrixXd damped = gram;
                damped.diagonal() += damping * (gram.diagonal().array() + 1e-30).matrix();
                const Eigen::VectorXd step = damped.ldlt().solve(right);
                const Eigen::VectorXd tried = (at + step).cwiseMax(low_).cwiseMin(high_);
                Eigen::VectorXd there;
                evaluate(tried, there, nullptr);
                const double cost_there = cost(there);
                if (step.allFinite() && cost_there <= now) {
                    better = true;
                    step_size = (step.array() * gram.diagonal().array().sqrt()).matrix().norm();
                    at = tried;
                    now = cost_there;
                    damping = std::max(damping / 5, 1e-12);
                } else {
                    damping *= 4;
                }
            }
            if (!better || step_size < 1e-9 * std::sqrt(static_cast<double>(size()))) return;
            evaluate(at, residual, &jacobian);
        }
    }

    // Mean square of the residuals in units of their variances, without the pull of those far off: about one where the
    // variances are true.
    double excess(const Eigen::VectorXd& residual) const {
        double square = 0, slope = 0;
        for (Eigen::Index i = 0; i < residual.size(); i += 2) {
            const double ratio = residual.segment<2>(i).squaredNorm() / (loss_scale * loss_scale);
            const double weight = 1 / (1 + ratio);
            square += weight * weight * ratio * loss_scale * loss_scale;
            slope += weight - weight * weight * ratio;
        }
        slope /= static_cast<double>(size());
        if (!(slope > 0.05)) return std::numeric_limits<double>::infinity();
        const auto freedom = static_cast<double>(residual.size() - unknowns());
        return square / freedom / (slope * slope);
    }

  private:
    std::vector<Datum> data_;
    std::size_t modes_;
    bool free_delay_;
    Eigen::VectorXd low_, high_;
};

double upper_median(std::vector<double> values) {
    const auto middle = values.begin() + static_cast<std::ptrdiff_t>(values.size() / 2);
    std::nth_element(values.begin(), middle, values.end());
    return *middle;
}

void put_covariance(WeightedFit& fit, const Problem& problem, const Eigen::VectorXd& at, bool free_delay,
                    bool at_bound) {
    Eigen::VectorXd residual;
    Eigen::MatrixXd jacobian;
    problem.evaluate(at, residual, &jacobian);
    const Eigen::Index unknowns = problem.unknowns();
    Eigen::VectorXd scale = jacobian.colwise().norm();
    Eigen::ColPivHouseholderQR<Eigen::MatrixXd> factor;
    factor.setThreshold(1e-8);
    for (Eigen::Index j = 0; j < unknowns; ++j) {
        if (scale[j] == 0) scale[j] = 1;
    }
    factor.compute(jacobian * scale.cwiseInverse().asDiagonal());
    std::vector<double> values = {fit.model.rigid_gain};
    fit.parameters = {"k0"};
    for (std::size_t j = 0; j < fit.model.modes.size(); ++j) {
        const auto& mode = fit.model.modes[j];
        values.insert(values.end(), {mode.gain, mode.freq_hz, mode.zeta});
        for (const char* format : {"k{}", "f{}_hz", "zeta{}"}) {
            fit.parameters.push_back(fmt::format(fmt::runtime(format), j + 1));
        }
    }
    if (free_delay) {
        fit.parameters.push_back("delay_s");
        values.push_back(1); // not fitted as a logarithm
    }
    std::vector<double> errors(values.size(), std::numeric_limits<double>::infinity());
    if (factor.rank() == unknowns && !at_bound) {
        const Eigen::MatrixXd triangle = factor.matrixQR().topRows(unknowns).triangularView<Eigen::Upper>();
        const Eigen::MatrixXd inverse = triangle.inverse();
        Eigen::MatrixXd covariance =
            factor.colsPermutation() * (inverse * inverse.transpose()) * factor.colsPermutation().transpose();
        // Variances that are too large for most points may yet be true for those that decide.
        covariance *= std::max(1.0, problem.excess(residual));
        for (Eigen::Index j = 0; j < unknowns; ++j) {
            std::vector<double> row;
            for (Eigen::Index k = 0; k < unknowns; ++k) {
                row.push_back(covariance(j, k) / scale[j] / scale[k] * values[static_cast<std::size_t>(j)] *
                              values[static_cast<std::size_t>(k)]);
            }
            errors[static_cast<std::size_t>(j)] = std::sqrt(row[static_cast<std::size_t>(j)]);
            fit.covariance.push_back(std::move(row));
        }
    } else {
        fit.message = "the data do not determine all parameters; try fewer modes";
    }
    fit.standard_errors.rigid_gain = errors[0];
    for (std::size_t j = 0; j < fit.model.modes.size(); ++j) {
        fit.standard_errors.modes.push_back({errors[3 * j + 1], errors[3 * j + 2], errors[3 * j + 3]});
    }
    if (free_delay) fit.delay_error = errors.back();
}

} // namespace

WeightedFit fit_weighted(const std::vector<MeasuredPoint>& points, const WeightedFitOptions& options) {
    FrequencyResponse response;
    std::vector<double> variances, known;
    std::size_t rounded = 0;
    for (const auto& point : points) {
        if (!point.missing.empty()) continue;
        if (point.frequency_hz < options.f_min_hz || point.frequency_hz > options.f_max_hz) continue;
        response.frequency_hz.push_back(point.frequency_hz);
        response.value.push_back(point.value);
        if (point.is_rounded) ++rounded;
        variances.push_back(point.variance / 2);
        if (std::isfinite(variances.back())) known.push_back(variances.back());
    }
    const auto modes = static_cast<std::size_t>(options.modes);
    const std::size_t least = 1 + 3 * modes + (options.delay ? 1 : 0);
    if (response.size() < least + 1) {
        throw InputError(fmt::format("{} modes need {} frequencies at least, measured are {}", options.modes, least + 1,
                                     response.size()));
    }
    ModalFitOptions start;
    start.f_min_hz = 0.5 * response.frequency_hz.front();
    start.f_max_hz = 2 * response.frequency_hz.back();
    start.modes = options.modes;
    const ModalModel first = fit_modal_model(response.remove_delay(options.delay.value_or(0)), start).model;

    const double usual = known.empty() ? 0 : upper_median(known);
    std::vector<Datum> data;
    for (std::size_t i = 0; i < response.size(); ++i) {
        // Below rounding no variance is true.
        const double variance = std::max(std::isfinite(variances[i]) ? variances[i] : usual, 1e-24);
        data.push_back({2 * pi * response.frequency_hz[i], response.value[i], variance});
    }
    Problem problem(std::move(data), modes, options.delay.has_value());
    Eigen::VectorXd at(problem.unknowns());
    at[0] = std::log(first.rigid_gain);
    for (std::size_t j = 0; j < modes; ++j) {
        const auto& mode = first.modes[j];
        at.segment<3>(static_cast<Eigen::Index>(1 + 3 * j)) << std::log(mode.gain), std::log(2 * pi * mode.freq_hz),
            std::log(mode.zeta);
    }
    if (options.delay) at[problem.unknowns() - 1] = *options.delay;

    problem.bound_around(at);

    // From a large misfit, under which all points count alike, down to the one that fits.
    Eigen::VectorXd residual;
    const auto excess_with = [&](double misfit) {
        problem.misfit = misfit;
        problem.minimize(at);
        problem.evaluate(at, residual, nullptr);
        return problem.excess(residual);
    };
    const auto fit_with_misfit = [&] {
        double high = 0.3, low = 1e-9;
        excess_with(high);
        while (high / low > 1.01) {
            const double middle = std::sqrt(high * low);
            (excess_with(middle) > 1 ? low : high) = middle;
        }
        // One that is far below the noise is none.
        problem.misfit = high > 2e-9 ? high : 0;
        problem.minimize(at);
    };
    fit_with_misfit();
    problem.weigh_by_model(at);
    fit_with_misfit();

    WeightedFit fit;
    fit.misfit = problem.misfit;
    fit.points = static_cast<int>(problem.size());
    fit.rounding = 2 * rounded > problem.size();
    std::vector<std::size_t> order(modes);
    for (std::size_t j = 0; j < modes; ++j) order[j] = j;
    std::ranges::stable_sort(order, {}, [&](std::size_t j) { return at[static_cast<Eigen::Index>(2 + 3 * j)]; });
    Eigen::VectorXd sorted = at;
    for (std::size_t j = 0; j < modes; ++j) {
        sorted.segment<3>(static_cast<Eigen::Index>(1 + 3 * j)) =
            at.segment<3>(static_cast<Eigen::Index>(1 + 3 * order[j]));
    }
    fit.model.rigid_gain = std::exp(sorted[0]);
    for (std::size_t j = 0; j < modes; ++j) {
        const auto mode = sorted.segment<3>(static_cast<Eigen::Index>(1 + 3 * j));
        fit.model.modes.push_back({std::exp(mode[0]), std::exp(mode[1]) / (2 * pi), std::exp(mode[2])});
    }
    if (options.delay) fit.delay = sorted[problem.unknowns() - 1];
    // A mode far outside is a slope to the data, which a lag or a delay that the model lacks has as well.
    const double lowest = response.frequency_hz.front(), highest = response.frequency_hz.back();
    constexpr double far = 1.25;
    const auto outside = std::ranges::find_if(
        fit.model.modes, [&](const auto& mode) { return mode.freq_hz < lowest / far || mode.freq_hz > highest * far; });
    const bool is_outside = outside != fit.model.modes.end();
    put_covariance(fit, problem, sorted, options.delay.has_value(), is_outside || problem.at_bound(at));
    if (is_outside) {
        fit.message =
            fmt::format("a mode is fitted at {:.6g} Hz, outside of the data from {:.6g} to {:.6g} Hz, which do not "
                        "determine it; try fewer modes",
                        outside->freq_hz, lowest, highest);
    }
    if (fit.message.empty() && fit.misfit > 0.05) {
        fit.message = fmt::format("the response differs from a modal model with {} modes by {:.2g} % more than its "
                                  "noise: friction, or another number of modes",
                                  options.modes, 100 * fit.misfit);
    }
    return fit;
}

Json to_json(const WeightedFit& fit) {
    const auto numbers = [](const ModalModel& model) {
        Json json{{"k0", model.rigid_gain}, {"modes", Json::array()}};
        for (const auto& mode : model.modes) {
            json["modes"].push_back({{"gain", mode.gain}, {"freq_hz", mode.freq_hz}, {"zeta", mode.zeta}});
        }
        return json;
    };
    Json json = numbers(fit.model);
    json["standard_errors"] = numbers(fit.standard_errors);
    if (!fit.parameters.empty() && fit.parameters.back() == "delay_s") {
        json["delay_s"] = fit.delay;
        json["standard_errors"]["delay_s"] = fit.delay_error;
    }
    json["parameters"] = fit.parameters;
    json["covariance"] = fit.covariance;
    json["misfit"] = fit.misfit;
    json["points"] = fit.points;
    json["rounding"] = fit.rounding;
    json["message"] = fit.message;
    return json;
}

} // namespace tribode
