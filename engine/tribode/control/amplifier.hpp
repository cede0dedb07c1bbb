#pragma once
#include <algorithm>
#include <cmath>
#include <limits>

namespace tribode {

// The static curve of an amplifier: saturation, then dead zone, then gain.
//
//     w = clip(u, -limit, limit);  0 where abs(w) <= half_width, else gain (w -+ half_width)
struct Amplifier {
    double limit = std::numeric_limits<double>::infinity(); // [N], > 0
    double half_width = 0;                                  // of the dead zone [N], >= 0
    double gain = 1;

    // Whether it changes anything.
    bool shapes() const { return gain != 1 || half_width > 0 || std::isfinite(limit); }

    double operator()(double u) const {
        const double w = std::clamp(u, -limit, limit);
        return gain * std::copysign(std::max(std::abs(w) - half_width, 0.0), w);
    }

    // d output / d u
    double slope(double u) const { return std::abs(u) > limit || std::abs(u) < half_width ? 0 : gain; }
};

} // namespace tribode
