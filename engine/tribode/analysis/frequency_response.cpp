#include "tribode/analysis/frequency_response.hpp"

#include "tribode/base/error.hpp"
#include "tribode/base/text.hpp"

#include <algorithm>
#include <cmath>
#include <numbers>

namespace tribode {

namespace {

constexpr double degrees = 180 / std::numbers::pi;

// The value shifted by whole turns of 360 into (center - 180, center + 180].
double near(double phase_deg, double center) { return phase_deg - 360 * std::ceil((phase_deg - center) / 360 - 0.5); }

// Value at x0 of the least-squares line through the points.
double line_at(double x0, const std::vector<double>& x, const std::vector<double>& y) {
    double mean_x = 0, mean_y = 0;
    for (std::size_t i = 0; i < x.size(); ++i) {
        mean_x += x[i] / static_cast<double>(x.size());
        mean_y += y[i] / static_cast<double>(x.size());
    }
    double xx = 0, xy = 0;
    for (std::size_t i = 0; i < x.size(); ++i) {
        xx += (x[i] - mean_x) * (x[i] - mean_x);
        xy += (x[i] - mean_x) * (y[i] - mean_y);
    }
    return mean_y + xy / xx * (x0 - mean_x);
}

} // namespace

std::vector<double> FrequencyResponse::gain_db() const {
    std::vector<double> gain;
    gain.reserve(value.size());
    for (const std::complex<double>& v : value) gain.push_back(20 * std::log10(std::abs(v)));
    return gain;
}

std::vector<double> FrequencyResponse::phase_deg(double first_near) const {
    std::vector<double> phase;
    phase.reserve(value.size());
    for (const std::complex<double>& v : value)
        phase.push_back(near(std::arg(v) * degrees, phase.empty() ? first_near : phase.back()));
    return phase;
}

std::complex<double> FrequencyResponse::at(double frequency) const {
    if (frequency_hz.empty() || !(frequency >= frequency_hz.front() && frequency <= frequency_hz.back()))
        throw InputError("frequency response: nothing measured at " + to_text(frequency) + " Hz" +
                         (frequency_hz.empty() ? std::string(", the response is empty")
                                               : ", must be between " + to_text(frequency_hz.front()) + " and " +
                                                     to_text(frequency_hz.back()) + " Hz"));
    const auto above = std::lower_bound(frequency_hz.begin(), frequency_hz.end(), frequency);
    const std::size_t i = static_cast<std::size_t>(above - frequency_hz.begin());
    if (frequency == frequency_hz[i]) return value[i];
    const std::complex<double> ratio = std::log(value[i] / value[i - 1]);
    const double below_hz = frequency_hz[i - 1], above_hz = frequency_hz[i];
    const double gain_share = std::log(frequency / below_hz) / std::log(above_hz / below_hz);
    const double phase_share = (frequency - below_hz) / (above_hz - below_hz);
    return value[i - 1] * std::polar(std::exp(ratio.real() * gain_share), ratio.imag() * phase_share);
}

FrequencyResponse FrequencyResponse::remove_delay(double seconds) const {
    FrequencyResponse without = *this;
    for (std::size_t i = 0; i < size(); ++i)
        without.value[i] *= std::polar(1.0, 2 * std::numbers::pi * frequency_hz[i] * seconds);
    return without;
}

double phase_delay(const FrequencyResponse& response, double frequency_hz, double half_width_hz, double expected) {
    // Without the expected delay the phase lies near -180 deg, and the rest of the delay is read there.
    const FrequencyResponse aligned = response.remove_delay(expected);
    double phase = std::arg(aligned.at(frequency_hz)) * degrees;

    FrequencyResponse around;
    for (std::size_t i = 0; i < aligned.size(); ++i)
        if (std::abs(aligned.frequency_hz[i] - frequency_hz) <= half_width_hz) {
            around.frequency_hz.push_back(aligned.frequency_hz[i]);
            around.value.push_back(aligned.value[i]);
        }
    if (around.size() >= 3) phase = line_at(frequency_hz, around.frequency_hz, around.phase_deg());
    return expected + (-180 - near(phase, -180)) / (360 * frequency_hz);
}

} // namespace tribode
