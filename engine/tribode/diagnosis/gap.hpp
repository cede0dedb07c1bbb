#pragma once
#include "tribode/base/json.hpp"

#include <algorithm>
#include <cmath>
#include <vector>

namespace tribode {

// Gap over the floor up to which what is missing has been found, and not a part of it.
inline constexpr double little_left = 3;

// rms of measured minus simulated, without and with what was found; and of the noise and rounding that no model removes.
// Of a machine [m]; of a system in the unit of its output or, of several outputs, relative to what each moves.
struct Gap {
    double before = 0, after = 0, floor = 0;

    bool is_left() const { return after > little_left * floor; } // more than a little
    // Share of the squared gap, negative where it grows; 0 without one.
    double explained() const { return before > 0 ? 1 - after / before * (after / before) : 0; }
    Json json() const; // null for what is not finite
};

// Of records together, each sample counting alike. A comparison has a gap and counts its samples().
template <class Comparison>
Gap total_gap(const std::vector<Comparison>& all) {
    Gap sum;
    double count = 0;
    for (const auto& one : all) {
        const auto n = static_cast<double>(one.samples());
        sum.before += n * one.gap.before * one.gap.before;
        sum.after += n * one.gap.after * one.gap.after;
        sum.floor += n * one.gap.floor * one.gap.floor;
        count += n;
    }
    for (double* part : {&sum.before, &sum.after, &sum.floor}) *part = std::sqrt(*part / std::max(count, 1.0));
    return sum;
}

} // namespace tribode
