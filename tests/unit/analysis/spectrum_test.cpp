#include "analysis/spectrum.hpp"
#include "base/error.hpp"

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

} // namespace
} // namespace tribode
