#include "tribode/design/s_curve_feedforward.hpp"
#include "tribode/base/error.hpp"
#include "tribode/base/text.hpp"
#include "tribode/design/discrete_plant.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <fmt/format.h>
#include <numbers>

namespace tribode {

namespace {

struct Impulse {
    double t;     // [s]
    double share; // of the whole
};

std::vector<Impulse> shaper(const VibrationMode& mode, int derivatives) {
    if (!(mode.zeta < 1)) {
        throw InputError(fmt::format("input shaping: the mode at {} Hz has zeta = {}, must be below 1",
                                     to_text(mode.freq_hz), to_text(mode.zeta)));
    }
    const double root = std::sqrt(1 - mode.zeta * mode.zeta), half_period = 1 / (2 * mode.freq_hz * root);
    const double decay = std::exp(-std::numbers::pi * mode.zeta / root), whole = 1 + decay;
    if (derivatives == 0) return {{0, 1 / whole}, {half_period, decay / whole}};
    return {{0, 1 / (whole * whole)},
            {half_period, 2 * decay / (whole * whole)},
            {2 * half_period, decay * decay / (whole * whole)}};
}

void require_rigid(const ModalModel& model, const char* method) {
    if (model.rigid_gain > 0) return;
    throw InputError(fmt::format("{}: the model has the rigid gain {} m/(N s^2), must be positive", method,
                                 to_text(model.rigid_gain)));
}

} // namespace

SCurve::SCurve(double distance, double duration)
    : distance_(distance),
      duration_(duration),
      snap_(distance / (8 * std::pow(duration / 8, 4))) {}

// The snap jumps by these multiples of S at i h; its n-fold integral is the sum of jump (t - i h)^n / n!.
double SCurve::integral(int times, double t) const {
    constexpr std::array<int, 9> jumps = {1, -2, 0, 2, -2, 2, 0, -2, 1};
    double sum = 0;
    for (std::size_t i = 0; i < jumps.size(); ++i) {
        const double since = t - static_cast<double>(i) * duration_ / 8;
        if (since > 0) sum += jumps[i] * std::pow(since, times) / std::tgamma(times + 1);
    }
    return snap_ * sum;
}

double SCurve::position(double t) const { return t >= duration_ ? distance_ : integral(4, t); }

double SCurve::mean_acceleration(double t, double span) const {
    const auto velocity = [&](double at) { return at >= duration_ ? 0.0 : integral(3, at); };
    return (velocity(t + span) - velocity(t)) / span;
}

double SCurve::mean_snap(double t, double span) const {
    const auto jerk = [&](double at) { return at >= duration_ ? 0.0 : integral(1, at); };
    return (jerk(t + span) - jerk(t)) / span;
}

Feedforward s_curve_feedforward(const ModalModel& model, const MoveTask& task) {
    require_rigid(model, "S-curve");
    const double ts = task.sample_time, k0 = model.rigid_gain;
    const SCurve path(task.distance, static_cast<double>(task.settling_sample()) * ts);
    double compliance = 0; // sum k_j/w_j^2 [m/N]
    for (const auto& mode : model.modes) compliance += mode.gain / std::pow(2 * std::numbers::pi * mode.freq_hz, 2);
    Feedforward result{"s_curve", task, {}, {}};
    for (std::size_t k = 0; k < task.length(); ++k) {
        const double t = static_cast<double>(k) * ts;
        result.reference.push_back(path.position(t));
        result.thrust.push_back(path.mean_acceleration(t, ts) / k0 - compliance / (k0 * k0) * path.mean_snap(t, ts));
    }
    return result;
}

Feedforward shaped_feedforward(const ModalModel& model, const MoveTask& task, int derivatives, int modes) {
    require_rigid(model, "input shaping");
    auto shaped = model.modes;
    std::sort(shaped.begin(), shaped.end(), [](const auto& a, const auto& b) { return a.freq_hz < b.freq_hz; });
    if (modes > 0) shaped.resize(std::min(shaped.size(), static_cast<std::size_t>(modes)));
    std::vector<Impulse> impulses = {{0, 1}};
    for (const auto& mode : shaped) {
        std::vector<Impulse> longer;
        for (const auto& [t, share] : impulses) {
            for (const auto& own : shaper(mode, derivatives)) longer.push_back({t + own.t, share * own.share});
        }
        impulses = std::move(longer);
    }
    const double ts = task.sample_time, duration = static_cast<double>(task.settling_sample()) * ts;
    const double left = duration - impulses.back().t;
    if (left < 8 * ts) {
        throw InputError(fmt::format("input shaping: the shapers take {} s of {} s and leave {} s for the path, must "
                                     "leave 8 samples; shape fewer modes or take zv",
                                     to_text(impulses.back().t), to_text(duration), to_text(left)));
    }
    const SCurve path(task.distance, left);
    Feedforward result{"input_shaping", task, {}, std::vector<double>(task.length())};
    for (std::size_t k = 0; k < task.length(); ++k) {
        for (const auto& [t, share] : impulses) {
            const double acceleration = path.mean_acceleration(static_cast<double>(k) * ts - t, ts);
            result.thrust[k] += share * acceleration / model.rigid_gain;
        }
    }
    result.reference = DiscretePlant(model, ts).simulate(result.thrust);
    return result;
}

} // namespace tribode
