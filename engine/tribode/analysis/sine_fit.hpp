#pragma once
#include <Eigen/Cholesky>
#include <Eigen/Core>
#include <complex>
#include <cstddef>
#include <span>
#include <vector>

namespace tribode {

// A periodic signal seen in one window of samples: offset, drift and the phasors of the harmonics of one
// frequency f,
//
//     x(t) = offset + drift (t - t_mid) + sum_n Re(X_n exp(j 2 pi n f t)),     n = 1 .. H,
//
// t_mid the middle of the window. The time t is that of the run, so the ratio of the phasors of two signals
// of one run is the response from one to the other, whichever windows they were read in. Values in the unit
// of the samples.
struct SineFit {
    double offset = 0;                           // mean of the window without drift and harmonics
    double drift = 0;                            // [unit/s], zero unless asked for
    std::vector<std::complex<double>> harmonics; // X_1 .. X_H; zero where the sampling cannot tell them
    double residual_rms = 0;                     // of what the fit leaves

    std::complex<double> fundamental() const { return harmonics.front(); }
    // sqrt(sum_{n>1} abs(X_n)^2) / abs(X_1); infinite or NaN where there is no fundamental.
    double total_harmonic_distortion() const;
};

enum class Drift { none, linear };

// Least squares over all samples; x[i] is taken at first_instant + i sample_time [s]. The sampling need not
// be commensurate with f, and the window need not hold whole periods: a signal of the form above is found to
// rounding. What is not of that form (noise, higher harmonics) is suppressed best over whole periods.
//
// Harmonics at or above the Nyquist frequency are left at zero, and so are those within one resolution
// 1/(window length) of it, whose sine and cosine cannot be told apart. Where the sampling is commensurate
// with f, harmonics above the Nyquist frequency fold onto those below and cannot be told from them either.
//
// Solved by normal equations: over one period or more the columns are nearly orthogonal. The Gram matrix has
// a condition number below 4 without drift; with drift and five harmonics 125 over one period, below 5 from
// two periods on. So squaring costs no digits that matter. Over less than a period it grows quickly. Throws
// InputError where fewer samples than unknowns are given, where frequency or sample time are not positive,
// where the fundamental is not below the Nyquist frequency (as above), and where the window is so short that
// the condition number exceeds 1e10. A sample that is not finite makes the fit NaN.
SineFit fit_sine(std::span<const double> samples, double sample_time, double frequency_hz, double first_instant,
                 int harmonics = 1, Drift drift = Drift::none);

// The same for several signals of one window: what does not depend on their samples is made once. The fits are those of
// fit_sine, to the last bit.
class SineBasis {
  public:
    // As fit_sine with a signal of `count` samples, and with the same exceptions.
    SineBasis(std::size_t count, double sample_time, double frequency_hz, double first_instant, int harmonics = 1,
              Drift drift = Drift::none);

    // `count` samples.
    SineFit fit(std::span<const double> samples) const;
    // X_1 of that fit alone.
    std::complex<double> fundamental(std::span<const double> samples) const;

  private:
    Eigen::VectorXd coefficients(std::span<const double> samples) const;

    double half_window_; // from the middle to the first and last sample [s]
    std::size_t harmonics_;
    bool drift_;
    Eigen::MatrixXd
        columns_; // (samples x unknowns): 1, time scaled to -1 .. 1 (with drift), cos and -sin of each harmonic
    Eigen::LLT<Eigen::MatrixXd> factor_; // of the Gram matrix
};

struct Window {
    std::size_t first = 0; // index of the first sample
    std::size_t count = 0; // samples
};

// `periods` periods from sample `first`, to the nearest sample.
Window whole_periods(std::size_t first, long periods, double sample_time, double frequency_hz);

// The largest number of periods whose window, as above, has at most `samples` samples.
long periods_within(std::size_t samples, double sample_time, double frequency_hz);

// How far the output repeats the input from period to period: gamma^2 = abs(sum_p Y_p conj(U_p))^2 /
// (sum_p abs(U_p)^2 sum_p abs(Y_p)^2), between 0 and 1; U_p and Y_p are the phasors of sub-windows of whole
// periods, the shortest with at least four samples per unknown of the fit
// (near the Nyquist frequency longer ones), each in the time from its beginning. One where the response is the same in
// all of them; noise and transients lower it. Zero where input or output has no fundamental.
// Throws InputError where the lengths differ or the record holds fewer than two such sub-windows.
double coherence(std::span<const double> input, std::span<const double> output, double sample_time, double frequency_hz,
                 int harmonics = 1);

// The same from several inputs to one output.
std::vector<double> coherence(std::span<const std::span<const double>> inputs, std::span<const double> output,
                              double sample_time, double frequency_hz, int harmonics = 1);

// True where two phasors of consecutive windows differ by at most `tolerance` times the latest one.
bool settled(std::complex<double> previous, std::complex<double> latest, double tolerance);

} // namespace tribode
