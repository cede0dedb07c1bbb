#include "tribode/friction/rolling_friction.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <functional>
#include <limits>
#include <random>
#include <utility>

namespace tribode {
namespace {

constexpr double infinity = std::numeric_limits<double>::infinity();
// [N], forces are below 10 N: a deflection is a difference of positions below 5 mm, known to 1e-18 m each,
// times at most 2e6 N/m, over some hundred events.
constexpr double rounding = 1e-9;

using Reports = std::vector<std::pair<std::size_t, SlipState>>;

// Limits 0.5, 1, 3, 20 and 1000 um; elements 1 and 4 have the same.
std::vector<MaxwellSlipElement> some_elements() {
    return {{2e6, 1.0, 0}, {4e5, 0.4, 0}, {1e5, 0.3, 0}, {2e4, 0.4, 0}, {1e6, 1.0, 0}, {1e3, 1.0, 10}};
}

// Moves the driven point slowly from event to event, as the plant does.
struct Motion {
    RollingFriction law;
    RollingFriction::State state;
    double y;
    int direction = 0;
    Reports reports;

    explicit Motion(std::vector<MaxwellSlipElement> elements, double start = 0)
        : law(std::move(elements)),
          state(law.at_rest(start)),
          y(start) {}

    double force() const { return law.force(state, y, 0); }

    void to(
        double target, const std::function<void()>& at_event = [] {}) {
        const auto report = [&](std::size_t element, SlipState now) { reports.emplace_back(element, now); };
        const int towards = target > y ? 1 : -1;
        if (towards == -direction) law.stick(state, y, report);
        direction = towards;
        const auto limit = [&] { return towards > 0 ? state.forward_limit : state.backward_limit; };
        while (towards * (target - limit()) > 0) {
            y = limit();
            at_event();
            law.slip(state, y, slip_towards(towards), report);
            at_event();
        }
        y = target;
    }
};

// Eqs. (11)-(15) for slow motion, without events: each deflection is clipped at the end of a piece in one
// direction.
struct Clip {
    std::vector<MaxwellSlipElement> elements;
    std::vector<double> z = std::vector<double>(elements.size());
    double y = 0;

    double force_at(double position) {
        double force = 0;
        for (std::size_t i = 0; i < elements.size(); ++i) {
            const double limit = elements[i].level / elements[i].stiffness;
            z[i] = std::clamp(z[i] + position - y, -limit, limit);
            force += elements[i].stiffness * z[i];
        }
        y = position;
        return force;
    }
};

// The curve from rest, F(d) [N].
double virgin_curve(const std::vector<MaxwellSlipElement>& elements, double d) { return Clip{elements}.force_at(d); }

TEST(MaxwellSlipElement, LimitIsTheDeflectionAtItsLevel) {
    EXPECT_DOUBLE_EQ((MaxwellSlipElement{2e6, 1.0, 0}.limit()), 0.5e-6);
}

TEST(RollingFriction, OneElementIsASpringThatSlipsAtItsLevel) {
    Motion motion({{1000, 2, 0}}); // limit 2 mm
    EXPECT_EQ(motion.state.forward_limit, 2e-3);
    EXPECT_EQ(motion.state.backward_limit, -2e-3);
    motion.to(1e-3);
    EXPECT_DOUBLE_EQ(motion.force(), 1.0);
    motion.to(5e-3);
    EXPECT_EQ(motion.force(), 2.0);
    EXPECT_EQ(motion.state.forward_limit, infinity); // nothing is left that could slip
    EXPECT_EQ(motion.state.direction, SlipState::slip_forward);
    motion.to(4e-3);
    EXPECT_NEAR(motion.force(), 1.0, rounding);
    EXPECT_NEAR(motion.state.backward_limit, 1e-3, 1e-18); // twice the limit back
    motion.to(0);
    EXPECT_EQ(motion.force(), -2.0);
    EXPECT_EQ(motion.reports,
              (Reports{{0, SlipState::slip_forward}, {0, SlipState::stick}, {0, SlipState::slip_backward}}));
}

TEST(RollingFriction, ForceOfAnyMotionIsThatOfTheClipFormulaAtEveryEvent) {
    std::mt19937_64 random(2);
    std::uniform_real_distribution<double> exponent(-7, -2.5);
    Motion motion(some_elements());
    Clip clip{some_elements()};
    for (int turn = 0; turn < 200; ++turn) {
        const double way = (turn % 2 ? -1 : 1) * std::pow(10, exponent(random));
        motion.to(motion.y + way, [&] { ASSERT_NEAR(motion.force(), clip.force_at(motion.y), rounding); });
        ASSERT_NEAR(motion.force(), clip.force_at(motion.y), rounding) << "turn " << turn;
        for (std::size_t i = 0; i < clip.z.size(); ++i) {
            // A deflection in stick stands at the last event.
            const bool stick = motion.state.slip[i] == SlipState::stick;
            const double z = motion.state.z[i] + (stick ? motion.y - motion.state.reference : 0);
            ASSERT_NEAR(z, clip.z[i], 1e-15) << "turn " << turn << ", element " << i;
        }
    }
    EXPECT_GT(motion.reports.size(), 400u); // a random walk without slip would show nothing
}

TEST(RollingFriction, DampingActsOnElementsInStickOnly) {
    Motion motion({{1000, 1, 5}, {1000, 2, 7}}); // limits 1 and 2 mm
    const double v = 0.1;
    motion.to(0.5e-3);
    EXPECT_NEAR(motion.law.force(motion.state, motion.y, v) - motion.force(), 12 * v, rounding);
    motion.to(1.5e-3);
    EXPECT_NEAR(motion.law.force(motion.state, motion.y, v) - motion.force(), 7 * v, rounding);
    motion.to(3e-3);
    EXPECT_EQ(motion.law.force(motion.state, motion.y, v), motion.force());
}

// Masing's rule: the curve from a reversal is the virgin curve at twice the scale in both directions.
TEST(RollingFriction, TheReversalCurveIsTwiceTheVirginCurve) {
    const double tip = 30e-6;
    Motion motion(some_elements());
    motion.to(tip);
    const double top = motion.force();
    for (const double d : {0.2e-6, 1e-6, 3e-6, 20e-6, 45e-6, 60e-6}) {
        motion.to(tip - d);
        EXPECT_NEAR(top - motion.force(), 2 * virgin_curve(some_elements(), d / 2), rounding) << d;
    }
    EXPECT_NEAR(motion.force(), -top, rounding); // at the opposite tip
}

TEST(RollingFriction, ALoopClosesAtItsTip) {
    for (const double tip : {0.3e-6, 2e-6, 50e-6, 2e-3}) {
        Motion motion(some_elements());
        motion.to(tip);
        const double top = motion.force();
        for (int period = 0; period < 3; ++period) {
            motion.to(-tip);
            EXPECT_NEAR(motion.force(), -top, rounding) << tip;
            motion.to(tip);
            EXPECT_NEAR(motion.force(), top, rounding) << tip;
        }
    }
}

TEST(RollingFriction, AnInnerLoopIsForgottenWhereItCloses) {
    Motion plain(some_elements()), nested(some_elements());
    for (Motion* motion : {&plain, &nested}) {
        motion->to(200e-6);
        motion->to(-50e-6);
        motion->to(100e-6);
    }
    const double before = nested.force();
    for (const double turn : {0.0, 60e-6, 20e-6, 60e-6, 0.0, 100e-6}) nested.to(turn);
    EXPECT_NEAR(nested.force(), before, rounding);
    for (const double y : {120e-6, 199e-6, 201e-6, 2e-3}) {
        plain.to(y);
        nested.to(y);
        EXPECT_NEAR(nested.force(), plain.force(), rounding) << y;
    }
}

TEST(RollingFriction, ElementsWithTheSameLimitGoTogether) {
    // Limits 1, 3, 1 mm; and again after a reversal, where they come from their backward limits.
    Motion motion({{1000, 1, 0}, {1000, 3, 0}, {500, 0.5, 0}});
    motion.to(1.5e-3);
    EXPECT_EQ(motion.reports, (Reports{{0, SlipState::slip_forward}, {2, SlipState::slip_forward}}));
    motion.to(-7.3e-3);
    motion.reports.clear();
    motion.to(-5e-3);
    EXPECT_EQ(motion.reports, (Reports{{0, SlipState::stick},
                                       {1, SlipState::stick},
                                       {2, SlipState::stick},
                                       {0, SlipState::slip_forward},
                                       {2, SlipState::slip_forward}}));
}

// Events are located to some tolerance, so a slip may come a little early or late.
TEST(RollingFriction, ASlipPutsTheDeflectionExactlyOnItsLimit) {
    const RollingFriction law({{1000, 1, 0}, {1000, 1.001, 0}, {1000, 5, 0}}); // limits 1, 1.001 and 5 mm
    for (const double y : {0.999e-3, 1e-3, 1.0005e-3}) {
        auto state = law.at_rest(0);
        Reports reports;
        law.slip(state, y, SlipState::slip_forward, [&](auto i, auto now) { reports.emplace_back(i, now); });
        EXPECT_EQ(state.z[0], law.elements()[0].limit());
        EXPECT_EQ(reports, (Reports{{0, SlipState::slip_forward}})) << y;
        EXPECT_NEAR(law.force(state, y, 0), 1 + 2 * 1000 * y, 1e-12); // its level, and the springs of the others
    }
    auto state = law.at_rest(0);
    law.slip(state, -1.002e-3, SlipState::slip_backward, [](auto, auto) {});
    EXPECT_EQ(state.z[0], -law.elements()[0].limit());
    EXPECT_EQ(state.z[1], -law.elements()[1].limit()) << "an element is left beyond its limit";
    EXPECT_EQ(state.slip[2], SlipState::stick);
}

TEST(RollingFriction, StickLeavesEveryDeflectionAndTheForceAsTheyAre) {
    Motion motion(some_elements());
    motion.to(10e-6); // four of six slip
    const double force = motion.force();
    Reports reports;
    motion.law.stick(motion.state, motion.y, [&](auto i, auto now) { reports.emplace_back(i, now); });
    EXPECT_EQ(reports,
              (Reports{{0, SlipState::stick}, {1, SlipState::stick}, {2, SlipState::stick}, {4, SlipState::stick}}));
    for (const std::size_t i : {0u, 1u, 2u, 4u}) {
        EXPECT_EQ(motion.state.z[i], motion.law.elements()[i].limit()) << i;
    }
    EXPECT_NEAR(motion.force(), force, rounding);
    EXPECT_EQ(motion.state.forward_limit, motion.y); // on in the old direction they slip at once
    EXPECT_EQ(motion.state.direction, SlipState::stick);
}

TEST(RollingFriction, CoulombLevelIsTheForceWithAllElementsInSlip) {
    Motion motion(some_elements());
    EXPECT_NEAR(motion.law.coulomb_level(), 4.1, 1e-15); // 1 + 0.4 + 0.3 + 0.4 + 1 + 1
    motion.to(10e-3);
    EXPECT_NEAR(motion.force(), 4.1, 1e-14); // six sums of numbers near one
    EXPECT_EQ(motion.state.stiffness, 0);
    EXPECT_EQ(motion.state.damping, 0);
}

TEST(RollingFriction, AtRestItsElementsAreRelaxedWhereverItIs) {
    Motion motion(some_elements(), 0.25);
    EXPECT_EQ(motion.force(), 0);
    EXPECT_DOUBLE_EQ(motion.state.forward_limit, 0.25 + 0.5e-6);
    EXPECT_DOUBLE_EQ(motion.state.backward_limit, 0.25 - 0.5e-6);
    EXPECT_EQ(motion.state.next_forward, 0u);
    EXPECT_EQ(motion.state.next_backward, 0u);
}

TEST(RollingFriction, WithoutElementsThereIsNoForceAndNoEvent) {
    const RollingFriction law;
    const auto state = law.at_rest(1.0);
    EXPECT_EQ(law.force(state, 2.0, 3.0), 0);
    EXPECT_EQ(law.coulomb_level(), 0);
    EXPECT_EQ(state.forward_limit, infinity);
    EXPECT_EQ(state.backward_limit, -infinity);
}

TEST(SlipState, NamesAndSignsAgree) {
    EXPECT_EQ(name_of(SlipState::slip_forward), "slip_forward");
    EXPECT_EQ(name_of(SlipState::stick), "stick");
    EXPECT_EQ(name_of(SlipState::slip_backward), "slip_backward");
    EXPECT_EQ(sign(slip_towards(2.0)), 1.0);
    EXPECT_EQ(sign(slip_towards(-2.0)), -1.0);
    EXPECT_EQ(sign(SlipState::stick), 0.0);
}

} // namespace
} // namespace tribode
