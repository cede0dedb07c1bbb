#include "tribode/analysis/delay_estimation.hpp"
#include "tribode/base/error.hpp"
#include "tribode/base/text.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>

namespace tribode {

namespace {

using std::numbers::pi;

void check(const FrequencyResponse& fra1, const FrequencyResponse& fra2) {
    if (fra1.frequency_hz != fra2.frequency_hz) {
        throw InputError("FRA-1 and FRA-2 are not at the same frequencies, both must come from one sweep");
    }
}

double delay_at(double frequency_hz, std::complex<double> thrust, std::complex<double> friction, double expected) {
    // Per unit of position: abs(friction - s)^2 = abs(thrust)^2; one root is positive where thrust exceeds friction.
    const double excess = std::norm(thrust) - std::norm(friction);
    if (!(excess > 0)) return std::numeric_limits<double>::quiet_NaN();
    const double s = friction.real() + std::sqrt(friction.real() * friction.real() + excess);
    const std::complex<double> aligned = (friction - s) / thrust * std::polar(1.0, 2 * pi * frequency_hz * expected);
    return expected - std::arg(aligned) / (2 * pi * frequency_hz);
}

double median(std::vector<double> values) {
    const auto middle = values.begin() + static_cast<std::ptrdiff_t>(values.size() / 2);
    std::nth_element(values.begin(), middle, values.end());
    if (values.size() % 2) return *middle;
    return (*middle + *std::max_element(values.begin(), middle)) / 2;
}

} // namespace

FrequencyResponse proposed_response(const FrequencyResponse& fra1, const FrequencyResponse& fra2, double delay) {
    check(fra1, fra2);
    FrequencyResponse response{fra1.frequency_hz, {}};
    for (std::size_t i = 0; i < fra1.size(); ++i) {
        const std::complex<double> thrust = 1.0 / fra1.value[i], friction = thrust - 1.0 / fra2.value[i];
        response.value.push_back(1.0 / (thrust * std::polar(1.0, -2 * pi * fra1.frequency_hz[i] * delay) - friction));
    }
    return response;
}

DelayEstimate estimate_delay(const FrequencyResponse& fra1, const FrequencyResponse& fra2, double f_min_hz,
                             double f_max_hz, double expected) {
    check(fra1, fra2);
    DelayEstimate estimate;
    std::vector<double> read;
    for (std::size_t i = 0; i < fra1.size(); ++i) {
        const double f = fra1.frequency_hz[i];
        if (f < f_min_hz || f > f_max_hz) continue;
        const std::complex<double> thrust = 1.0 / fra1.value[i], friction = thrust - 1.0 / fra2.value[i];
        estimate.frequency_hz.push_back(f);
        estimate.delays.push_back(delay_at(f, thrust, friction, expected));
        if (std::isfinite(estimate.delays.back())) read.push_back(estimate.delays.back());
    }
    if (read.empty()) {
        throw InputError("delay: between " + to_text(f_min_hz) + " and " + to_text(f_max_hz) +
                         " Hz there is no frequency with more thrust than friction, there must be one");
    }
    estimate.delay = median(read);
    for (double& value : read) value = std::abs(value - estimate.delay);
    estimate.spread = 1.4826 * median(read);
    return estimate;
}

} // namespace tribode
