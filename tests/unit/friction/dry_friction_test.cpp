#include "tribode/friction/dry_friction.hpp"

#include <gtest/gtest.h>

#include <limits>

namespace tribode {
namespace {

constexpr double infinity = std::numeric_limits<double>::infinity();

TEST(DryFriction, PlainCoulombFrictionHasOneLevelAtEveryVelocity) {
    const DryFriction dry{.coulomb = 3, .stribeck = tribode::Stribeck{3, 0.01, 1}};
    EXPECT_TRUE(dry.present());
    EXPECT_FALSE(dry.velocity_dependent());
    for (const double v : {-1.0, 0.0, 1e-9, 5.0}) {
        EXPECT_EQ(dry.level(v), 3.0);
        EXPECT_EQ(dry.slope(v), 0.0);
    }
}

TEST(DryFriction, IsAbsentWithoutAnyLevel) {
    EXPECT_FALSE(DryFriction{}.present());
    EXPECT_TRUE((DryFriction{.coulomb = 0, .stribeck = tribode::Stribeck{1, 1, 1}}.present()));
    EXPECT_TRUE((DryFriction{.coulomb = 1, .stribeck = tribode::Stribeck{0, 1, 1}}.present()));
}

class Stribeck : public ::testing::TestWithParam<double> {
  protected:
    const DryFriction dry{.coulomb = 3, .stribeck = tribode::Stribeck{5, 0.02, GetParam()}};
};

INSTANTIATE_TEST_SUITE_P(Exponents, Stribeck, ::testing::Values(0.5, 1.0, 2.0));

TEST_P(Stribeck, LevelRunsFromStaticToCoulomb) {
    EXPECT_EQ(dry.level(0), 5.0);
    EXPECT_NEAR(dry.level(infinity), 3.0, 1e-15);
    // At the Stribeck velocity 1/e of the difference is left, for any exponent; rounding of a number near 4.
    EXPECT_NEAR(dry.level(0.02), 3 + 2 * std::exp(-1.0), 4e-15);
    EXPECT_EQ(dry.level(-0.013), dry.level(0.013));
}

TEST_P(Stribeck, SlopeIsTheDerivativeOfTheLevelByTheSpeed) {
    for (const double v : {0.003, 0.02, 0.07}) {
        // Central differences err by h^2/6 times the third derivative, here below 1e8 N s^3/m^3, and by
        // rounding, 1e-15 N/h; the slope is of the order of 100 N s/m.
        const double h = 1e-6;
        const double difference = (dry.level(v + h) - dry.level(v - h)) / (2 * h);
        EXPECT_NEAR(dry.slope(v), difference, 1e-4) << v;
        EXPECT_LT(dry.slope(v), 0) << v;
        EXPECT_EQ(dry.slope(-v), dry.slope(v)) << v;
    }
}

TEST_P(Stribeck, SlopeIsZeroWhereTheVelocityIs) { EXPECT_EQ(dry.slope(0), 0.0); }

} // namespace
} // namespace tribode
