#pragma once
#include <cstddef>
#include <span>
#include <vector>

namespace tribode {

// Signals of equal sample times, as an identification by inverse dynamics needs them.

// Behind a Butterworth low-pass filter of an even order, run forwards and backwards: no phase, and at the corner a gain of
// 1/2. Made by the bilinear transform with the corner in its place. At both ends the signal is continued by its mirror
// image in the end point over three times the order, as is the custom, and the filter starts from rest there.
// Throws InputError where the corner is not below half the sample rate, the order not even and from 2 to 20, or there are
// no more samples than that.
std::vector<double> zero_phase_low_pass(std::span<const double> values, double sample_time, double corner_hz,
                                        int order = 4);

// Every factor-th value up to the last one, behind a low-pass filter that is run in the same way: Chebyshev of the first
// kind, order 8, ripple 0.05 dB, corner at 0.8 of half the new sample rate, as the custom is. A constant keeps 0.9886 of
// itself. Throws InputError where the factor is below 2 or there are no more than 24 samples.
std::vector<double> decimated(std::span<const double> values, int factor);

// Central differences, at both ends one-sided. Throws InputError for fewer than two values.
std::vector<double> central_differences(std::span<const double> values, double sample_time);

// Samples in which a signal seems clipped: stretches of four equal values or more at an end of its range that a smooth curve
// breaks off at, in steps above `step` of rounding. A signal made for the record may stand there as designed, after a jump or in a
// straight line. Zero where there are fewer than three stretches.
std::size_t clipped_samples(std::span<const double> values, double step);

// values = sum of coefficients times columns, in the sense of least squares.
struct LinearFit {
    std::vector<double> coefficients;
    std::vector<double> standard_errors; // from the residual, taken for white
    std::vector<double> residual;        // values less the sum
    double relative_error = 0;           // norm of the residual over that of the values
};

// Throws InputError where columns differ in length, are no fewer than the values, or depend on one another.
LinearFit linear_fit(const std::vector<std::vector<double>>& columns, std::span<const double> values);

} // namespace tribode
