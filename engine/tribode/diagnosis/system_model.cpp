#include "tribode/diagnosis/system_model.hpp"

#include <algorithm>
#include <cmath>
#include <memory>
#include <numeric>

namespace tribode {

namespace {

constexpr double longest_step = 1.5; // of the median: longer ones are gaps

// Samples of a clock at an even period, from values at instants that may be uneven.
std::vector<double> resampled(const std::vector<double>& t, const std::vector<double>& values, double period,
                              Interpolation between) {
    const auto count = static_cast<std::size_t>(std::ceil((t.back() - t.front()) / period * (1 - 1e-12))) + 1;
    std::vector<double> even(count);
    std::size_t i = 0;
    for (std::size_t k = 0; k < count; ++k) {
        const double now = t.front() + static_cast<double>(k) * period;
        // What holds begins at the nearest instant of the clock: with the last one before it, half of all samples would act a period late
        // where instants jitter.
        const double reached = between == Interpolation::hold ? now + 0.5 * period : now * (1 + 1e-12);
        while (i + 1 < t.size() && t[i + 1] <= reached) ++i;
        if (between == Interpolation::hold || i + 1 == t.size()) {
            even[k] = values[i];
        } else {
            even[k] = values[i] + (values[i + 1] - values[i]) * (now - t[i]) / (t[i + 1] - t[i]);
        }
    }
    return even;
}

} // namespace

bool is_even(const std::vector<double>& t, double period) {
    for (std::size_t k = 0; k < t.size(); ++k) {
        if (std::abs(t[k] - t.front() - static_cast<double>(k) * period) > 1e-3 * period) return false;
    }
    return true;
}

std::vector<std::array<double, 4>> straightened(const std::vector<std::array<double, 4>>& pieces, std::size_t n) {
    using Piece = std::array<double, 4>;
    std::vector<Piece> lines;
    const double share = 1 / static_cast<double>(n);
    for (std::size_t first = 0; first < pieces.size(); first += n) {
        double mean = 0, moment = 0; // about the middle
        for (std::size_t k = 0; k < n; ++k) {
            // Beyond the last one its end holds.
            const Piece& last = pieces.back();
            const bool is_over = first + k >= pieces.size();
            const auto [a, b, c, d] =
                is_over ? Piece{last[0] + last[1] + last[2] + last[3], 0, 0, 0} : pieces[first + k];
            const double own = a + b / 2 + c / 3 + d / 4, rising = a / 2 + b / 3 + c / 4 + d / 5;
            mean += share * own;
            moment += share * ((static_cast<double>(k) * share - 0.5) * own + share * rising);
        }
        lines.push_back({mean - 6 * moment, 12 * moment, 0, 0});
    }
    return lines;
}

std::size_t SystemRecord::measured(std::size_t samples) const {
    std::size_t count = 0;
    for (const auto& values : outputs) {
        for (std::size_t k = 0; k < samples; ++k) count += std::isnan(values[k]) ? 0 : 1;
    }
    return count;
}

std::optional<double> SystemRecord::first_measured(std::size_t output) const {
    if (output >= outputs.size()) return std::nullopt;
    const auto first = std::ranges::find_if(outputs[output], [](double y) { return !std::isnan(y); });
    return first == outputs[output].end() ? std::nullopt : std::optional(*first);
}

std::vector<Stretch> stretches_of(const SystemModel& model, const std::vector<SystemRecord>& records) {
    const bool is_map = model.equations.states.empty();
    std::vector<Stretch> all;
    for (const auto& record : records) {
        for (std::size_t o = 0; o < record.outputs.size(); ++o) {
            bool follows = false;
            for (const double y : record.outputs[o]) {
                if (std::isnan(y)) {
                    follows = false;
                } else if (follows) {
                    ++all.back().samples;
                } else {
                    all.push_back({o, 1});
                    follows = !is_map;
                }
            }
        }
    }
    return all;
}

SystemRecord SystemRecord::part(std::size_t from, std::size_t samples) const {
    from = std::min(from, size());
    samples = std::min(samples, size() - from);
    const auto cut = [&](const std::vector<double>& values) {
        const auto begin = values.begin() + static_cast<std::ptrdiff_t>(from);
        return values.empty() ? values : std::vector<double>(begin, begin + static_cast<std::ptrdiff_t>(samples));
    };
    SystemRecord part{.source = source, .t = cut(t)};
    for (const auto& values : inputs) part.inputs.push_back(cut(values));
    for (const auto& values : outputs) part.outputs.push_back(cut(values));
    if (whole) {
        part.whole = std::make_shared<SystemRecord>(whole->part(from * every, samples * every));
        part.every = every;
    }
    return part;
}

std::vector<double> SystemModel::values(std::size_t records) const {
    std::vector<double> all;
    for (const auto& parameter : parameters) all.push_back(equations.parameters[parameter.place].value);
    for (std::size_t r = 0; r < records; ++r) {
        for (const std::size_t state : starts) all.push_back(equations.states[state].start);
    }
    return all;
}

std::vector<double> SystemModel::values_of(const std::vector<double>& values, std::size_t record) const {
    const auto shared = static_cast<std::ptrdiff_t>(parameters.size()),
               own = static_cast<std::ptrdiff_t>(starts.size());
    std::vector<double> one(values.begin(), values.begin() + shared);
    const auto begin = values.begin() + shared + static_cast<std::ptrdiff_t>(record) * own;
    one.insert(one.end(), begin, begin + own);
    return one;
}

Equations SystemModel::begun(const std::vector<double>& values, std::size_t r, const SystemRecord& record) const {
    Equations begun = deep_copy(equations);
    for (std::size_t i = 0; i < parameters.size(); ++i) begun.parameters[parameters[i].place].value = values[i];
    const std::size_t own = parameters.size() + r * starts.size();
    for (std::size_t i = 0; i < starts.size(); ++i) begun.states[starts[i]].start = values[own + i];
    if (beginnings.empty()) return begun;
    for (std::size_t i = 0; i < begun.inputs.size(); ++i) {
        if (i < record.inputs.size() && !record.inputs[i].empty()) begun.inputs[i].value = record.inputs[i].front();
    }
    // Where an input acts late its first value has done so before.
    for (const auto& one : beginnings) {
        if (std::ranges::find(starts, one.state) != starts.end()) continue;
        const auto first = one.measured ? record.first_measured(*one.measured) : std::nullopt;
        begun.states[one.state].start = first ? *first : begun.value_at_start(one.at_rest, {});
    }
    for (std::size_t i = 0; i < begun.inputs.size(); ++i) begun.inputs[i].value = equations.inputs[i].value;
    return begun;
}

SystemModel SystemModel::with(const std::vector<double>& values) const {
    SystemModel moved = *this;
    for (std::size_t i = 0; i < parameters.size(); ++i) {
        moved.equations.parameters[parameters[i].place].value = values[i];
    }
    for (std::size_t i = 0; i < starts.size(); ++i) {
        moved.equations.states[starts[i]].start = values[parameters.size() + i];
    }
    return moved;
}

Equations deep_copy(const Equations& equations) {
    Equations copy = equations;
    copy.graph = std::make_shared<Expressions>(*equations.graph);
    return copy;
}

double sample_time(const std::vector<double>& t) {
    std::vector<double> steps;
    for (std::size_t i = 1; i < t.size(); ++i) steps.push_back(t[i] - t[i - 1]);
    const auto middle = steps.begin() + static_cast<std::ptrdiff_t>(steps.size() / 2);
    std::nth_element(steps.begin(), middle, steps.end());
    const double median = *middle;
    if (is_even(t, median)) return median;
    std::erase_if(steps, [median](double step) { return step > longest_step * median; });
    return std::accumulate(steps.begin(), steps.end(), 0.0) / static_cast<double>(steps.size());
}

InputSamples input_of(const SystemRecord& record, std::size_t input, Interpolation between) {
    if (record.every > 1) {
        InputSamples samples = input_of(*record.whole, input, between);
        samples.pieces = straightened(samples.pieces, record.every);
        samples.period *= static_cast<double>(record.every);
        samples.degree = 1;
        return samples;
    }
    const double period = sample_time(record.t);
    const auto& values = record.inputs[input];
    return input_samples(is_even(record.t, period) ? values : resampled(record.t, values, period, between), period,
                         record.t.front(), between);
}

} // namespace tribode
