#include "tribode/analysis/loop_gain.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <numbers>

namespace tribode {
namespace {

using Complex = std::complex<double>;
using std::numbers::pi;

Complex s_of(double frequency_hz) { return {0, 2 * pi * frequency_hz}; }

// Interpolation between 20000 frequencies over four decades: steps of 0.05 %, errors of its square and less.
constexpr double interpolation = 1e-5;

// L = k/(s (s+1)(s+2)): the phase is -180 deg at w = sqrt 2, where abs(L) = k/6.
TEST(StabilityMargins, OfATripleLagAreThoseByHand) {
    const auto margins =
        stability_margins([](double f) { return 2.0 / (s_of(f) * (s_of(f) + 1.0) * (s_of(f) + 2.0)); }, 1e-3, 10);
    ASSERT_TRUE(margins.gain_margin && margins.phase_margin_deg);
    EXPECT_NEAR(*margins.gain_margin, 3, 3 * interpolation);
    EXPECT_NEAR(*margins.phase_crossover_hz, std::sqrt(2) / (2 * pi), interpolation);
    // abs(L) = 1 at w^2 (w^2+1)(w^2+4) = 4, w^2 = (sqrt 17 - 3)/2; the phase there is -90 - atan w - atan(w/2).
    const double w = std::sqrt((std::sqrt(17) - 3) / 2);
    EXPECT_NEAR(*margins.gain_crossover_hz * 2 * pi, w, interpolation);
    EXPECT_NEAR(*margins.phase_margin_deg, 90 - (std::atan(w) + std::atan(w / 2)) * 180 / pi, 0.01);
    EXPECT_FALSE(margins.gain_reduction_margin);
}

// L = k (s+1)^2/s^3 crosses the negative axis at w = 1 with abs(L) = 2 k: it bears any more gain, and half of 1/k less.
TEST(StabilityMargins, AConditionallyStableLoopHasAMarginBelow) {
    const auto margins = stability_margins(
        [](double f) { return 4.0 * (s_of(f) + 1.0) * (s_of(f) + 1.0) / std::pow(s_of(f), 3); }, 1e-3, 10);
    ASSERT_TRUE(margins.gain_reduction_margin);
    EXPECT_NEAR(*margins.gain_reduction_margin, 1 / 8.0, interpolation);
    EXPECT_FALSE(margins.gain_margin);
}

// L = 1/s: abs(1 + L) falls to 1 and no further; it never crosses the negative axis.
TEST(StabilityMargins, AnIntegratorHasNoPhaseCrossover) {
    const auto margins = stability_margins([](double f) { return 1.0 / s_of(f); }, 1e-3, 10);
    EXPECT_FALSE(margins.gain_margin);
    EXPECT_NEAR(*margins.phase_margin_deg, 90, 0.01);
    EXPECT_NEAR(margins.modulus_margin, 1, 1e-3); // at the end of the band, w = 63: 1/w^2/2
}

// A rigid body behind a hold: k0 Ts^2/2 (z + 1)/(z - 1)^2. A sample of dead time is z^-1.
TEST(SampledResponse, ARigidBodyBehindAHoldIsItsZTransform) {
    constexpr double ts = 1e-3, k0 = 0.1;
    for (const double f : {1.0, 50.0, 200.0, 450.0}) {
        const Complex z = std::polar(1.0, 2 * pi * f * ts);
        const Complex expected = k0 * ts * ts / 2 * (z + 1.0) / ((z - 1.0) * (z - 1.0)) / z;
        // The terms left out, n^-3 from 11 on, beside the first ones.
        EXPECT_LT(std::abs(sampled_response({k0, {}}, {ts, ts, 0}, f) / expected - 1.0), 1e-3) << f;
    }
}

TEST(SampledResponse, TheLagTurnsAndLowersAtLowFrequencies) {
    constexpr double f = 10, lag = 100;
    const Complex with = sampled_response({0.1, {}}, {1e-3, 0, lag}, f);
    const Complex without = sampled_response({0.1, {}}, {1e-3, 0, 0}, f);
    // Aliases at 990 Hz and above are below (10/990)^2 of the response.
    EXPECT_LT(std::abs(with / without - 1.0 / Complex(1, f / lag)), 2e-4);
}

} // namespace
} // namespace tribode
