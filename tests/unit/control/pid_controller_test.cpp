#include "tribode/control/pid_controller.hpp"

#include <gtest/gtest.h>

namespace tribode {
namespace {

constexpr double sample_time = 1e-3;

// A filter whose a = exp(-2 pi f Ts) is one half.
const double half_hz = std::log(2.0) / (2 * std::numbers::pi * 1e-3);

// Errors 1, 3, 2 m with kp = 100, ki = 50, kd = 2, Ts = 1 ms:
//     I = 0.05, 0.2, 0.3
TEST(PidController, ThreeSamplesByHand) {
    const PidController pid{.kp = 100, .ki = 50, .kd = 2, .derivative_filter_hz = 0};
    PidController::State state;
    // d = 1000, 2000, -1000. Rounding of numbers near 5000.
    EXPECT_NEAR(pid.step(state, 1, sample_time), 100 + 0.05 + 2000, 1e-11);
    EXPECT_NEAR(pid.step(state, 3, sample_time), 300 + 0.2 + 4000, 1e-11);
    EXPECT_NEAR(pid.step(state, 2, sample_time), 200 + 0.3 - 2000, 1e-11);
}

TEST(PidController, ThreeSamplesWithTheDerivativeFilterByHand) {
    const PidController pid{.kp = 100, .ki = 50, .kd = 2, .derivative_filter_hz = half_hz};
    PidController::State state;
    // d = 500, 250 + 1000, 625 - 500. Rounding of numbers near 3000.
    EXPECT_NEAR(pid.step(state, 1, sample_time), 100 + 0.05 + 1000, 1e-11);
    EXPECT_NEAR(pid.step(state, 3, sample_time), 300 + 0.2 + 2500, 1e-11);
    EXPECT_NEAR(pid.step(state, 2, sample_time), 200 + 0.3 + 250, 1e-11);
}

TEST(PidController, TheIntegralIsNotLimited) {
    const PidController pid{.kp = 0, .ki = 1000, .kd = 0, .derivative_filter_hz = 0};
    PidController::State state;
    double output = 0;
    for (int k = 0; k < 1000000; ++k) output = pid.step(state, 1.0, sample_time);
    EXPECT_EQ(output, 1e6); // one a step: whole numbers are exact
}

} // namespace
} // namespace tribode
