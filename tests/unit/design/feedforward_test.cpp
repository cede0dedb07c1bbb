#include "tribode/base/error.hpp"
#include "tribode/design/discrete_plant.hpp"
#include "tribode/design/feedforward.hpp"
#include "tribode/design/s_curve_feedforward.hpp"
#include "tribode/design/zero_phase_feedforward.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <numbers>

namespace tribode {
namespace {

const ModalModel table{94.28e-3, {{13.08e-3, 33.32, 2.48e-2}, {5.27e-3, 82.22, 3.22e-3}}};
const MoveTask task; // 0.5 mm in 50 ms, 100 samples

// Largest distance from the end once the move is over.
double residual(const ModalModel& model, const Feedforward& feedforward) {
    const auto position = DiscretePlant(model, task.sample_time).simulate(feedforward.thrust);
    double most = 0;
    for (std::size_t k = task.settling_sample(); k < position.size(); ++k) {
        most = std::max(most, std::abs(position[k] - task.distance));
    }
    return most;
}

// ---- zero phase error tracking -----------------------------------------------------------------------------------

TEST(ZeroPhase, TheModelFollowsTheReferenceToRounding) {
    const auto feedforward = zero_phase_feedforward(table, task);
    const auto position = DiscretePlant(table, task.sample_time).simulate(feedforward.thrust);
    // Rounding, 1e-19 m a sample, which the lightly damped anti-resonances and the rigid body sum over 600 samples.
    for (std::size_t k = 0; k < position.size(); ++k) EXPECT_NEAR(position[k], feedforward.reference[k], 1e-13) << k;
}

// No phase: the filtered S-curve is as symmetric about the middle of the move as the S-curve itself.
TEST(ZeroPhase, TheReferenceIsSymmetricAboutTheMiddleOfTheMove) {
    const auto reference = zero_phase_feedforward(table, task).reference;
    for (std::size_t k = 0; k <= 100; ++k) EXPECT_NEAR(reference[k] + reference[100 - k], 5e-4, 1e-16) << k; // rounding
    EXPECT_EQ(reference[0], 0);
    for (std::size_t k = 100; k < reference.size(); ++k) EXPECT_NEAR(reference[k], 5e-4, 1e-18);
}

TEST(ZeroPhase, TheThrustDoesNotRingFromSampleToSample) {
    const auto thrust = zero_phase_feedforward(table, task).thrust;
    for (std::size_t k = 102; k < thrust.size(); ++k) {
        // After the move only the anti-resonances are left, below 80 Hz: 0.25 rad a sample, not pi.
        const double second = thrust[k] - 2 * thrust[k - 1] + thrust[k - 2];
        EXPECT_LT(std::abs(second), 0.1) << k;
    }
}

TEST(ZeroPhase, AMoveShorterThanItsZerosIsRefused) {
    MoveTask shortest = task;
    shortest.duration = 2 * task.sample_time;
    EXPECT_THROW(zero_phase_feedforward(table, shortest), InputError);
}

// ---- S-curve -----------------------------------------------------------------------------------------------------

TEST(SCurve, PeaksAreThoseOfTheFormulas) {
    const SCurve path(0.02, 0.8);                    // h = 0.1 s, S = 25 m/s^4
    constexpr double moment = 1e-7, rounding = 1e-8; // means over a moment: 25 m/s^4 times it, and cancellation over it
    EXPECT_EQ(path.position(-1), 0);
    EXPECT_NEAR(path.position(0.4), 0.01, 1e-15);
    EXPECT_EQ(path.position(0.8), 0.02);
    EXPECT_EQ(path.position(5), 0.02);
    EXPECT_NEAR(path.mean_snap(0.05, moment), 25, 1e-4); // cancellation of jerks of 2.5 over 1e-7
    EXPECT_NEAR(path.mean_snap(0.15, moment), -25, 1e-4);
    EXPECT_NEAR(path.mean_acceleration(0.2 - moment / 2, moment), 0.25, 1e-6 + rounding);
    EXPECT_NEAR(path.mean_acceleration(0.6 - moment / 2, moment), -0.25, 1e-6 + rounding);
    EXPECT_NEAR(path.mean_acceleration(0.4 - moment / 2, moment), 0, 1e-6 + rounding);
    EXPECT_NEAR((path.position(0.4 + 1e-4) - path.position(0.4 - 1e-4)) / 2e-4, 0.05, 1e-6); // 2 S h^3
    EXPECT_EQ(path.mean_snap(0.9, 0.1), 0);
    EXPECT_EQ(path.mean_acceleration(0.9, 0.1), 0);
}

// Of a mass the inverse is exact, but for the hold, whose staircase leaves (Ts/h)^2 of the path.
TEST(SCurve, AMassFollowsTheReference) {
    const ModalModel mass{0.1, {}};
    const auto feedforward = s_curve_feedforward(mass, task);
    const auto position = DiscretePlant(mass, task.sample_time).simulate(feedforward.thrust);
    for (std::size_t k = 0; k < position.size(); ++k) EXPECT_NEAR(position[k], feedforward.reference[k], 1e-6) << k;
    EXPECT_LT(residual(mass, feedforward), 1e-9);
}

// Well below an undamped resonance the snap term leaves the sixth order only: it makes the error much smaller than
// a rigid body's feedforward does.
TEST(SCurve, SnapFollowsTheResonanceBelowIt) {
    const ModalModel model{0.1, {{0.02, 200, 0}}}, rigid{0.1, {}};
    MoveTask slow = task;
    slow.duration = 0.2;
    const auto largest_error = [&](const ModalModel& design) {
        const auto feedforward = s_curve_feedforward(design, slow);
        const auto position = DiscretePlant(model, slow.sample_time).simulate(feedforward.thrust);
        double most = 0;
        for (std::size_t k = 0; k < position.size(); ++k) {
            most = std::max(most, std::abs(position[k] - feedforward.reference[k]));
        }
        return most;
    };
    EXPECT_LT(largest_error(model), 0.5 * largest_error(rigid));
}

TEST(SCurve, AModelWithoutARigidGainIsRefused) {
    EXPECT_THROW(s_curve_feedforward({0, {{0.01, 30, 0.1}}}, task), InputError);
    EXPECT_THROW(shaped_feedforward({0, {{0.01, 30, 0.1}}}, task, 0, 0), InputError);
}

// ---- input shaping -----------------------------------------------------------------------------------------------

TEST(InputShaping, NoVibrationOfTheShapedModesIsLeft) {
    // The hold's staircase is no exact S-curve: 1e-4 of the static deflection of 5 um.
    EXPECT_LT(residual(table, shaped_feedforward(table, task, 0, 0)), 1e-9);
    // Not shaped, the second mode rings on by more than a hundred times that.
    EXPECT_GT(residual(table, shaped_feedforward(table, task, 0, 1)), 1e-7);
}

// The derivative shaper is there for models that are wrong: a tenth in the frequency of the one mode.
TEST(InputShaping, WithTheDerivativeAWrongFrequencyLeavesLess) {
    const ModalModel model{94.28e-3, {{13.08e-3, 50, 1e-2}}}, wrong{94.28e-3, {{13.08e-3, 55, 1e-2}}};
    const double zv = residual(wrong, shaped_feedforward(model, task, 0, 0));
    const double zvd = residual(wrong, shaped_feedforward(model, task, 1, 0));
    EXPECT_LT(residual(model, shaped_feedforward(model, task, 1, 0)), 1e-9); // as above
    EXPECT_LT(zvd, zv);
}

TEST(InputShaping, ShapersLongerThanTheMoveAreRefused) {
    EXPECT_THROW(shaped_feedforward({0.1, {{0.01, 9, 0}}}, task, 0, 0), InputError);  // half a period: 56 ms
    EXPECT_THROW(shaped_feedforward({0.1, {{0.01, 40, 1}}}, task, 0, 0), InputError); // overdamped: no period
}

// ---- the interface -----------------------------------------------------------------------------------------------

TEST(Feedforward, EveryMethodMovesTheModelToItsEnd) {
    for (const auto& method : FeedforwardOptions::methods()) {
        FeedforwardOptions options;
        options.method = method;
        const Feedforward feedforward = design_feedforward(table, options);
        EXPECT_EQ(feedforward.method, method);
        ASSERT_EQ(feedforward.reference.size(), 601u) << method;
        ASSERT_EQ(feedforward.thrust.size(), 601u) << method;
        EXPECT_EQ(feedforward.reference[0], 0) << method;
        EXPECT_NEAR(feedforward.reference.back(), 5e-4, 1e-9) << method; // a hundredth of an encoder step
        // The S-curve neglects the damping of a mode whose period is half of the move.
        EXPECT_LT(residual(table, feedforward), method == "s_curve" ? 2e-4 : 1e-9) << method;
    }
}

// At low frequencies F_u is the inverse of the model times the move's delay: its gain w^2/k0 within the plant's modes.
TEST(Feedforward, TheGainAtLowFrequenciesIsThatOfTheInverse) {
    const double f = 1, w = 2 * std::numbers::pi * f;
    // Modes and the spread of the move over 50 ms: (w/w1)^2 and (w 25 ms)^2/2 at most, 1.3 %.
    EXPECT_NEAR(std::abs(design_feedforward(table, {}).thrust_response(f)) / (w * w / 94.28e-3), 1, 0.013);
}

TEST(Feedforward, ItsTableReadsBack) {
    const Feedforward feedforward = design_feedforward(table, {});
    const Feedforward again = feedforward_from_json(to_json(feedforward), "test");
    EXPECT_EQ(again.method, "deadbeat");
    EXPECT_EQ(again.reference, feedforward.reference);
    EXPECT_EQ(again.thrust, feedforward.thrust);
    EXPECT_EQ(again.task.settling_sample(), 100u);
    EXPECT_EQ(again.task.length(), 601u);
    Json uneven = to_json(feedforward);
    uneven["thrust_N"] = {1.0};
    EXPECT_THROW(feedforward_from_json(uneven, "test"), InputError);
}

TEST(Feedforward, OptionsThatDoNotFitAreRefused) {
    for (const auto& wrong : {Json{{"distance_m", 0}}, Json{{"horizon_s", 0.01}}, Json{{"method", "dead"}},
                              Json{{"smoothness", 9}}, Json{{"sample_time_s", 1e-9}}}) {
        FieldReader fields(wrong, "test");
        FeedforwardOptions options;
        EXPECT_THROW(read_options(options, fields), InputError) << wrong;
    }
}

} // namespace
} // namespace tribode
