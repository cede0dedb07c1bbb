#pragma once
#include <complex>
#include <cstddef>
#include <span>
#include <string>
#include <vector>

namespace tribode {

// x(t) = offset + Re(phasor exp(j 2 pi f t)), t = 0 at the first sample, with the frequency found as well.
struct FreeSine {
    double frequency_hz = 0;
    double offset = 0;
    std::complex<double> phasor;
    double residual_rms = 0;
};

// Least squares over the samples, by Gauss-Newton from near_hz, which must lie within about half a resolution 1/(n Ts). The
// first iteration leaves the frequency where it is.
FreeSine fit_free_sine(std::span<const double> samples, double sample_time, double near_hz, int iterations = 30);

// A stretch of a signal that is one sine.
struct SineSegment {
    double frequency_hz = 0;
    double amplitude = 0;
    double residual = 0;   // rms of what is no sine, relative to the amplitude
    std::size_t first = 0; // sample
    std::size_t count = 0; // samples
};

enum class ExcitationKind { stepped_sine, multisine, broadband };

// What an excitation is: single sines in turn, a signal that repeats itself, or anything else.
struct Excitation {
    ExcitationKind kind = ExcitationKind::broadband;
    std::vector<SineSegment> segments; // of a stepped sine, in their order in time
    std::size_t period = 0;            // of a multisine [samples]; the record holds two of them at least
};

// Recognizes the excitation of a record.
//
// Stepped sine: from the beginning on, the shortest window with three periods of one sine is sought (strongest line of the
// spectrum, then a fit with free frequency); the sine is followed as long as it predicts the samples after the window. So
// frequencies may come in any order, with phase jumps, pauses and changes of amplitude between them; the first periods of a
// segment may be lost. Segments of at least
// four periods count, and they must cover half of the samples that are not zero. In a chirp neighboring segments hardly
// differ; such a signal is no stepped sine.
//
// Multisine: the normalized autocorrelation has a peak near one at the period. Throws InputError where the signal repeats
// itself but the record does not hold two whole periods, or the period is no whole number of samples; and where the signal
// is constant. `where` begins the message.
Excitation recognize_excitation(std::span<const double> signal, double sample_time, const std::string& where);

} // namespace tribode
