#include "tribode/experiment/input_samples.hpp"
#include "tribode/experiment/simulation.hpp"

#include <algorithm>
#include <cmath>
#include <fmt/format.h>

namespace tribode {

InputSamples input_samples(const std::vector<double>& values, double period, double offset, Interpolation between) {
    InputSamples samples{.period = period, .offset = offset};
    if (between == Interpolation::band_limited) {
        samples.degree = 3;
        samples.pieces = band_limited(values);
        return samples;
    }
    samples.degree = between == Interpolation::linear ? 1 : 0;
    for (std::size_t k = 0; k < values.size(); ++k) {
        const bool rises = samples.degree == 1 && k + 1 < values.size();
        samples.pieces.push_back({values[k], rises ? values[k + 1] - values[k] : 0, 0, 0});
    }
    return samples;
}

void connect_samples(Equations& equations, const Equations::Input& input, InputSamples samples, double start) {
    auto& graph = *equations.graph;
    Equations::Function function;
    std::vector<Term> held;
    const auto add = [&](const std::string& name, const std::string& unit, double value) {
        held.push_back(graph.variable(name));
        equations.discrete.push_back({name, unit, value, held.back(), {}});
    };
    // The sample at the start, or the last one before it.
    const double last = std::floor((start - samples.offset) / samples.period * (1 + 1e-15));
    const std::size_t piece = std::min(static_cast<std::size_t>(std::max(last, 0.0)), samples.pieces.size() - 1);
    const auto first = last >= 0 ? samples.pieces[piece] : std::array{input.value, 0.0, 0.0, 0.0};
    Term value = 0;
    if (samples.degree == 0) {
        add(input.name, input.unit, first[0]);
        value = held[0];
    } else {
        for (std::size_t n = 0; n <= samples.degree; ++n)
            add(fmt::format("{}.c{}", input.name, n), input.unit, first[n]);
        add(input.name + ".since", "s", last >= 0 ? samples.offset + last * samples.period : 0);
        const Term elapsed = graph.make(Op::subtract, equations.time, held.back());
        const Term s = graph.make(Op::multiply, graph.constant(1 / samples.period), elapsed);
        value = held[samples.degree];
        for (std::size_t n = samples.degree; n-- > 0;) {
            value = graph.make(Op::add, held[n], graph.make(Op::multiply, s, value));
        }
        equations.outputs.push_back({input.name, input.unit, value});
    }
    equations.replace({{input.symbol, value}});
    Equations::Clock clock{.name = "input " + input.name, .period = samples.period, .offset = samples.offset};
    function.writes = held;
    function.call = [samples = std::move(samples)](long k, std::span<const double>, std::span<double> written) {
        const auto& now = samples.pieces[std::min(static_cast<std::size_t>(k), samples.pieces.size() - 1)];
        std::copy_n(now.begin(), samples.degree + 1, written.begin());
        if (samples.degree > 0) written.back() = samples.offset + static_cast<double>(k) * samples.period;
    };
    clock.function = std::move(function);
    equations.clocks.insert(equations.clocks.begin(), std::move(clock));
}

} // namespace tribode
