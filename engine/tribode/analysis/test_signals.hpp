#pragma once
#include "tribode/base/options.hpp"

#include <cstddef>
#include <cstdint>
#include <vector>

namespace tribode {

// A sine whose frequency runs from one end of a band to the other.
struct ChirpOptions {
    double sample_time = 5e-4; // [s]
    double duration = 10;      // [s], rounded to whole samples
    double f_start_hz = 1, f_end_hz = 200;
    double amplitude = 15;
    bool linear = false; // in time; else the same time per octave

    static void describe(auto& o, auto& fields) {
        fields.number("sample_time_s", o.sample_time, "s", Allowed::positive, "of the signal");
        fields.number("duration_s", o.duration, "s", Allowed::positive,
                      "length of the signal, rounded to whole samples");
        fields.number("f_start_hz", o.f_start_hz, "Hz", Allowed::positive, "frequency at the beginning");
        fields.number("f_end_hz", o.f_end_hz, "Hz", Allowed::positive,
                      "frequency at the end, which may be the lower one");
        fields.number("amplitude_N", o.amplitude, "N", Allowed::positive, "of the sine");
        fields.flag("linear", o.linear, "the frequency changes linearly in time; else each octave takes the same time");
    }
};

struct Chirp {
    std::vector<double> values;
    std::vector<double> frequency_hz; // at each sample
};

// Throws InputError where a frequency is above 0.45 of the sampling rate or the signal has fewer than 2 or more than 1e8
// samples.
Chirp make_chirp(const ChirpOptions& options);

// A pseudo-random binary sequence: the longest of a shift register, of 2^order - 1 clock periods.
struct BinarySequenceOptions {
    long order = 10;
    long hold_samples = 1; // of one clock period
    long periods = 4;
    double amplitude = 15;
    std::uint64_t seed = 0; // where in its period the sequence begins

    static void describe(auto& o, auto& fields) {
        fields.integer("order", o.order, 2, 20, "length of the shift register; a period has 2^order − 1 values");
        fields.integer("hold_samples", o.hold_samples, 1, 10'000, "samples for which each value is held");
        fields.integer("periods", o.periods, 1, 100'000, "length of the signal");
        fields.number("amplitude_N", o.amplitude, "N", Allowed::positive, "the signal is plus or minus this");
        fields.integer("seed", o.seed, 0, 1L << 53, "another one begins elsewhere in the period");
    }
};

struct BinarySequence {
    std::vector<double> values;
    std::size_t period = 0; // [samples]
};

// The spectrum is flat up to about 0.4 of the clock's frequency, 1/(hold_samples Ts) [Godfrey 1993, chapter 1].
// Throws InputError where there are more than 1e8 samples.
BinarySequence make_binary_sequence(const BinarySequenceOptions& options);

} // namespace tribode
