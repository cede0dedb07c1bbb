#include "tribode/analysis/modal_fit.hpp"

#include "tribode/analysis/modal_descent.hpp"
#include "tribode/base/error.hpp"
#include "tribode/base/field_reader.hpp"
#include "tribode/base/text.hpp"

#include <Eigen/QR>

#include <algorithm>
#include <array>
#include <cmath>
#include <fmt/format.h>
#include <limits>
#include <numbers>

namespace tribode {

namespace {

using Fit = ModalDescent::Result;

// Of the first searches, where modes are still missing and their peaks must not pull: 0.5 is 65 % or 29 deg.
constexpr double search_scale = 0.5;
// Least scale read from data, far above rounding and far below any measurement.
constexpr double min_scale = 1e-7;
// In standard deviations: 97 % of the efficiency of least squares on normal errors of two components.
// component.
constexpr double scale_per_deviation = 3;

constexpr Lanes one_in_all = {{1, 1, 1, 1, 1, 1, 1, 1}};

ModalModel to_model(const std::vector<double>& logarithms) {
    ModalModel model;
    model.rigid_gain = std::exp(logarithms[0]);
    for (std::size_t j = 1; j < logarithms.size(); j += 3)
        model.modes.push_back({std::exp(logarithms[j]), std::exp(logarithms[j + 1]) / (2 * std::numbers::pi),
                               std::exp(logarithms[j + 2])});
    return model;
}

// Median of abs(H) w^2 over the highest tenth of the band: above all modes the sum of all gains.
double total_gain(const std::vector<ResponsePoint>& points) {
    std::vector<double> gains;
    for (std::size_t i = points.size() - std::max<std::size_t>(points.size() / 10, 1); i < points.size(); ++i)
        gains.push_back(std::abs(points[i].value) * points[i].omega * points[i].omega);
    const auto middle = gains.begin() + static_cast<std::ptrdiff_t>(gains.size() / 2);
    std::ranges::nth_element(gains, middle);
    return *middle;
}

// Wide, but a mode that the data do not ask for must stop somewhere.
ModalDescent descent_of(const std::vector<ResponsePoint>& points) {
    const double gain = total_gain(points);
    return {points,
            {std::log(1e-6 * gain), std::log(1e3 * gain)},
            {std::log(0.5 * points.front().omega), std::log(2 * points.back().omega)},
            {std::log(1e-6), std::log(5.0)}};
}

// Response of a model at all points.
std::vector<std::complex<double>> responses(const std::vector<ResponsePoint>& points, const ModalModel& model) {
    std::vector<std::complex<double>> values;
    values.reserve(points.size());
    for (const ResponsePoint& point : points) values.push_back(model.response(point.omega / (2 * std::numbers::pi)));
    return values;
}

double squared_log_ratio(std::complex<double> measured, std::complex<double> modeled) {
    // As norm(log(ratio)), which takes great care near abs(ratio) = 1, where nothing depends on it here.
    const auto ratio = measured / modeled;
    const double gain = 0.5 * std::log(std::norm(ratio)), phase = std::arg(ratio);
    return gain * gain + phase * phase;
}

// abs(ln z)^2 >= (2 w/(2 + w))^2 with w the distance of z from one, relative to the smaller of both; and (2 + w)^2 is below
// 4 + 2 e + (1 + 2/e) w^2 for every e > 0, of which three are tried. Multiplies 1 + this bound/a^2 of all points, lane by lane.
TRIBODE_CLONES void multiply_floors(std::size_t count, std::size_t blocks, const Lanes* base, const Lanes* extra,
                                    double share, Lanes& product) {
    constexpr double e[] = {0.06, 0.4, 2.5}, inverse = 4 / (search_scale * search_scale);
    const double rest = 1 - share;
    Lanes all = one_in_all;
    for (std::size_t b = 0; b < count; ++b) {
        const Lanes real = rest * base[b] + share * extra[b];
        const Lanes imag = rest * base[blocks + b] + share * extra[blocks + b];
        const Lanes off = real - one_in_all, square = off * off + imag * imag;
        const Lanes smaller = min(real * real + imag * imag, one_in_all);
        const Lanes below = min(
            min((4 + 2 * e[0]) * smaller + (1 + 2 / e[0]) * square, (4 + 2 * e[1]) * smaller + (1 + 2 / e[1]) * square),
            (4 + 2 * e[2]) * smaller + (1 + 2 / e[2]) * square);
        all = all + all * (inverse * square / below);
    }
    product = all;
}

// gain/(w_j^2 - w^2 + j loss) over H at all points.
TRIBODE_CLONES void put_trial_mode(std::size_t blocks, const Lanes* omega, const Lanes* inverse, double gain,
                                   double own, double zeta, Lanes* ratio) {
    for (std::size_t b = 0; b < blocks; ++b) {
        const Lanes stiff = own * own - omega[b] * omega[b], loss = (2 * zeta * own) * omega[b];
        const Lanes scale = gain / (stiff * stiff + loss * loss), real = scale * stiff, imag = -(scale * loss);
        ratio[b] = real * inverse[b] - imag * inverse[blocks + b];
        ratio[blocks + b] = real * inverse[blocks + b] + imag * inverse[b];
    }
}

// The robust cost of the search over all points, of one trial model after the other: many, so it spares what it can.
class TrialCost {
  public:
    TrialCost(const std::vector<ResponsePoint>& points, const std::vector<std::complex<double>>& base)
        : count_(points.size()),
          blocks_((points.size() + lane_count - 1) / lane_count),
          omega_(blocks_, one_in_all),
          inverse_(2 * blocks_),
          base_(2 * blocks_),
          extra_(2 * blocks_) {
        std::fill_n(base_.begin(), blocks_, one_in_all); // what fills up the last block has no cost
        for (std::size_t k = 0; k < count_; ++k) {
            put(inverse_, k, 1.0 / points[k].value);
            put(base_, k, base[k] / points[k].value);
            omega_[k / lane_count][k % lane_count] = points[k].omega;
        }
    }

    // The part of the trials that follow which comes from the mode that is tried.
    void set_mode(double gain, double omega, double zeta) {
        put_trial_mode(blocks_, omega_.data(), inverse_.data(), gain, omega, zeta, extra_.data());
        for (std::size_t k = count_; k < blocks_ * lane_count; ++k) put(extra_, k, 1);
    }

    // Of (1 - share) base + share extra; infinite where it is not below `least`.
    double operator()(double share, double least) const {
        constexpr double infinite = std::numeric_limits<double>::infinity();
        if (least < infinite && !(floor(share) * (1 - 1e-9) < least)) return infinite;
        constexpr double square_scale = search_scale * search_scale;
        // sum ln(1 + r^2/a^2) as the logarithm of products, sixteen at a time: each factor is below 1e9.
        constexpr std::size_t at_a_time = 16;
        double cost = 0, product = 1;
        for (std::size_t k = 0; k < count_; ++k) {
            const std::complex<double> ratio = (1 - share) * at(base_, k) + share * at(extra_, k);
            const double gain = 0.5 * std::log(std::norm(ratio)), phase = std::arg(ratio);
            product *= 1 + (gain * gain + phase * phase) / square_scale;
            if (k % at_a_time != at_a_time - 1 && k + 1 < count_) continue;
            cost += square_scale * std::log(product);
            product = 1;
            if (!(cost < least)) return infinite;
        }
        return cost;
    }

  private:
    // A bound below the cost, without a function of each point.
    double floor(double share) const {
        constexpr std::size_t at_a_time = 28; // each factor is below 17, the product of all below 1e276
        double sum = 0;
        for (std::size_t b = 0; b < blocks_; b += at_a_time) {
            Lanes lanes;
            multiply_floors(std::min(at_a_time, blocks_ - b), blocks_, base_.data() + b, extra_.data() + b, share,
                            lanes);
            double product = 1;
            for (const double lane : lanes.of) product *= lane;
            sum += std::log(product);
        }
        return search_scale * search_scale * sum;
    }

    std::complex<double> at(const std::vector<Lanes>& values, std::size_t k) const {
        return {values[k / lane_count][k % lane_count], values[blocks_ + k / lane_count][k % lane_count]};
    }
    void put(std::vector<Lanes>& values, std::size_t k, std::complex<double> value) const {
        values[k / lane_count][k % lane_count] = value.real();
        values[blocks_ + k / lane_count][k % lane_count] = value.imag();
    }

    std::size_t count_, blocks_; // points, and the vectors that hold them
    std::vector<Lanes> omega_;
    std::vector<Lanes> inverse_, base_, extra_; // 1/H, P/H; real, then imaginary parts
};

// Starts with one mode more than `fit`: the best of a grid over frequency, damping and share of the total
// gain, which is taken from the other gains, and the next best ones at least 5 % away in frequency.
std::vector<std::vector<double>> starts_with_one_more(const std::vector<ResponsePoint>& points, const Fit& fit) {
    constexpr std::size_t max_frequencies = 150, max_starts = 3;
    constexpr double dampings[] = {0.003, 0.015, 0.07, 0.3}, shares[] = {0.03, 0.12, 0.4};
    const ModalModel base = to_model(fit.logarithms);
    double gain = base.rigid_gain;
    for (const VibrationMode& mode : base.modes) gain += mode.gain;

    struct Candidate {
        double cost, omega, zeta, share;
    };
    std::vector<Candidate> candidates; // the best one of each frequency
    TrialCost cost_of(points, responses(points, base));
    const std::size_t stride = (points.size() + max_frequencies - 1) / max_frequencies;
    for (std::size_t i = 0; i < points.size(); i += stride) {
        Candidate best{std::numeric_limits<double>::infinity(), points[i].omega, 0, 0};
        for (const double zeta : dampings) {
            cost_of.set_mode(gain, best.omega, zeta);
            for (const double share : shares) {
                const double cost = cost_of(share, best.cost);
                if (cost < best.cost) best = {cost, best.omega, zeta, share};
            }
        }
        candidates.push_back(best);
    }

    std::ranges::stable_sort(candidates, {}, &Candidate::cost);
    std::vector<std::vector<double>> starts;
    std::vector<double> taken;
    for (const Candidate& candidate : candidates) {
        const auto too_near = [&](double omega) { return std::abs(std::log(omega / candidate.omega)) < 0.05; };
        if (starts.size() == max_starts || std::ranges::any_of(taken, too_near)) continue;
        std::vector<double> start = fit.logarithms;
        for (std::size_t j = 0; j < start.size(); j = j == 0 ? 1 : j + 3) start[j] += std::log(1 - candidate.share);
        start.insert(start.end(),
                     {std::log(candidate.share * gain), std::log(candidate.omega), std::log(candidate.zeta)});
        starts.push_back(std::move(start));
        taken.push_back(candidate.omega);
    }
    for (std::size_t j = 1; j < fit.logarithms.size(); j += 3) {
        const double apart = std::clamp(std::exp(fit.logarithms[j + 2]), 0.01, 0.3);
        std::vector<double> start = fit.logarithms;
        start[j] -= std::numbers::ln2;
        start.insert(start.end(), {start[j], start[j + 1] + apart, start[j + 2]});
        start[j + 1] -= apart;
        starts.push_back(std::move(start));
    }
    return starts;
}

// Standard deviation of one component of ln(H/P), from the median of the magnitudes, which a few wild points
// do not move. For normal errors the median is sigma sqrt(2 ln 2).
double robust_deviation(const std::vector<ResponsePoint>& points, const ModalModel& model) {
    std::vector<double> squares;
    const std::vector<std::complex<double>> modeled = responses(points, model);
    for (std::size_t i = 0; i < points.size(); ++i) squares.push_back(squared_log_ratio(points[i].value, modeled[i]));
    const auto middle = squares.begin() + static_cast<std::ptrdiff_t>(squares.size() / 2);
    std::ranges::nth_element(squares, middle);
    return std::sqrt(*middle / (2 * std::numbers::ln2));
}

// Standard deviations of the logarithms; infinite where the Jacobian has no full rank and for those at a
// bound.
std::vector<double> logarithm_errors(ModalDescent& descent, const std::vector<double>& logarithms, double scale) {
    const auto [gain, phase, jacobian] = descent.residuals(logarithms);
    const std::size_t parameters = logarithms.size();
    std::vector<double> errors(parameters, std::numeric_limits<double>::infinity());
    Eigen::ColPivHouseholderQR<Eigen::MatrixXd> factor;
    factor.setThreshold(1e-8);
    factor.compute(jacobian);
    if (factor.rank() < jacobian.cols() || 2 * gain.size() <= parameters) return errors;

    // Influence psi(e) = rho' e of the residual pair e, and half the trace of its derivative.
    double square = 0, slope = 0;
    for (std::size_t i = 0; i < gain.size(); ++i) {
        const double magnitude = gain[i] * gain[i] + phase[i] * phase[i];
        const double weight = 1 / (1 + magnitude / (scale * scale));
        square += weight * weight * magnitude;
        slope += weight - weight * weight * magnitude / (scale * scale);
    }
    const double variance = square / static_cast<double>(2 * gain.size() - parameters);
    const double mean_slope = slope / static_cast<double>(gain.size());
    const auto triangle = factor.matrixQR().topRows(jacobian.cols()).triangularView<Eigen::Upper>();
    const Eigen::MatrixXd inverse = triangle.solve(Eigen::MatrixXd::Identity(jacobian.cols(), jacobian.cols()));
    const Eigen::VectorXd lengths = factor.colsPermutation() * inverse.rowwise().norm();
    for (std::size_t j = 0; j < parameters; ++j)
        if (logarithms[j] > descent.bounds(j).low && logarithms[j] < descent.bounds(j).high)
            errors[j] = std::sqrt(variance) / mean_slope * lengths[static_cast<Eigen::Index>(j)];
    return errors;
}

std::vector<ResponsePoint> points_in_band(const FrequencyResponse& response, const ModalFitOptions& options) {
    std::vector<ResponsePoint> points;
    for (std::size_t i = 0; i < response.size(); ++i) {
        const double f = response.frequency_hz[i];
        const std::complex<double> value = response.value[i];
        if (!(f >= options.f_min_hz && f <= options.f_max_hz)) continue;
        if (!std::isfinite(value.real()) || !std::isfinite(value.imag()) || value == 0.0)
            throw InputError("modal fit: the response at " + to_text(f) + " Hz is " + to_text(value.real()) + " + j " +
                             to_text(value.imag()) + ", must be finite and not zero");
        // Beyond, its square and those of its ratios to others are no numbers.
        constexpr double least = 1e-60, most = 1e60;
        if (!(std::abs(value) >= least && std::abs(value) <= most))
            throw InputError("modal fit: the response at " + to_text(f) + " Hz has the magnitude " +
                             to_text(std::abs(value)) + ", must be from " + to_text(least) + " to " + to_text(most));
        points.push_back({2 * std::numbers::pi * f, value});
    }
    std::ranges::stable_sort(points, {}, &ResponsePoint::omega);
    const std::size_t least = 1 + 3 * static_cast<std::size_t>(options.modes);
    if (points.size() < least)
        throw InputError("modal fit: " + std::to_string(points.size()) + " frequencies between " +
                         to_text(options.f_min_hz) + " and " + to_text(options.f_max_hz) + " Hz, must be at least " +
                         std::to_string(least) + " for " + std::to_string(options.modes) + " modes");
    return points;
}

void require_valid(const FrequencyResponse& response, const ModalFitOptions& options) {
    if (response.frequency_hz.size() != response.value.size())
        throw InputError("modal fit: " + std::to_string(response.frequency_hz.size()) + " frequencies and " +
                         std::to_string(response.value.size()) + " values, must be the same number");
    if (!(options.f_min_hz > 0 && options.f_min_hz < options.f_max_hz))
        throw InputError("modal fit: the band is " + to_text(options.f_min_hz) + " to " + to_text(options.f_max_hz) +
                         " Hz, must be positive and ascending");
    if (options.modes < 0)
        throw InputError("modal fit: modes = " + std::to_string(options.modes) + ", must not be negative");
    if (!(options.robust_scale >= 0))
        throw InputError("modal fit: robust_scale = " + to_text(options.robust_scale) + ", must not be negative");
}

// One complete search with the modes added one at a time.
Fit search(const std::vector<ResponsePoint>& points, ModalDescent& descent, int modes, int& iterations) {
    Fit fit = descent.descend({std::log(total_gain(points))}, search_scale, 50);
    iterations += fit.iterations;
    for (int added = 0; added < modes; ++added) {
        Fit best;
        for (std::vector<double>& start : starts_with_one_more(points, fit)) {
            Fit candidate = descent.descend(std::move(start), search_scale, 50);
            iterations += candidate.iterations;
            if (best.logarithms.empty() || candidate.cost < best.cost) best = std::move(candidate);
        }
        fit = std::move(best);
    }
    return fit;
}

// The fit repeated with the scale read from its own residuals, until that no longer changes.
Fit refine_with_scale(const std::vector<ResponsePoint>& points, ModalDescent& descent, Fit fit, double& scale,
                      int& iterations) {
    constexpr int max_iterations = 200, max_rounds = 20;
    const bool from_data = scale == 0;
    for (int round = 0; round < max_rounds; ++round) {
        if (from_data) {
            const double deviation = robust_deviation(points, to_model(fit.logarithms));
            const double read = std::max(scale_per_deviation * deviation, min_scale);
            if (std::abs(read - scale) <= 1e-3 * scale) break;
            scale = read;
        }
        fit = descent.descend(std::move(fit.logarithms), scale, max_iterations);
        iterations += fit.iterations;
        if (!from_data) break;
    }
    return fit;
}

std::vector<double> by_ascending_frequency(const std::vector<double>& logarithms) {
    std::vector<std::array<double, 3>> modes;
    for (std::size_t j = 1; j < logarithms.size(); j += 3)
        modes.push_back({logarithms[j], logarithms[j + 1], logarithms[j + 2]});
    std::ranges::stable_sort(modes, {}, [](const std::array<double, 3>& mode) { return mode[1]; });
    std::vector<double> ordered = {logarithms[0]};
    for (const auto& mode : modes) ordered.insert(ordered.end(), mode.begin(), mode.end());
    return ordered;
}

// d p = p d(ln p) for each parameter.
ModalModel parameter_errors(const ModalModel& model, const std::vector<double>& errors) {
    ModalModel scaled = model;
    scaled.rigid_gain *= errors[0];
    for (std::size_t j = 0; j < model.modes.size(); ++j) {
        scaled.modes[j].gain *= errors[3 * j + 1];
        scaled.modes[j].freq_hz *= errors[3 * j + 2];
        scaled.modes[j].zeta *= errors[3 * j + 3];
    }
    return scaled;
}

double residual_rms(const std::vector<ResponsePoint>& points, const ModalModel& model) {
    const std::vector<std::complex<double>> modeled = responses(points, model);
    double sum = 0;
    for (std::size_t i = 0; i < points.size(); ++i) sum += squared_log_ratio(points[i].value, modeled[i]);
    return std::sqrt(sum / static_cast<double>(points.size()));
}

// What the user should know of the result; empty where all is well.
std::string advice(const ModalFitResult& result, const std::vector<double>& errors, const ModalFitOptions& options) {
    if (!result.converged)
        return "modal fit: no minimum after " + std::to_string(result.iterations) +
               " iterations; another number of modes or another band may help";
    for (const double error : errors)
        if (!std::isfinite(error))
            return "modal fit: the data between " + to_text(options.f_min_hz) + " and " + to_text(options.f_max_hz) +
                   " Hz do not determine all parameters of " + std::to_string(options.modes) +
                   " modes; try fewer modes";
    for (const VibrationMode& mode : result.model.modes)
        if (mode.freq_hz < options.f_min_hz || mode.freq_hz > options.f_max_hz)
            return "modal fit: a mode was put at " + to_text(mode.freq_hz) + " Hz, outside the band of " +
                   to_text(options.f_min_hz) + " to " + to_text(options.f_max_hz) +
                   " Hz; try fewer modes or a wider band";
    return {};
}

} // namespace

ModalFitResult fit_modal_model(const FrequencyResponse& response, const ModalFitOptions& options) {
    require_valid(response, options);
    const std::vector<ResponsePoint> points = points_in_band(response, options);

    ModalFitResult result;
    result.robust_scale = options.robust_scale;
    ModalDescent descent = descent_of(points);
    Fit fit = search(points, descent, options.modes, result.iterations);
    fit = refine_with_scale(points, descent, std::move(fit), result.robust_scale, result.iterations);
    fit.logarithms = by_ascending_frequency(fit.logarithms);

    const std::vector<double> errors = logarithm_errors(descent, fit.logarithms, result.robust_scale);
    result.model = to_model(fit.logarithms);
    result.standard_errors = parameter_errors(result.model, errors);
    result.residual_rms = residual_rms(points, result.model);
    result.converged = fit.converged;
    result.message = advice(result, errors, options);
    return result;
}

Json to_json(const ModalModel& model) {
    Json json;
    json["k0"] = model.rigid_gain;
    for (std::size_t j = 0; j < model.modes.size(); ++j) {
        const std::string number = std::to_string(j + 1);
        json["k" + number] = model.modes[j].gain;
        json["f" + number + "_hz"] = model.modes[j].freq_hz;
        json["zeta" + number] = model.modes[j].zeta;
    }
    return json;
}

ModalModel modal_model_from_json(const Json& json, const std::string& where) {
    FieldReader fields(json, where, "model");
    ModalModel model;
    model.rigid_gain = fields.number("k0", "m/(N s^2)", Allowed::non_negative);
    for (int j = 1; fields.has(fmt::format("k{}", j)); ++j) {
        model.modes.push_back({fields.number(fmt::format("k{}", j), "m/(N s^2)", Allowed::positive),
                               fields.number(fmt::format("f{}_hz", j), "Hz", Allowed::positive),
                               fields.number(fmt::format("zeta{}", j), "", Allowed::non_negative)});
    }
    return model;
}

Json to_json(const ModalFitResult& result) {
    Json json = to_json(result.model);
    json["standard_errors"] = to_json(result.standard_errors);
    json["residual_rms"] = result.residual_rms;
    json["converged"] = result.converged;
    json["message"] = result.message;
    return json;
}

} // namespace tribode
