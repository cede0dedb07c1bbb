#include "tribode/base/random.hpp"
#include "tribode/system/tape.hpp"

#include <array>
#include <bit>
#include <cmath>
#include <gtest/gtest.h>
#include <limits>
#include <unordered_map>

namespace tribode {
namespace {

bool are_same(double a, double b) {
    if (std::isnan(a) && std::isnan(b)) return true;
    return std::bit_cast<std::uint64_t>(a) == std::bit_cast<std::uint64_t>(b);
}

// Equations as a loop writes them: the same for each of `count` elements.
class Elements {
  public:
    explicit Elements(std::size_t count) {
        for (std::size_t i = 0; i < 2 * count; ++i) {
            x.push_back(variable("x", i));
            y.push_back(variable("y", i));
        }
        const Term shared = variable("shared", 0);
        std::vector<Term> all;
        for (std::size_t i = 0; i < count; ++i) {
            const Term constant = graph.constant(0.1 + static_cast<double>(i)), other = graph.constant(-3.3);
            const Term near = x[2 * i], far = x[2 * i + 1]; // every second one
            const Term less = make(Op::less, x[i], y[i]);
            for (const Term term : {
                     make(Op::add, x[i], y[i]),
                     make(Op::subtract, x[i], shared),
                     make(Op::multiply, x[i], y[i]),
                     make(Op::divide, shared, y[i]),
                     make(Op::negate, make(Op::subtract, y[i], x[i])),
                     make(Op::less_equal, x[i], y[i]),
                     make(Op::equal, x[i], y[i]),
                     less,
                     make(Op::select, less, constant, make(Op::multiply, constant, y[i])),
                     make(Op::select, make(Op::less, far, near), far, near),
                     make(Op::select, make(Op::less, near, far), far, near),
                     make(Op::add, make(Op::multiply, constant, x[i]), make(Op::multiply, y[i], shared)),
                     make(Op::subtract, make(Op::add, constant, make(Op::multiply, other, x[i])),
                          make(Op::multiply, make(Op::multiply, constant, y[i]), near)),
                 }) {
                all.push_back(term);
            }
        }
        // A sum and a minimum of them all.
        outputs = all;
        Term sum = all.front(), least = all.front();
        for (const Term term : std::span(all).subspan(1)) {
            sum = make(Op::add, sum, term);
            least = make(Op::select, make(Op::less, term, least), term, least);
        }
        outputs.push_back(sum);
        outputs.push_back(least);
    }

    // Node by node, each operation by itself.
    std::vector<double> values(std::span<const double> inputs_values) const {
        std::unordered_map<Term, double> known;
        for (std::size_t i = 0; i < inputs.size(); ++i) known[inputs[i]] = inputs_values[i];
        for (const Term term : graph.reachable(outputs)) {
            const auto& node = graph[term];
            if (node.op == Op::variable) continue;
            known[term] =
                node.op == Op::constant ? node.value : apply(node.op, known[node.a], known[node.b], known[node.c]);
        }
        std::vector<double> list;
        for (const Term output : outputs) list.push_back(known[output]);
        return list;
    }

    Term make(Op op, Term a, Term b = 0, Term c = 0) { return graph.make(op, a, b, c); }

    Expressions graph;
    std::vector<Term> inputs, x, y, outputs;

  private:
    Term variable(const std::string& name, std::size_t i) {
        inputs.push_back(graph.variable(name + std::to_string(i)));
        return inputs.back();
    }
};

// Numbers, and now and then what is none.
std::vector<double> random_inputs(std::size_t count, std::uint64_t seed) {
    constexpr double infinity = std::numeric_limits<double>::infinity();
    constexpr std::array special = {0.0, -0.0, infinity, -infinity, std::numeric_limits<double>::quiet_NaN(), 1.0};
    std::vector<double> values;
    for (std::size_t i = 0; i < count; ++i) {
        const double u = uniform(seed, 0, i), chosen = uniform(seed, 1, i);
        const auto place = static_cast<std::size_t>(chosen * 30);
        values.push_back(place < special.size() ? special[place] : 4 * u - 2);
    }
    return values;
}

TEST(Tape, ElementsHaveTheBitsOfOperationsOneByOneHoweverManyThereAre) {
    for (std::size_t count = 1; count <= 21; ++count) {
        const Elements elements(count);
        const Tape tape(elements.graph, elements.inputs, elements.outputs);
        for (std::uint64_t seed = 0; seed < 20; ++seed) {
            const auto inputs = random_inputs(elements.inputs.size(), 100 * count + seed);
            std::vector<double> values(elements.outputs.size());
            tape.evaluate({inputs}, values);
            const auto expected = elements.values(inputs);
            for (std::size_t i = 0; i < values.size(); ++i) {
                ASSERT_TRUE(are_same(values[i], expected[i]))
                    << count << " elements, output " << i << ": " << values[i] << ", not " << expected[i];
            }
        }
    }
}

TEST(Tape, PartsAndLanesHaveTheBitsOfTheWhole) {
    const Elements elements(13);
    const Tape tape(elements.graph, elements.inputs, elements.outputs);
    const auto inputs = random_inputs(elements.inputs.size(), 7);
    std::vector<double> whole(elements.outputs.size());
    tape.evaluate({inputs}, whole);

    for (const std::size_t step : {1, 2, 13, 50}) {
        std::vector<std::size_t> places;
        for (std::size_t i = 0; i < whole.size(); i += step) places.push_back(i);
        const Tape part = tape.part(places);
        std::vector<double> values(places.size());
        part.evaluate({inputs}, values);
        for (std::size_t i = 0; i < places.size(); ++i) EXPECT_TRUE(are_same(values[i], whole[places[i]]));
    }

    constexpr std::size_t lanes = 4;
    std::vector<double> wide_inputs, wide(lanes * whole.size());
    for (const double value : inputs) wide_inputs.insert(wide_inputs.end(), lanes, value);
    Tape::SideBySide<lanes>(tape, nullptr).evaluate(wide_inputs.data(), nullptr, wide.data());
    for (std::size_t i = 0; i < wide.size(); ++i) EXPECT_TRUE(are_same(wide[i], whole[i / lanes]));
}

// What needs constant inputs alone is computed once: also where it stands beside equal operations on others, and in a part.
TEST(Tape, ConstantInputsOfLanesHaveTheBitsOfTheWhole) {
    const Elements elements(13);
    const std::size_t count = elements.inputs.size();
    for (const std::size_t moving : {std::size_t{0}, count / 3, count / 2, count}) {
        const std::size_t discrete = moving / 4, constant = count - moving;
        Tape tape(elements.graph, elements.inputs, elements.outputs, {moving - discrete, discrete, constant});
        for (const bool of_part : {false, true}) {
            if (of_part) tape = tape.part(std::array<std::size_t, 5>{3, 40, 41, 90, elements.outputs.size() - 1});
            constexpr std::size_t lanes = 8;
            std::vector<double> wide(lanes * count), found(lanes * tape.output_count());
            std::vector<std::vector<double>> inputs(lanes);
            for (std::size_t l = 0; l < lanes; ++l) inputs[l] = random_inputs(count, l);
            const auto spread = [&] {
                for (std::size_t i = 0; i < lanes * count; ++i) wide[i] = inputs[i % lanes][i / lanes];
            };
            spread();
            const double* given = wide.data();
            Tape::SideBySide<lanes> side_by_side(tape, given + lanes * moving);
            for (std::uint64_t seed = 20; seed < 23; ++seed) { // the others move
                for (std::size_t l = 0; l < lanes; ++l) {
                    const auto other = random_inputs(count, seed + l);
                    std::copy_n(other.begin(), moving, inputs[l].begin());
                }
                spread();
                side_by_side.evaluate(given, given + lanes * (moving - discrete), found.data());
                for (std::size_t l = 0; l < lanes; ++l) {
                    const std::span<const double> all = inputs[l];
                    std::vector<double> one(tape.output_count());
                    tape.evaluate(
                        {all.first(moving - discrete), all.subspan(moving - discrete, discrete), all.last(constant)},
                        one);
                    for (std::size_t i = 0; i < one.size(); ++i) EXPECT_TRUE(are_same(found[i * lanes + l], one[i]));
                }
            }
        }
    }
}

TEST(Tape, BoundsOfElementsHoldTheirValues) {
    const Elements elements(9);
    const Tape tape(elements.graph, elements.inputs, elements.outputs);
    for (std::uint64_t seed = 0; seed < 100; ++seed) {
        std::vector<double> inputs;
        std::vector<Enclosure> bounds;
        for (std::size_t i = 0; i < elements.inputs.size(); ++i) {
            inputs.push_back(4 * uniform(seed, 2, i) - 2);
            bounds.push_back({{inputs.back() - 0.1, inputs.back() + 0.2}, {0, 0}});
        }
        std::vector<double> values(elements.outputs.size());
        std::vector<Enclosure> enclosed(elements.outputs.size());
        tape.evaluate({inputs}, values);
        tape.enclose({{std::span<const Enclosure>(bounds), {}}, {}}, enclosed);
        for (std::size_t i = 0; i < values.size(); ++i) EXPECT_TRUE(enclosed[i].value.contains(values[i])) << i;
    }
}

} // namespace
} // namespace tribode
