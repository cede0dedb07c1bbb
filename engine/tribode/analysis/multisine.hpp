#pragma once
#include "tribode/base/options.hpp"

#include <cstddef>
#include <cstdint>
#include <vector>

namespace tribode {

struct MultisineOptions {
    double sample_time = 5e-4; // [s]
    double period = 4;         // [s], rounded to whole samples; its inverse is the distance of the lines
    long periods = 4;
    double f_min_hz = 10, f_max_hz = 200;
    double amplitude = 15;  // largest value of the signal
    bool odd = true;        // odd lines alone
    long detection = 4;     // of each so many of these lines one is left out, by chance; 0: none
    std::uint64_t seed = 0; // another seed is another realization

    static void describe(auto& o, auto& fields) {
        fields.number("sample_time_s", o.sample_time, "s", Allowed::positive, "of the signal");
        fields.number("period_s", o.period, "s", Allowed::positive,
                      "rounded to whole samples; its inverse is the distance of the lines");
        fields.integer("periods", o.periods, 1, 100'000, "length of the signal");
        fields.number("f_min_hz", o.f_min_hz, "Hz", Allowed::positive, "lower end of the band");
        fields.number("f_max_hz", o.f_max_hz, "Hz", Allowed::positive, "upper end of the band");
        fields.number("amplitude_N", o.amplitude, "N", Allowed::positive, "largest value of the signal");
        fields.flag("odd", o.odd, "only odd multiples of the line distance");
        fields.integer("detection", o.detection, 0, 1000,
                       "of this many lines, one is left out at random to detect distortion; 0: none");
        fields.integer("seed", o.seed, 0, 1L << 53, "another one gives another realization");
    }
};

struct Multisine {
    std::vector<double> values;
    std::size_t period = 0;           // [samples]
    std::vector<double> frequency_hz; // of the excited lines
    double crest_factor = 0;          // largest value over rms
};

// Random-phase multisine: lines of equal amplitude with phases drawn by the seed [Pintelon 2012, chapter 5]. Of eight draws
// the one with the least crest factor is taken. Throws InputError where no two lines lie in the band, the band reaches above 0.45 of
// the sampling rate, or there are more than 1e8 samples.
Multisine make_multisine(const MultisineOptions& options);

} // namespace tribode
