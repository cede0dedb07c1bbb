#include "tribode/analysis/friction_loop.hpp"

#include <algorithm>
#include <cmath>
#include <numbers>

namespace tribode {

using std::numbers::pi;
using Complex = std::complex<double>;

FrictionLoop::AtAmplitude FrictionLoop::at(double amplitude) const {
    return {describing_function(elements, amplitude), laws ? laws(amplitude) : nullptr};
}

Complex FrictionLoop::plant_response(const AtAmplitude& n, double frequency_hz) const {
    // Friction that sticks without any damping is a spring, whose resonance has its poles on the limit of stability, where the
    // angle of 1 + L jumps by half a turn one way or the other. A little loss, as all friction has, puts them on the stable side.
    constexpr Complex lossy(1, 1e-6);
    const Complex loss = viscous == 0 ? lossy : 1;
    // At the images of the hold the motion is not the sine that N belongs to; inertia is far greater than N there.
    const auto with_friction = [&](double f) {
        const Complex s(0, 2 * pi * std::abs(f)), p = plant.response(std::abs(f));
        const Complex response = p / (1.0 + p * (loss * n(s, std::abs(f)) + viscous * s));
        return f < 0 ? std::conj(response) : response;
    };
    return sampled_response(with_friction, delays, frequency_hz);
}

Complex FrictionLoop::model_response(const AtAmplitude& n, double frequency_hz) const {
    const double ts = delays.sample_time;
    const Complex velocity = (1.0 - std::polar(1.0, -2 * pi * frequency_hz * ts)) / ts;
    return n(velocity, frequency_hz) + viscous * velocity;
}

std::function<Complex(double)> FrictionLoop::loop_gain(double friction_feedback, double amplitude) const {
    return [this, friction_feedback, n = at(amplitude)](double f) {
        return plant_response(n, f) * (controller(f) - friction_feedback * model_response(n, f));
    };
}

FrictionLoop::Stability FrictionLoop::stability(double friction_feedback, double amplitude, double f_min_hz,
                                                double f_max_hz) const {
    constexpr int count = 20000; // a lightly damped mode turns the phase within a few parts in a thousand
    const AtAmplitude n = at(amplitude);
    std::vector<double> frequency;
    std::vector<Complex> plain, fed_back; // L = plain - p fed_back
    for (int i = 0; i < count; ++i) {
        frequency.push_back(f_min_hz * std::pow(f_max_hz / f_min_hz, i / (count - 1.0)));
        const Complex g = plant_response(n, frequency.back());
        plain.push_back(g * controller(frequency.back()));
        fed_back.push_back(g * model_response(n, frequency.back()));
    }
    const auto is_stable = [&](double share) {
        const auto difference = [&](std::size_t i) { return 1.0 + plain[i] - share * fed_back[i]; };
        double angle = std::arg(difference(0));
        if (angle > pi / 3) angle -= 2 * pi;
        for (std::size_t i = 1; i < frequency.size(); ++i) angle += std::arg(difference(i) / difference(i - 1));
        return std::abs(angle) < pi / 2;
    };

    std::vector<CriticalFeedback> crossings;
    const auto share_at = [&](std::size_t i) { return (1.0 + plain[i]) / fed_back[i]; };
    for (std::size_t i = 1; i < frequency.size(); ++i) {
        const Complex before = share_at(i - 1), now = share_at(i);
        if ((before.imag() < 0) == (now.imag() < 0)) continue;
        const double part = before.imag() / (before.imag() - now.imag());
        const double share = before.real() + part * (now.real() - before.real());
        if (share > 0) crossings.push_back({share, frequency[i - 1] + part * (frequency[i] - frequency[i - 1])});
    }
    // Without an integrator the right side is real at standstill, where no sign of its imaginary part changes.
    const Complex standstill = share_at(0);
    if (standstill.real() > 0 && std::abs(standstill.imag()) < 0.01 * standstill.real()) {
        crossings.push_back({standstill.real(), 0});
    }
    std::ranges::sort(crossings, {}, &CriticalFeedback::share);

    Stability result{is_stable(friction_feedback), std::nullopt};
    bool stable_below = !crossings.empty() && is_stable(0.5 * crossings.front().share);
    for (std::size_t i = 0; i < crossings.size() && !result.critical; ++i) {
        const double share = crossings[i].share;
        const double above = i + 1 < crossings.size() ? 0.5 * (share + crossings[i + 1].share) : 2 * share;
        const bool stable_above = is_stable(above);
        if (stable_below && !stable_above) result.critical = crossings[i];
        stable_below = stable_above;
    }
    return result;
}

} // namespace tribode
