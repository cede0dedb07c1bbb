#pragma once
#include <cmath>
#include <complex>
#include <cstddef>
#include <numbers>
#include <optional>
#include <vector>

namespace tribode {

// exp(j 2 pi cycles), whole turns taken off before the multiplication.
inline std::complex<double> turned(double cycles) {
    return std::polar(1.0, 2 * std::numbers::pi * (cycles - std::floor(cycles)));
}

// Amplitude spectrum of a piece of a signal: mean removed, Hann window w,
//
//     A(f) = 2 abs(sum_k w_k (x_k - mean) e^{-j 2 pi f k Ts}) / sum_k w_k.
//
// A lasting vibration shows with its amplitude at its frequency, in the unit of x; one that decays shows with a mean
// over the window. Lines are 4/(n Ts) wide, whatever the grid of frequencies [Hz]. Rounding changes the sum by at most
// (7 log2 2n + 4 f n Ts) eps of that of the sizes w_k abs(x_k - mean). Throws InputError with less than 4 samples.
std::vector<double> amplitude_spectrum(const std::vector<double>& x, double sample_time,
                                       const std::vector<double>& frequency_hz);

// Frequency of the largest line of x without its mean in [lowest_hz, highest_hz], on a grid of at most a third of the
// resolution 1/(n Ts); nothing where the grid has no line there. Work: n ln n.
std::optional<double> strongest_line(const std::vector<double>& x, double sample_time, double lowest_hz,
                                     double highest_hz);

} // namespace tribode
