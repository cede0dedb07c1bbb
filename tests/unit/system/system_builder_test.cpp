#include "tribode/base/error.hpp"
#include "tribode/solver/simulator.hpp"
#include "tribode/system/equation_system.hpp"
#include "tribode/system/system_builder.hpp"

#include <cmath>
#include <gtest/gtest.h>

namespace tribode {
namespace {

// What the function throws, or "nothing".
template <class Function>
std::string complaint(const Function& function) {
    try {
        function();
    } catch (const InputError& error) {
        return error.what();
    }
    return "nothing";
}

TEST(SystemBuilder, AnExpressionReadsAsItIsWritten) {
    SystemBuilder b("test");
    const Expression x = b.state("x", 1), y = b.state("y", 2);
    const auto text = [&](const Expression& e) { return e.graph()->text(e.in(*e.graph())); };
    EXPECT_EQ(text(2 * x - y / 3), "x*2 - y/3");
    EXPECT_EQ(text(-x - 1), "-x - 1");
    EXPECT_EQ(text(x > 0), "0 < x");
    EXPECT_EQ(text(sin(x * y)), "sin(x*y)");
}

TEST(SystemBuilder, NumbersAloneAreCalculatedAtOnce) {
    const Expression five = Expression(2) + Expression(3);
    EXPECT_FALSE(five.graph());
    Expressions graph;
    EXPECT_TRUE(graph.is_constant(five.in(graph), 5));
}

// An oscillator x'' = -w^2 x, sampled every 0.1 s into a discrete variable.
TEST(SystemBuilder, StatesOutputsAndSamplesAreThoseOfTheClosedForm) {
    SystemBuilder b("oscillator");
    const Expression x = b.state("x", 1, "m"), v = b.state("v", 0, "m/s"), held = b.discrete("held", 0, "m");
    b.rate(x, v);
    b.rate(v, -9 * x);
    b.output("twice", 2 * x + 0 * held, "m");
    b.sample("hold", 0.1, 0, {{held, x}});
    const EquationSystem system(b.equations());
    Simulator run(system, {});
    ASSERT_TRUE(run.advance_to(1).ok());
    double twice = 0;
    system.outputs(run.state(), {&twice, 1});
    EXPECT_NEAR(twice, 2 * std::cos(3.0), 1e-12);
    EXPECT_NEAR(system.discrete(run.state())[0], std::cos(3.0), 1e-12);
}

TEST(SystemBuilder, AnEventEndsTheRunWhereItsConditionBecomesTrue) {
    SystemBuilder b("fall");
    const Expression h = b.state("h", 1), v = b.state("v", 0);
    b.rate(h, v);
    b.rate(v, -2);
    b.stop_when("landed", h <= 0);
    const EquationSystem system(b.equations());
    Simulator run(system, {});
    const RunOutcome outcome = run.advance_to(5);
    EXPECT_EQ(outcome.end, RunEnd::stopped);
    EXPECT_NEAR(outcome.t, 1, 1e-14);
}

// 0 = x + z - 3, x' = z - x - 1: x' = 2 - 2 x.
TEST(SystemBuilder, AlgebraicVariablesFollowFromTheirResiduals) {
    SystemBuilder b("algebraic");
    const Expression x = b.state("x", 0), z = b.algebraic("z", 0);
    b.rate(x, z - x - 1);
    b.residual("sum", x + z - 3);
    const EquationSystem system(b.equations());
    Simulator run(system, {});
    ASSERT_TRUE(run.advance_to(1).ok());
    EXPECT_NEAR(run.state().x[0], 1 - std::exp(-2.0), 1e-6);
    EXPECT_NEAR(run.state().x[0] + run.state().x[1], 3, 1e-9);
}

TEST(SystemBuilder, SystemsOfOneBuilderAreIndependent) {
    SystemBuilder b("growing");
    const Expression x = b.state("x", 1);
    b.rate(x, x);
    const EquationSystem first(b.equations());
    b.output("square", x * x);
    const EquationSystem second(b.equations());
    EXPECT_EQ(first.equations().outputs.size(), 0u);
    EXPECT_EQ(second.equations().outputs.size(), 1u);
}

TEST(SystemBuilder, WhatIsWrongIsSaid) {
    SystemBuilder b("test"), other("other");
    const Expression x = b.state("x", 1), z = other.state("z", 1);
    EXPECT_EQ(complaint([&] { (void)(x + z); }), "an expression is made of variables of two systems, must be of one");
    EXPECT_EQ(complaint([&] { b.rate(x, z); }), "test: an expression has variables of another system");
    EXPECT_EQ(complaint([&] { b.equations(); }), "test: the state x has no rate");
    b.rate(x, -x);
    EXPECT_EQ(complaint([&] { b.rate(x, x); }), "test: the state x has two rates, must be one");
    EXPECT_EQ(complaint([&] { b.rate(2 * x, x); }), "test: a rate is given for x*2, which is no state");
    EXPECT_EQ(complaint([&] { b.when("never", x, {}); }),
              "test: the condition of \"never\" is x, must be a comparison or made of comparisons");
    EXPECT_EQ(complaint([&] {
                  b.when("late", x < 0, {{x + 1, 0}});
              }),
              "test: x + 1 gets a new value, must be a state or a discrete variable");
    EXPECT_EQ(complaint([&] { b.state("w", std::nan("")); }),
              "test: w has the start value nan and the nominal value 1, must be finite, and the latter positive");
    b.algebraic("q", 0);
    EXPECT_EQ(complaint([&] { b.equations(); }),
              "test: there are 1 algebraic variables and 0 residuals, must be as many");
}

} // namespace
} // namespace tribode
