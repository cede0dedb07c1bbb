#include "diagnosis/candidate.hpp"
#include "analysis/friction_identification.hpp"
#include "base/error.hpp"

#include <Eigen/Dense>
#include <unsupported/Eigen/FFT>

#include <algorithm>
#include <cmath>
#include <complex>
#include <fmt/format.h>
#include <limits>
#include <numbers>

namespace tribode {

namespace {

constexpr double two_pi = 2 * std::numbers::pi;
constexpr double infinity = std::numeric_limits<double>::infinity();

using Signal = std::vector<double>;

struct Regression {
    Eigen::VectorXd coefficients;
    double explained; // share of the sum of squares
};

Regression regress(const std::vector<Signal>& columns, const Signal& target) {
    const auto n = static_cast<Eigen::Index>(columns.size());
    Eigen::MatrixXd normal = Eigen::MatrixXd::Zero(n, n);
    Eigen::VectorXd right = Eigen::VectorXd::Zero(n);
    double square = 0;
    const auto dot = [](const Signal& a, const Signal& b) {
        double sum = 0;
        for (std::size_t k = 0; k < a.size(); ++k) sum += a[k] * b[k];
        return sum;
    };
    for (Eigen::Index i = 0; i < n; ++i) {
        for (Eigen::Index j = 0; j <= i; ++j) {
            normal(i, j) = normal(j, i) =
                dot(columns[static_cast<std::size_t>(i)], columns[static_cast<std::size_t>(j)]);
        }
        right[i] = dot(columns[static_cast<std::size_t>(i)], target);
    }
    square = dot(target, target);
    // Columns that a record does not show are left out rather than blown up.
    for (Eigen::Index i = 0; i < n; ++i) normal(i, i) += 1e-9 * normal(i, i) + std::numeric_limits<double>::min();
    Regression result;
    result.coefficients = normal.ldlt().solve(right);
    result.explained = square > 0 ? result.coefficients.dot(right) / square : 0;
    return result;
}

template <class Function>
Signal map(const Signal& x, const Function& f) {
    Signal y(x.size());
    std::transform(x.begin(), x.end(), y.begin(), f);
    return y;
}

double largest(const Signal& x) {
    double most = 0;
    for (const double value : x) most = std::max(most, std::abs(value));
    return most;
}

double rms(const Signal& x) {
    double sum = 0;
    for (const double value : x) sum += value * value;
    return x.empty() ? 0 : std::sqrt(sum / static_cast<double>(x.size()));
}

std::vector<double> geometric(double from, double to, int count) {
    std::vector<double> values;
    for (int i = 0; i < count; ++i)
        values.push_back(from * std::pow(to / from, static_cast<double>(i) / std::max(count - 1, 1)));
    return values;
}

// A sinusoid of x found in a signal: amplitude sin(2 pi x/period + phase).
struct Sinusoid {
    double period, amplitude, phase, explained;
};

Sinusoid sinusoid_of(const Signal& x, const Signal& target, const Signal& weight, double period, bool mean) {
    Signal sine(x.size()), cosine(x.size());
    for (std::size_t k = 0; k < x.size(); ++k) {
        const double w = weight.empty() ? 1 : weight[k];
        sine[k] = w * std::sin(two_pi * x[k] / period);
        cosine[k] = w * std::cos(two_pi * x[k] / period);
    }
    std::vector<Signal> columns{std::move(sine), std::move(cosine)};
    if (mean) columns.push_back(weight.empty() ? Signal(x.size(), 1.0) : weight);
    const Regression fit = regress(columns, target);
    return {period, std::hypot(fit.coefficients[0], fit.coefficients[1]),
            std::atan2(fit.coefficients[1], fit.coefficients[0]), fit.explained};
}

// The sinusoids of x that explain most of a signal, one at a time, periods from `shortest` to `longest`. Fine periods
// are proposed by the spectrum of the signal collected in bins of x, long ones by trying.
std::vector<Sinusoid> sinusoids(const Signal& x, const Signal& target, const Signal& weight, double shortest,
                                double longest, std::size_t count, bool mean = false) {
    if (!(longest > shortest)) return {};
    const auto [low, high] = std::minmax_element(x.begin(), x.end());
    const double span = *high - *low;
    if (!(span > 0)) return {};
    std::vector<double> periods;
    for (const double period : geometric(std::max(shortest, span / 6), longest, 24)) {
        if (period <= longest) periods.push_back(period);
    }
    const double width = shortest / 6;
    const auto bins = static_cast<std::size_t>(std::min(span / width + 1, 4e6));
    if (bins > 8) {
        std::size_t length = 1;
        while (length < 4 * bins) length *= 2;
        std::vector<double> collected(length, 0.0);
        for (std::size_t k = 0; k < x.size(); ++k) {
            const auto bin = std::min(static_cast<std::size_t>((x[k] - *low) / width), length - 1);
            collected[bin] += target[k] * (weight.empty() ? 1 : weight[k]);
        }
        std::vector<std::complex<double>> line;
        Eigen::FFT<double> fft;
        fft.SetFlag(Eigen::FFT<double>::HalfSpectrum);
        fft.fwd(line, collected);
        const double total = static_cast<double>(length) * width;
        std::vector<std::pair<double, double>> peaks; // magnitude, period
        for (std::size_t i = 2; i + 1 < line.size(); ++i) {
            const double period = total / static_cast<double>(i);
            if (period < shortest || period > longest) continue;
            const double here = std::abs(line[i]);
            if (here >= std::abs(line[i - 1]) && here > std::abs(line[i + 1])) peaks.push_back({here, period});
        }
        std::sort(peaks.rbegin(), peaks.rend());
        for (std::size_t i = 0; i < std::min<std::size_t>(peaks.size(), 12); ++i) periods.push_back(peaks[i].second);
    }
    std::vector<Sinusoid> found;
    for (double period : periods) {
        // To the top of the peak, whose width is period^2/span.
        Sinusoid best = sinusoid_of(x, target, weight, period, mean);
        for (double width_left = 0.25 * period * period / span; width_left > 0.01 * period * period / span;
             width_left /= 2) {
            for (const double next : {best.period - width_left, best.period + width_left}) {
                if (next < shortest || next > longest) continue;
                const Sinusoid other = sinusoid_of(x, target, weight, next, mean);
                if (other.explained > best.explained) best = other;
            }
        }
        found.push_back(best);
    }
    std::sort(found.begin(), found.end(), [](const auto& a, const auto& b) { return a.explained > b.explained; });
    // Neighbours on one peak count once.
    std::vector<Sinusoid> distinct;
    for (const auto& one : found) {
        const bool known = std::any_of(distinct.begin(), distinct.end(), [&](const Sinusoid& other) {
            return std::abs(1 / one.period - 1 / other.period) < 0.5 / span;
        });
        if (!known && distinct.size() < count) distinct.push_back(one);
    }
    return distinct;
}

struct MaxwellSlipBounds {
    double least_level, most_level, least_reach, most_reach;
    bool replace_coulomb;
};

// Elements of levels F and reaches X = F/K: numbers F, X of one after another.
Candidate maxwell_slip(const MaxwellSlipBounds& bounds, const std::vector<double>& start) {
    const std::size_t count = start.size() / 2;
    Candidate candidate;
    candidate.effect = "presliding_hysteresis";
    candidate.form =
        fmt::format("{} elements{}", count, bounds.replace_coulomb ? " in place of the Coulomb level" : "");
    for (std::size_t i = 1; i <= count; ++i) {
        candidate.parameters.push_back(
            {fmt::format("elements[{}].F", i), bounds.least_level, bounds.most_level, true, 1e-3});
        candidate.parameters.push_back(
            {fmt::format("elements[{}].X", i), bounds.least_reach, bounds.most_reach, true, 1e-3});
    }
    candidate.make = [replace = bounds.replace_coulomb](std::span<const double> p) {
        Json list = Json::array();
        for (std::size_t i = 0; i + 1 < p.size(); i += 2) {
            list.push_back({{"K", p[i] / p[i + 1]}, {"F", p[i]}, {"D", 0.0}});
        }
        return Json{{"elements", list}, {"replace_coulomb", replace}};
    };
    candidate.starts = {start};
    // Each element in two, a factor of three apart: their loop is nearly that of the one.
    candidate.richer = [bounds](std::span<const double> p) {
        std::vector<std::vector<double>> starts;
        for (std::size_t i = 0; i < p.size(); i += 2) {
            std::vector<double> next(p.begin(), p.end());
            next[i] /= 2;
            next.push_back(next[i]);
            next.push_back(std::min(next[i + 1] * std::sqrt(3.0), bounds.most_reach));
            next[i + 1] = std::max(next[i + 1] / std::sqrt(3.0), bounds.least_reach);
            starts.push_back(std::move(next));
        }
        Candidate more = maxwell_slip(bounds, starts.front());
        more.starts = std::move(starts);
        return std::make_shared<const Candidate>(std::move(more));
    };
    return candidate;
}

class Proposer {
  public:
    explicit Proposer(const Clues& clues)
        : c_(clues),
          d_(clues.residual.force),
          y_(clues.residual.position),
          v_(clues.residual.velocity) {
        const auto [low, high] = std::minmax_element(y_.begin(), y_.end());
        low_ = *low;
        high_ = *high;
        stroke_ = high_ - low_;
        reach_ = std::max(std::abs(low_), std::abs(high_));
        fastest_ = largest(v_);
        thrust_ = largest(c_.residual.reference_thrust);
        duration_ = static_cast<double>(c_.measurement.size()) * c_.machine.sample_time;
        const double slow = 0.01 * fastest_;
        sign_ = map(v_, [slow](double v) { return std::clamp(v / slow, -1.0, 1.0); });
        gain_ = c_.machine.rigid_gain;
        for (const auto& mode : c_.machine.modes) gain_ += mode.gain;
    }

    std::vector<Candidate> all() {
        constant();
        coulomb();
        viscous();
        asymmetric();
        stribeck();
        presliding();
        position_dependent();
        time_varying();
        ripple();
        spring();
        cubic();
        drag();
        dead_zone();
        saturation();
        thrust_gain();
        payload();
        delay();
        lag();
        mode();
        disturbance();
        encoder();
        backlash();
        return std::move(list_);
    }

  private:
    // Bounds that no plausible machine comes near: forces against the thrust that was used, and so on.
    double force() const { return 20 * thrust_; }

    FitParameter linear(const std::string& name, double most, double typical) const {
        return {name, -most, most, false, 1e-3 * typical + 1e-9 * most};
    }
    static FitParameter factor(const std::string& name, double low, double high) {
        return {name, low, high, true, 1e-3};
    }
    FitParameter angle(const std::string& name) const { return {name, -1e3, 1e3, false, 1e-3}; }
    double typical_force() const { return std::max(rms(d_), 1e-3 * thrust_); }
    // The size at least that a start has, lest the first differences see nothing.
    double sized(double value) const {
        const double least = 0.02 * typical_force();
        return std::abs(value) > least ? value : std::copysign(least, value);
    }

    void add(Candidate candidate) {
        for (auto* points : {&candidate.starts, &candidate.probes}) {
            for (auto& point : *points) {
                for (std::size_t i = 0; i < point.size(); ++i) {
                    const auto& p = candidate.parameters[i];
                    const double room = p.logarithmic ? 0 : 1e-6 * (p.high - p.low);
                    point[i] = std::clamp(point[i], p.low + room, p.high - room);
                }
            }
        }
        if (!candidate.starts.empty() || !candidate.probes.empty()) list_.push_back(std::move(candidate));
    }

    void constant() {
        const double mean = regress({Signal(d_.size(), 1.0)}, d_).coefficients[0];
        add({"constant_force",
             "",
             {linear("F", force(), typical_force())},
             [](std::span<const double> p) {
                 return Json{{"F", p[0]}};
             },
             {{sized(mean)}},
             {},
             {}});
    }

    void coulomb() {
        const double level = -regress({sign_}, d_).coefficients[0];
        const double least = -c_.machine.dry.coulomb;
        std::vector<std::vector<double>> starts{{sized(level)}};
        if (level > 0) starts.push_back({0.5 * level});
        add({"coulomb_friction",
             "",
             {{"dF", least, force(), false, 1e-3 * typical_force()}},
             [](std::span<const double> p) {
                 return Json{{"dF", p[0]}};
             },
             starts,
             {},
             {}});
    }

    void viscous() {
        const double damping = -regress({v_}, d_).coefficients[0];
        const double typical = typical_force() / fastest_;
        add({"viscous_friction",
             "",
             {{"dD", -c_.machine.viscous, 1e3 * typical + 1e3, false, 1e-3 * typical}},
             [](std::span<const double> p) {
                 return Json{{"dD", p[0]}};
             },
             {{std::abs(damping) > 0.02 * typical ? damping : std::copysign(0.02 * typical, damping)}},
             {},
             {}});
    }

    void asymmetric() {
        const Signal forward = map(sign_, [](double s) { return -std::max(s, 0.0); });
        const Signal backward = map(sign_, [](double s) { return std::max(-s, 0.0); });
        const Signal v_forward = map(v_, [](double v) { return -std::max(v, 0.0); });
        const Signal v_backward = map(v_, [](double v) { return std::max(-v, 0.0); });
        const double typical = typical_force(), damping = typical / fastest_;
        const Regression levels = regress({forward, backward}, d_);
        const Regression both = regress({forward, backward, v_forward, v_backward}, d_);
        const double least = -c_.machine.dry.coulomb, least_damping = -c_.machine.viscous;
        const FitParameter positive{"dF_pos", least, force(), false, 1e-3 * typical};
        const FitParameter negative{"dF_neg", least, force(), false, 1e-3 * typical};
        const FitParameter damping_positive{"dD_pos", least_damping, 1e3 * damping + 1e3, false, 1e-3 * damping};
        const FitParameter damping_negative{"dD_neg", least_damping, 1e3 * damping + 1e3, false, 1e-3 * damping};
        const auto make = [](double a, double b, double c, double d) {
            return Json{{"dF_pos", a}, {"dF_neg", b}, {"dD_pos", c}, {"dD_neg", d}};
        };
        add({"asymmetric_friction",
             "one direction, forward",
             {positive},
             [make](std::span<const double> p) { return make(p[0], 0, 0, 0); },
             {{sized(regress({forward}, d_).coefficients[0])}},
             {},
             {}});
        add({"asymmetric_friction",
             "one direction, backward",
             {negative},
             [make](std::span<const double> p) { return make(0, p[0], 0, 0); },
             {{sized(regress({backward}, d_).coefficients[0])}},
             {},
             {}});
        add({"asymmetric_friction",
             "levels",
             {positive, negative},
             [make](std::span<const double> p) { return make(p[0], p[1], 0, 0); },
             {{sized(levels.coefficients[0]), sized(levels.coefficients[1])}},
             {},
             {}});
        add({"asymmetric_friction",
             "levels and damping",
             {positive, negative, damping_positive, damping_negative},
             [make](std::span<const double> p) { return make(p[0], p[1], p[2], p[3]); },
             {{both.coefficients[0], both.coefficients[1], both.coefficients[2], both.coefficients[3]},
              {levels.coefficients[0], levels.coefficients[1], 0, 0}},
             {},
             {}});
    }

    void stribeck() {
        struct Start {
            double explained, level, velocity, exponent;
        };
        std::vector<Start> starts;
        for (const double velocity : geometric(std::max(1e-3 * fastest_, 1e-4), 0.7 * fastest_, 9)) {
            for (const double exponent : {1.0, 2.0}) {
                Signal shape(v_.size());
                for (std::size_t k = 0; k < v_.size(); ++k) {
                    shape[k] = -sign_[k] * std::exp(-std::pow(std::abs(v_[k]) / velocity, exponent));
                }
                const Regression fit = regress({shape}, d_);
                if (fit.coefficients[0] > 0) starts.push_back({fit.explained, fit.coefficients[0], velocity, exponent});
            }
        }
        std::sort(starts.begin(), starts.end(), [](const auto& a, const auto& b) { return a.explained > b.explained; });
        std::vector<std::vector<double>> points;
        for (const auto& start : starts) {
            if (points.size() == 3) break;
            points.push_back({std::max(start.level, 0.05 * typical_force()), start.velocity, start.exponent});
        }
        add({"stribeck_friction",
             "",
             {factor("dFs", 1e-3 * typical_force(), force()), factor("velocity", 1e-5, 3), factor("exponent", 0.3, 4)},
             [](std::span<const double> p) {
                 return Json{{"dFs", p[0]}, {"velocity", p[1]}, {"exponent", p[2]}};
             },
             points,
             {},
             {}});
    }

    void presliding() {
        for (const bool replace : {false, true}) {
            if (replace && c_.machine.dry.coulomb == 0) continue;
            Signal friction = map(d_, [](double d) { return -d; });
            if (replace) {
                for (std::size_t k = 0; k < d_.size(); ++k) friction[k] += c_.machine.dry.coulomb * sign_[k];
            }
            for (const int count : {3, 5, 7}) {
                FrictionFitOptions options;
                options.elements = count;
                options.shortest = 5e-7;
                options.longest = std::max(std::min(stroke_, 2e-3), 4e-6);
                options.optimise = count < 7;
                std::vector<MaxwellSlipElement> elements;
                try {
                    elements = fit_friction(y_, friction, options).elements;
                } catch (const InputError&) {
                    continue; // the residual force holds no friction at all
                }
                double sum = 0;
                for (const auto& element : elements) sum += element.level;
                if (elements.empty() || sum < 0.02 * typical_force()) continue;
                std::vector<double> start;
                for (const auto& element : elements) {
                    start.push_back(std::max(element.level, 1e-3 * sum));
                    start.push_back(element.limit());
                }
                add(maxwell_slip({1e-4 * sum, 3 * force(), 5e-8, std::max(stroke_, 1e-5), replace}, start));
                if (static_cast<int>(elements.size()) < count) break;
            }
        }
    }

    bool has_friction() const { return largest(c_.residual.friction) > 1e-3 * thrust_; }

    void position_dependent() {
        if (!has_friction() || stroke_ < 1e-6) return;
        const Signal friction = map(c_.residual.friction, [](double f) { return -f; });
        std::vector<std::vector<double>> starts;
        for (const auto& one : sinusoids(y_, d_, friction, stroke_ / 40, 1.5 * stroke_, 3)) {
            starts.push_back({std::clamp(one.amplitude, 0.03, 0.9), one.period, one.phase});
        }
        add({"position_dependent_friction",
             "sine",
             {{"a", 0, 3, false, 1e-3}, factor("period_m", stroke_ / 60, 3 * stroke_), angle("phase")},
             [](std::span<const double> p) {
                 return Json{{"mode", "sine"}, {"a", p[0]}, {"period_m", p[1]}, {"phase", p[2]}};
             },
             starts,
             {},
             {}});
        std::vector<std::vector<double>> gradients;
        for (const double period : {1.2 * reach_, 0.5 * reach_}) {
            Signal shape(y_.size());
            for (std::size_t k = 0; k < y_.size(); ++k) shape[k] = friction[k] * std::clamp(y_[k] / period, -1.0, 1.0);
            gradients.push_back({std::clamp(regress({shape}, d_).coefficients[0], -2.0, 2.0), period});
        }
        add({"position_dependent_friction",
             "gradient",
             {{"a", -5, 5, false, 1e-3}, factor("period_m", 0.05 * reach_, 20 * reach_)},
             [](std::span<const double> p) {
                 return Json{{"mode", "gradient"}, {"a", p[0]}, {"period_m", p[1]}, {"phase", 0.0}};
             },
             gradients,
             {},
             {}});
    }

    void time_varying() {
        if (!has_friction()) return;
        const Signal& t = c_.residual.time;
        const Signal friction = map(c_.residual.friction, [](double f) { return -f; });
        const auto size_of = [&](const auto& shape) {
            Signal column(t.size());
            for (std::size_t k = 0; k < t.size(); ++k) column[k] = friction[k] * shape(t[k]);
            return regress({column}, d_);
        };
        std::vector<std::pair<double, std::vector<double>>> exponentials;
        for (const double T : geometric(0.05 * duration_, 2 * duration_, 6)) {
            const Regression fit = size_of([T](double at) { return 1 - std::exp(-at / T); });
            exponentials.push_back({fit.explained, {std::clamp(fit.coefficients[0], -0.9, 3.0), T}});
        }
        std::sort(exponentials.rbegin(), exponentials.rend());
        exponentials.resize(2);
        std::vector<std::vector<double>> starts;
        for (const auto& [explained, point] : exponentials) starts.push_back(point);
        const auto make = [](const char* kind, double a, double T) { return Json{{"kind", kind}, {"a", a}, {"T", T}}; };
        add({"time_varying_friction",
             "exp",
             {{"a", -0.98, 10, false, 1e-3}, factor("T", 0.01 * duration_, 10 * duration_)},
             [make](std::span<const double> p) { return make("exp", p[0], p[1]); },
             starts,
             {},
             {}});
        // Of a ramp only a/T shows; T is set to 10 s.
        constexpr double ramp = 10;
        const double slope = size_of([](double at) { return at / ramp; }).coefficients[0];
        add({"time_varying_friction",
             "ramp",
             {{"a", -0.98 * ramp / duration_, 100, false, 1e-3}},
             [make](std::span<const double> p) { return make("ramp", p[0], ramp); },
             {{slope}},
             {},
             {}});
        std::vector<std::pair<double, std::vector<double>>> sines;
        for (const double T : geometric(0.1 * duration_, 2 * duration_, 14)) {
            const Regression fit = size_of([T](double at) { return std::sin(two_pi * at / T); });
            sines.push_back({fit.explained, {std::clamp(fit.coefficients[0], -0.9, 0.9), T}});
        }
        std::sort(sines.rbegin(), sines.rend());
        starts = {sines[0].second, sines[1].second};
        add({"time_varying_friction",
             "sine",
             {{"a", -0.99, 0.99, false, 1e-3}, factor("T", 0.02 * duration_, 4 * duration_)},
             [make](std::span<const double> p) { return make("sine", p[0], p[1]); },
             starts,
             {},
             {}});
    }

    void ripple() {
        if (stroke_ < 1e-6) return;
        const double shortest = std::max(stroke_ / 60, 2e-6), longest = stroke_;
        const auto harmonic = [](double F, double period, double phase) {
            return Json{{"F", F}, {"period_m", period}, {"phase", phase}};
        };
        std::vector<std::vector<double>> one, two;
        for (const auto& first : sinusoids(y_, d_, {}, shortest, longest, 3)) {
            one.push_back({std::max(first.amplitude, 0.05 * typical_force()), first.period, first.phase});
            Signal rest = d_;
            for (std::size_t k = 0; k < rest.size(); ++k) {
                rest[k] -= first.amplitude * std::sin(two_pi * y_[k] / first.period + first.phase);
            }
            for (const auto& second : sinusoids(y_, rest, {}, shortest, longest, 1)) {
                two.push_back({std::max(first.amplitude, 0.05 * typical_force()), first.period, first.phase,
                               std::max(second.amplitude, 0.01 * typical_force()), second.period, second.phase});
            }
        }
        if (two.size() > 2) two.resize(2);
        const FitParameter F = factor("harmonics[1].F", 1e-4 * typical_force(), force());
        const FitParameter period = factor("harmonics[1].period_m", shortest, longest);
        add({"force_ripple",
             "one harmonic",
             {F, period, angle("harmonics[1].phase")},
             [harmonic](std::span<const double> p) {
                 return Json{{"harmonics", Json::array({harmonic(p[0], p[1], p[2])})}};
             },
             one,
             {},
             {}});
        add({"force_ripple",
             "two harmonics",
             {F, period, angle("harmonics[1].phase"), factor("harmonics[2].F", 1e-4 * typical_force(), force()),
              factor("harmonics[2].period_m", shortest, longest), angle("harmonics[2].phase")},
             [harmonic](std::span<const double> p) {
                 return Json{{"harmonics", Json::array({harmonic(p[0], p[1], p[2]), harmonic(p[3], p[4], p[5])})}};
             },
             two,
             {},
             {}});
    }

    void spring() {
        const Regression fit = regress({map(y_, [](double y) { return -y; }), Signal(y_.size(), 1.0)}, d_);
        const double k = fit.coefficients[0], typical = typical_force() / reach_;
        const double stiffness = std::abs(k) > 0.02 * typical ? k : std::copysign(0.02 * typical, k);
        const double middle = std::clamp(fit.coefficients[1] / stiffness, low_ - stroke_, high_ + stroke_);
        const FitParameter open{"k", -1e3 * typical, 1e3 * typical, false, 1e-3 * typical};
        add({"spring_force",
             "about zero",
             {open},
             [](std::span<const double> p) {
                 return Json{{"k", p[0]}, {"y0", 0.0}};
             },
             {{stiffness}},
             {},
             {}});
        add({"spring_force",
             "",
             {open, {"y0", low_ - 2 * stroke_, high_ + 2 * stroke_, false, 1e-3 * stroke_}},
             [](std::span<const double> p) {
                 return Json{{"k", p[0]}, {"y0", p[1]}};
             },
             {{stiffness, middle}},
             {},
             {}});
    }

    void cubic() {
        const double typical = typical_force() / std::pow(reach_, 3);
        const auto shape = [this](double y0) { return map(y_, [y0](double y) { return -std::pow(y - y0, 3); }); };
        struct Start {
            double explained, k3, y0;
        };
        std::vector<Start> starts;
        for (int i = 0; i <= 12; ++i) {
            const double y0 = low_ - 0.25 * stroke_ + stroke_ * 1.5 * i / 12;
            const Regression fit = regress({shape(y0)}, d_);
            starts.push_back({fit.explained, fit.coefficients[0], y0});
        }
        std::sort(starts.begin(), starts.end(), [](const auto& a, const auto& b) { return a.explained > b.explained; });
        const double about_zero = regress({shape(0)}, d_).coefficients[0];
        const FitParameter open{"k3", -1e3 * typical, 1e3 * typical, false, 1e-3 * typical};
        const auto least = [typical](double k3) {
            return std::abs(k3) > 0.02 * typical ? k3 : std::copysign(0.02 * typical, k3);
        };
        add({"cubic_stiffness",
             "about zero",
             {open},
             [](std::span<const double> p) {
                 return Json{{"k3", p[0]}, {"y0", 0.0}};
             },
             {{least(about_zero)}},
             {},
             {}});
        add({"cubic_stiffness",
             "",
             {open, {"y0", low_ - stroke_, high_ + stroke_, false, 1e-3 * stroke_}},
             [](std::span<const double> p) {
                 return Json{{"k3", p[0]}, {"y0", p[1]}};
             },
             {{least(starts[0].k3), starts[0].y0}},
             {},
             {}});
    }

    void drag() {
        const double c = -regress({map(v_, [](double v) { return v * std::abs(v); })}, d_).coefficients[0];
        const double typical = typical_force() / (fastest_ * fastest_);
        add({"quadratic_drag",
             "",
             {{"c", -0.2 * std::abs(c) - typical, 1e3 * typical, false, 1e-3 * typical}},
             [](std::span<const double> p) {
                 return Json{{"c", p[0]}};
             },
             {{std::max(c, 0.02 * typical)}},
             {},
             {}});
    }

    // Shapes of u: the thrust that an amplifier makes of the reference, less the reference.
    void dead_zone() {
        const Signal& u = c_.residual.reference_thrust;
        std::vector<std::pair<double, std::vector<double>>> starts;
        for (const double width : geometric(0.01 * thrust_, 0.8 * thrust_, 10)) {
            const Regression fit =
                regress({map(u, [width](double value) { return -std::clamp(value, -width, width); })}, d_);
            // The right width has the coefficient one.
            starts.push_back({std::abs(fit.coefficients[0] - 1), {width}});
        }
        std::sort(starts.begin(), starts.end());
        add({"dead_zone",
             "",
             {factor("half_width", 1e-3 * thrust_, 2 * thrust_)},
             [](std::span<const double> p) {
                 return Json{{"half_width", p[0]}};
             },
             {starts[0].second, starts[1].second},
             {},
             {}});
    }

    void saturation() {
        std::vector<std::vector<double>> probes;
        for (const double share : geometric(0.05, 0.98, 18)) probes.push_back({share * thrust_});
        add({"thrust_saturation",
             "",
             {factor("limit", 0.02 * thrust_, thrust_)},
             [](std::span<const double> p) {
                 return Json{{"limit", p[0]}};
             },
             {},
             probes,
             {}});
    }

    void thrust_gain() {
        const double gain = 1 + regress({c_.residual.thrust}, d_).coefficients[0];
        add({"thrust_gain",
             "",
             {factor("gain", 0.05, 20)},
             [](std::span<const double> p) {
                 return Json{{"gain", p[0]}};
             },
             {{std::clamp(gain, 0.3, 3.0)}, {gain > 1 ? 1.1 : 0.9}},
             {},
             {}});
    }

    void payload() {
        if (c_.machine.rigid_gain == 0) return;
        const double ratio = -regress({c_.residual.inertial}, d_).coefficients[0];
        add({"payload_mass",
             "",
             {factor("1 + ratio", 0.1, 20)},
             [](std::span<const double> p) {
                 return Json{{"ratio", p[0] - 1}};
             },
             {{1 + std::clamp(ratio, -0.6, 2.0)}, {ratio > 0 ? 1.1 : 0.9}},
             {},
             {}});
    }

    void delay() {
        const double extra = -regress({c_.residual.thrust_rate}, d_).coefficients[0];
        const double least = -c_.machine.input_delay, most = 0.01;
        std::vector<std::vector<double>> starts{{std::clamp(extra, 0.9 * least, 3e-3)}};
        for (const double other : {2e-4, 6e-4, 1.2e-3, -2e-4}) starts.push_back({std::max(other, 0.9 * least)});
        add({"input_delay",
             "",
             {{"extra_s", least, most, false, 2e-6}},
             [](std::span<const double> p) {
                 return Json{{"extra_s", p[0]}};
             },
             {},
             starts,
             {}});
    }

    void lag() {
        const double present = c_.machine.current_loop_hz > 0 ? c_.machine.current_loop_hz : 2000;
        std::vector<std::vector<double>> probes;
        for (const double share : {0.85, 0.6, 0.4, 0.25, 0.15, 0.08, 1.3}) probes.push_back({share * present});
        add({"actuator_lag",
             "",
             {factor("current_loop_hz", 5, 20 * present)},
             [](std::span<const double> p) {
                 return Json{{"current_loop_hz", p[0]}};
             },
             {},
             probes,
             {}});
    }

    void mode() {
        std::vector<std::vector<double>> probes;
        for (const double f : geometric(6, std::min(400.0, 0.3 / c_.machine.sample_time), 26)) {
            probes.push_back({0.03 * gain_, f, 0.02});
        }
        add({"resonant_mode",
             "",
             {factor("gain", 1e-5 * gain_, 20 * gain_), factor("freq_hz", 2, 0.45 / c_.machine.sample_time),
              factor("zeta", 5e-4, 0.7)},
             [](std::span<const double> p) {
                 return Json{{"gain", p[0]}, {"freq_hz", p[1]}, {"zeta", p[2]}};
             },
             {},
             probes,
             0});
    }

    void disturbance() {
        const Signal& t = c_.residual.time;
        std::vector<std::vector<double>> starts;
        for (const auto& one : sinusoids(t, d_, {}, 1 / (1.2 * c_.residual.bandwidth), duration_ / 2, 3)) {
            starts.push_back({std::max(one.amplitude, 0.02 * typical_force()), 1 / one.period, one.phase});
        }
        // Above the band of the residual force the errors themselves show it.
        Signal time(c_.whitened.size());
        for (std::size_t k = 0; k < time.size(); ++k) time[k] = static_cast<double>(k) * c_.machine.sample_time;
        for (const auto& one : sinusoids(time, c_.whitened, {}, 4 * c_.machine.sample_time, 0.1, 1)) {
            starts.push_back({typical_force(), 1 / one.period, 0});
            starts.push_back({typical_force(), 1 / one.period, 2});
            starts.push_back({typical_force(), 1 / one.period, 4});
        }
        add({"periodic_disturbance",
             "",
             {factor("F", 1e-4 * typical_force(), 3 * force()),
              factor("freq_hz", 0.5 / duration_, 0.45 / c_.machine.sample_time), angle("phase")},
             [](std::span<const double> p) {
                 return Json{{"F", p[0]}, {"freq_hz", p[1]}, {"phase", p[2]}};
             },
             {},
             starts,
             {}});
    }

    void encoder() {
        const Signal& y = c_.measurement.position();
        const double shortest = std::max({4e-6, 4 * c_.machine.encoder_resolution, stroke_ / 20000});
        const double longest = std::min(0.5 * stroke_, 0.05);
        std::vector<std::vector<double>> one, two;
        for (const auto& found : sinusoids(y, c_.whitened, {}, shortest, longest, 3)) {
            const double A = found.amplitude * c_.innovation;
            one.push_back({A, found.period, found.phase});
            two.push_back({A, found.period, found.phase, 0.1 * A, 0});
            two.push_back({A, found.period, found.phase, 0.1 * A, 3});
        }
        const FitParameter A = factor("A", 1e-3 * c_.innovation, 0.3 * stroke_);
        const FitParameter period = factor("period_m", shortest / 2, longest);
        const auto make = [](double a, double p, double phase, double a2, double phase2) {
            return Json{{"A", a}, {"period_m", p}, {"phase", phase}, {"A2", a2}, {"phase2", phase2}};
        };
        add({"encoder_periodic_error",
             "fundamental",
             {A, period, angle("phase")},
             [make](std::span<const double> p) { return make(p[0], p[1], p[2], 0, 0); },
             one,
             {},
             {}});
        if (two.size() > 2) two.resize(2);
        add({"encoder_periodic_error",
             "two harmonics",
             {A, period, angle("phase"), factor("A2", 1e-3 * c_.innovation, 0.3 * stroke_), angle("phase2")},
             [make](std::span<const double> p) { return make(p[0], p[1], p[2], p[3], p[4]); },
             two,
             {},
             {}});
    }

    void backlash() {
        if (!c_.machine.modes.empty() || c_.machine.rigid_gain == 0) return;
        for (const char* sensor : {"motor", "load"}) {
            std::vector<std::vector<double>> probes;
            for (const double gap : geometric(4e-6, 2e-4, 12)) {
                for (const double share : {0.2, 0.35, 0.5, 0.65}) {
                    for (const double contact : {160.0, 240.0, 340.0}) probes.push_back({gap, share, contact, 0.2});
                }
            }
            add({"backlash",
                 sensor,
                 // Steps of differences are small, lest a contact come or go within one.
                 {{"gap_m", 1e-7, 5e-3, true, 1e-4},
                  {"load_fraction", 0.03, 0.97, false, 1e-4},
                  {"contact_hz", 30, 2000, true, 1e-4},
                  {"contact_zeta", 5e-3, 2, true, 1e-4}},
                 [sensor](std::span<const double> p) {
                     return Json{{"gap_m", p[0]},
                                 {"load_fraction", p[1]},
                                 {"contact_hz", p[2]},
                                 {"contact_zeta", p[3]},
                                 {"sensor", sensor}};
                 },
                 {},
                 probes,
                 {},
                 3,
                 {},
                 true});
        }
    }

    const Clues& c_;
    const Signal &d_, &y_, &v_;
    Signal sign_;
    double low_, high_, stroke_, reach_, fastest_, thrust_, duration_, gain_;
    std::vector<Candidate> list_;
};

} // namespace

Effect Candidate::at(std::span<const double> values) const {
    const Json description{{"name", effect}, {"parameters", make(values)}};
    FieldReader fields(description, "diagnosis");
    return Effect::read(fields);
}

std::vector<Candidate> candidates(const Clues& clues) { return Proposer(clues).all(); }

} // namespace tribode
