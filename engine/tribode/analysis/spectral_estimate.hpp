#pragma once
#include "tribode/base/options.hpp"

#include <complex>
#include <cstddef>
#include <string>
#include <vector>

namespace tribode {

// Power and cross spectra by Welch's method: averages over windows of the record [Welch 1967].
struct SpectrumOptions {
    double sample_time = 5e-4; // [s]
    std::string window = "hann";
    long window_samples = 0; // 0: an eighth of the record, at most 8192
    double overlap = 0.5;    // share of a window
    std::string detrend = "line";

    static void describe(auto& o, auto& fields) {
        fields.number("sample_time_s", o.sample_time, "s", Allowed::positive, "of all signals");
        fields.choice("window", o.window, {"hann", "hamming", "blackman_harris", "flat_top", "rectangular"},
                      "`flat_top` is for amplitudes of sines, `rectangular` for whole periods");
        fields.integer("window_samples", o.window_samples, 0, 1L << 24,
                       "length of a window; 0: the power of two up to an eighth of the record, at most 8192");
        fields.number("overlap", o.overlap, "", Allowed::non_negative,
                      "share of a window that the next one has in common with it, up to 0.95");
        fields.choice("detrend", o.detrend, {"none", "mean", "line"}, "what is removed from each window");
    }
};

// What input i says of the output, line by line.
struct InputSpectra {
    std::vector<double> power;               // one-sided density [unit^2/Hz]
    std::vector<std::complex<double>> cross; // of output and input, E(Y X*), one-sided density
    std::vector<double> coherence;           // ordinary: of this input and the output alone
    // Responses. h1: noise is in the output only; of several inputs, those of the joint regression. Of one input also h2:
    // noise is in the input only; hv: in both, by the share that each has of its own power: the geometric mean of both.
    std::vector<std::complex<double>> h1, h2, hv;
    // Of the relative error of h1 [Bendat 2010, chapter 9]: gain (neper) and phase (rad) each. Where noise is in the output
    // only, also that of h2 and hv.
    std::vector<double> standard_deviation;
};

struct SpectralEstimate {
    std::vector<double> frequency_hz; // without zero and half the sampling rate
    std::vector<double> power;        // of the output, one-sided density [unit^2/Hz]
    std::vector<InputSpectra> inputs;
    std::vector<double> coherence; // multiple: of all inputs and the output; of one input the ordinary one
    std::vector<double> noise;     // power density of what the inputs do not explain; unbiased

    std::size_t windows = 0;
    double averages = 0; // as many windows without overlap would be worth
    // Of a line, for white noise. The power density times this is also the mean square of a sine at a line [Hz].
    double bandwidth = 0;
    // The true power is that of an estimate times low to high, with 95 % [chi squared with twice the averages].
    double power_low = 0, power_high = 0;
    // A multiple coherence above it does not come about by chance, with 95 %, at one given frequency.
    double coherence_threshold = 0;
};

// As many windows without overlap as `windows` of them, each `step` samples after the one before, are worth: overlapping ones are
// not independent [Welch 1967].
double averages_of(const std::vector<double>& window, std::size_t step, std::size_t windows);

// inputs: none for a power spectrum only. Throws InputError where lengths differ, where the record has less than two windows,
// or no more averages than inputs; and where inputs are linearly dependent at a frequency.
SpectralEstimate spectral_estimate(const std::vector<std::vector<double>>& inputs, const std::vector<double>& output,
                                   const SpectrumOptions& options);

} // namespace tribode
