#include "tribode/diagnosis/record_defects.hpp"
#include "tribode/base/quantity.hpp"
#include "tribode/diagnosis/prediction_statistics.hpp"
#include "tribode/diagnosis/system_record.hpp"

#include <algorithm>
#include <cmath>
#include <fmt/format.h>

namespace tribode {

namespace {

constexpr double far_apart = 30;       // times what the cubic leaves elsewhere
constexpr double is_elsewhere = 0.1;   // of how far a sample stands apart. A kink leaves 1/6 beside it, a jump 1/3
constexpr double largest_share = 0.01; // of all samples
constexpr double even_step = 1.5;      // of the sample time: a longer step is not even
constexpr double long_gap = 5;         // of the sample time: the inputs are not known within
constexpr double largest_uneven_share = 0.05; // of steps that are no gaps but uneven: then all steps are as they come
constexpr std::size_t shortest_part = 20;     // samples

// What the cubic through two samples on either side leaves of one between them.
double apart(const std::vector<double>& y, std::size_t k) {
    return y[k] - (4 * (y[k - 1] + y[k + 1]) - y[k - 2] - y[k + 2]) / 6;
}

} // namespace

std::vector<std::size_t> isolated_samples(const std::vector<double>& t, const std::vector<double>& values) {
    const std::size_t n = values.size();
    if (n < shortest_part) return {};
    std::vector<double> sizes;
    for (std::size_t k = 2; k + 2 < n; ++k) sizes.push_back(std::abs(apart(values, k)));
    auto sorted = sizes;
    const auto middle = sorted.begin() + static_cast<std::ptrdiff_t>(sorted.size() / 2);
    std::nth_element(sorted.begin(), middle, sorted.end());
    const double usual = std::max(1.4826 * *middle, rounding_noise(values));
    if (!(usual > 0)) return {};
    const double longest = even_step * sample_time(t);
    std::vector<std::size_t> found;
    for (std::size_t k = 4; k + 4 < n; ++k) {
        const double own = sizes[k - 2];
        if (!(own > far_apart * usual)) continue;
        bool is_even = true;
        for (std::size_t i = k - 4; i < k + 4; ++i) is_even = is_even && t[i + 1] - t[i] < longest;
        std::vector<double> around(values.begin() + static_cast<std::ptrdiff_t>(k - 4),
                                   values.begin() + static_cast<std::ptrdiff_t>(k + 5));
        around[4] -= apart(values, k);
        double left = 0;
        for (std::size_t i = 2; i < 7; ++i) left = std::max(left, std::abs(apart(around, i)));
        if (is_even && left < is_elsewhere * own) found.push_back(k);
    }
    if (static_cast<double>(found.size()) > largest_share * static_cast<double>(n)) return {};
    return found;
}

namespace {

void replace_isolated(SystemRecord& record, const SystemModel& model, std::vector<std::string>& remarks) {
    // What an input does for a sample alone an output may do, too.
    std::vector<std::size_t> of_inputs;
    for (const auto& input : record.inputs) {
        if (input.empty()) continue;
        for (const std::size_t k : isolated_samples(record.t, input)) of_inputs.push_back(k);
    }
    for (std::size_t o = 0; o < record.outputs.size(); ++o) {
        auto& values = record.outputs[o];
        auto found = isolated_samples(record.t, values);
        std::erase_if(found, [&](std::size_t k) {
            return std::ranges::any_of(of_inputs, [k](std::size_t i) { return i <= k && k <= i + 2; });
        });
        if (found.empty()) continue;
        for (const std::size_t k : found) values[k] -= apart(values, k);
        const bool is_one = found.size() == 1;
        remarks.push_back(fmt::format(
            "{}: {} of {} {} apart from {} neighbours alone, as errors of a sensor do, {} t = {}; what runs "
            "through the neighbours takes {} place.",
            record.source, is_one ? "one sample" : fmt::format("{} samples", found.size()), measured_name(model, o),
            is_one ? "stands" : "stand", is_one ? "its" : "their", is_one ? "at" : "the first one at",
            format_quantity(record.t[found[0]], "s", 4), is_one ? "its" : "their"));
    }
}

} // namespace

std::vector<SystemRecord> without_defects(SystemRecord record, const SystemModel& model,
                                          std::vector<std::string>& remarks) {
    if (model.equations.states.empty()) return {std::move(record)};
    replace_isolated(record, model, remarks);
    const auto has_column = [](const auto& input) { return !input.empty(); };
    if (std::ranges::none_of(record.inputs, has_column)) return {std::move(record)}; // nothing is unknown within a gap
    const double period = sample_time(record.t);
    std::vector<std::size_t> begins = {0};
    std::size_t uneven = 0;
    for (std::size_t k = 1; k < record.size(); ++k) {
        const double step = record.t[k] - record.t[k - 1];
        if (step > long_gap * period) {
            begins.push_back(k);
        } else if (step > even_step * period) {
            ++uneven;
        }
    }
    const double steps = static_cast<double>(record.size());
    if (begins.size() == 1 || static_cast<double>(uneven + begins.size()) > largest_uneven_share * steps) {
        return {std::move(record)};
    }
    std::vector<std::size_t> free = model.starts;
    const auto& states = model.equations.states;
    for (std::size_t i = 0; i < states.size(); ++i) {
        if (!states[i].is_algebraic() && std::ranges::find(free, i) == free.end()) {
            remarks.push_back(
                fmt::format("{}: nothing was recorded for {} from t = {} on. The inputs are taken to run on, "
                            "as {}.start is not free, with which a record of its own could begin there.",
                            record.source, format_quantity(record.t[begins[1]] - record.t[begins[1] - 1], "s", 3),
                            format_quantity(record.t[begins[1] - 1], "s", 4), states[i].name));
            return {std::move(record)};
        }
    }
    begins.push_back(record.size());
    std::vector<SystemRecord> parts;
    for (std::size_t p = 0; p + 1 < begins.size(); ++p) {
        const std::size_t samples = begins[p + 1] - begins[p];
        const bool is_too_short = samples < shortest_part;
        if (p > 0) {
            const double from = record.t[begins[p] - 1], to = record.t[begins[p]];
            remarks.push_back(fmt::format("{}: nothing was recorded for {} from t = {} on; what comes behind {}.",
                                          record.source, format_quantity(to - from, "s", 3),
                                          format_quantity(from, "s", 4),
                                          is_too_short ? "is too short and is left out"
                                                       : "is a record of its own, with start values of its own"));
        }
        if (is_too_short) continue;
        parts.push_back(record.part(begins[p], samples));
        if (begins[p] > 0) {
            parts.back().source += fmt::format(" from t = {}", format_quantity(record.t[begins[p]], "s", 4));
        }
    }
    return parts.empty() ? std::vector<SystemRecord>{std::move(record)} : parts;
}

} // namespace tribode
