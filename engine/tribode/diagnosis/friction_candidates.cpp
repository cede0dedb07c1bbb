#include "tribode/analysis/friction_identification.hpp"
#include "tribode/base/error.hpp"
#include "tribode/diagnosis/proposer.hpp"

#include <algorithm>
#include <cmath>
#include <fmt/format.h>
#include <numbers>

namespace tribode {

namespace {

constexpr double two_pi = 2 * std::numbers::pi;

struct MaxwellSlipBounds {
    double min_level, max_level, min_reach, max_reach;
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
            {fmt::format("elements[{}].F", i), bounds.min_level, bounds.max_level, true, 1e-3});
        candidate.parameters.push_back(
            {fmt::format("elements[{}].X", i), bounds.min_reach, bounds.max_reach, true, 1e-3});
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
            next.push_back(std::min(next[i + 1] * std::sqrt(3.0), bounds.max_reach));
            next[i + 1] = std::max(next[i + 1] / std::sqrt(3.0), bounds.min_reach);
            starts.push_back(std::move(next));
        }
        Candidate more = maxwell_slip(bounds, starts.front());
        more.starts = std::move(starts);
        return std::make_shared<const Candidate>(std::move(more));
    };
    return candidate;
}

} // namespace

void Proposer::coulomb() {
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

void Proposer::viscous() {
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

void Proposer::asymmetric() {
    const Signal forward = map(sign_, [](double s) { return -std::max(s, 0.0); });
    const Signal backward = map(sign_, [](double s) { return std::max(-s, 0.0); });
    const Signal v_forward = map(v_, [](double v) { return -std::max(v, 0.0); });
    const Signal v_backward = map(v_, [](double v) { return std::max(-v, 0.0); });
    const double typical = typical_force(), damping = typical / fastest_;
    const Regression levels = regress({forward, backward}, d_);
    const Regression both = regress({forward, backward, v_forward, v_backward}, d_);
    const double least = -c_.machine.dry.coulomb, min_damping = -c_.machine.viscous;
    const FitParameter positive{"dF_pos", least, force(), false, 1e-3 * typical};
    const FitParameter negative{"dF_neg", least, force(), false, 1e-3 * typical};
    const FitParameter damping_positive{"dD_pos", min_damping, 1e3 * damping + 1e3, false, 1e-3 * damping};
    const FitParameter damping_negative{"dD_neg", min_damping, 1e3 * damping + 1e3, false, 1e-3 * damping};
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

void Proposer::stribeck() {
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

void Proposer::presliding() {
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

bool Proposer::has_friction() const { return largest(c_.residual.friction) > 1e-3 * thrust_; }

void Proposer::position_dependent() {
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

void Proposer::time_varying() {
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

} // namespace tribode
