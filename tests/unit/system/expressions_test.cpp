#include "base/error.hpp"
#include "system/expressions.hpp"
#include "system/tape.hpp"
#include "unit/system/random_expressions.hpp"

#include <gtest/gtest.h>
#include <limits>

namespace tribode {
namespace {

class ExpressionsTest : public testing::Test {
  protected:
    Expressions graph;
    Term x = graph.variable("x"), y = graph.variable("y");

    Term number(double value) { return graph.constant(value); }
    double value(Term term, double at_x, double at_y) const {
        const Tape tape(graph, {x, y}, {term});
        double result = 0;
        tape.evaluate({std::vector{at_x, at_y}}, std::span(&result, 1));
        return result;
    }
};

TEST_F(ExpressionsTest, EqualExpressionsAreOneTerm) {
    EXPECT_EQ(graph.make(Op::add, x, y), graph.make(Op::add, y, x));
    EXPECT_EQ(graph.make(Op::sin, graph.make(Op::multiply, x, y)), graph.make(Op::sin, graph.make(Op::multiply, y, x)));
    EXPECT_NE(graph.make(Op::subtract, x, y), graph.make(Op::subtract, y, x));
    EXPECT_NE(graph.variable("x"), x) << "a name is no identity";
}

TEST_F(ExpressionsTest, ConstantsAreFolded) {
    EXPECT_TRUE(graph.is_constant(graph.make(Op::power, number(2), number(10)), 1024));
    EXPECT_TRUE(graph.is_constant(graph.make(Op::select, number(1), number(3), x), 3));
    EXPECT_EQ(graph.make(Op::add, x, number(0)), x);
    EXPECT_EQ(graph.make(Op::multiply, number(1), x), x);
    EXPECT_TRUE(graph.is_constant(graph.make(Op::multiply, x, number(0)), 0));
    EXPECT_TRUE(graph.is_constant(graph.make(Op::subtract, x, x), 0));
    EXPECT_EQ(graph.make(Op::power, x, number(2)), graph.make(Op::multiply, x, x));
    EXPECT_EQ(graph.make(Op::negate, graph.make(Op::negate, x)), x);
}

TEST_F(ExpressionsTest, TheTextReadsAsItWasWritten) {
    const Term sum = graph.make(Op::add, y, number(2));
    EXPECT_EQ(graph.text(graph.make(Op::multiply, x, sum)), "x*(y + 2)");
    EXPECT_EQ(graph.text(graph.make(Op::subtract, x, graph.make(Op::subtract, y, number(1)))), "x - (y - 1)");
    EXPECT_EQ(graph.text(graph.make(Op::select, graph.make(Op::less, x, number(0)), y, x)), "where(x < 0, y, x)");
    EXPECT_EQ(graph.text(graph.make(Op::power, graph.make(Op::negate, x), number(3))), "(-x)^3");
}

TEST_F(ExpressionsTest, AVariableThatIsNoInputIsRefusedByName) { EXPECT_THROW(Tape(graph, {x}, {y}), InputError); }

TEST_F(ExpressionsTest, ReplacingIsOneStep) {
    const Term sum = graph.make(Op::add, x, y);
    const auto swapped = graph.substitute(std::vector{graph.make(Op::subtract, x, y)}, {{x, y}, {y, x}});
    EXPECT_EQ(swapped[0], graph.make(Op::subtract, y, x));
    EXPECT_EQ(graph.substitute(std::vector{sum}, {{y, number(0)}})[0], x);
}

TEST_F(ExpressionsTest, ADerivativeOfATermIsTakenOnce) {
    const Term product = graph.make(Op::multiply, graph.make(Op::sin, x), y);
    EXPECT_EQ(graph.derivatives(std::vector{product, product}, x)[1],
              graph.make(Op::multiply, graph.make(Op::cos, x), y));
    EXPECT_TRUE(graph.is_constant(graph.derivatives(std::vector{product}, graph.variable("z"))[0], 0));
}

TEST_F(ExpressionsTest, AKinkHasTheDerivativeOfItsSide) {
    const Term magnitude = graph.make(Op::select, graph.make(Op::less, x, number(0)), graph.make(Op::negate, x), x);
    const Term slope = graph.derivatives(std::vector{magnitude}, x)[0];
    EXPECT_EQ(value(slope, -3, 0), -1);
    EXPECT_EQ(value(slope, 3, 0), 1);
}

// The complex step x + ih gives Im f / h without a difference of near numbers: exact to rounding at h = 1e-100.
TEST_F(ExpressionsTest, DerivativesOfRandomGraphsAreThoseOfTheComplexStep) {
    constexpr double h = 1e-100;
    for (std::uint64_t seed = 1; seed <= 300; ++seed) {
        Expressions random;
        const std::vector<Term> variables = {random.variable("a"), random.variable("b"), random.variable("c")};
        RandomExpressions source(random, variables, seed);
        Term root = 0;
        for (int i = 0; i < 20; ++i) root = source.next();
        std::vector<double> point;
        for (std::size_t i = 0; i < variables.size(); ++i) point.push_back(4 * uniform(seed, 1, i) - 2);

        const std::vector<std::complex<double>> real(point.begin(), point.end());
        const Tape tape(random, variables, {root});
        double value = 0;
        tape.evaluate({point}, std::span(&value, 1));
        const double wanted = complex_value(random, root, variables, real).real();
        EXPECT_NEAR(value, wanted, 1e-12 * (1 + std::abs(wanted))) << random.text(root);

        for (std::size_t i = 0; i < variables.size(); ++i) {
            const Term derivative = random.derivatives(std::vector{root}, variables[i])[0];
            const Tape slope_tape(random, variables, {derivative});
            double slope = 0;
            slope_tape.evaluate({point}, std::span(&slope, 1));
            auto moved = real;
            moved[i] += std::complex<double>(0, h);
            const double step = complex_value(random, root, variables, moved).imag() / h;
            // Both are exact to rounding, which up to twenty operations in a row carry on.
            EXPECT_NEAR(slope, step, 1e-10 * (1 + std::abs(step))) << seed << ": " << random.text(root);
        }
    }
}

TEST_F(ExpressionsTest, ATapeOfManyRegistersAgreesWithASmallOne) {
    Term sum = number(0);
    for (int i = 0; i < 2000; ++i) sum = graph.make(Op::add, graph.make(Op::sin, graph.make(Op::add, sum, x)), y);
    const double large = value(sum, 0.3, 0.7);
    double wanted = 0;
    for (int i = 0; i < 2000; ++i) wanted = std::sin(wanted + 0.3) + 0.7;
    EXPECT_EQ(large, wanted);
}

} // namespace
} // namespace tribode
