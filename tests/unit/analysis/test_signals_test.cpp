#include "tribode/analysis/test_signals.hpp"
#include "unit/script/messages.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <numbers>
#include <set>

namespace tribode {
namespace {

// The frequency between two samples, from the phase of the analytic form: three samples of a slow sine in sampling terms.
double frequency_at(const std::vector<double>& x, std::size_t k, double sample_time) {
    return std::acos((x[k - 1] + x[k + 1]) / (2 * x[k])) / (2 * std::numbers::pi * sample_time);
}

TEST(Chirp, HasTheFrequencyThatItSays) {
    for (const bool linear : {false, true}) {
        for (const auto& [start, end] : {std::pair{5.0, 80.0}, {80.0, 5.0}, {20.0, 20.0}}) {
            const Chirp made = make_chirp({.sample_time = 1e-4,
                                           .duration = 8,
                                           .f_start_hz = start,
                                           .f_end_hz = end,
                                           .amplitude = 3,
                                           .linear = linear});
            ASSERT_EQ(made.values.size(), 80000u);
            EXPECT_DOUBLE_EQ(made.frequency_hz.front(), start);
            EXPECT_NEAR(made.frequency_hz.back(), end, 0.01);
            const double middle = linear ? 0.5 * (start + end) : std::sqrt(start * end);
            EXPECT_NEAR(made.frequency_hz[40000], middle, 1e-9);
            for (std::size_t k = 1000; k + 1 < made.values.size(); k += 977) {
                if (std::abs(made.values[k]) < 2.5) continue; // there it is seen best
                EXPECT_NEAR(frequency_at(made.values, k, 1e-4), made.frequency_hz[k], 0.03 * made.frequency_hz[k]) << k;
            }
        }
    }
}

TEST(Chirp, WhatCannotBeIsRefused) {
    EXPECT_EQ(problem_of([] { make_chirp({.f_end_hz = 1000}); }),
              "input: f_end_hz = 1000 Hz, must be 900 Hz at most, 0.45 of the sampling rate");
    EXPECT_EQ(problem_of([] { make_chirp({.duration = 1e-4}); }),
              "input: duration_s = 0.0001 s has 0 samples, must have 2 to 1e8");
}

TEST(BinarySequence, IsTheLongestOfEachOrder) {
    for (long order = 2; order <= 20; ++order) {
        const BinarySequence made = make_binary_sequence({.order = order, .periods = 1, .amplitude = 1});
        const std::size_t length = (std::size_t{1} << order) - 1;
        ASSERT_EQ(made.period, length);
        ASSERT_EQ(made.values.size(), length);
        // Every state of the register but zero once: of a longest sequence alone.
        std::set<std::uint32_t> states;
        std::uint32_t state = 0;
        for (std::size_t i = 0; i < length + static_cast<std::size_t>(order); ++i) {
            state = (state << 1 | (made.values[i % length] > 0 ? 1u : 0u)) & static_cast<std::uint32_t>(length);
            if (i + 1 >= static_cast<std::size_t>(order) && states.size() < length) states.insert(state);
        }
        EXPECT_EQ(states.size(), length) << order;
        EXPECT_FALSE(states.contains(0)) << order;
    }
}

TEST(BinarySequence, HoldsItsValuesAndRepeats) {
    const BinarySequence one = make_binary_sequence({.order = 6, .periods = 1, .amplitude = 2, .seed = 5});
    const BinarySequence held =
        make_binary_sequence({.order = 6, .hold_samples = 3, .periods = 2, .amplitude = 2, .seed = 5});
    ASSERT_EQ(held.period, 3 * one.period);
    ASSERT_EQ(held.values.size(), 2 * held.period);
    for (std::size_t k = 0; k < held.values.size(); ++k) {
        EXPECT_EQ(held.values[k], one.values[k % held.period / 3]);
        EXPECT_EQ(std::abs(held.values[k]), 2);
    }
    // Another seed is another beginning; the sum of a period is one value.
    EXPECT_NE(one.values, make_binary_sequence({.order = 6, .periods = 1, .amplitude = 2, .seed = 6}).values);
    double sum = 0;
    for (const double value : one.values) sum += value;
    EXPECT_EQ(sum, 2);
}

} // namespace
} // namespace tribode
