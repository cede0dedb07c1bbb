#include "tribode/diagnosis/proposer.hpp"

#include <algorithm>
#include <cmath>
#include <numbers>

namespace tribode {

namespace {

constexpr double two_pi = 2 * std::numbers::pi;

} // namespace

void Proposer::constant() {
    const double mean = regress({Signal(d_.size(), 1.0)}, d_).coefficients[0];
    add({"constant_force",
         "",
         {{"F", -force(), force(), false, 1e-3 * typical_force() + 1e-9 * force()}},
         [](std::span<const double> p) {
             return Json{{"F", p[0]}};
         },
         {{sized(mean)}},
         {},
         {}});
}

void Proposer::ripple() {
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

void Proposer::spring() {
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

void Proposer::cubic() {
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

void Proposer::drag() {
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

void Proposer::disturbance() {
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

} // namespace tribode
