#include "tribode/analysis/friction_identification.hpp"
#include "tribode/analysis/periodic_friction.hpp"

#include <cmath>
#include <gtest/gtest.h>
#include <numbers>

namespace tribode {
namespace {

using std::numbers::pi;
using Phasor = std::complex<double>;

constexpr double frequency = 30;
const MaxwellSlipElement element{1e5, 1.0, 0}; // slips at 10 um

Phasor of_sine(double amplitude, const MaxwellSlipElement& e, double viscous = 0) {
    const std::array<Phasor, 1> position = {amplitude};
    return friction_phasor(position, frequency, {e}, viscous);
}

TEST(PeriodicFriction, an_element_that_never_slips_is_a_spring_with_its_damping) {
    const double amplitude = 0.8 * element.limit();
    const Phasor force = of_sine(amplitude, {element.stiffness, element.level, 3.0}, 2.0);
    // It slips once on the way to its steady state, since it begins relaxed at a turning point; after that a sum over
    // equidistant points of sine and cosine is exact, so the error is rounding.
    EXPECT_NEAR(force.real(), element.stiffness * amplitude, 1e-9);
    EXPECT_NEAR(force.imag(), 2 * pi * frequency * 5.0 * amplitude, 1e-9);
}

// Describing function of an elastic-plastic element: sticking from a turning point over an angle s with
// 1 - cos(s) = 2X/a, slipping for the rest of the half turn; its loop has the area 4F(a - X).
TEST(PeriodicFriction, an_element_that_slips_has_its_describing_function) {
    for (const double ratio : {1.2, 2.0, 10.0, 100.0}) {
        const double a = ratio * element.limit();
        const double s = std::acos(1 - 2 / ratio);
        const double real = element.stiffness * a / pi * (s - std::sin(2 * s) / 2);
        const double imag = 4 * element.level * (a - element.limit()) / (pi * a);
        const Phasor force = of_sine(a, element);
        // The corners of the force lie between two of 2000 points: (pi/1000)^2 of the force per unit of the slope's
        // change, which is K a = ratio F.
        const double tolerance = 1e-5 * ratio * element.level;
        EXPECT_NEAR(force.real(), real, tolerance) << ratio;
        EXPECT_NEAR(force.imag(), imag, tolerance) << ratio;
    }
}

TEST(PeriodicFriction, the_phase_of_the_motion_turns_the_force_with_it) {
    const double amplitude = 3 * element.limit();
    const Phasor turn = std::polar(1.0, 1.234);
    const std::array<Phasor, 1> turned = {amplitude * turn};
    const Phasor force = friction_phasor(turned, frequency, {element}, 1.0);
    // As above; the corners fall elsewhere between the points.
    EXPECT_NEAR(std::abs(force - of_sine(amplitude, element, 1.0) * turn), 0, 3e-5 * element.level);
}

TEST(PeriodicFriction, harmonics_of_the_motion_act_through_its_turning_points) {
    const std::vector<MaxwellSlipElement> elements = {{1e6, 0.5, 0}, {1e5, 1.0, 0}, {2e4, 2.0, 0}};
    const std::array<Phasor, 5> position = {Phasor(4e-5, 1e-5), 0, Phasor(-1e-5, 1.5e-5), 0, Phasor(2e-6, 3e-6)};
    // The same by another road: the quasi-static force along three periods, the last of them projected.
    constexpr int points = 40'000;
    std::vector<double> x;
    for (int i = 0; i < 3 * points; ++i) {
        double sum = 0;
        for (std::size_t n = 0; n < position.size(); ++n) {
            sum += (position[n] * std::polar(1.0, 2 * pi * static_cast<double>(n + 1) * i / points)).real();
        }
        x.push_back(sum);
    }
    const std::vector<double> force = rolling_force(elements, x);
    Phasor expected = 0;
    for (int i = 2 * points; i < 3 * points; ++i) {
        expected += force[static_cast<std::size_t>(i)] * std::polar(2.0 / points, -2 * pi * i / points);
    }
    const Phasor found = friction_phasor(position, frequency, elements, 0);
    // The stiffest element slips after 1 um, in a few of the 2000 points: 1e-4 of the level.
    EXPECT_NEAR(std::abs(found - expected), 0, 3.5e-4);
    // The fundamental alone says something else: the test would notice harmonics that are left out.
    const Phasor fundamental = friction_phasor(std::span(position).first(1), frequency, elements, 0);
    EXPECT_GT(std::abs(fundamental - expected), 0.1);
}

} // namespace
} // namespace tribode
