#include "tribode/experiment/friction_map.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <numbers>

namespace tribode {
namespace {

constexpr double ts = 5e-4, mass = 10; // [s], [kg]
const ModalModel rigid{1 / mass, {}};

// A mass whose friction is c v + d v^3 [N], under 5 and 12 Hz (periods of 1 s), and a friction model of half of it.
struct Motion {
    std::vector<double> position, velocity, driving, left, friction;

    Motion(std::size_t count, double first, double second) {
        for (std::size_t k = 0; k < count; ++k) {
            const double t = ts * static_cast<double>(k), a = 2 * std::numbers::pi * 5, b = 2 * std::numbers::pi * 12;
            position.push_back(first * std::sin(a * t) + second * std::cos(b * t));
            velocity.push_back(first * a * std::cos(a * t) - second * b * std::sin(b * t));
            const double acceleration = -first * a * a * std::sin(a * t) - second * b * b * std::cos(b * t);
            const double v = velocity.back();
            friction.push_back(20 * v + 300 * v * v * v);
            driving.push_back(mass * acceleration + friction.back());
            left.push_back(driving.back() - friction.back() / 2);
        }
    }

    ForceSignals signals() const { return {position, driving, left, ts}; }
};

TEST(FrictionMap, TheResidualOfAPeriodicRecordIsWhatTheModelLacks) {
    const Motion motion(6000, 1e-3, 4e-4);
    const ForceResidual r = force_residual(motion.signals(), 2000, rigid, 200);
    ASSERT_EQ(r.force.size(), 2000u);
    double square = 0;
    for (std::size_t k = 0; k < 2000; ++k) {
        EXPECT_NEAR(r.force[k], motion.friction[k] / 2, 1e-9);
        EXPECT_NEAR(r.velocity[k], motion.velocity[k], 1e-12);
        EXPECT_NEAR(r.position[k], motion.position[k], 1e-15);
        square += motion.friction[k] * motion.friction[k] / 2000;
    }
    EXPECT_NEAR(r.friction_rms, std::sqrt(square), 1e-9);
    EXPECT_NEAR(r.rms, std::sqrt(square) / 2, 1e-9);
    EXPECT_GT(r.explained, 0.9); // it is a function of the velocity
}

TEST(FrictionMap, TheResidualOfAnyRecordIsItInTheMiddle) {
    const Motion motion(9001, 1e-3, 4e-4);
    const ForceResidual r = force_residual(motion.signals(), 0, rigid, 200);
    ASSERT_EQ(r.force.size(), r.position.size());
    ASSERT_EQ(r.force.size(), r.velocity.size());
    EXPECT_EQ(r.first, 8192u / 32);
    for (std::size_t k = 0; k < r.force.size(); ++k) {
        // Of a friction of 1.3 N; next to the faded ends the limit of the band rings.
        const double within = k < 250 || k + 250 > r.force.size() ? 0.02 : 3e-3;
        EXPECT_NEAR(r.force[k], motion.friction[k + r.first] / 2, within) << k;
        EXPECT_NEAR(r.friction[k], motion.friction[k + r.first], within) << k;
        EXPECT_EQ(r.position[k], motion.position[k + r.first]);
    }
    // A residual that is nothing but noise is no function of them.
    Motion noisy(9001, 1e-3, 4e-4);
    for (std::size_t k = 0; k < noisy.left.size(); ++k) {
        noisy.left[k] = noisy.driving[k] - noisy.friction[k] + std::sin(1e3 * std::pow(static_cast<double>(k), 1.3));
    }
    EXPECT_LT(force_residual(noisy.signals(), 0, rigid, 900).explained, 0.1);
}

TEST(FrictionMap, TheLoopOfASineIsFrictionOverPosition) {
    const Motion motion(10240, 1e-3, 0);
    const ForceResidual r = force_residual(motion.signals(), 0, rigid, 200);
    const MeasuredLoop loop = measured_loop(r, {600, 8400}, 5, ts);
    ASSERT_EQ(loop.position.size(), 401u); // one period, to sample 9000
    for (std::size_t i = 0; i < loop.position.size(); ++i) {
        const std::size_t k = 9000 - 401 + i;
        EXPECT_NEAR(loop.position[i], motion.position[k], 1e-5);
        EXPECT_NEAR(loop.measured[i], motion.friction[k], 4e-3);
        EXPECT_NEAR(loop.modeled[i], motion.friction[k] / 2, 4e-3);
    }
    EXPECT_TRUE(measured_loop(r, {0, 300}, 5, ts).position.empty());
    EXPECT_TRUE(measured_loop(r, {600, 9640}, 5, ts).position.empty()); // in the faded end
}

TEST(FrictionMap, CellsAreMeansAndEmptyWhereLittleIs) {
    const std::vector<double> x = {0, 0.1, 0.2, 1, 0.9}, y = {0, 0, 0, 1, 1}, f = {1, 2, 6, 5, 7};
    const CellMeans means = cell_means(x, y, f, 2);
    EXPECT_EQ(means.x_edges, (std::vector<double>{0, 0.5, 1}));
    EXPECT_DOUBLE_EQ(means.values[0], 3);
    for (const std::size_t i : {1u, 2u, 3u}) EXPECT_TRUE(std::isnan(means.values[i]));
}

} // namespace
} // namespace tribode
