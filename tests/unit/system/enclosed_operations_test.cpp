#include "tribode/base/random.hpp"
#include "tribode/system/enclosed_operations.hpp"
#include "tribode/system/tape.hpp"
#include "unit/system/random_expressions.hpp"

#include <cmath>
#include <complex>
#include <gtest/gtest.h>

namespace tribode {
namespace {

// Bounds of random expressions over random pieces of random lines hold the values at points of them, and the rates of
// change that complex arithmetic finds, which has nothing in common with the bounds.
TEST(EnclosedOperations, HoldValuesAndRatesOfRandomExpressions) {
    long finite = 0, all = 0;
    for (std::uint64_t seed = 1; seed <= 300; ++seed) {
        Expressions graph;
        const std::vector<Term> variables = {graph.variable("x"), graph.variable("y")};
        RandomExpressions make(graph, variables, seed);
        Term root = 0;
        for (int i = 0; i < 12; ++i) root = make.next();
        const Tape tape(graph, variables, {root});
        for (std::uint64_t piece = 0; piece < 10; ++piece) {
            const auto draw = [&](std::uint64_t k, double low, double high) {
                return low + (high - low) * uniform(seed, piece + 1, k);
            };
            const double width = std::pow(10, draw(0, -8, 0.5));
            const double x0 = draw(1, -3, 3), y0 = draw(2, -3, 3), u = draw(3, -1, 1), v = draw(4, -1, 1);
            const auto along = [&](double start, double rate) {
                const double end = start + rate * width;
                return Enclosure{{std::min(start, end), std::max(start, end)}, Interval::point(rate)};
            };
            const std::array<Enclosure, 2> inputs = {along(x0, u), along(y0, v)};
            Enclosure bounds;
            tape.enclose({std::span<const Enclosure>(inputs), {}, {}}, std::span(&bounds, 1));
            ASSERT_LE(bounds.value.low, bounds.value.high);
            ++all;
            finite += std::isfinite(bounds.rate.low) && std::isfinite(bounds.rate.high);
            for (int i = 0; i <= 10; ++i) {
                const double t = i == 10 ? width : width * i / 10; // not a rounding beyond the end
                const std::array<double, 2> point = {x0 + u * t, y0 + v * t};
                double value = 0;
                tape.evaluate({point}, std::span(&value, 1));
                EXPECT_TRUE(bounds.value.contains(value))
                    << seed << ": " << value << " in [" << bounds.value.low << ", " << bounds.value.high << "], "
                    << value - bounds.value.low << ", " << bounds.value.high - value << ": " << graph.text(root);
                constexpr double step = 1e-30; // the imaginary part is the slope times this
                const auto complex =
                    complex_value(graph, root, variables, {{point[0], u * step}, {point[1], v * step}});
                const double rate = complex.imag() / step, rounding = 1e-9 * (1 + std::abs(rate));
                EXPECT_LE(bounds.rate.low, rate + rounding) << seed << ": " << graph.text(root);
                EXPECT_GE(bounds.rate.high, rate - rounding) << seed << ": " << graph.text(root);
            }
        }
    }
    EXPECT_GT(finite, all / 2) << "bounds that say nothing hold always";
}

// Parts of a tape, of one output or of some in another order: values and bounds are those of the whole to the bit.
TEST(EnclosedOperations, OfAPartOfATapeAreThoseOfTheWhole) {
    std::size_t instructions = 0, of_parts = 0;
    for (std::uint64_t seed = 1; seed <= 100; ++seed) {
        Expressions graph;
        const std::vector<Term> variables = {graph.variable("x"), graph.variable("y")};
        RandomExpressions make(graph, variables, seed);
        std::vector<Term> roots = {graph.constant(3), variables[1]};
        for (int i = 0; i < 12; ++i) roots.push_back(make.next());
        const Tape whole(graph, variables, roots);
        const std::array<double, 2> point = {uniform(seed, 1, 0), uniform(seed, 1, 1)};
        const std::array<Enclosure, 2> piece = {Enclosure{{point[0], point[0] + 0.1}, {1, 2}},
                                                Enclosure{{point[1] - 0.1, point[1]}, {-1, 1}}};
        const Tape::EnclosedInputs inputs{{std::span<const Enclosure>(piece), {}}, {}};
        std::vector<double> values(roots.size());
        std::vector<Enclosure> bounds(roots.size());
        whole.evaluate({point}, values);
        whole.enclose(inputs, bounds);
        const std::size_t last = roots.size() - 1;
        const std::vector<std::vector<std::size_t>> choices = {{}, {0}, {1}, {last}, {last - 3, 0, last - 7}};
        for (const auto& outputs : choices) {
            const Tape part = whole.part(outputs);
            std::vector<double> of_part(outputs.size());
            std::vector<Enclosure> bounds_of_part(outputs.size());
            part.evaluate({point}, of_part);
            part.enclose(inputs, bounds_of_part);
            for (std::size_t i = 0; i < outputs.size(); ++i) {
                EXPECT_EQ(of_part[i], values[outputs[i]]) << seed;
                const auto& [value, rate] = bounds_of_part[i];
                EXPECT_EQ(value.low, bounds[outputs[i]].value.low) << seed;
                EXPECT_EQ(value.high, bounds[outputs[i]].value.high) << seed;
                EXPECT_EQ(rate.low, bounds[outputs[i]].rate.low) << seed;
                EXPECT_EQ(rate.high, bounds[outputs[i]].rate.high) << seed;
            }
        }
        EXPECT_EQ(whole.part(choices[0]).instruction_count(), 0U);
        EXPECT_EQ(whole.part(choices[2]).instruction_count(), 0U);
        instructions += whole.instruction_count();
        of_parts += whole.part(choices[3]).instruction_count();
    }
    EXPECT_LT(of_parts, instructions / 2);
}

// A narrow piece has narrow bounds: as wide as the function changes on it, to first order.
TEST(EnclosedOperations, ShrinkWithThePiece) {
    Expressions graph;
    const Term t = graph.variable("t");
    const Term wave = graph.make(Op::sin, graph.make(Op::multiply, graph.constant(30), t));
    const Tape tape(graph, {t}, {graph.make(Op::exp, wave)});
    for (const double width : {1e-2, 1e-4, 1e-6}) {
        const Enclosure time{{0.7, 0.7 + width}, {1, 1}};
        Enclosure bounds;
        tape.enclose({std::span(&time, 1), {}, {}}, std::span(&bounds, 1));
        EXPECT_LT(bounds.value.high - bounds.value.low, 30 * std::exp(1) * width * 1.5);
        EXPECT_GE(bounds.value.high - bounds.value.low, 0);
    }
}

TEST(EnclosedOperations, OutsideADomainNothingIsKnown) {
    const Enclosure around{{-0.5, 0.5}, {1, 1}}, none{};
    for (const Op op : {Op::log, Op::sqrt}) {
        EXPECT_EQ(apply(op, around, none, none).value.low, -Interval::infinity);
        EXPECT_EQ(apply(op, around, none, none).rate.high, Interval::infinity);
    }
    // A condition that may change within the piece may jump; one that may not is constant.
    EXPECT_EQ(apply(Op::less, around, Enclosure::constant(0), none).rate.high, Interval::infinity);
    const Enclosure holds = apply(Op::less, around, Enclosure::constant(1), none);
    EXPECT_EQ(holds.value.low, 1);
    EXPECT_EQ(holds.rate.high, 0);
}

} // namespace
} // namespace tribode
