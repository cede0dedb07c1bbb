#include "tribode/analysis/spectrum.hpp"
#include "tribode/base/error.hpp"
#include "tribode/base/lanes.hpp"

#include <bit>
#include <cmath>
#include <complex>
#include <fmt/format.h>
#include <numbers>
#include <numeric>
#include <unsupported/Eigen/FFT>

namespace tribode {

namespace {

// z_k += turn z_{k + half} for k < half, real and imaginary parts apart; far: those from half on.
TRIBODE_CLONES void fold(double* __restrict real, double* __restrict imag, const double* __restrict far_real,
                         const double* __restrict far_imag, std::size_t half, std::complex<double> turn) {
    const double turn_real = turn.real(), turn_imag = turn.imag();
    for (std::size_t k = 0; k < half; ++k) {
        real[k] += turn_real * far_real[k] - turn_imag * far_imag[k];
        imag[k] += turn_real * far_imag[k] + turn_imag * far_real[k];
    }
}

// sum_k x_k e^{-j 2 pi cycles k} of 2^m numbers. The later half is added to the first, turned by the angle between them, and so on:
// a few sines in place of one for each number, and each number is turned m times at most. work: room for as many complex numbers.
std::complex<double> turned_sum(const std::vector<double>& x, double cycles, std::vector<double>& work) {
    work.assign(2 * x.size(), 0.0);
    std::copy(x.begin(), x.end(), work.begin());
    double *real = work.data(), *imag = real + x.size();
    for (std::size_t half = x.size() / 2; half > 0; half /= 2) {
        fold(real, imag, real + half, imag + half, half, turned(-cycles * static_cast<double>(half)));
    }
    return {real[0], imag[0]};
}

} // namespace

std::vector<double> amplitude_spectrum(const std::vector<double>& x, double sample_time,
                                       const std::vector<double>& frequency_hz) {
    using std::numbers::pi;
    if (x.size() < 4)
        throw InputError(fmt::format("a spectrum of {} samples was asked for, must be 4 or more", x.size()));
    const double mean = std::accumulate(x.begin(), x.end(), 0.0) / static_cast<double>(x.size());
    std::vector<double> weighted(std::bit_ceil(x.size())), work;
    double weights = 0;
    for (std::size_t k = 0; k < x.size(); ++k) {
        const double w = 1 - std::cos(2 * pi * static_cast<double>(k) / static_cast<double>(x.size()));
        weighted[k] = w * (x[k] - mean);
        weights += w;
    }
    std::vector<double> amplitude;
    for (const double f : frequency_hz) {
        amplitude.push_back(2 * std::abs(turned_sum(weighted, f * sample_time, work)) / weights);
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
