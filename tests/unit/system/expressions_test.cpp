#include "tribode/base/error.hpp"
#include "tribode/base/random.hpp"
#include "tribode/system/expressions.hpp"
#include "tribode/system/tape.hpp"
#include "unit/system/random_expressions.hpp"

#include <bit>
#include <gtest/gtest.h>
#include <limits>
#include <numbers>

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
    // Absolute values and signs, as a reader writes them.
    const Term error = graph.make(Op::subtract, x, y), below = graph.make(Op::less, error, number(0));
    const auto by_sign = [&](Term negative, Term positive) {
        return graph.make(Op::no_event, graph.make(Op::select, below, negative, positive));
    };
    EXPECT_EQ(graph.text(by_sign(graph.make(Op::subtract, y, x), error)), "abs(x - y)");
    const Term bent = graph.make(Op::power, x, y), bent_by_sign = by_sign(graph.make(Op::negate, bent), bent);
    EXPECT_EQ(graph.text(bent_by_sign), "sign(x - y)*x^y");
    EXPECT_EQ(graph.text(graph.make(Op::power, bent_by_sign, y)), "(sign(x - y)*x^y)^y");
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

TEST_F(ExpressionsTest, WhatRestsAtTheEdgeOfADomainHasTheDerivativeZero) {
    const Term above = graph.make(Op::less, number(1), x), clamped = graph.make(Op::select, above, number(1), x);
    for (const Op op : {Op::asin, Op::acos}) {
        const Term slope = graph.derivatives(std::vector{graph.make(op, clamped)}, x)[0];
        EXPECT_EQ(value(slope, 2, 0), 0);
        EXPECT_NEAR(value(slope, 0.6, 0), op == Op::asin ? 1.25 : -1.25, 1e-15);
        EXPECT_TRUE(std::isinf(value(slope, 1, 0)));
    }
    const Term left = graph.make(Op::subtract, number(1), clamped);
    EXPECT_EQ(value(graph.derivatives(std::vector{graph.make(Op::power, left, number(0.5))}, x)[0], 2, 0), 0);
    // x^y by y, at x = 0: it goes to zero with x^y.
    const Term by_exponent = graph.derivatives(std::vector{graph.make(Op::power, x, y)}, y)[0];
    EXPECT_EQ(value(by_exponent, 0, 1.5), 0);
    EXPECT_DOUBLE_EQ(value(by_exponent, 4, 1.5), 8 * std::log(4.0));
    EXPECT_FALSE(std::isfinite(value(by_exponent, 0, 0)));
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

// Each operation by itself, in the order of the graph.
std::vector<double> one_by_one(const Expressions& graph, const std::vector<Term>& variables,
                               const std::vector<double>& point, const std::vector<Term>& roots) {
    std::unordered_map<Term, double> value;
    for (std::size_t i = 0; i < variables.size(); ++i) value[variables[i]] = point[i];
    for (const Term term : graph.reachable(roots)) {
        const auto& node = graph[term];
        if (node.op == Op::constant) value[term] = node.value;
        if (operand_count(node.op) > 0) value[term] = apply(node.op, value[node.a], value[node.b], value[node.c]);
    }
    std::vector<double> values;
    for (const Term root : roots) values.push_back(value[root]);
    return values;
}

// Sums of products of all shapes: long and nested ones, shared parts, constant factors, one output a part of another. The
// tape takes them together and still rounds as it is written, so that all bits are the same.
TEST_F(ExpressionsTest, SumsOfProductsAreRoundedAsTheyAreWritten) {
    for (std::uint64_t seed = 1; seed <= 300; ++seed) {
        Expressions random;
        const std::vector<Term> variables = {random.variable("a"), random.variable("b"), random.variable("c")};
        std::uint64_t count = 0;
        const auto draw = [&](std::size_t of) {
            return static_cast<std::size_t>(uniform(seed, 0, count++) * static_cast<double>(of));
        };
        const auto number = [&] { return random.constant(4 * uniform(seed, 1, count++) - 2); };
        std::vector<Term> pool = variables, roots;
        for (int i = 0; i < 60; ++i) {
            const Term a = pool[draw(pool.size())], b = pool[draw(pool.size())], last = pool.back();
            Term made = a;
            switch (draw(9)) {
            case 0: made = random.make(Op::multiply, a, b); break;
            case 1: made = random.make(Op::multiply, number(), a); break;
            case 2: made = random.make(Op::negate, a); break;
            case 3: made = random.make(Op::no_event, a); break;
            case 4: made = random.make(Op::subtract, a, b); break;
            case 5: made = random.make(Op::add, last, random.make(Op::multiply, number(), a)); break;
            case 6: made = random.make(Op::subtract, last, random.make(Op::multiply, a, b)); break;
            case 7: made = random.make(Op::add, number(), last); break;
            default: made = random.make(Op::add, last, b);
            }
            pool.push_back(made);
        }
        for (int i = 0; i < 5; ++i) roots.push_back(pool[pool.size() - 1 - draw(40)]);
        const std::vector<double> point = {uniform(seed, 2, 0), -uniform(seed, 2, 1), 3.0};
        std::vector<double> values(roots.size());
        Tape(random, variables, roots).evaluate({point}, values);
        EXPECT_EQ(values, one_by_one(random, variables, point, roots)) << seed;
    }
}

// As many summands as are unrolled, and more.
TEST_F(ExpressionsTest, SumsOfAnyLengthHaveAllTheirSummands) {
    Term sum = graph.make(Op::multiply, number(1.5), x);
    for (int length = 2; length < 40; ++length) {
        sum = graph.make(Op::subtract, sum, graph.make(Op::multiply, graph.make(Op::multiply, number(length), x), y));
        EXPECT_EQ(value(sum, 0.3, 0.7), one_by_one(graph, {x, y}, {0.3, 0.7}, {sum})[0]) << length;
    }
}

TEST_F(ExpressionsTest, InputsComeInParts) {
    std::vector<Term> inputs;
    for (const char* name : {"a", "b", "c", "d", "e"}) inputs.push_back(graph.variable(name));
    const Term output = graph.make(Op::subtract, graph.make(Op::divide, inputs[0], inputs[2]), inputs[4]);
    const std::vector<double> first = {6}, third = {10, 2, 30, 5};
    double found = 0;
    Tape(graph, inputs, {output}, {1, 0, 4}).evaluate({first, {}, third}, {&found, 1});
    EXPECT_EQ(found, 6.0 / 2 - 5);
}

// Several sets of inputs side by side are evaluated to the same bits as one by one, but for functions of their own.
TEST_F(ExpressionsTest, LanesAreTheSameBitsAsOneByOne) {
    RandomExpressions random(graph, {x, y, graph.variable("z")}, 5, Op::atan);
    std::vector<Term> outputs;
    for (int i = 0; i < 300; ++i) outputs.push_back(random.next());
    const auto inputs = graph.variables_of(outputs);
    Term sum = outputs[0]; // of more summands than are written out
    for (std::size_t i = 1; i < 25; ++i)
        sum = graph.make(Op::subtract, sum, graph.make(Op::multiply, outputs[i], outputs[i + 1]));
    outputs.push_back(sum);
    const Tape tape(graph, inputs, outputs);
    std::size_t finite = 0;
    const auto check = [&]<std::size_t lanes>(std::integral_constant<std::size_t, lanes>) {
        std::vector<double> given(inputs.size() * lanes), found(outputs.size() * lanes);
        for (std::size_t i = 0; i < given.size(); ++i) given[i] = std::sin(1.7 * static_cast<double>(i + lanes));
        Tape::SideBySide<lanes>(tape, nullptr).evaluate(given.data(), nullptr, found.data());
        for (std::size_t l = 0; l < lanes; ++l) {
            std::vector<double> own(inputs.size()), one(outputs.size());
            for (std::size_t i = 0; i < own.size(); ++i) own[i] = given[i * lanes + l];
            tape.evaluate({own}, one);
            for (std::size_t i = 0; i < one.size(); ++i) {
                finite += std::isfinite(one[i]) ? 1 : 0;
                EXPECT_EQ(std::bit_cast<std::uint64_t>(one[i]), std::bit_cast<std::uint64_t>(found[i * lanes + l]))
                    << lanes << " " << l << " " << i;
            }
        }
    };
    check(std::integral_constant<std::size_t, 1>());
    check(std::integral_constant<std::size_t, 4>());
    check(std::integral_constant<std::size_t, 8>());
    EXPECT_GT(finite, 13 * outputs.size() * 9 / 10) << "what is no number is equal to the bit for little";
}

// Sine, cosine, exp and tanh of lanes are those of the C library but for three units in the last place, whatever the argument.
TEST_F(ExpressionsTest, FunctionsOfLanesAgreeWithTheCLibrary) {
    constexpr double infinite = std::numeric_limits<double>::infinity();
    std::vector<double> arguments = {0,    -0.0,   5e-324,   1e-300,    -1e-9,       22,
                                     1e22, -1e308, infinite, -infinite, std::nan("")};
    for (int k = -400; k <= 400; ++k) arguments.push_back(k * std::numbers::pi / 4);
    for (std::uint64_t k = 0; k < 20000; ++k) {
        const double u = 2 * uniform(3, 0, k) - 1;
        for (const double size : {1e-6, 1.0, 25.0, 750.0, 2e5}) arguments.push_back(size * u);
    }
    arguments.resize(arguments.size() / 8 * 8);
    for (const Op op : {Op::sin, Op::cos, Op::exp, Op::tanh}) {
        const Tape tape(graph, {x}, {graph.make(op, x)});
        double worst = 0;
        for (std::size_t k = 0; k < arguments.size(); k += 8) {
            double found[8], of_four[8];
            Tape::SideBySide<8>(tape, nullptr).evaluate(&arguments[k], nullptr, found);
            Tape::SideBySide<4>(tape, nullptr).evaluate(&arguments[k], nullptr, of_four);
            Tape::SideBySide<4>(tape, nullptr).evaluate(&arguments[k + 4], nullptr, of_four + 4);
            for (std::size_t l = 0; l < 8; ++l) {
                const double wanted = apply(op, arguments[k + l], 0, 0);
                double alone = 0;
                Tape::SideBySide<1>(tape, nullptr).evaluate(&arguments[k + l], nullptr, &alone);
                EXPECT_EQ(std::bit_cast<std::uint64_t>(found[l]), std::bit_cast<std::uint64_t>(of_four[l]));
                EXPECT_EQ(std::bit_cast<std::uint64_t>(found[l]), std::bit_cast<std::uint64_t>(alone));
                EXPECT_EQ(std::isfinite(found[l]), std::isfinite(wanted)) << arguments[k + l];
                if (!std::isfinite(wanted)) continue;
                const double unit = std::nextafter(std::abs(wanted), infinite) - std::abs(wanted);
                worst = std::max(worst, std::abs(found[l] - wanted) / unit);
            }
        }
        EXPECT_LE(worst, 3) << static_cast<int>(op);
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
