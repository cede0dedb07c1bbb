#include "tribode/analysis/spectrum.hpp"
#include "tribode/base/error.hpp"

#include <bit>
#include <cmath>
#include <complex>
#include <fmt/format.h>
#include <numbers>
#include <numeric>
#include <unsupported/Eigen/FFT>

namespace tribode {

std::vector<double> amplitude_spectrum(const std::vector<double>& x, double sample_time,
                                       const std::vector<double>& frequency_hz) {
    using std::numbers::pi;
    if (x.size() < 4)
        throw InputError(fmt::format("a spectrum of {} samples was asked for, must be 4 or more", x.size()));
    const double mean = std::accumulate(x.begin(), x.end(), 0.0) / static_cast<double>(x.size());
    std::vector<double> weighted(x.size());
    double weights = 0;
    for (std::size_t k = 0; k < x.size(); ++k) {
        const double w = 1 - std::cos(2 * pi * static_cast<double>(k) / static_cast<double>(x.size()));
        weighted[k] = w * (x[k] - mean);
        weights += w;
    }
    std::vector<double> amplitude;
    for (const double f : frequency_hz) {
        std::complex<double> sum = 0;
        for (std::size_t k = 0; k < x.size(); ++k) {
            sum += weighted[k] * std::polar(1.0, -2 * pi * f * sample_time * static_cast<double>(k));
        }
        amplitude.push_back(2 * std::abs(sum) / weights);
    }
    return amplitude;
}

std::optional<double> strongest_line(const std::vector<double>& x, double sample_time, double lowest_hz,
                                     double highest_hz) {
    // Zeros make the grid finer, and the length a power of two, whose transform is the quickest.
    std::vector<double> padded(std::bit_ceil(3 * x.size()));
    const double mean = std::accumulate(x.begin(), x.end(), 0.0) / static_cast<double>(x.size());
    for (std::size_t k = 0; k < x.size(); ++k) padded[k] = x[k] - mean;
    std::vector<std::complex<double>> lines;
    Eigen::FFT<double>().fwd(lines, padded);

    const double step = 1 / (static_cast<double>(padded.size()) * sample_time);
    std::optional<double> strongest;
    double power = 0;
    for (std::size_t i = 0; i <= padded.size() / 2; ++i) {
        const double frequency = static_cast<double>(i) * step;
        if (frequency < lowest_hz || frequency > highest_hz || std::norm(lines[i]) <= power) continue;
        power = std::norm(lines[i]);
        strongest = frequency;
    }
    return strongest;
}

} // namespace tribode
