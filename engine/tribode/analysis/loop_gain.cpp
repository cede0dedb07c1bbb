#include "tribode/analysis/loop_gain.hpp"

#include <algorithm>
#include <cmath>
#include <numbers>

namespace tribode {

using std::numbers::pi;

std::complex<double> sampled_response(const ModalModel& plant, const LoopDelays& delays, double frequency_hz) {
    return sampled_response([&plant](double f) { return plant.response(f); }, delays, frequency_hz);
}

std::complex<double> sampled_response(const std::function<std::complex<double>(double frequency_hz)>& plant,
                                      const LoopDelays& delays, double frequency_hz) {
    const double ts = delays.sample_time;
    std::complex<double> sum = 0;
    for (int n = -10; n <= 10; ++n) {
        const double f = frequency_hz + n / ts;
        const std::complex<double> s(0, 2 * pi * f);
        const auto hold = (1.0 - std::exp(-s * ts)) / s;
        const auto lag = delays.lag_hz > 0 ? 1.0 + s / (2 * pi * delays.lag_hz) : 1.0;
        sum += hold * std::exp(-s * delays.dead_time) * plant(f) / lag;
    }
    return sum / ts;
}

StabilityMargins stability_margins(const std::function<std::complex<double>(double)>& loop_gain, double f_min_hz,
                                   double f_max_hz) {
    constexpr int count = 20000;
    StabilityMargins margins;
    std::complex<double> before = loop_gain(f_min_hz);
    double f_before = f_min_hz;
    margins.modulus_margin = std::abs(1.0 + before);
    for (int i = 1; i < count; ++i) {
        const double f = f_min_hz * std::pow(f_max_hz / f_min_hz, i / (count - 1.0));
        const std::complex<double> now = loop_gain(f);
        margins.modulus_margin = std::min(margins.modulus_margin, std::abs(1.0 + now));
        if (before.imag() * now.imag() <= 0 && before.imag() != now.imag()) {
            const double part = before.imag() / (before.imag() - now.imag());
            const double real = before.real() + part * (now.real() - before.real());
            if (real < 0 && real > -1 && (!margins.gain_margin || -1 / real < *margins.gain_margin)) {
                margins.gain_margin = -1 / real;
                margins.phase_crossover_hz = f_before + part * (f - f_before);
            }
            if (real <= -1)
                margins.gain_reduction_margin = std::max(margins.gain_reduction_margin.value_or(0), -1 / real);
        }
        const double level_before = std::log(std::abs(before)), level = std::log(std::abs(now));
        if (level_before * level <= 0 && level_before != level) {
            const double part = level_before / (level_before - level);
            const double angle = std::abs(std::arg(-(before + part * (now - before)))) * 180 / pi;
            if (!margins.phase_margin_deg || angle < *margins.phase_margin_deg) {
                margins.phase_margin_deg = angle;
                margins.gain_crossover_hz = f_before + part * (f - f_before);
            }
        }
        before = now;
        f_before = f;
    }
    return margins;
}

} // namespace tribode
