#include "tribode/analysis/friction_loop.hpp"

#include <Eigen/Dense>
#include <cmath>
#include <gtest/gtest.h>
#include <numbers>

namespace tribode {
namespace {

using Complex = std::complex<double>;
using std::numbers::pi;

constexpr double ts = 1e-3; // [s]

// kp + kd (1 - z^-1)/Ts
std::function<Complex(double)> pd(double kp, double kd) {
    return [=](double f) { return kp + kd / ts * (1.0 - std::polar(1.0, -2 * pi * f * ts)); };
}

// A mass of 1 kg behind a hold and under PD control: with G(z) = Ts^2/2 (z + 1)/(z - 1)^2 the poles are the roots of
// z (z - 1)^2 + Ts^2/2 (z + 1) ((kp + kd/Ts) z - kd/Ts).
bool poles_inside(double kp, double kd) {
    const double h = ts * ts / 2, a = kp + kd / ts, b = kd / ts;
    Eigen::Matrix3d companion;
    companion << 2 - h * a, -1 - h * (a - b), h * b, 1, 0, 0, 0, 1, 0;
    return companion.eigenvalues().cwiseAbs().maxCoeff() < 1;
}

TEST(FrictionLoop, NyquistsCriterionSaysWhatThePolesSay) {
    FrictionLoop loop;
    loop.plant.rigid_gain = 1;
    loop.delays.sample_time = ts;
    loop.viscous = 1e-6; // the poles by hand have none
    int stable = 0, unstable = 0;
    for (const double kp : {100.0, 1e4, 1e5, 4e5}) {
        for (const double kd : {1.0, 30.0, 300.0, 900.0, 1500.0, 3000.0}) {
            loop.controller = pd(kp, kd);
            const bool wanted = poles_inside(kp, kd);
            EXPECT_EQ(loop.stability(0, 0, 0.05, 500).stable, wanted) << kp << ", " << kd;
            ++(wanted ? stable : unstable);
        }
    }
    EXPECT_GT(stable, 3);
    EXPECT_GT(unstable, 3);
}

TEST(FrictionLoop, AtTheCriticalShareTheLoopGainIsMinusOneAndStabilityEnds) {
    FrictionLoop loop;
    loop.plant.rigid_gain = 0.1;
    loop.plant.modes = {{0.02, 35, 0.02}};
    loop.delays = {5e-4, 1e-3, 750};
    loop.controller = [](double f) {
        const Complex s(0, 2 * pi * f);
        return 2e4 + 600.0 * s + 1.8e5 / s;
    };
    loop.elements = {{2e6, 0.5, 0}, {1e5, 2, 0}, {1e4, 3, 0}};
    loop.viscous = 2;
    for (const double amplitude : {0.0, 1e-6, 1e-5, 1e-4}) {
        const auto critical = loop.stability(1, amplitude, 0.05, 1000).critical;
        ASSERT_TRUE(critical) << amplitude;
        // Interpolated between frequencies 0.05 % apart.
        EXPECT_LT(std::abs(1.0 + loop.loop_gain(critical->share, amplitude)(critical->frequency_hz)), 1e-5)
            << amplitude;
        EXPECT_TRUE(loop.stability(0.999 * critical->share, amplitude, 0.05, 1000).stable) << amplitude;
        EXPECT_FALSE(loop.stability(1.001 * critical->share, amplitude, 0.05, 1000).stable) << amplitude;
    }
}

// Stuck elements are a spring K; feeding p K back leaves kp + K - p K, which must stay positive.
TEST(FrictionLoop, WithoutAnIntegratorTooMuchFeedbackDriftsOff) {
    FrictionLoop loop;
    loop.plant.rigid_gain = 0.1;
    loop.delays.sample_time = ts;
    loop.controller = pd(2e4, 600);
    loop.elements = {{3e4, 1, 0}, {1e4, 1, 0}};
    loop.viscous = 50;
    const auto critical = loop.stability(1, 0, 0.005, 500).critical;
    ASSERT_TRUE(critical);
    EXPECT_NEAR(critical->share, 1 + 2e4 / 4e4, 1e-5);
    EXPECT_EQ(critical->frequency_hz, 0);
    EXPECT_TRUE(loop.stability(1.499, 0, 0.005, 500).stable);
    EXPECT_FALSE(loop.stability(1.501, 0, 0.005, 500).stable);
}

} // namespace
} // namespace tribode
