#include "tribode/base/error.hpp"
#include "tribode/base/random.hpp"
#include "tribode/system/expressions.hpp"
#include "tribode/system/lookup_table.hpp"
#include "tribode/system/tape.hpp"

#include <cmath>
#include <gtest/gtest.h>

namespace tribode {
namespace {

using Points = LookupTable::Points;
using Interpolation = LookupTable::Interpolation;
using Extrapolation = LookupTable::Extrapolation;

class Draws {
  public:
    explicit Draws(std::uint64_t seed) : seed_(seed) {}
    double operator()(double low, double high) { return low + (high - low) * uniform(seed_, 0, count_++); }
    std::size_t below(std::size_t count) { return static_cast<std::size_t>((*this)(0, static_cast<double>(count))); }
    std::vector<double> ascending(std::size_t count) {
        std::vector<double> list = {(*this)(-3, 0)};
        while (list.size() < count) list.push_back(list.back() + std::pow(10, (*this)(-1, 0.5)));
        return list;
    }

  private:
    std::uint64_t seed_, count_ = 0;
};

Points random_points(Draws& draw) {
    Points points;
    points.x = draw.ascending(2 + draw.below(6));
    if (draw(0, 1) < 0.5) points.y = draw.ascending(2 + draw.below(5));
    points.interpolation = std::array{Interpolation::linear, Interpolation::spline, Interpolation::natural,
                                      Interpolation::pchip}[draw.below(points.y.empty() ? 4 : 3)];
    points.extrapolation = draw(0, 1) < 0.5 ? Extrapolation::hold : Extrapolation::linear;
    points.values.resize(points.x.size() * std::max<std::size_t>(points.y.size(), 1));
    for (double& value : points.values) value = draw(-5, 5);
    return points;
}

TEST(LookupTableTest, RangesHoldEveryValueOfTheTableAndItsSlopes) {
    long looked_at = 0;
    double widest = 0; // of the range over that of the values found, for one variable
    for (std::uint64_t seed = 1; seed <= 400; ++seed) {
        Draws draw(seed);
        const Points points = random_points(draw);
        std::vector<std::shared_ptr<const LookupTable>> tables = {std::make_shared<LookupTable>(points)};
        for (int variable = 0; variable < tables[0]->variables(); ++variable) {
            if (const auto slope = tables[0]->slope(variable)) tables.push_back(slope);
            if (const auto border = tables[0]->border(variable)) tables.push_back(border);
        }
        for (const auto& table : tables) {
            for (int box = 0; box < 10; ++box) {
                const auto range_near = [&](const std::vector<double>& abscissas) {
                    if (abscissas.empty()) return LookupTable::Range{0, 0};
                    const double low = draw(abscissas.front() - 2, abscissas.back() + 1);
                    return LookupTable::Range{low, low + std::pow(10, draw(-3, 0.8))};
                };
                const auto x = range_near(points.x), y = range_near(points.y);
                const int side = static_cast<int>(draw.below(4));
                const auto range = table->range(x, y, side);
                double low = INFINITY, high = -INFINITY;
                for (int i = 0; i < 300; ++i) {
                    const double u = i == 0 ? x.low : i == 1 ? x.high : draw(x.low, x.high);
                    const double v = i == 0 ? y.low : i == 1 ? y.high : draw(y.low, y.high);
                    const double value = table->value(u, v, side);
                    low = std::min(low, value);
                    high = std::max(high, value);
                    ASSERT_GE(value, range.low) << "seed " << seed << " at " << u << ", " << v;
                    ASSERT_LE(value, range.high) << "seed " << seed << " at " << u << ", " << v;
                    ++looked_at;
                }
                if (points.y.empty() && high - low > 1e-3)
                    widest = std::max(widest, (range.high - range.low) / (high - low));
            }
        }
    }
    EXPECT_GT(looked_at, 1'000'000);
    EXPECT_LT(widest, 3) << "a held side may jump in a small part of the interval, which random points miss";
}

TEST(LookupTableTest, RangeOfASplineIsExact) {
    // s^3 - s on [-1, 1]: extremes at 1/sqrt(3).
    Points points;
    for (const double x : {-2.0, -1.0, 0.0, 1.5, 2.0}) {
        points.x.push_back(x);
        points.values.push_back(x * x * x - x);
    }
    points.interpolation = Interpolation::spline;
    const LookupTable table(points);
    const double most = 2 / (3 * std::sqrt(3.0));
    const auto range = table.range({-1, 1}, {}, 0);
    EXPECT_NEAR(range.low, -most, 1e-12);
    EXPECT_NEAR(range.high, most, 1e-12);
    const auto slope = table.slope(0)->range({-1, 1}, {}, 0);
    EXPECT_NEAR(slope.low, -1, 1e-12);
    EXPECT_NEAR(slope.high, 2, 1e-12);
    EXPECT_EQ(table.range({-3, 1}, {}, 0).low, -INFINITY) << "there is no value beyond the abscissas";
    EXPECT_EQ(table.range({NAN, 1}, {}, 0).high, INFINITY);
    points.extrapolation = Extrapolation::hold;
    const auto held = LookupTable(points).range({-INFINITY, INFINITY}, {}, 0);
    EXPECT_NEAR(held.low, -6, 1e-11);
    EXPECT_NEAR(held.high, 6, 1e-11);
    points.extrapolation = Extrapolation::linear;
    EXPECT_EQ(LookupTable(points).range({0, INFINITY}, {}, 0).high, INFINITY);
}

TEST(LookupTableTest, SlopesAreThoseOfDifferences) {
    for (std::uint64_t seed = 1; seed <= 100; ++seed) {
        Draws draw(seed);
        const LookupTable table(random_points(draw));
        for (int i = 0; i < 20; ++i) {
            const double x = draw(-4, 8), y = draw(-4, 8), h = 1e-6;
            const int side = table.side_of(x, y);
            for (int variable = 0; variable < table.variables(); ++variable) {
                const double dx = variable == 0 ? h : 0, dy = variable == 1 ? h : 0;
                const double difference =
                    (table.value(x + dx, y + dy, side) - table.value(x - dx, y - dy, side)) / 2 / h;
                const auto slope = table.slope(variable);
                EXPECT_NEAR(slope ? slope->value(x, y, side) : 0, difference, 1e-5 * (1 + std::abs(difference)));
            }
        }
    }
}

TEST(LookupTableTest, BordersChangeTheirSignWhereSidesChange) {
    for (std::uint64_t seed = 1; seed <= 100; ++seed) {
        Draws draw(seed);
        Points points = random_points(draw);
        points.interpolation = Interpolation::linear;
        points.extrapolation = Extrapolation::hold;
        const LookupTable table(points);
        const auto border = table.border(0);
        ASSERT_TRUE(border);
        for (int i = 0; i < 100; ++i) {
            const double x = draw(points.x.front() - 1, points.x.back() + 1);
            EXPECT_EQ(border->value(x, 0) > 0, (table.side_of(x, 0) & 1) == 1);
        }
        // Held beyond a kink, a stretch goes on as it was.
        const double kink = points.x.back(), h = 1e-3;
        const int before = table.side_of(kink - h, 0);
        const double y = points.y.empty() ? 0 : points.y[0];
        EXPECT_NEAR(table.value(kink + h, y, before) - table.value(kink, y, before),
                    table.value(kink, y, before) - table.value(kink - h, y, before), 1e-12);
    }
}

TEST(LookupTableTest, EqualSlopesAreNoKink) {
    Points points;
    points.x = {0, 1, 2, 3};
    points.values = {0, 2, 4, 5};
    const LookupTable table(points);
    EXPECT_LT(table.border(0)->value(1, 0), 0);
    EXPECT_EQ(table.border(0)->value(2, 0), 0);
}

TEST(LookupTableTest, TheGraphDifferentiatesByTheChainRule) {
    Expressions graph;
    const Term a = graph.variable("a"), b = graph.variable("b");
    Points points;
    points.x = {0, 1, 2, 4, 5};
    points.y = {-1, 0, 2, 3};
    for (const double x : points.x) {
        for (const double y : points.y) points.values.push_back(std::sin(x) * (y + y * y));
    }
    points.interpolation = Interpolation::spline;
    const auto table = std::make_shared<const LookupTable>(points);
    const Term value = graph.look_up(table, graph.make(Op::multiply, a, a), graph.make(Op::multiply, a, b));
    EXPECT_EQ(value, graph.look_up(table, graph.make(Op::multiply, a, a), graph.make(Op::multiply, a, b)));
    const std::vector roots = {value};
    const Tape tape(graph, {a, b}, {value, graph.derivatives(roots, a)[0], graph.derivatives(roots, b)[0]});
    const auto at = [&](double x, double y) {
        std::vector<double> result(3);
        tape.evaluate({std::vector{x, y}}, result);
        return result;
    };
    const double h = 1e-6;
    const auto here = at(1.3, 0.7);
    EXPECT_EQ(here[0], table->value(1.69, 1.3 * 0.7));
    EXPECT_NEAR(here[1], (at(1.3 + h, 0.7)[0] - at(1.3 - h, 0.7)[0]) / (2 * h), 1e-8);
    EXPECT_NEAR(here[2], (at(1.3, 0.7 + h)[0] - at(1.3, 0.7 - h)[0]) / (2 * h), 1e-8);
    // Of numbers, a number.
    EXPECT_TRUE(graph.is_constant(graph.look_up(table, graph.constant(1), graph.constant(2)), table->value(1, 2)));
    // With a number in the place of a variable, the same.
    const Term put_in = graph.substitute(roots, {{b, graph.constant(0.7)}})[0];
    double result = 0;
    Tape(graph, {a}, {put_in}).evaluate({std::vector{1.3}}, std::span(&result, 1));
    EXPECT_EQ(result, here[0]);
}

} // namespace
} // namespace tribode
