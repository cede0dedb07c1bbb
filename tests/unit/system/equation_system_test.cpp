#include "tribode/base/error.hpp"
#include "tribode/solver/simulator.hpp"
#include "tribode/system/equation_system.hpp"
#include "unit/system/small_systems.hpp"

#include <algorithm>
#include <cmath>
#include <gtest/gtest.h>

namespace tribode {
namespace {

SolverOptions by(Method method) { return {.method = method, .relative_tolerance = 1e-10, .absolute_tolerance = 1e-12}; }

class EveryMethod : public testing::TestWithParam<Method> {};
INSTANTIATE_TEST_SUITE_P(Methods, EveryMethod,
                         testing::Values(Method::exact, Method::erk, Method::adams, Method::bdf, Method::ida),
                         [](const auto& test) { return name_of(test.param); });

Writer bouncing_ball(double restitution) {
    Writer w;
    const Term h = w.state("h", 1), v = w.state("v", 0);
    w.rate(0, v).rate(1, w.number(-9.81));
    w.when(w.less(h, w.number(0)), {{h, w.number(0)}, {v, w.multiply(w.number(-restitution), v)}});
    return w;
}

TEST_P(EveryMethod, ABallBouncesAtTheInstantsOfItsSeries) {
    const EquationSystem system(bouncing_ball(0.7).equations);
    Simulator run(system, by(GetParam()));
    ASSERT_TRUE(run.advance_to(2).ok());
    ASSERT_EQ(run.events().size(), 4u);
    const double first = std::sqrt(2 / 9.81);
    double wanted = first, flight = 2 * first;
    for (const auto& event : run.events()) {
        // The default of the multistep methods leaves some nanoseconds; the exact solver rounding.
        EXPECT_NEAR(event.t, wanted, GetParam() == Method::exact ? 1e-14 : 1e-7);
        wanted += flight *= 0.7;
    }
}

// Zeno: the bounces come to an end at t = first (1 + 2 e/(1 - e)), and so does the run.
TEST_P(EveryMethod, ABallThatBouncesForEverEndsAsChattering) {
    const EquationSystem system(bouncing_ball(0.7).equations);
    Simulator run(system, by(GetParam()));
    const RunOutcome outcome = run.advance_to(4);
    EXPECT_EQ(outcome.end, RunEnd::chattering);
    EXPECT_NEAR(outcome.t, std::sqrt(2 / 9.81) * (1 + 1.4 / 0.3), 1.1e-3) << "the window of chattering";
}

// x' = 1 below zero and -1 above: it slides along zero, which this engine does not follow.
TEST_P(EveryMethod, SlidingAtASwitchingSurfaceEndsAsChattering) {
    Writer w;
    const Term x = w.state("x", 0.3);
    w.rate(0, w.where(w.less(x, w.number(0)), w.number(1), w.number(-1)));
    const EquationSystem system(w.equations);
    Simulator run(system, by(GetParam()));
    const RunOutcome outcome = run.advance_to(1);
    EXPECT_EQ(outcome.end, RunEnd::chattering);
    EXPECT_NEAR(outcome.t, 0.3, 1.1e-3);
    EXPECT_NE(outcome.message.find("the relation x < 0"), std::string::npos) << outcome.message;
}

// As above, along a surface that moves: the tolerances of both states do not cancel in what crosses.
TEST_P(EveryMethod, SlidingAlongASurfaceThatMovesEndsAsChattering) {
    Writer w;
    const Term x = w.state("x", 0.8), y = w.state("y", 0.2);
    w.rate(0, w.where(w.less(x, y), w.number(-0.1), w.number(-2.4))).rate(1, w.number(-0.3));
    const EquationSystem system(w.equations);
    SolverOptions options = by(GetParam());
    options.max_steps = 10000; // in place of a run without end
    Simulator run(system, options);
    const RunOutcome outcome = run.advance_to(1);
    EXPECT_EQ(outcome.end, RunEnd::chattering);
    EXPECT_NEAR(outcome.t, 2.0 / 7, 1e-3);
    EXPECT_LT(run.statistics().events, 1100);
}

// Bounds of the states let their difference have either sign on a step, however short.
TEST(EquationSystem, StatesThatMoveAlikeAreNotSearchedForCrossings) {
    for (const Method method : {Method::erk, Method::adams, Method::bdf}) {
        Writer w;
        const Term x = w.state("x", 1.5), y = w.state("y", 1.5);
        const Term larger = w.where(w.less(x, y), y, x);
        const auto rate = [&](Term own, Term other) {
            return w.subtract(w.graph.make(Op::sin, other), w.multiply(w.number(2), w.add(own, larger)));
        };
        w.rate(0, rate(x, y)).rate(1, rate(y, x));
        const EquationSystem system(w.equations);
        Simulator run(system, by(method));
        ASSERT_TRUE(run.advance_to(1).ok());
        EXPECT_NEAR(run.state().x[0], run.state().x[1], 1e-12);
        EXPECT_LT(run.statistics().guard_evaluations, 5 * run.statistics().steps);
    }
}

// The flow between two tanks, or to one of a fixed level: a step leads beyond the crossing, where sqrt would have no value.
TEST(EquationSystem, ARootOfADistanceHasAValueOnBothSides) {
    for (const Method method : {Method::erk, Method::adams, Method::bdf, Method::ida}) {
        for (const bool is_other_first : {false, true}) {
            Writer w;
            const Term x = w.state("x", 1.2), y = w.state("y", 1), zero = w.number(0);
            const Term away = is_other_first ? w.subtract(y, x) : w.subtract(x, y);
            const Term distance = w.where(w.less(away, zero), w.graph.make(Op::negate, away), away);
            const Term flow = w.multiply(w.number(-0.2), w.graph.make(Op::sqrt, distance));
            w.rate(0, flow).rate(1, w.number(0.1));
            const EquationSystem system(w.equations);
            Simulator run(system, by(method));
            const RunOutcome outcome = run.advance_to(4);
            ASSERT_TRUE(outcome.ok()) << outcome.message;
            // z = x - y falls by 0.1 + 0.2 sqrt(|z|), to zero after 10 sqrt(0.2) - 5 log(1 + 2 sqrt(0.2)), and on in the same way.
            const double root = std::sqrt(run.state().x[1] - run.state().x[0]);
            EXPECT_NEAR(10 * root - 5 * std::log(1 + 2 * root),
                        4 - (10 * std::sqrt(0.2) - 5 * std::log(1 + 2 * std::sqrt(0.2))), 1e-6);
        }
    }
}

TEST_P(EveryMethod, TwoEventsAtOneInstantAreHandledInDeclaredOrder) {
    Writer w;
    const Term x = w.state("x", 1), y = w.state("y", 1), n = w.discrete("n", 0);
    w.rate(0, w.number(-1)).rate(1, w.number(-1));
    w.when(w.less(x, w.number(0)), {{n, w.add(w.multiply(w.number(10), n), w.number(1))}});
    w.when(w.less(y, w.number(0)), {{n, w.add(w.multiply(w.number(10), n), w.number(2))}});
    const EquationSystem system(w.equations);
    Simulator run(system, by(GetParam()));
    ASSERT_TRUE(run.advance_to(2).ok());
    EXPECT_EQ(system.discrete(run.state())[0], 12);
    EXPECT_EQ(run.events().size(), 2u);
}

// The first resets what the second would have seen: it does not fire.
TEST_P(EveryMethod, AnEventThatWasTakenAwayByAnotherAtTheSameInstantDoesNotHappen) {
    Writer w;
    const Term x = w.state("x", 1), y = w.state("y", 1), n = w.discrete("n", 0);
    w.rate(0, w.number(-1)).rate(1, w.number(-1));
    w.when(w.less(x, w.number(0)), {{y, w.number(5)}});
    w.when(w.less(y, w.number(0)), {{n, w.number(1)}});
    const EquationSystem system(w.equations);
    Simulator run(system, by(GetParam()));
    ASSERT_TRUE(run.advance_to(2).ok());
    EXPECT_EQ(system.discrete(run.state())[0], 0);
    EXPECT_NEAR(run.state().x[1], 4, 1e-9);
}

TEST_P(EveryMethod, AResetMayFireAnotherEventAtTheSameInstant) {
    Writer w;
    const Term x = w.state("x", 1), y = w.state("y", 3), n = w.discrete("n", 0);
    w.rate(0, w.number(-1));
    w.when(w.less(x, w.number(0)), {{y, w.number(-1)}, {x, w.number(10)}});
    w.when(w.less(y, w.number(0)), {{n, w.add(n, w.number(1))}});
    const EquationSystem system(w.equations);
    Simulator run(system, by(GetParam()));
    ASSERT_TRUE(run.advance_to(2).ok());
    EXPECT_EQ(system.discrete(run.state())[0], 1);
    ASSERT_EQ(run.events().size(), 2u);
    EXPECT_EQ(run.events()[0].t, run.events()[1].t);
}

// Each makes the other true again, without time passing.
TEST_P(EveryMethod, EventsThatFireOneAnotherForEverEndTheRun) {
    Writer w;
    const Term x = w.state("x", 1), n = w.discrete("n", 0);
    const Term one = w.number(1), half = w.number(0.5);
    w.rate(0, w.number(-1));
    w.when(w.less(x, w.number(0)), {{n, one}});
    w.when(w.graph.make(Op::all, w.less(x, w.number(0)), w.less(half, n)), {{n, w.number(0)}});
    w.when(w.graph.make(Op::all, w.less(x, w.number(0)), w.less(n, half)), {{n, one}});
    const EquationSystem system(w.equations);
    Simulator run(system, by(GetParam()));
    const RunOutcome outcome = run.advance_to(2);
    EXPECT_EQ(outcome.end, RunEnd::chattering);
    EXPECT_NEAR(outcome.t, 1, 1e-9);
}

TEST(EquationSystem, ACrossingAtASampleComesBeforeIt) {
    Writer w;
    const Term x = w.state("x", 0), u = w.discrete("u", 0), n = w.discrete("n", 0);
    w.rate(0, w.number(1));
    w.when(w.graph.make(Op::less_equal, w.number(1), x), {{u, w.number(7)}});
    w.equations.clocks.push_back({"clock", 1, 0, {{n, u}}, std::nullopt});
    const EquationSystem system(w.equations);
    Simulator run(system, by(Method::exact));
    ASSERT_TRUE(run.advance_to(1).ok());
    ASSERT_EQ(run.events().size(), 1u) << "also at the end";
    EXPECT_EQ(run.events()[0].t, 1);
    EXPECT_EQ(system.discrete(run.state())[1], 7);
}

// The instant of an event is known to rounding only; what it sets is of the side to which it leads.
TEST_P(EveryMethod, WhatAnEventSetsHasTheBranchesOfAfterIt) {
    for (const Op op : {Op::less, Op::less_equal}) {
        Writer w;
        const Term x = w.state("x", 0.1), n = w.discrete("n", 0), m = w.discrete("m", 0);
        w.state("y", 0);
        const Term before = w.graph.make(op, w.equations.time, w.number(1));
        const Term below = w.graph.make(op, x, w.number(0.7));
        w.rate(0, w.number(0.3)).rate(1, w.where(before, w.number(1), w.where(below, w.number(2), w.number(3))));
        w.when(w.graph.make(Op::logical_not, before), {{n, w.where(before, w.number(1), w.number(2))}});
        w.when(w.graph.make(Op::logical_not, below), {{m, w.where(below, w.number(1), w.number(2))}});
        const EquationSystem system(w.equations);
        Simulator run(system, by(GetParam()));
        ASSERT_TRUE(run.advance_to(3).ok());
        EXPECT_EQ(system.discrete(run.state())[0], 2);
        EXPECT_EQ(system.discrete(run.state())[1], 2);
    }
}

TEST_P(EveryMethod, WhatAnEventAtTheVeryStartSetsHasTheBranchesOfAfterIt) {
    Writer w;
    const Term x = w.state("x", 0), n = w.discrete("n", 0);
    const Term before = w.graph.make(Op::less_equal, w.equations.time, w.number(0));
    w.rate(0, w.number(1));
    w.when(w.graph.make(Op::logical_not, before), {{n, w.where(before, w.number(1), w.number(2))}});
    w.when(w.less(w.number(0), x), {}); // at the same instant
    const EquationSystem system(w.equations);
    Simulator run(system, by(GetParam()));
    ASSERT_TRUE(run.advance_to(1).ok());
    EXPECT_EQ(system.discrete(run.state())[0], 2);
}

TEST_P(EveryMethod, AnEventAtTheVeryStartFires) {
    Writer w;
    const Term x = w.state("x", 0), n = w.discrete("n", 0);
    w.rate(0, w.number(-1));
    w.when(w.less(x, w.number(0)), {{n, w.add(n, w.number(1))}});
    const EquationSystem system(w.equations);
    Simulator run(system, by(GetParam()));
    ASSERT_TRUE(run.advance_to(1).ok());
    EXPECT_EQ(system.discrete(run.state())[0], 1);
    EXPECT_NEAR(run.events().at(0).t, 0, 1e-9);
}

TEST_P(EveryMethod, WhatIsTrueAtTheStartIsNoEvent) {
    Writer w;
    const Term x = w.state("x", -1), n = w.discrete("n", 0);
    w.rate(0, w.number(-1));
    w.when(w.less(x, w.number(0)), {{n, w.number(1)}});
    const EquationSystem system(w.equations);
    Simulator run(system, by(GetParam()));
    ASSERT_TRUE(run.advance_to(1).ok());
    EXPECT_EQ(system.discrete(run.state())[0], 0);
    EXPECT_TRUE(run.events().empty());
}

// A condition that is a difference of large numbers is found a rounding early or late; it changes once all the same.
TEST_P(EveryMethod, ACrossingThatIsLocatedARoundingEarlyCountsOnce) {
    for (int i = 0; i < 50; ++i) {
        Writer w;
        const Term x = w.state("x", 0.01 * i), y = w.state("y", 0.3), n = w.discrete("n", 0);
        w.rate(0, w.number(1)).rate(1, w.number(-0.7));
        const Term sum = w.add(w.multiply(w.number(200), w.subtract(x, w.number(0.61))), w.multiply(w.number(0.02), y));
        w.when(w.less(w.number(0), sum), {{n, w.add(n, w.number(1))}});
        const EquationSystem system(w.equations);
        Simulator run(system, by(GetParam()));
        const RunOutcome outcome = run.advance_to(1);
        ASSERT_TRUE(outcome.ok()) << outcome.message;
        EXPECT_EQ(system.discrete(run.state())[0], 1);
        EXPECT_EQ(run.events().size(), 1u);
    }
}

// x' = -1 until x falls below zero, x' = 1 until it rises above it: both conditions stand at the same zero, and which side
// the located instant lies on is for rounding to say. It goes on where another switch leads away.
TEST_P(EveryMethod, AModeThatBeginsWhereItsOwnConditionWouldEndItLasts) {
    Writer w;
    const Term x = w.state("x", 0.3), mode = w.discrete("mode", 0), zero = w.number(0);
    const Term down = w.graph.make(Op::equal, mode, w.number(0)), up = w.graph.make(Op::equal, mode, w.number(1));
    w.rate(0, w.where(down, w.number(-1), w.where(up, w.number(-1), w.number(1))));
    w.when(w.graph.make(Op::all, down, w.less(x, zero)), {{mode, w.number(1)}});
    w.when(w.graph.make(Op::all, up, w.less(zero, x)), {{mode, w.number(2)}});
    const EquationSystem system(w.equations);
    Simulator run(system, by(GetParam()));
    ASSERT_TRUE(run.advance_to(1).ok());
    EXPECT_EQ(system.discrete(run.state())[0], 1);
    EXPECT_NEAR(run.state().x[0], -0.7, 1e-9);
}

// A thermostat: two modes, each with its own rate, that take turns.
TEST_P(EveryMethod, ModesTakeTurns) {
    Writer w;
    const Term temperature = w.state("T", 18), mode = w.discrete("mode", 0);
    const Term on = w.graph.make(Op::equal, mode, w.number(0)), off = w.graph.make(Op::equal, mode, w.number(1));
    const Term loss = w.multiply(w.number(-0.1), w.subtract(temperature, w.number(10)));
    w.rate(0, w.where(on, w.add(loss, w.number(2)), loss));
    w.when(w.graph.make(Op::all, on, w.less(w.number(21), temperature)), {{mode, w.number(1)}});
    w.when(w.graph.make(Op::all, off, w.less(temperature, w.number(19))), {{mode, w.number(0)}});
    const EquationSystem system(w.equations);
    EXPECT_FALSE(system.why_not_affine());
    Simulator run(system, by(GetParam()));
    ASSERT_TRUE(run.advance_to(20).ok());
    // Heating from T to 30 - (30 - T) e^{-t/10}, cooling from T to 10 + (T - 10) e^{-t/10}.
    const double first = 10 * std::log(12.0 / 9), cooling = 10 * std::log(11.0 / 9), heating = 10 * std::log(11.0 / 9);
    ASSERT_GE(run.events().size(), 3u);
    // The multistep methods leave hundreds of their tolerance, 1e-10 of 20 degrees, over a rate of one degree a second.
    const double tolerance = GetParam() == Method::exact ? 1e-13 : 1e-6;
    EXPECT_NEAR(run.events()[0].t, first, tolerance);
    EXPECT_NEAR(run.events()[1].t, first + cooling, tolerance);
    EXPECT_NEAR(run.events()[2].t, first + cooling + heating, tolerance);
}

TEST_P(EveryMethod, ASampleMayFireAnEvent) {
    Writer w;
    const Term n = w.discrete("n", 0), fired = w.discrete("fired", 0);
    w.state("x", 0);
    w.equations.clocks.push_back({"clock", 0.1, 0, {{n, w.add(n, w.number(1))}}, std::nullopt});
    w.when(w.graph.make(Op::less_equal, w.number(5), n), {{n, w.number(0)}, {fired, w.add(fired, w.number(1))}});
    const EquationSystem system(w.equations);
    Simulator run(system, by(GetParam()));
    ASSERT_TRUE(run.advance_to(0.95).ok());
    EXPECT_EQ(system.discrete(run.state())[0], 0);
    EXPECT_EQ(system.discrete(run.state())[1], 2);
}

TEST_P(EveryMethod, AStiffModeIsRunByAnyMethodThatMayTakeTheTime) {
    Writer w;
    const Term x = w.state("x", 1), mode = w.discrete("mode", 0);
    const Term stiff = w.graph.make(Op::equal, mode, w.number(1));
    w.rate(0, w.where(stiff, w.multiply(w.number(-1e4), w.subtract(x, w.number(0.2))), w.number(-1)));
    w.when(w.less(x, w.number(0.5)), {{mode, w.number(1)}});
    const EquationSystem system(w.equations);
    Simulator run(system, by(GetParam()));
    ASSERT_TRUE(run.advance_to(1).ok());
    EXPECT_NEAR(run.state().x[0], 0.2, 1e-7);
}

TEST(EquationSystem, AffineIsWhatItIs) {
    const auto reason = [](Writer& w) { return EquationSystem(w.equations).why_not_affine().value_or(""); };
    Writer linear;
    const Term x = linear.state("x", 1), d = linear.discrete("d", 2);
    linear.rate(0, linear.add(linear.multiply(d, x), linear.multiply(linear.equations.time, linear.equations.time)));
    EXPECT_EQ(reason(linear), "");
    linear.rate(0, linear.multiply(x, x));
    EXPECT_EQ(reason(linear), "der(x) is not linear in x: its derivative by it is x + x");
    linear.rate(0, linear.graph.make(Op::sin, linear.equations.time));
    EXPECT_EQ(reason(linear), "der(x) is no polynomial of degree 3 in t");
    linear.rate(0, linear.number(1)).when(linear.less(linear.multiply(x, x), linear.number(4)), {});
    EXPECT_NE(reason(linear).find("the relation x*x < 4 is not linear in x"), std::string::npos);
}

// Forty relations and five numbers in A and G: each has its place in the key, which tells whether the matrices are the same.
TEST(EquationSystem, TheKeyOfItsMatricesHoldsAnyNumberOfValues) {
    Writer w;
    Term sum = w.number(0);
    const Term x = w.state("x", 0.5);
    std::vector<Term> gains;
    for (int i = 0; i < 5; ++i) gains.push_back(w.discrete("gain" + std::to_string(i), -1.0 - i));
    for (const Term gain : gains) sum = w.add(sum, w.multiply(gain, x));
    for (int i = 0; i < 40; ++i) {
        sum = w.add(sum,
                    w.where(w.less(x, w.number(0.1 + 0.02 * i)), w.multiply(w.number(-0.1 * (i + 1)), x), w.number(0)));
    }
    w.rate(0, sum);
    w.equations.clocks.push_back({"clock", 0.01, 0, {{gains[4], w.subtract(gains[4], w.number(0.5))}}, std::nullopt});
    const EquationSystem system(w.equations);
    const auto key_of = [&](const SystemState& state) {
        AffineKey key;
        system.append_affine_key(*state.discrete, key);
        return key;
    };
    const SystemState start = system.initial_state();
    EXPECT_TRUE(key_of(start) == key_of(system.initial_state()));
    std::vector<AffineKey> keys = {key_of(start)};
    const auto is_new = [&](const AffineKey& key) {
        const bool known = std::find(keys.begin(), keys.end(), key) != keys.end();
        keys.push_back(key);
        return !known;
    };
    for (GuardId relation = 0; relation < 40; ++relation) {
        SystemState state = start;
        EventLog log;
        system.on_crossing(relation, state, log);
        EXPECT_TRUE(is_new(key_of(state))) << relation;
    }
    SystemState sampled = start;
    system.on_sample(0, 0, sampled);
    EXPECT_TRUE(is_new(key_of(sampled)));

    // dx/dt has no constant part here.
    const AffineForm form = system.affine_form(*start.discrete);
    double slope = 0;
    system.derivative(0, std::vector<double>{1}, *start.discrete, {&slope, 1});
    EXPECT_EQ(form.a, std::vector<double>{slope});

    Simulator exact(system, by(Method::exact)), erk(system, by(Method::erk));
    ASSERT_TRUE(exact.advance_to(0.3).ok());
    ASSERT_TRUE(erk.advance_to(0.3).ok());
    EXPECT_NEAR(exact.state().x[0], erk.state().x[0], 1e-9);
}

// x' = -x + t^3: the exact solver with a polynomial, against the closed form.
TEST(EquationSystem, APolynomialInTimeIsSolvedToRounding) {
    Writer w;
    const Term x = w.state("x", 1), t = w.equations.time;
    w.rate(0, w.subtract(w.multiply(t, w.multiply(t, t)), x));
    const EquationSystem system(w.equations);
    Simulator run(system, by(Method::exact));
    ASSERT_TRUE(run.advance_to(2).ok());
    EXPECT_NEAR(run.state().x[0], 7 * std::exp(-2.0) + 8 - 12 + 12 - 6, 1e-14);
}

TEST(EquationSystem, TheJacobianStandsColumnByColumn) {
    Writer w;
    const Term x = w.state("x", 2), y = w.state("y", 3);
    w.rate(0, w.multiply(x, y)).rate(1, w.graph.make(Op::sin, x));
    const EquationSystem system(w.equations);
    const SystemState start = system.initial_state();
    std::vector<double> matrix(4);
    ASSERT_TRUE(system.jacobian(0, start.x, *start.discrete, matrix));
    EXPECT_EQ(matrix, (std::vector<double>{3, std::cos(2.0), 2, 0}));
}

TEST(EquationSystem, BelowNoEventARelationIsTakenAsItIs) {
    Writer w;
    const Term x = w.state("x", 1);
    const Term branch = w.where(w.less(x, w.number(0.5)), w.number(-2), w.number(-1));
    w.rate(0, w.graph.make(Op::no_event, branch));
    const EquationSystem quiet(w.equations);
    EXPECT_EQ(quiet.guard_count(), 0u);
    w.rate(0, branch);
    EXPECT_EQ(EquationSystem(w.equations).guard_count(), 2u) << "the last is that of endless events";
}

TEST(EquationSystem, ASnapshotGoesOnAsTheRunDoes) {
    const EquationSystem system(bouncing_ball(0.7).equations);
    Simulator run(system, by(Method::erk));
    ASSERT_TRUE(run.advance_to(1).ok());
    Simulator other(system, by(Method::erk), run.state());
    ASSERT_TRUE(run.advance_to(2).ok());
    ASSERT_TRUE(other.advance_to(2).ok());
    EXPECT_NEAR(other.state().x[0], run.state().x[0], 1e-9); // steps differ, tolerances do not
}

TEST(EquationSystem, ARateThatIsNotFiniteIsNamed) {
    Writer w;
    const Term x = w.state("x", 1);
    w.state("y", 0);
    w.rate(0, w.number(-1)).rate(1, w.graph.make(Op::log, x));
    const EquationSystem system(w.equations);
    Simulator run(system, by(Method::erk));
    const auto culprit = run.advance_to(3).not_finite;
    ASSERT_TRUE(culprit);
    EXPECT_EQ(culprit->state, 1u);
    EXPECT_NEAR(culprit->t, 1, 1e-3);
}

TEST_P(EveryMethod, ARateThatIsNeverFiniteIsNamedAtTheStart) {
    Writer w;
    w.state("x", 1);
    w.state("y", 0);
    w.rate(0, w.number(-1)).rate(1, w.graph.make(Op::divide, w.number(1), w.number(0)));
    const EquationSystem system(w.equations);
    Simulator run(system, by(GetParam()));
    const auto culprit = run.advance_to(3).not_finite;
    ASSERT_TRUE(culprit);
    EXPECT_EQ(culprit->state, 1u);
    EXPECT_NEAR(culprit->t, 0, 1e-3);
}

// A belt that turns round at 0.5, on which x = t moves with t - 1 before and t + 1 behind.
TEST_P(EveryMethod, AnEventKnowsWhatATermWasBeforeTheInstant) {
    Writer w;
    const Term x = w.state("x", 0), jumped_from = w.discrete("jumped_from", 9);
    w.state("y", 0);
    const Term belt = w.where(w.less(w.equations.time, w.number(0.5)), w.number(1), w.number(-1));
    const Term v = w.subtract(x, belt), before = w.graph.make(Op::before, v);
    w.rate(0, w.number(1)).rate(1, belt);
    w.when(w.graph.make(Op::no_event, w.less(w.number(1), w.subtract(v, before))), {{jumped_from, before}});
    w.when(w.less(w.number(0.7), x), {}); // an instant at which nothing jumps
    const EquationSystem system(w.equations);
    Simulator run(system, by(GetParam()));
    ASSERT_TRUE(run.advance_to(1).ok());
    ASSERT_EQ(run.events().size(), 2u);
    EXPECT_NEAR(run.events()[0].t, 0.5, 1e-12);
    EXPECT_NEAR(system.discrete(run.state())[0], -0.5, 1e-9);
}

// The instant is found from either side of the jump, by rounding.
TEST_P(EveryMethod, AnEventBelowNoEventSeesTheJumpOfItsInstant) {
    for (int i = 1; i <= 60; ++i) {
        Writer w;
        const Term x = w.state("x", 0), seen = w.discrete("seen", 0);
        const Term jump = w.where(w.less(w.equations.time, w.number(0.037 * i)), w.number(0), w.number(1));
        w.rate(0, jump);
        w.when(w.graph.make(Op::no_event, w.less(w.number(0.5), jump)), {{seen, w.add(jump, x)}});
        const EquationSystem system(w.equations);
        Simulator run(system, by(GetParam()));
        ASSERT_TRUE(run.advance_to(3).ok());
        ASSERT_EQ(run.events().size(), 1u) << i;
        EXPECT_NEAR(run.events()[0].t, 0.037 * i, 1e-12);
        EXPECT_NEAR(system.discrete(run.state())[0], 1, 1e-9);
    }
}

// All right sides are the values before the event: two states change places.
TEST_P(EveryMethod, NewValuesAreMadeOfThoseBeforeTheEvent) {
    Writer w;
    const Term x = w.state("x", 1), y = w.state("y", 7), n = w.discrete("n", 0);
    w.rate(0, w.number(-1));
    w.when(w.less(x, w.number(0.5)), {{x, y}, {y, x}, {n, w.add(n, y)}});
    const EquationSystem system(w.equations);
    Simulator run(system, by(GetParam()));
    ASSERT_TRUE(run.advance_to(0.75).ok());
    EXPECT_NEAR(run.state().x[0], 6.75, 1e-9);
    EXPECT_NEAR(run.state().x[1], 0.5, 1e-9);
    EXPECT_NEAR(system.discrete(run.state())[0], 7, 1e-9);
}

// Where steps lead beyond the place at which a condition has a value, its fall before that is found all the same.
TEST(EquationSystem, AConditionWithoutAValueDoesNotHideItsCrossing) {
    for (const Method method : {Method::erk, Method::adams, Method::bdf}) {
        Writer w;
        const Term x = w.state("x", 1), n = w.discrete("n", 0), v = w.discrete("v", -1);
        w.rate(0, v);
        const Term root = w.graph.make(Op::sqrt, x);
        w.when(w.less(root, w.number(0.1)), {{n, w.add(n, w.number(1))}, {v, w.number(0)}});
        const EquationSystem system(w.equations);
        Simulator run(system, by(method));
        const RunOutcome outcome = run.advance_to(2);
        EXPECT_TRUE(outcome.ok()) << outcome.message;
        EXPECT_EQ(system.discrete(run.state())[0], 1);
        EXPECT_NEAR(run.state().x[0], 0.01, 1e-9);
    }
}

TEST(EquationSystem, AConditionThatLosesItsValueEndsTheRunThereAndIsNamed) {
    Writer w;
    const Term x = w.state("x", 1);
    w.rate(0, w.number(-1));
    w.when(w.less(w.add(w.graph.make(Op::sqrt, x), w.number(1)), w.number(0.5)), {});
    const EquationSystem system(w.equations);
    Simulator run(system, by(Method::erk));
    const RunOutcome outcome = run.advance_to(2);
    EXPECT_FALSE(outcome.ok());
    EXPECT_NEAR(outcome.t, 1, 1e-9);
    EXPECT_NE(outcome.message.find("the relation 1 + sqrt(x) < 0.5, which has no value there,"), std::string::npos)
        << outcome.message;
}

TEST(EquationSystem, ANewValueThatIsNotFiniteIsRefused) {
    Writer w;
    const Term x = w.state("x", 1), y = w.state("y", 0);
    w.rate(0, w.number(-1));
    w.when(w.less(x, w.number(0.5)), {{y, w.graph.make(Op::divide, w.number(1), y)}});
    const EquationSystem system(w.equations);
    Simulator run(system, by(Method::exact));
    try {
        run.advance_to(1);
        ADD_FAILURE() << "y is " << run.state().x[1];
    } catch (const InputError& error) {
        EXPECT_STREQ(error.what(), "when 0: y gets the value inf at t = 0.5 s, must be finite");
    }
}

// x' = u, u from a counter n: two clocks that meet. The second reads what the first has set, one clock or two.
TEST(EquationSystem, ClocksThatMeetAndCauseNoEventAreOne) {
    for (const bool watched : {false, true}) {
        Writer w;
        w.state("x", 0);
        const Term n = w.discrete("n", 0), u = w.discrete("u", 0), past = w.discrete("past", 0);
        w.rate(0, u);
        w.equations.clocks.push_back({"count", 0.5, 0, {{n, w.add(n, w.number(1))}}, std::nullopt});
        w.equations.clocks.push_back({"hold", 0.5, 0, {{u, w.multiply(n, w.number(2))}}, std::nullopt});
        if (watched) w.when(w.less(w.number(2.5), n), {{past, w.number(1)}});
        const EquationSystem system(w.equations);
        EXPECT_EQ(system.clocks().size(), watched ? 2u : 1u);
        Simulator run(system, by(Method::exact));
        ASSERT_TRUE(run.advance_to(1.25).ok());
        EXPECT_NEAR(run.state().x[0], 0.5 * 2 + 0.5 * 4 + 0.25 * 6, 1e-15);
        EXPECT_EQ(system.discrete(run.state())[2], watched);
        EXPECT_EQ(run.statistics().restarts, 3); // once an instant
    }
}

// A clock whose values move nothing lets the integrator go on.
TEST(EquationSystem, AClockThatChangesNoMotionRestartsNothing) {
    Writer w;
    w.state("x", 0);
    const Term n = w.discrete("n", 0);
    w.rate(0, w.number(1));
    w.equations.clocks.push_back({"count", 0.1, 0, {{n, w.add(n, w.number(1))}}, std::nullopt});
    const EquationSystem system(w.equations);
    Simulator run(system, by(Method::erk));
    ASSERT_TRUE(run.advance_to(0.95).ok());
    EXPECT_EQ(system.discrete(run.state())[0], 10);
    EXPECT_EQ(run.statistics().restarts, 1);
}

TEST(EquationSystem, NamesStandOnce) {
    Writer w;
    w.state("x", 1);
    w.discrete("x", 1);
    EXPECT_THROW(EquationSystem{w.equations}, InputError);
}

} // namespace
} // namespace tribode
