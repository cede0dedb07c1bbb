#include "tribode/base/error.hpp"
#include "tribode/design/deadbeat_feedforward.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <numeric>

namespace tribode {
namespace {

const ModalModel table{94.28e-3, {{13.08e-3, 33.32, 2.48e-2}, {5.27e-3, 82.22, 3.22e-3}}};
const MoveTask task; // 0.5 mm in 50 ms, 100 samples

double sum(const std::vector<double>& values) { return std::accumulate(values.begin(), values.end(), 0.0); }

class Deadbeat : public ::testing::TestWithParam<int> {};

TEST_P(Deadbeat, TheReferenceRestsAtItsEndFromTheDemandedSampleOn) {
    const auto feedforward = deadbeat_feedforward(table, task, GetParam());
    ASSERT_EQ(feedforward.reference.size(), 601u);
    // Rounding of a sum of 100 values below 1e-5 m.
    for (std::size_t k = 100; k < 601; ++k) EXPECT_NEAR(feedforward.reference[k], 5e-4, 1e-17 * 100) << k;
    EXPECT_GT(std::abs(feedforward.reference[99] - 5e-4), 1e-12) << "it should not be there a sample earlier";
}

TEST_P(Deadbeat, TheThrustEndsWithTheMove) {
    const auto feedforward = deadbeat_feedforward(table, task, GetParam());
    for (std::size_t k = 100; k < 601; ++k)
        EXPECT_NEAR(feedforward.thrust[k], 0, 1e-11) << k; // rounding of taps a thousand times as large
}

// N K r is what D K r makes of the plant: the model, simulated on its own, arrives and stays.
TEST_P(Deadbeat, TheModelFollowsTheReferenceToRounding) {
    const auto feedforward = deadbeat_feedforward(table, task, GetParam());
    const auto position = DiscretePlant(table, task.sample_time).simulate(feedforward.thrust);
    // The thrust is known to 1e-11 N, which the rigid body sums twice over 0.3 s: k0 (0.3 s)^2/2 times that.
    for (std::size_t k = 0; k < position.size(); ++k) {
        EXPECT_NEAR(position[k], feedforward.reference[k], 5e-14) << k;
    }
}

TEST_P(Deadbeat, TheGainIsOne) {
    const DiscretePlant plant(table, task.sample_time);
    const auto taps = deadbeat_taps(plant, 95, GetParam());
    ASSERT_EQ(taps.size(), 95u);
    EXPECT_NEAR(sum(plant.numerator()) * sum(taps), 1, 1e-12); // rounding of the sums
}

// Other taps with the same sum cost more: the tap moved to a neighbor, in either direction.
TEST_P(Deadbeat, NoOtherTapsAreSmoother) {
    const DiscretePlant plant(table, task.sample_time);
    std::vector<double> difference = plant.denominator();
    for (int i = 1; i < GetParam(); ++i) difference = product(difference, {1, -1});
    const auto cost = [&](const std::vector<double>& taps) {
        double squares = 0;
        for (const double d : product(difference, taps)) squares += d * d;
        return squares;
    };
    const auto best = deadbeat_taps(plant, 95, GetParam());
    const double least = cost(best);
    for (const std::size_t i : {0u, 20u, 47u, 93u}) {
        for (const double part : {1e-3, -1e-3}) {
            auto other = best;
            other[i] += part * best[47];
            other[i + 1] -= part * best[47];
            EXPECT_GT(cost(other), least) << i;
        }
    }
}

INSTANTIATE_TEST_SUITE_P(Smoothness, Deadbeat, ::testing::Values(1, 2, 3, 4));

TEST(DeadbeatFeedforward, TheShortestMoveHasOneTap) {
    MoveTask shortest = task;
    shortest.duration = 6 * task.sample_time;
    const auto feedforward = deadbeat_feedforward(table, shortest, 1);
    EXPECT_NEAR(feedforward.reference[6], 5e-4, 1e-14); // rounding; the thrust goes to 1e8 N and back
    shortest.duration = 5 * task.sample_time;
    EXPECT_THROW(deadbeat_feedforward(table, shortest, 1), InputError);
}

// By hand: a mass of 1 kg and one tap. N = Ts^2/2 (z^-1 + z^-2), D = (1 - z^-1)^2, so N(1) = Ts^2 and K = 1/Ts^2:
// a push of distance/Ts^2 for one sample and the same back.
TEST(DeadbeatFeedforward, AMassIsPushedAndBraked) {
    const MoveTask two{0.1, 0.02, 0.2, 0.5}; // two samples of 0.1 s
    const auto feedforward = deadbeat_feedforward({1, {}}, two, 1);
    const std::vector<double> thrust = {2, -2, 0, 0, 0, 0}, reference = {0, 0.01, 0.02, 0.02, 0.02, 0.02};
    ASSERT_EQ(feedforward.thrust.size(), thrust.size());
    for (std::size_t k = 0; k < thrust.size(); ++k) {
        EXPECT_NEAR(feedforward.thrust[k], thrust[k], 1e-13); // rounding
        EXPECT_NEAR(feedforward.reference[k], reference[k], 1e-15);
    }
}

} // namespace
} // namespace tribode
