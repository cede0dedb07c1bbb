#pragma once
#include "tribode/analysis/excitation.hpp"
#include "tribode/analysis/frequency_response.hpp"
#include "tribode/analysis/sine_fit.hpp"

#include <complex>
#include <functional>
#include <limits>
#include <span>
#include <string>
#include <vector>

namespace tribode {

// Frequency responses with their uncertainty, from measured signals: one output, several inputs (each analysis has one of
// its own), and the excitation, which no noise of the loop reaches. With the phasors or spectra Y, W, E of output, input and
// excitation the response is Y E* / (W E*), summed over repetitions: in closed loop the joint input-output estimate, in open
// loop, where the excitation is the input, the usual one.
//
// The uncertainty is that of the ratio: with the errors dY and dW, dH/H = dY/Y - dW/W = Z. Noise that goes round a loop
// is in both, and only this difference counts. `variance` is the expectation of abs(Z)^2; gain (in neper) and phase (in
// rad) have half of it each.

// A response that was fitted, by which transients are known.
struct KnownResponse {
    std::function<std::complex<double>(double frequency_hz)> response;
    std::vector<std::complex<double>> poles; // one of each pair [1/s]
};

struct MeasuredSignals {
    double sample_time = 0;
    std::span<const double> excitation, output;
    std::vector<std::span<const double>> inputs;
    double resolution = 0; // of the output, 0: not known
    // What the loop acts by, where the excitation is added to it in a closed loop: what an error of the output does to it is then
    // known. Empty: no such loop.
    std::span<const double> thrust = {};
    std::vector<KnownResponse> known = {}; // to each input, empty: not known

    const KnownResponse* known_response(std::size_t input) const {
        return input < known.size() && known[input].response ? &known[input] : nullptr;
    }
};

// One frequency of a measured response.
struct MeasuredPoint {
    static constexpr double unknown = std::numeric_limits<double>::quiet_NaN();

    double frequency_hz = 0;
    std::complex<double> value = {unknown, unknown};
    double variance = unknown; // of the relative error: noise, what differs between repetitions, the bias squared
    double coherence = unknown;
    double odd_distortion = unknown, even_distortion = unknown; // amplitude relative to that of the output
    double transient = 0; // share of the value that was a transient; taken out where it was seen clearly
    double bias = 0;      // what is estimated to be left of it
    bool settled = true;  // the bias is below two standard deviations, or below the tolerance
    std::size_t repetitions = 1;
    std::string missing; // why there is no value; empty where there is one
    // The output is rounded, and no noise makes its rounding random: the variance contains an estimate of what does not show.
    bool is_rounded = false;

    double standard_gain_db() const;
    double standard_phase_deg() const;
};

// Of the points with a value.
FrequencyResponse response_of(const std::vector<MeasuredPoint>& points);

// What one stretch of a record says at one frequency; the lists have an entry for each input.
struct Observation {
    double frequency_hz = 0;
    double duration = 0; // [s]
    std::complex<double> excitation, output;
    std::vector<std::complex<double>> inputs; // with the transient of the ratio taken out, where there was one
    std::vector<double> variance, coherence, transient, bias;
    std::vector<double> odd, even;                      // squares of the distortions; of multisines
    std::vector<std::complex<double>> output_harmonics; // of sines
    std::complex<double> output_transient =
        0; // of sines: share of the fundamental of the output, where it is taken out
    std::vector<std::vector<std::complex<double>>> input_harmonics; // of sines
    Window window;
    bool is_line = false;    // of a multisine
    bool is_rounded = false; // as of a point; of sines
    std::string missing;
};

struct SineOptions {
    int harmonics = 5;            // fitted, for the distortion
    long periods = 0;             // the last ones of each segment; 0: as many as have settled
    bool keep_transients = false; // do not remove them, see below
    double tolerance = 2e-3;      // relative, of what may be left of a transient in a point that is called settled
};

// One observation per segment, over whole periods at its end.
//
// Noise and transient are told apart in the spectrum of the window: lines between the harmonics hold no steady response.
// There Z is fitted by a parabola over the lines next to f (a transient is smooth over frequency; this is the local
// polynomial method [Pintelon 2012, chapter 7]). Its value at f is the transient, the residual is the noise. A transient is
// taken out where that costs less than leaving it, and the variance contains the price of either. Where the response was fitted
// before (MeasuredSignals::known), Z = dY/Y - (P/P(f)) dW/W is the response's own free motion, and the transients of its poles are
// fitted beside the parabola. The bias left is taken from a fit of lower order. A transient next to
// f that decays slowly is in no line; it shows in the ratios over the thirds of the segment, and their differences, taken for a
// geometric series, are added to the bias. Where the number of
// periods is not given, windows of 1, 3/4, 1/2, 1/3 and 1/4 of the segment are tried, and the longest one whose mean square
// error is at most 1.5 times the smallest is used.
//
// Rounding of the output repeats itself with the sine where their ratio is that of small whole numbers; then it hides in
// no line between the harmonics, and its variance is added from the resolution.
std::vector<Observation> sine_observations(const MeasuredSignals& signals, const std::vector<SineSegment>& segments,
                                           const SineOptions& options);

// One observation per excited line, from whole periods at the end of the record. The first periods are left out as far as
// that lowers the variance of the mean, and the straight line of a drift is taken off it. The noise is read from the difference of
// the periods, averaged over seven lines. Lines above 0.45 of the sampling rate are left out.
// Lines in the band that are not excited detect distortion [Pintelon 2012, chapter 4]: what the output has there besides
// the response to the input, odd and even lines apart, less the noise.
std::vector<Observation> multisine_observations(const MeasuredSignals& signals, std::size_t period,
                                                const std::string& where);

// The observations of all records as one response per input, by ascending frequency. Repetitions of a frequency are averaged.
// Where they differ by more than the noise of each, the difference makes the variance; of multisines always, averaged over
// nine lines and not less than the noise; and of one realization the distortion that the lines detect is added to the noise.
// The distortion of sines is what harmonics of the output have besides the response to those of the input, where the
// response is known at their frequency.
std::vector<std::vector<MeasuredPoint>> merged(const std::vector<Observation>& observations,
                                               const SineOptions& options = {});

// Windowed cross spectra of all records together: Hann windows of `window` samples (0: an eighth of the shortest record, at
// most 8192), three quarters overlapping, from the first sample to the last, straight lines removed. Lines where the excitation has
// less than 1e-4 of its largest amplitude are left out.
//
// The variance is that of what the excitation does not explain, for as many averages as the windows are worth, and of what the
// windows leak: where a window cuts off a signal, the response of neighboring frequencies is in a line, by the response's slope.
// A chirp passes a line in one or two windows, which agree whatever they leak.
//
// Throws InputError where a record has less than two windows: one explains any output.
std::vector<std::vector<MeasuredPoint>> cross_spectra(const std::vector<MeasuredSignals>& records,
                                                      std::size_t window = 0);

} // namespace tribode
