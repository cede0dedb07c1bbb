#include "tribode/analysis/test_signals.hpp"
#include "tribode/base/constants.hpp"
#include "tribode/base/error.hpp"
#include "tribode/base/random.hpp"

#include <array>
#include <bit>
#include <cmath>
#include <fmt/format.h>

namespace tribode {

Chirp make_chirp(const ChirpOptions& o) {
    const double samples = std::round(o.duration / o.sample_time);
    if (!(samples >= 2 && samples <= 1e8)) {
        throw InputError(
            fmt::format("duration_s = {:.6g} s has {:.6g} samples, must have 2 to 1e8", o.duration, samples));
    }
    for (const auto& [name, frequency] : {std::pair{"f_start_hz", o.f_start_hz}, {"f_end_hz", o.f_end_hz}}) {
        if (!(frequency * o.sample_time <= 0.45)) {
            throw InputError(fmt::format("{} = {:.6g} Hz, must be {:.6g} Hz at most, 0.45 of the sampling rate", name,
                                         frequency, 0.45 / o.sample_time));
        }
    }
    const double duration = samples * o.sample_time, octaves = std::log(o.f_end_hz / o.f_start_hz);
    const bool linear = o.linear || octaves == 0;
    const double rate = linear ? (o.f_end_hz - o.f_start_hz) / duration : octaves / duration;
    Chirp made;
    for (std::size_t k = 0; k < static_cast<std::size_t>(samples); ++k) {
        const double t = static_cast<double>(k) * o.sample_time;
        // The phase is the integral of the frequency.
        const double turns = linear ? (o.f_start_hz + 0.5 * rate * t) * t : o.f_start_hz * std::expm1(rate * t) / rate;
        made.values.push_back(o.amplitude * std::sin(two_pi * turns));
        made.frequency_hz.push_back(linear ? o.f_start_hz + rate * t : o.f_start_hz * std::exp(rate * t));
    }
    return made;
}

namespace {

// The places that are fed back, from 1 on, for registers of 2 to 20: primitive polynomials [Golomb 1967].
constexpr std::array<std::array<int, 4>, 21> feedback = {{{},
                                                          {},
                                                          {2, 1},
                                                          {3, 2},
                                                          {4, 3},
                                                          {5, 3},
                                                          {6, 5},
                                                          {7, 6},
                                                          {8, 6, 5, 4},
                                                          {9, 5},
                                                          {10, 7},
                                                          {11, 9},
                                                          {12, 6, 4, 1},
                                                          {13, 4, 3, 1},
                                                          {14, 5, 3, 1},
                                                          {15, 14},
                                                          {16, 15, 13, 4},
                                                          {17, 14},
                                                          {18, 11},
                                                          {19, 6, 2, 1},
                                                          {20, 17}}};

} // namespace

BinarySequence make_binary_sequence(const BinarySequenceOptions& o) {
    const std::size_t length = (std::size_t{1} << o.order) - 1;
    const auto hold = static_cast<std::size_t>(o.hold_samples);
    BinarySequence made;
    made.period = length * hold;
    if (static_cast<double>(made.period) * static_cast<double>(o.periods) > 1e8) {
        throw InputError("a binary sequence of more than 1e8 samples was asked for");
    }
    std::uint32_t fed_back = 0;
    for (const int place : feedback[static_cast<std::size_t>(o.order)]) {
        if (place > 0) fed_back |= 1u << (place - 1);
    }
    // Any state but zero is one of the period.
    auto state = 1 + static_cast<std::uint32_t>(uniform(o.seed, 0, 0) * static_cast<double>(length));
    std::vector<double> period;
    for (std::size_t i = 0; i < length; ++i) {
        const bool high = (state >> (o.order - 1) & 1u) != 0;
        period.insert(period.end(), hold, high ? o.amplitude : -o.amplitude);
        state = (state << 1 | static_cast<std::uint32_t>(std::popcount(state & fed_back) & 1)) &
                static_cast<std::uint32_t>(length);
    }
    for (long p = 0; p < o.periods; ++p) made.values.insert(made.values.end(), period.begin(), period.end());
    return made;
}

} // namespace tribode
