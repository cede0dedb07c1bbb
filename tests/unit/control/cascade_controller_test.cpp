#include "tribode/control/cascade_controller.hpp"

#include <gtest/gtest.h>

namespace tribode {
namespace {

// kp = 10, kv = 2, Ts = 1 ms, r = 0.6 m, q = 0.5, 0.502, 0.506 m:
//     qf = 0.5, 0.501, 0.504;  dq = 0, 1, 3 m/s
//     u = 2 (1 - 0), 2 (0.98 - 1), 2 (0.94 - 3) = 2, -0.04, -4.12 N
constexpr double sample_time = 1e-3, reference = 0.6;
const std::vector<double> positions = {0.5, 0.502, 0.506};

// Positions near 0.5 m, known to 1e-16 m, divided by 1 ms.
constexpr double rounding = 2e-12;

std::vector<double> outputs(const CascadeController& controller) {
    CascadeController::State state;
    std::vector<double> u;
    for (const double q : positions) u.push_back(controller.step(state, reference, q, sample_time));
    return u;
}

void expect_outputs(const CascadeController& controller, const std::vector<double>& expected) {
    const auto u = outputs(controller);
    for (std::size_t k = 0; k < expected.size(); ++k) EXPECT_NEAR(u[k], expected[k], rounding) << k;
}

TEST(CascadeController, ThreeSamplesByHand) { expect_outputs({.kp = 10, .kv = 2}, {2, -0.04, -4.12}); }

TEST(CascadeController, TheOutputIsLimitedInBothDirections) {
    expect_outputs({.kp = 10, .kv = 2, .limit = 1.5}, {1.5, -0.04, -1.5});
}

TEST(CascadeController, ADelayHandsOnEarlierOutputsAfterZeros) {
    expect_outputs({.kp = 10, .kv = 2, .delay_samples = 1}, {0, 2, -0.04});
    expect_outputs({.kp = 10, .kv = 2, .delay_samples = 2}, {0, 0, 2});
    expect_outputs({.kp = 10, .kv = 2, .delay_samples = 3}, {0, 0, 0});
}

// e = 1, -0.02, -2.06 m/s and I[k] = I[k-1] + 5 Ts e[k]; beyond the limit I rests where e would take it further.
TEST(CascadeController, TheIntegralPartByHand) {
    expect_outputs({.kp = 10, .kv = 2, .ki = 5}, {2.01, -0.0302, -4.1308});
    expect_outputs({.kp = 10, .kv = 2, .ki = 5, .limit = 1.5}, {1.5, -0.0402, -1.5});
}

TEST(CascadeController, AtTheStartTheAxisIsTakenToRestWhereItIs) {
    const CascadeController controller{.kp = 10, .kv = 2};
    CascadeController::State state;
    EXPECT_EQ(controller.step(state, 7.0, 7.0, sample_time), 0.0);
    EXPECT_EQ(controller.step(state, 7.0, 7.0, sample_time), 0.0);
}

} // namespace
} // namespace tribode
