#include "tribode/base/error.hpp"
#include "tribode/system/linearization.hpp"
#include "unit/system/small_systems.hpp"

#include <cmath>
#include <gtest/gtest.h>
#include <numbers>

namespace tribode {
namespace {

// y = g/(s^2 + d s + k): der(x) = v, der(v) = -k x - d v + g u.
Writer oscillator(double k, double d, double g) {
    Writer w;
    const Term x = w.state("x", 0), v = w.state("v", 0), u = w.graph.variable("u");
    w.equations.inputs.push_back({"u", "", 0, u});
    w.rate(0, v).rate(
        1, w.subtract(w.multiply(w.number(g), u), w.add(w.multiply(w.number(k), x), w.multiply(w.number(d), v))));
    w.equations.outputs.push_back({"y", "", x});
    return w;
}

TEST(Linearization, AnOscillatorHasThePolesOfItsPolynomial) {
    const auto w = oscillator(4, 0.4, 3);
    const Linearization linear = linearize(w.equations, {0, {0, 0}, {}});
    const auto poles = linear.poles();
    ASSERT_EQ(poles.size(), 2u);
    EXPECT_NEAR(poles[0].real(), -0.2, 1e-14);
    EXPECT_NEAR(poles[0].imag(), -std::sqrt(3.96), 1e-14);
    EXPECT_TRUE(linear.is_stable());
    const std::complex<double> s(0, 2 * std::numbers::pi * 0.7);
    EXPECT_NEAR(std::abs(linear.response(0.7, 0, 0) - 3.0 / (s * s + 0.4 * s + 4.0)), 0, 1e-14);
    EXPECT_EQ(linear.rate_left, 0);
}

TEST(Linearization, APointThatDoesNotRestIsSaidSo) {
    const auto w = oscillator(4, 0.4, 3);
    EXPECT_NEAR(linearize(w.equations, {0, {0.5, 0}, {}}).rate_left, 2, 1e-15);
}

// der(x) = -x + asin(min(x, 1)): at x = 2 the arc rests at its edge; at x = 1 it has no slope.
TEST(Linearization, AnArcAtTheEdgeOfItsDomainIsConstantOrRefused) {
    Writer w;
    const Term x = w.state("x", 0), one = w.number(1);
    const Term arc = w.graph.make(Op::asin, w.where(w.less(one, x), one, x));
    w.rate(0, w.subtract(arc, x));
    const Linearization linear = linearize(w.equations, {0, {2}, {}});
    EXPECT_EQ(linear.a(0, 0), -1);
    EXPECT_TRUE(linear.is_stable());
    try {
        linearize(w.equations, {0, {1}, {}});
        FAIL() << "a slope without an end is to be refused";
    } catch (const InputError& problem) {
        EXPECT_NE(std::string(problem.what()).find("by x is not a finite number at this point"), std::string::npos)
            << problem.what();
    }
}

// der(x) = a x + u, u := -k x at each T: x[k+1] = (e^{aT} - k (e^{aT} - 1)/a) x[k].
TEST(Linearization, TheSampledControllerIsPartOfTheLoop) {
    constexpr double a = 1, k = 3, T = 0.1;
    for (const bool called : {false, true}) {
        Writer w;
        const Term x = w.state("x", 0), u = w.discrete("u", 0);
        w.rate(0, w.add(w.multiply(w.number(a), x), u));
        Equations::Clock clock{"controller", T, 0, {}, std::nullopt};
        if (called) {
            clock.function =
                Equations::Function{{x}, {u}, [](long, auto read, auto written) { written[0] = -k * read[0]; }};
        } else {
            clock.set = {{u, w.multiply(w.number(-k), x)}};
        }
        w.equations.clocks.push_back(clock);
        const Linearization linear = linearize(w.equations, {0, {0}, {0}});
        EXPECT_EQ(linear.sample_time, T);
        const double e = std::exp(a * T), wanted = e - k * (e - 1) / a;
        const auto poles = linear.poles(); // u is written anew from x at each sample: a pole at zero
        ASSERT_EQ(poles.size(), 2u);
        // Differences of a linear function are exact to rounding over the step, 6e-6.
        EXPECT_NEAR(poles[0].real(), 0, 1e-9);
        EXPECT_NEAR(poles[1].real(), wanted, called ? 1e-9 : 1e-14);
        EXPECT_TRUE(linear.is_stable());
    }
}

// A clock of half the period, with an offset: two updates in a period, each after its own stretch of time.
TEST(Linearization, ClocksOfSeveralPeriodsHaveACommonOne) {
    Writer w;
    const Term x = w.state("x", 0), u = w.discrete("u", 0), n = w.discrete("n", 0);
    w.rate(0, u);
    w.equations.clocks.push_back({"fast", 0.1, 0.05, {{u, w.multiply(w.number(-2), x)}}, std::nullopt});
    w.equations.clocks.push_back({"slow", 0.2, 0, {{n, w.multiply(w.number(0.5), n)}}, std::nullopt});
    const Linearization linear = linearize(w.equations, {0, {0}, {0, 0}});
    EXPECT_DOUBLE_EQ(linear.sample_time, 0.2);
    // (x, u) after 0.05 s, update, 0.1 s, update, 0.05 s.
    const auto period = [](double x0, double u0) {
        double held = u0, at = x0 + 0.05 * held;
        held = -2 * at;
        at += 0.1 * held;
        held = -2 * at;
        at += 0.05 * held;
        return std::pair(at, held);
    };
    EXPECT_NEAR(linear.a(0, 0), period(1, 0).first, 1e-15);
    EXPECT_NEAR(linear.a(0, 1), period(0, 1).first, 1e-15);
    EXPECT_NEAR(linear.a(1, 0), period(1, 0).second, 1e-15);
    EXPECT_NEAR(linear.a(1, 1), period(0, 1).second, 1e-15);
    EXPECT_NEAR(linear.a(2, 2), 0.5, 1e-15);
}

TEST(Linearization, ClocksWithoutACommonPeriodAreRefused) {
    Writer w;
    const Term n = w.discrete("n", 0);
    w.equations.clocks.push_back({"a", 0.1, 0, {{n, n}}, std::nullopt});
    w.equations.clocks.push_back({"b", 0.1 * std::sqrt(2), 0, {{n, n}}, std::nullopt});
    EXPECT_THROW(linearize(w.equations, {0, {}, {0}}), InputError);
}

// A rounded measurement still closes the loop; what is not in the linear system is told.
TEST(Linearization, WhatIsLeftOutIsTold) {
    Writer w;
    const Term x = w.state("x", 0), u = w.discrete("u", 0), mode = w.discrete("mode", 0);
    w.equations.discrete[1].modes = {"on", "off"};
    const Term quantum = w.number(0.5);
    const Term rounded = w.multiply(quantum, w.graph.make(Op::floor, w.multiply(w.number(2), x)));
    const Term magnitude = w.where(w.less(x, w.number(0)), w.graph.make(Op::negate, x), x);
    w.rate(0, w.add(w.add(u, magnitude), x));
    w.equations.clocks.push_back({"controller", 0.1, 0, {{u, w.multiply(w.number(-3), rounded)}}, std::nullopt});
    const auto in = [&](int number) { return w.graph.make(Op::equal, mode, w.number(number)); };
    w.when(w.graph.make(Op::all, in(0), w.less(w.number(1), x)), {{mode, w.number(1)}});
    w.when(w.graph.make(Op::all, in(1), w.less(x, w.number(1))), {{mode, w.number(0)}});
    const Linearization linear = linearize(w.equations, {0, {0}, {0, 0}});
    EXPECT_EQ(linear.left_out,
              (std::vector<std::string>{"the event when 0", "the steps of floor(x*2)", "the other side of x < 0"}));
    // x' = u + 2 x above zero, u = -3 x at each sample.
    const double e = std::exp(0.2), wanted = e - 3 * (e - 1) / 2;
    EXPECT_NEAR(linear.poles().back().real(), 1, 1e-14) << "the mode stays";
    EXPECT_NEAR(linear.poles()[1].real(), wanted, 1e-14);
    EXPECT_EQ(linearize(w.equations, {0, {-0.2}, {0, 1}}).left_out.size(), 2u);
}

TEST(Linearization, ASampleThatMakesAnEventHappenIsRefused) {
    Writer w;
    const Term n = w.discrete("n", 4), m = w.discrete("m", 0);
    w.equations.clocks.push_back({"count", 0.1, 0, {{n, w.add(n, w.number(1))}}, std::nullopt});
    w.when(w.graph.make(Op::less_equal, w.number(5), n), {{m, w.number(1)}});
    EXPECT_EQ(linearize(w.equations, {0, {}, {1, 0}}).left_out, std::vector<std::string>{"the event when 0"});
    EXPECT_THROW(linearize(w.equations, {0, {}, {4, 0}}), InputError);
}

} // namespace
} // namespace tribode
