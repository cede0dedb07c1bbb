#include "tribode/analysis/describing_function.hpp"
#include "tribode/analysis/periodic_friction.hpp"

#include <cmath>
#include <gtest/gtest.h>
#include <numbers>

namespace tribode {
namespace {

using Complex = std::complex<double>;
using std::numbers::pi;

const std::vector<MaxwellSlipElement> three = {{2e6, 1, 0}, {1e5, 2, 40}, {1e4, 3, 0}}; // limits 0.5, 20, 300 um

// friction_phasor follows the motion point by point and shares no formula with the closed form.
TEST(DescribingFunction, IsTheFrictionOfASinusoidalMotionFollowedInTime) {
    const double frequency = 12, omega = 2 * pi * frequency;
    for (const double amplitude : {1e-7, 6e-7, 1e-5, 3e-5, 1e-4, 5e-4, 1e-2}) {
        const Complex force = friction_phasor(std::vector<Complex>{amplitude}, frequency, three, 0);
        const Complex found = describing_function(three, amplitude)(Complex(0, omega));
        // 2000 points a period: the damping of an element ends up to one point late, 2 pi/2000 of an angle.
        EXPECT_LT(std::abs(found * amplitude / force - 1.0), 2e-3) << amplitude;
    }
}

TEST(DescribingFunction, IsASpringBelowTheLeastLimit) {
    for (const double amplitude : {0.0, 5e-7}) {
        EXPECT_EQ(describing_function(three, amplitude).stiffness, Complex(2e6 + 1e5 + 1e4));
        EXPECT_EQ(describing_function(three, amplitude).damping, Complex(40));
    }
}

// The angle th is 2 sqrt(X/a) then, so the error falls with sqrt(X/a) = 3e-4 relative to the force.
TEST(DescribingFunction, TendsToThatOfDryFrictionForLargeMotions) {
    const double amplitude = 1e3;
    const Complex found = describing_function({{1e5, 10, 0}}, amplitude).stiffness;
    EXPECT_LT(std::abs(found / Complex(0, 4 * 10 / (pi * amplitude)) - 1.0), 1e-3);
}

// Per period an element that slips takes 4 F (a - X); of the fundamental it is pi a^2 Im N.
TEST(DescribingFunction, HoldsTheAreaOfTheLoop) {
    const double amplitude = 1e-4;
    EXPECT_NEAR(pi * amplitude * amplitude * describing_function({{1e5, 2, 0}}, amplitude).stiffness.imag(),
                4 * 2 * (amplitude - 2e-5), 1e-15); // rounding
}

} // namespace
} // namespace tribode
