#pragma once
#include <limits>

namespace tribode {

// The real numbers from low to high, both included.
struct Interval {
    double low = 0, high = 0;

    static constexpr double infinity = std::numeric_limits<double>::infinity();
    static Interval all() { return {-infinity, infinity}; }
    static Interval point(double value) { return {value, value}; }

    bool contains(double value) const { return low <= value && value <= high; }
};

// Bounds of a quantity over a piece of a trajectory: its value, and its rate of change by time. A rate of all numbers
// also stands for a quantity that jumps.
struct Enclosure {
    Interval value;
    Interval rate; // [1/s]

    static Enclosure constant(double value) { return {Interval::point(value), {0, 0}}; }
    static Enclosure unknown() { return {Interval::all(), Interval::all()}; }
};

} // namespace tribode
