#include "tribode/record/time_grid.hpp"
#include "tribode/base/error.hpp"
#include "tribode/base/text.hpp"

#include <algorithm>
#include <cmath>
#include <fmt/format.h>

namespace tribode {

TimeGrid time_grid(const Table& table, std::string_view column) {
    const std::vector<double>& t = table[column].values;
    TimeGrid grid;
    if (t.size() < 2) return grid;

    std::vector<double> steps(t.size() - 1);
    for (std::size_t k = 1; k < t.size(); ++k) {
        steps[k - 1] = t[k] - t[k - 1];
        if (steps[k - 1] > 0) continue;
        throw InputError(fmt::format("{}: {} = {} s after {} s, time must increase from row to row", table.place(k),
                                     column, to_text(t[k]), to_text(t[k - 1])));
    }
    std::vector<double> sorted = steps;
    // Of two in the middle the lower: a gap makes steps longer, never shorter.
    const auto middle = sorted.begin() + static_cast<std::ptrdiff_t>((sorted.size() - 1) / 2);
    std::nth_element(sorted.begin(), middle, sorted.end());
    const double median = *middle;

    std::vector<double> place(t.size()); // n_k
    for (std::size_t k = 1; k < t.size(); ++k) {
        // What nobody can count is not counted further.
        constexpr double max_missing = 1e15;
        const double ratio = steps[k - 1] / median;
        const double missing = ratio > 1.5 ? std::min(std::round(ratio) - 1, max_missing) : 0;
        place[k] = place[k - 1] + 1 + missing;
        if (missing == 0) continue;
        grid.gaps.push_back({k, static_cast<std::size_t>(missing)});
        grid.dropped += grid.gaps.back().missing;
    }

    // Straight line through (n_k, t_k), about the means so that a late t_0 costs no digits.
    const double count = static_cast<double>(t.size());
    double mean_place = 0, mean_time = 0, product = 0, square = 0;
    for (std::size_t k = 0; k < t.size(); ++k) {
        mean_place += place[k] / count;
        mean_time += (t[k] - t[0]) / count;
    }
    for (std::size_t k = 0; k < t.size(); ++k) {
        product += (place[k] - mean_place) * (t[k] - t[0] - mean_time);
        square += (place[k] - mean_place) * (place[k] - mean_place);
    }
    grid.sample_time = product / square;
    for (std::size_t k = 0; k < t.size(); ++k) {
        const double off = t[k] - t[0] - mean_time - grid.sample_time * (place[k] - mean_place);
        grid.jitter_rms += off * off / count;
        grid.jitter_max = std::max(grid.jitter_max, std::abs(off));
    }
    grid.jitter_rms = std::sqrt(grid.jitter_rms);
    return grid;
}

} // namespace tribode
