#include "tribode/experiment/friction_describing_function.hpp"
#include "tribode/analysis/describing_function.hpp"
#include "tribode/base/error.hpp"
#include "tribode/base/text.hpp"

#include <algorithm>
#include <cmath>
#include <fmt/format.h>
#include <memory>
#include <numbers>

namespace tribode {

namespace {

using Complex = std::complex<double>;
using std::numbers::pi;

constexpr int points_per_period = 400;

// Of dry friction, whose force is in phase with the velocity: 4/(pi a) times the mean of the level, weighted by the speed.
Complex dry_describing_function(const DryFriction& dry, double amplitude, double frequency_hz) {
    if (!dry.present()) return 0;
    // Midpoints in the sine of the phase, whose rate is the speed.
    double sum = 0;
    for (int i = 0; i < points_per_period; ++i) {
        const double part = (i + 0.5) / points_per_period;
        sum += dry.level(2 * pi * frequency_hz * amplitude * std::sqrt(1 - part * part));
    }
    return {0, 4 / (pi * amplitude) * sum / points_per_period};
}

} // namespace

Complex law_describing_function(const std::vector<Effect>& laws, double amplitude, double frequency_hz, double load) {
    if (laws.empty()) return 0;
    constexpr double settled = 1e-6;
    constexpr int max_periods = 200;
    SampledLaws sampled(laws, 1 / (frequency_hz * points_per_period));
    const double speed = 2 * pi * frequency_hz * amplitude;
    Complex last = 0;
    for (int period = 0; period < max_periods; ++period) {
        Complex sum = 0;
        for (int i = 0; i < points_per_period; ++i) {
            const double angle = 2 * pi * i / points_per_period;
            sampled.step(amplitude * std::sin(angle), load);
            sum += sampled.force(speed * std::cos(angle)) * std::polar(1.0, -angle);
        }
        const Complex now = sum * Complex(0, 2.0 / (points_per_period * amplitude)); // over -ja, the phasor of the sine
        if (period > 1 && std::abs(now - last) <= settled * std::abs(now)) return now;
        last = now;
    }
    return last;
}

std::function<Complex(double)> law_describing_table(const std::vector<Effect>& laws, double amplitude, double f_min_hz,
                                                    double f_max_hz) {
    constexpr double per_decade = 16;
    const auto steps = static_cast<std::size_t>(std::ceil(per_decade * std::log10(f_max_hz / f_min_hz)));
    const double ratio = std::log(f_max_hz / f_min_hz) / static_cast<double>(steps);
    constexpr double no_load = 0;
    auto table = std::make_shared<std::vector<Complex>>();
    for (std::size_t i = 0; i <= steps; ++i) {
        const double f = f_min_hz * std::exp(ratio * static_cast<double>(i));
        table->push_back(law_describing_function(laws, amplitude, f, no_load));
    }
    return [table, f_min_hz, ratio](double f) {
        const double place = std::clamp(std::log(f / f_min_hz) / ratio, 0.0, static_cast<double>(table->size() - 1));
        const auto i = std::min(static_cast<std::size_t>(place), table->size() - 2);
        const double part = place - static_cast<double>(i);
        return (1 - part) * (*table)[i] + part * (*table)[i + 1];
    };
}

FrequencyResponse friction_describing_function(const FrictionModel& model, const std::vector<double>& amplitude,
                                               const std::vector<double>& frequency_hz, double load) {
    if (amplitude.size() != 1 && amplitude.size() != frequency_hz.size()) {
        throw InputError(fmt::format("amplitude_m has {} entries, must be one or {}, as many as frequency_hz has",
                                     amplitude.size(), frequency_hz.size()));
    }
    FrequencyResponse response;
    for (std::size_t i = 0; i < frequency_hz.size(); ++i) {
        const double f = frequency_hz[i], a = amplitude[amplitude.size() == 1 ? 0 : i];
        const Complex s(0, 2 * pi * f);
        response.frequency_hz.push_back(f);
        response.value.push_back(describing_function(model.elements, a)(s) + model.viscous * s +
                                 dry_describing_function(model.dry, a, f) +
                                 law_describing_function(model.laws, a, f, load));
    }
    return response;
}

} // namespace tribode
