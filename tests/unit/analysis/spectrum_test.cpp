#include "tribode/analysis/spectrum.hpp"
#include "tribode/base/error.hpp"
#include "tribode/base/random.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <complex>
#include <limits>
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

// Against the formula in extended precision, term by term, for noise: 4, a power of two, one more, and many samples.
TEST(AmplitudeSpectrum, IsThatOfItsFormulaWithinTheRoundingItStates) {
    using Wide = long double;
    constexpr Wide two_pi = 2 * std::numbers::pi_v<Wide>;
    for (const std::size_t n : {4U, 512U, 513U, 3001U}) {
        std::vector<double> x(n);
        for (std::size_t k = 0; k < n; ++k) x[k] = uniform(n, 0, k) - 0.3;
        const std::vector<double> frequency = {0.5, 17.3, 250, 999.7};
        const auto amplitude = amplitude_spectrum(x, ts, frequency);
        Wide mean = 0;
        for (const double value : x) mean += value / static_cast<Wide>(n);
        for (std::size_t i = 0; i < frequency.size(); ++i) {
            Wide weights = 0, sizes = 0;
            std::complex<Wide> sum = 0;
            for (std::size_t k = 0; k < n; ++k) {
                const Wide w = 1 - std::cos(two_pi * static_cast<Wide>(k) / static_cast<Wide>(n));
                const Wide weighted = w * (x[k] - mean);
                weights += w;
                sizes += std::abs(weighted);
                sum += weighted * std::polar<Wide>(1, -two_pi * frequency[i] * Wide{ts} * static_cast<Wide>(k));
            }
            const double count = static_cast<double>(n), eps = std::numeric_limits<double>::epsilon();
            // Besides what is stated, weights and mean are rounded.
            const double parts = 7 * std::log2(2 * count) + 4 * frequency[i] * count * ts + 4;
            const auto rounding = static_cast<double>(2 * sizes / weights) * parts * eps;
            EXPECT_NEAR(amplitude[i], static_cast<double>(2 * std::abs(sum) / weights), rounding)
                << n << " samples, " << frequency[i] << " Hz";
        }
    }
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
