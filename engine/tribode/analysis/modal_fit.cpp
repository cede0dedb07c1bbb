#include "tribode/analysis/modal_fit.hpp"

#include "tribode/base/error.hpp"
#include "tribode/base/field_reader.hpp"
#include "tribode/base/text.hpp"

#include <Eigen/QR>
#include <ceres/ceres.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <fmt/format.h>
#include <limits>
#include <memory>
#include <numbers>

namespace tribode {

namespace {

// Of the first searches, where modes are still missing and their peaks must not pull: 0.5 is 65 % or 29 deg.
constexpr double search_scale = 0.5;
// Least scale read from data, far above rounding and far below any measurement.
constexpr double min_scale = 1e-7;
// In standard deviations: 97 % of the efficiency of least squares on normal errors of two components.
// component.
constexpr double scale_per_deviation = 3;

struct Point {
    double omega; // [rad/s]
    std::complex<double> value;
};

struct Fit {
    std::vector<double> logarithms; // k0, then k, w, zeta of each mode
    double cost = std::numeric_limits<double>::infinity();
    int iterations = 0;
    bool converged = false;
};

// The model at the point where the solver looks, from the logarithms of its parameters: made once for all frequencies.
class Exponentials final : public ceres::EvaluationCallback {
  public:
    struct Mode {
        double gain, square, damp; // k, w^2, 2 w zeta
    };

    explicit Exponentials(const std::vector<double>& logarithms) : logarithms_(logarithms) {}

    void PrepareForEvaluation(bool, bool new_point) override {
        if (!new_point) return;
        rigid_gain = std::exp(logarithms_[0]);
        modes.clear();
        for (std::size_t j = 1; j < logarithms_.size(); j += 3) {
            const double own = std::exp(logarithms_[j + 1]);
            modes.push_back({std::exp(logarithms_[j]), own * own, 2 * own * std::exp(logarithms_[j + 2])});
        }
    }

    double rigid_gain = 0; // [m/(N s^2)]
    std::vector<Mode> modes;

  private:
    const std::vector<double>& logarithms_; // to which the solver writes the point before it asks
};

// ln(H/P) at one frequency: gain [neper] and phase [rad], and its derivatives -(dP/dp)/P by the logarithms.
class LogRatio final : public ceres::CostFunction {
  public:
    LogRatio(const Point& point, const Exponentials& model, int parameters) : point_(point), model_(model) {
        mutable_parameter_block_sizes()->push_back(parameters);
        set_num_residuals(2);
    }

    bool Evaluate(double const* const*, double* residual, double** jacobians) const override {
        const double square = point_.omega * point_.omega;
        const double rigid = -model_.rigid_gain / square;
        std::complex<double> sum = rigid;
        for (const auto& mode : model_.modes) sum += mode.gain * receptance(mode, square);
        // H conj(P)
        const double real = point_.value.real() * sum.real() + point_.value.imag() * sum.imag();
        const double imag = point_.value.imag() * sum.real() - point_.value.real() * sum.imag();
        residual[0] = 0.5 * std::log(std::norm(point_.value) / std::norm(sum));
        residual[1] = std::atan2(imag, real);
        if (!jacobians || !jacobians[0]) return true;

        const std::complex<double> minus_inverse = -std::conj(sum) / std::norm(sum);
        double* gains = jacobians[0];
        double* phases = gains + parameter_block_sizes()[0];
        const auto put = [&](std::complex<double> derivative) {
            const std::complex<double> slope = derivative * minus_inverse;
            *gains++ = slope.real();
            *phases++ = slope.imag();
        };
        put(rigid);
        for (const auto& mode : model_.modes) {
            const std::complex<double> once = receptance(mode, square), part = mode.gain * once, twice = part * once;
            const std::complex<double> damping(0, mode.damp * point_.omega);
            put(part);
            put(-twice * (2 * mode.square + damping));
            put(-twice * damping);
        }
        return true;
    }

  private:
    // 1/(w_j^2 - w^2 + j 2 zeta w_j w)
    std::complex<double> receptance(const Exponentials::Mode& mode, double square) const {
        const double stiff = mode.square - square, damp = mode.damp * point_.omega;
        const double scale = 1 / (stiff * stiff + damp * damp);
        return {scale * stiff, -scale * damp};
    }

    Point point_;
    const Exponentials& model_;
};

std::unique_ptr<ceres::LossFunction> make_loss(double scale) {
    if (std::isinf(scale)) return std::make_unique<ceres::TrivialLoss>();
    return std::make_unique<ceres::CauchyLoss>(scale);
}

ModalModel to_model(const std::vector<double>& logarithms) {
    ModalModel model;
    model.rigid_gain = std::exp(logarithms[0]);
    for (std::size_t j = 1; j < logarithms.size(); j += 3)
        model.modes.push_back({std::exp(logarithms[j]), std::exp(logarithms[j + 1]) / (2 * std::numbers::pi),
                               std::exp(logarithms[j + 2])});
    return model;
}

// Median of abs(H) w^2 over the highest tenth of the band: above all modes the sum of all gains.
double total_gain(const std::vector<Point>& points) {
    std::vector<double> gains;
    for (std::size_t i = points.size() - std::max<std::size_t>(points.size() / 10, 1); i < points.size(); ++i)
        gains.push_back(std::abs(points[i].value) * points[i].omega * points[i].omega);
    const auto middle = gains.begin() + static_cast<std::ptrdiff_t>(gains.size() / 2);
    std::ranges::nth_element(gains, middle);
    return *middle;
}

// Where the logarithms may go. Wide, but a mode that the data do not ask for must stop somewhere.
struct Bounds {
    double gain[2], omega[2], zeta[2];

    explicit Bounds(const std::vector<Point>& points)
        : gain{std::log(1e-6 * total_gain(points)), std::log(1e3 * total_gain(points))},
          omega{std::log(0.5 * points.front().omega), std::log(2 * points.back().omega)},
          zeta{std::log(1e-6), std::log(5.0)} {}

    const double* of(std::size_t parameter) const {
        if (parameter % 3 == 0 && parameter > 0) return zeta;
        return parameter % 3 == 2 ? omega : gain;
    }
};

// The least-squares problem of the points with a model of that size. What it is made with outlives it.
class FitProblem {
  public:
    FitProblem(const std::vector<Point>& points, ceres::LossFunction& loss, std::vector<double>& logarithms)
        : model_(logarithms),
          problem_(options(model_)) {
        const auto parameters = static_cast<int>(logarithms.size());
        for (const Point& point : points) {
            problem_.AddResidualBlock(new LogRatio(point, model_, parameters), &loss, logarithms.data());
        }
        const Bounds bounds(points);
        for (int j = 0; j < parameters; ++j) {
            const double* bound = bounds.of(static_cast<std::size_t>(j));
            double& logarithm = logarithms[static_cast<std::size_t>(j)];
            logarithm = std::clamp(logarithm, bound[0], bound[1]);
            problem_.SetParameterLowerBound(logarithms.data(), j, bound[0]);
            problem_.SetParameterUpperBound(logarithms.data(), j, bound[1]);
        }
    }

    ceres::Problem* operator->() { return &problem_; }
    ceres::Problem* get() { return &problem_; }

  private:
    static ceres::Problem::Options options(Exponentials& model) {
        ceres::Problem::Options options;
        options.loss_function_ownership = ceres::DO_NOT_TAKE_OWNERSHIP;
        options.evaluation_callback = &model;
        return options;
    }

    Exponentials model_;
    ceres::Problem problem_;
};

Fit refine(const std::vector<Point>& points, std::vector<double> start, double scale, int max_iterations) {
    Fit fit;
    fit.logarithms = std::move(start);
    const auto loss = make_loss(scale);
    FitProblem problem(points, *loss, fit.logarithms);
    ceres::Solver::Options options;
    options.linear_solver_type = ceres::DENSE_QR;
    options.max_num_iterations = max_iterations;
    options.function_tolerance = 1e-12;
    options.gradient_tolerance = 1e-14;
    options.parameter_tolerance = 1e-12;
    // Where there are bounds, each step would be tried along its way before it is tried as it is.
    options.max_num_line_search_step_size_iterations = 0;
    options.logging_type = ceres::SILENT;
    ceres::Solver::Summary summary;
    ceres::Solve(options, problem.get(), &summary);
    fit.iterations = summary.num_successful_steps + summary.num_unsuccessful_steps;
    fit.converged = summary.termination_type == ceres::CONVERGENCE;
    if (summary.IsSolutionUsable()) fit.cost = summary.final_cost;
    return fit;
}

// Response of a model at all points.
std::vector<std::complex<double>> responses(const std::vector<Point>& points, const ModalModel& model) {
    std::vector<std::complex<double>> values;
    values.reserve(points.size());
    for (const Point& point : points) values.push_back(model.response(point.omega / (2 * std::numbers::pi)));
    return values;
}

double squared_log_ratio(std::complex<double> measured, std::complex<double> modeled) {
    // As norm(log(ratio)), which takes great care near abs(ratio) = 1, where nothing depends on it here.
    const auto ratio = measured / modeled;
    const double gain = 0.5 * std::log(std::norm(ratio)), phase = std::arg(ratio);
    return gain * gain + phase * phase;
}

// The robust cost of the search over all points, of one trial model after the other: many, so it spares what it can.
class TrialCost {
  public:
    explicit TrialCost(const std::vector<Point>& points) : points_(points) {
        for (const Point& point : points) logarithm_.push_back(std::log(std::norm(point.value)));
    }

    // Of (1 - share) base + share extra; infinite where it is not below `least`.
    double operator()(const std::vector<std::complex<double>>& base, const std::vector<std::complex<double>>& extra,
                      double share, double least) const {
        constexpr double square_scale = search_scale * search_scale;
        // sum ln(1 + r^2/a^2) as the logarithm of products, sixteen at a time: each factor is below 1e9.
        constexpr std::size_t at_a_time = 16;
        double cost = 0, product = 1;
        for (std::size_t k = 0; k < points_.size(); ++k) {
            const double real = (1 - share) * base[k].real() + share * extra[k].real();
            const double imag = (1 - share) * base[k].imag() + share * extra[k].imag();
            const std::complex<double> value = points_[k].value;
            const double gain = 0.5 * (logarithm_[k] - std::log(real * real + imag * imag));
            const double phase =
                std::atan2(value.imag() * real - value.real() * imag, value.real() * real + value.imag() * imag);
            product *= 1 + (gain * gain + phase * phase) / square_scale;
            if (k % at_a_time != at_a_time - 1 && k + 1 < points_.size()) continue;
            cost += square_scale * std::log(product);
            product = 1;
            if (!(cost < least)) return std::numeric_limits<double>::infinity();
        }
        return cost;
    }

  private:
    const std::vector<Point>& points_;
    std::vector<double> logarithm_; // ln(abs(H)^2)
};

// Starts with one mode more than `fit`: the best of a grid over frequency, damping and share of the total
// gain, which is taken from the other gains, and the next best ones at least 5 % away in frequency.
std::vector<std::vector<double>> starts_with_one_more(const std::vector<Point>& points, const Fit& fit) {
    constexpr std::size_t max_frequencies = 150, max_starts = 3;
    constexpr double dampings[] = {0.003, 0.015, 0.07, 0.3}, shares[] = {0.03, 0.12, 0.4};
    const ModalModel base_model = to_model(fit.logarithms);
    const std::vector<std::complex<double>> base = responses(points, base_model);
    double gain = base_model.rigid_gain;
    for (const VibrationMode& mode : base_model.modes) gain += mode.gain;

    struct Candidate {
        double cost, omega, zeta, share;
    };
    std::vector<Candidate> candidates; // the best one of each frequency
    const TrialCost cost_of(points);
    const std::size_t stride = (points.size() + max_frequencies - 1) / max_frequencies;
    for (std::size_t i = 0; i < points.size(); i += stride) {
        Candidate best{std::numeric_limits<double>::infinity(), points[i].omega, 0, 0};
        for (const double zeta : dampings) {
            const ModalModel added{0, {{gain, best.omega / (2 * std::numbers::pi), zeta}}};
            const std::vector<std::complex<double>> extra = responses(points, added);
            for (const double share : shares) {
                const double cost = cost_of(base, extra, share, best.cost);
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
double robust_deviation(const std::vector<Point>& points, const ModalModel& model) {
    std::vector<double> squares;
    const std::vector<std::complex<double>> modeled = responses(points, model);
    for (std::size_t i = 0; i < points.size(); ++i) squares.push_back(squared_log_ratio(points[i].value, modeled[i]));
    const auto middle = squares.begin() + static_cast<std::ptrdiff_t>(squares.size() / 2);
    std::ranges::nth_element(squares, middle);
    return std::sqrt(*middle / (2 * std::numbers::ln2));
}

// Standard deviations of the logarithms; infinite where the Jacobian has no full rank and for those at a
// bound.
std::vector<double> logarithm_errors(const std::vector<Point>& points, std::vector<double> logarithms, double scale) {
    const auto loss = make_loss(scale);
    FitProblem problem(points, *loss, logarithms);
    ceres::Problem::EvaluateOptions options;
    options.apply_loss_function = false;
    std::vector<double> residuals;
    ceres::CRSMatrix sparse;
    const bool evaluated = problem->Evaluate(options, nullptr, &residuals, nullptr, &sparse);
    const std::size_t parameters = logarithms.size();
    std::vector<double> errors(parameters, std::numeric_limits<double>::infinity());
    if (!evaluated) return errors;
    using RowMajor = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;
    const Eigen::MatrixXd jacobian = Eigen::Map<const RowMajor>(sparse.values.data(), sparse.num_rows, sparse.num_cols);

    const Bounds bounds(points);
    Eigen::ColPivHouseholderQR<Eigen::MatrixXd> factor;
    factor.setThreshold(1e-8);
    factor.compute(jacobian);
    if (factor.rank() < jacobian.cols() || residuals.size() <= parameters) return errors;

    // Influence psi(e) = rho' e of the residual pair e, and half the trace of its derivative.
    double square = 0, slope = 0;
    for (std::size_t i = 0; i < residuals.size(); i += 2) {
        const double magnitude = residuals[i] * residuals[i] + residuals[i + 1] * residuals[i + 1];
        double rho[3];
        loss->Evaluate(magnitude, rho);
        square += rho[1] * rho[1] * magnitude;
        slope += rho[1] + rho[2] * magnitude;
    }
    const double variance = square / static_cast<double>(residuals.size() - parameters);
    const double mean_slope = slope / static_cast<double>(points.size());
    const auto triangle = factor.matrixQR().topRows(jacobian.cols()).triangularView<Eigen::Upper>();
    const Eigen::MatrixXd inverse = triangle.solve(Eigen::MatrixXd::Identity(jacobian.cols(), jacobian.cols()));
    const Eigen::VectorXd lengths = factor.colsPermutation() * inverse.rowwise().norm();
    for (std::size_t j = 0; j < parameters; ++j)
        if (logarithms[j] > bounds.of(j)[0] && logarithms[j] < bounds.of(j)[1])
            errors[j] = std::sqrt(variance) / mean_slope * lengths[static_cast<Eigen::Index>(j)];
    return errors;
}

std::vector<Point> points_in_band(const FrequencyResponse& response, const ModalFitOptions& options) {
    std::vector<Point> points;
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
    std::ranges::stable_sort(points, {}, &Point::omega);
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
Fit search(const std::vector<Point>& points, int modes, int& iterations) {
    Fit fit = refine(points, {std::log(total_gain(points))}, search_scale, 50);
    iterations += fit.iterations;
    for (int added = 0; added < modes; ++added) {
        Fit best;
        for (std::vector<double>& start : starts_with_one_more(points, fit)) {
            Fit candidate = refine(points, std::move(start), search_scale, 50);
            iterations += candidate.iterations;
            if (best.logarithms.empty() || candidate.cost < best.cost) best = std::move(candidate);
        }
        fit = std::move(best);
    }
    return fit;
}

// The fit repeated with the scale read from its own residuals, until that no longer changes.
Fit refine_with_scale(const std::vector<Point>& points, Fit fit, double& scale, int& iterations) {
    constexpr int max_iterations = 200, max_rounds = 20;
    const bool from_data = scale == 0;
    for (int round = 0; round < max_rounds; ++round) {
        if (from_data) {
            const double deviation = robust_deviation(points, to_model(fit.logarithms));
            const double read = std::max(scale_per_deviation * deviation, min_scale);
            if (std::abs(read - scale) <= 1e-3 * scale) break;
            scale = read;
        }
        fit = refine(points, std::move(fit.logarithms), scale, max_iterations);
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

double residual_rms(const std::vector<Point>& points, const ModalModel& model) {
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
    const std::vector<Point> points = points_in_band(response, options);

    ModalFitResult result;
    result.robust_scale = options.robust_scale;
    Fit fit = search(points, options.modes, result.iterations);
    fit = refine_with_scale(points, std::move(fit), result.robust_scale, result.iterations);
    fit.logarithms = by_ascending_frequency(fit.logarithms);

    const std::vector<double> errors = logarithm_errors(points, fit.logarithms, result.robust_scale);
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
