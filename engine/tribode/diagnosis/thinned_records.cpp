#include "tribode/diagnosis/thinned_records.hpp"
#include "tribode/diagnosis/prediction_statistics.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <memory>
#include <numeric>

namespace tribode {

namespace {

constexpr std::size_t longest_stride = 16, least_left = 2000, least_of_a_record = 300; // samples
constexpr std::size_t shortest_stride = 4; // from there on motion and noise are told apart
constexpr std::size_t blocks = 20;         // of a record, in each of which what is left out follows from the rest
// What cubics through every n-th value are off, in squares: times what those through every second one are, and these times the noise.
constexpr double most_growth = 1.6, most_noise = 16;
constexpr double most_off_input = 0.15; // of the input's deviation, rms

double deviation_of_input(const std::vector<double>& values) {
    const auto count = static_cast<double>(values.size());
    const double mean = std::accumulate(values.begin(), values.end(), 0.0) / count;
    double sum = 0;
    for (const double value : values) sum += (value - mean) * (value - mean);
    return std::sqrt(sum / count);
}

using Squares = std::array<double, blocks>;

// The mean squares of what cubics through every n-th value are off between these, in each block.
Squares off_cubics(const std::vector<double>& values, std::size_t n) {
    const std::size_t last = (values.size() - 1) / n; // of those that are kept
    Squares squares = {}, count = {};
    for (std::size_t k = n; k < (last - 1) * n; ++k) {
        if (k % n == 0) continue;
        const std::size_t i = k / n * n;
        const double s = static_cast<double>(k - i) / static_cast<double>(n);
        const double a = values[i - n], b = values[i], c = values[i + n], d = values[i + 2 * n];
        const double between =
            b + s * (c - b) - s * (1 - s) / 6 * ((2 - s) * (a - 2 * b + c) + (1 + s) * (b - 2 * c + d));
        const std::size_t block = k * blocks / values.size();
        squares[block] += (values[k] - between) * (values[k] - between);
        ++count[block];
    }
    for (std::size_t b = 0; b < blocks; ++b) squares[b] /= std::max(count[b], 1.0);
    return squares;
}

// Whether every n-th value tells the others: cubics through these are off by noise, which is the same through every second one.
// What moves is off by 16 times as much where a cubic is twice as long.
bool tells_the_others(const std::vector<double>& values, std::size_t n, double tolerance) {
    const double noise = std::max(white_noise(values), rounding_noise(values)), nothing = tolerance * tolerance;
    const Squares near = off_cubics(values, 2), far = off_cubics(values, n);
    for (std::size_t b = 0; b < blocks; ++b) {
        if (near[b] > std::max(most_noise * noise * noise, nothing)) return false;
        if (far[b] > std::max(most_growth * near[b], nothing)) return false;
    }
    return true;
}

SystemRecord with_every(const SystemRecord& record, std::size_t n) {
    SystemRecord some;
    some.source = record.source;
    const auto kept = [&](const std::vector<double>& values) {
        std::vector<double> some_values;
        for (std::size_t k = 0; k < values.size(); k += n) some_values.push_back(values[k]);
        return some_values;
    };
    some.t = kept(record.t);
    for (const auto& values : record.inputs) some.inputs.push_back(kept(values));
    for (const auto& values : record.outputs) some.outputs.push_back(kept(values));
    some.whole = std::make_shared<SystemRecord>(record);
    some.every = n;
    return some;
}

// Whether an input runs nearly along the lines that take its place.
bool runs_along_lines(const SystemRecord& some, std::size_t input) {
    const auto& values = some.whole->inputs[input];
    if (values.empty()) return true;
    const auto lines = input_of(some, input, Interpolation::linear).pieces;
    double squares = 0;
    for (std::size_t k = 0; k < values.size(); ++k) {
        const auto& line = lines[std::min(k / some.every, lines.size() - 1)];
        const double off =
            values[k] - line[0] - line[1] * static_cast<double>(k % some.every) / static_cast<double>(some.every);
        squares += off * off;
    }
    return std::sqrt(squares / static_cast<double>(values.size())) <= most_off_input * deviation_of_input(values);
}

bool may_be_thinned(const SystemModel& model, const SystemRecord& record) {
    const auto& e = model.equations;
    // A clock sees the inputs of its instants, and an output that an input moves at once needs those of its own.
    if (e.states.empty() || !e.clocks.empty() || record.size() < 4 * blocks ||
        !is_even(record.t, sample_time(record.t)))
        return false;
    std::vector<Term> outputs;
    for (const std::size_t output : model.measured) outputs.push_back(e.outputs[output].value);
    const auto variables = e.graph->variables_of(outputs);
    const bool is_moved = std::ranges::any_of(
        e.inputs, [&](const auto& input) { return std::ranges::find(variables, input.symbol) != variables.end(); });
    return !is_moved && std::ranges::none_of(record.outputs, [](const auto& values) {
        return std::ranges::any_of(values, [](double y) { return std::isnan(y); });
    });
}

} // namespace

std::vector<SystemRecord> thinned(const SystemModel& model, const std::vector<SystemRecord>& records,
                                  const std::vector<double>& tolerance) {
    std::vector<SystemRecord> best = records;
    if (!std::ranges::all_of(records, [&](const auto& record) { return may_be_thinned(model, record); })) return best;
    for (std::size_t n = shortest_stride; n <= longest_stride; n *= 2) {
        std::vector<SystemRecord> some;
        std::size_t left = 0;
        for (const auto& record : records) {
            some.push_back(with_every(record, n));
            left += some.back().size();
            bool is_told = some.back().size() >= least_of_a_record;
            for (std::size_t o = 0; o < record.outputs.size() && is_told; ++o) {
                is_told = tells_the_others(record.outputs[o], n, tolerance[o]);
            }
            if (!is_told) return best;
            for (std::size_t i = 0; i < record.inputs.size(); ++i) {
                if (!runs_along_lines(some.back(), i)) return best;
            }
        }
        if (left < least_left) return best;
        best = std::move(some);
    }
    return best;
}

} // namespace tribode
