#pragma once
#include <complex>
#include <cstddef>
#include <vector>

namespace tribode {

// A measured frequency response function: one complex value per frequency, frequencies positive and
// ascending. The functions below assume that and equal lengths.
struct FrequencyResponse {
    std::vector<double> frequency_hz;
    std::vector<std::complex<double>> value; // (frequencies), in the unit of output per input, e.g. m/N

    std::size_t size() const { return frequency_hz.size(); }

    std::vector<double> gain_db() const; // 20 log10 of the magnitude

    // Unwrapped [deg]: the first phase lies within 180 deg of `first_near`, (-360, 0] by default, which holds a
    // free mass (-180) as well as one that friction holds like a spring (near 0); from there each step is taken
    // the shorter way. A step of a resonance is always shorter than 180 deg without delay; where the grid is so
    // coarse that the delay adds the rest, remove the delay first.
    std::vector<double> phase_deg(double first_near = -180) const;

    // Between the points: the logarithm of the gain is linear in the logarithm of the frequency, the phase
    // linear in frequency, the shorter way. Exact at the points. Throws InputError outside the measured
    // range.
    std::complex<double> at(double frequency) const;

    // The response without a dead time: times exp(+j 2 pi f seconds).
    FrequencyResponse remove_delay(double seconds) const;
};

// The dead time [s] that turns a phase of -180 deg, of a mass far from its resonances, into the one measured
// at frequency_hz: L = (-180 - phi_L) / (360 f_L), positive for a lag. phi_L is read from a least-squares
// line through the phases within half_width_hz of f_L, or interpolated where fewer than three points lie
// there.
//
// A phase is known up to whole turns, a delay up to whole periods of f_L: the answer lies within half a
// period of `expected` (4.2 ms at 120 Hz). Turns are not counted up from low frequencies: on a coarse grid
// that would take one too many or too few at each lightly damped resonance. Throws InputError where f_L is
// outside the measured range.
double phase_delay(const FrequencyResponse& response, double frequency_hz, double half_width_hz = 5,
                   double expected = 0);

} // namespace tribode
