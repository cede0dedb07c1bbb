#include "tribode/control/sampled_friction.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <random>

namespace tribode {
namespace {

constexpr double sample_time = 1e-3; // [s]

// One element: limit 0.01 m, D = 5 N s/m; D_v = 2 N s/m.
TEST(SampledFriction, FourSamplesByHand) {
    SampledFriction friction({{100, 1, 5}}, 2, sample_time);
    // Rounding: positions near 0.3 m are known to 5e-17 m, and divided by 1 ms.
    constexpr double rounding = 1e-12;
    EXPECT_EQ(friction.step(0.300), 0);                                     // sets the reference
    EXPECT_NEAR(friction.step(0.304), 0.4 + 5 * 4 + 2 * 4, rounding);       // stick: z = 4 mm, v = 4 m/s
    EXPECT_NEAR(friction.step(0.312), 1 + 2 * 8, rounding);                 // slip: no D
    EXPECT_NEAR(friction.step(0.311), 0.9 + 5 * (-1) + 2 * (-1), rounding); // back from the limit
}

TEST(SampledFriction, ResetRelaxesTheElementsAtTheNextSample) {
    SampledFriction friction({{100, 1, 5}}, 2, sample_time);
    friction.step(0.3);
    friction.step(0.4);
    friction.reset();
    EXPECT_EQ(friction.step(-7.0), 0);
    EXPECT_EQ(friction.step(-7.0), 0);
}

TEST(SampledFriction, WithoutElementsItIsViscous) {
    SampledFriction friction({}, 2, sample_time);
    friction.step(0);
    EXPECT_DOUBLE_EQ(friction.step(1e-3), 2.0);
}

// Where every reversal is a sample, the sampled law is the law itself: each deflection runs into its limits.
TEST(SampledFriction, AgreesWithTheClipFormulaOfEachElement) {
    const std::vector<MaxwellSlipElement> elements = {{2e6, 1, 0}, {1e5, 0.3, 2}, {1e3, 1, 10}};
    const double viscous = 2.35;
    SampledFriction friction(elements, viscous, sample_time);
    std::mt19937_64 random(4);
    std::normal_distribution<double> travel(0, 300e-6);
    std::vector<double> z(elements.size());
    double y = 0.1;
    friction.step(y);
    int slips = 0;
    for (int k = 0; k < 500; ++k) {
        const double previous = y;
        y += travel(random);
        const double v = (y - previous) / sample_time;
        double expected = viscous * v;
        for (std::size_t i = 0; i < elements.size(); ++i) {
            const auto& [stiffness, level, damping] = elements[i];
            z[i] = std::clamp(z[i] + (y - previous), -level / stiffness, level / stiffness);
            const bool slipped = std::abs(z[i]) == level / stiffness;
            slips += slipped;
            expected += stiffness * z[i] + (slipped ? 0 : damping * v);
        }
        ASSERT_NEAR(friction.step(y), expected, 1e-12) << k; // sums of numbers below 10
    }
    EXPECT_GT(slips, 500);
    EXPECT_LT(slips, 1400); // of 1500: both stick and slip were seen
}

} // namespace
} // namespace tribode
