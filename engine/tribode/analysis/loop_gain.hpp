#pragma once
#include "tribode/analysis/modal_model.hpp"

#include <complex>
#include <functional>
#include <optional>

namespace tribode {

// What lies between the hold and the sampler of a loop, besides the plant itself.
struct LoopDelays {
    double sample_time = 0; // Ts [s]
    double dead_time = 0;   // of input and output together [s]
    double lag_hz = 0;      // first-order lag of the thrust; 0: none
};

// From thrust samples to position samples [m/N], hold, lag and dead time included:
//
//     (1/Ts) sum_n G(s + j n 2 pi/Ts),   G(s) = (1 - e^{-s Ts})/s  e^{-s dead_time}  P(s)/(1 + s/w_lag)
//
// with |n| <= 10; the terms fall with n^-3 or faster, so the rest is below 1e-3 at the Nyquist frequency and 1e-6 at a
// tenth of it. 0 < frequency_hz < 1/Ts.
std::complex<double> sampled_response(const ModalModel& plant, const LoopDelays& delays, double frequency_hz);

// The same for a plant given as its response P at any frequency, negative ones too, where it is the conjugate.
std::complex<double> sampled_response(const std::function<std::complex<double>(double frequency_hz)>& plant,
                                      const LoopDelays& delays, double frequency_hz);

// Of a loop gain L with negative feedback. Where there are several crossovers, the nearest to instability counts.
struct StabilityMargins {
    std::optional<double> gain_margin;           // least factor above 1 that brings L to -1
    std::optional<double> gain_reduction_margin; // greatest factor below 1 that does
    std::optional<double> phase_crossover_hz;    // of the gain margin
    std::optional<double> phase_margin_deg;      // least angle between L and -1 where abs(L) = 1
    std::optional<double> gain_crossover_hz;     // of the phase margin
    double modulus_margin = 0;                   // least abs(1 + L), the inverse of the peak of the sensitivity
};

// Margins over a band, from L at 20000 frequencies in equal ratios. They are distances; whether the closed loop is stable
// is for Nyquist's criterion or a simulation to say.
StabilityMargins stability_margins(const std::function<std::complex<double>(double frequency_hz)>& loop_gain,
                                   double f_min_hz, double f_max_hz);

} // namespace tribode
