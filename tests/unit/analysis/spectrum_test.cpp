#include "tribode/analysis/spectrum.hpp"
#include "tribode/base/error.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <numbers>

namespace tribode {
namespace {

constexpr double ts = 5e-4; // [s]

std::vector<double> sine(double amplitude, double frequency_hz, double offset) {
    std::vector<double> x(500); // 0.25 s
    for (std::size_t k = 0; k < x.size(); ++k) {
        x[k] = offset + amplitude * std::sin(2 * std::numbers::pi * frequency_hz * ts * static_cast<double>(k));
    }
    return x;
}

TEST(AmplitudeSpectrum, ASineStandsAtItsFrequencyWithItsAmplitude) {
    const auto amplitude = amplitude_spectrum(sine(3e-6, 34, 5), ts, {34, 60, 150});
    // Leakage of the negative frequency, 68 Hz away, and of the mean: a Hann window has 1e-4 there.
    EXPECT_NEAR(amplitude[0], 3e-6, 3e-6 * 1e-3);
    EXPECT_LT(amplitude[1], 3e-6 * 1e-2); // 6.5 lines away
    EXPECT_LT(amplitude[2], 3e-6 * 1e-3);
}

TEST(AmplitudeSpectrum, AConstantHasNone) {
    for (const double a : amplitude_spectrum(std::vector<double>(100, 7.0), ts, {0.5, 20})) EXPECT_LT(a, 1e-14);
}

TEST(AmplitudeSpectrum, ThreeSamplesAreTooFew) { EXPECT_THROW(amplitude_spectrum({1, 2, 3}, ts, {20}), InputError); }

TEST(StrongestLine, IsWithinAThirdOfTheResolutionOfASine) {
    // 4 Hz of resolution; the sine has 3 to 200 periods in the record, and an offset.
    for (const double f : {12.0, 34.5, 150.3, 800.0}) {
        const auto line = strongest_line(sine(3e-6, f, 5e-6), ts, 8, 1000);
        ASSERT_TRUE(line.has_value());
        EXPECT_NEAR(*line, f, 4.0 / 3) << f;
    }
}

TEST(StrongestLine, LooksNowhereElse) {
    auto x = sine(1, 100, 0);
    const auto faint = sine(0.1, 400, 0);
    for (std::size_t k = 0; k < x.size(); ++k) x[k] += faint[k];
    EXPECT_NEAR(strongest_line(x, ts, 8, 1000).value(), 100, 4.0 / 3);
    EXPECT_NEAR(strongest_line(x, ts, 390, 410).value(), 400, 4.0 / 3); // to here 100 Hz leaks 1/(75 pi)
    EXPECT_FALSE(strongest_line(x, ts, 10.1, 10.2).has_value());        // between two lines of the grid
    EXPECT_FALSE(strongest_line(std::vector<double>(100, 7.0), ts, 0, 1000).has_value());
}

} // namespace
} // namespace tribode
