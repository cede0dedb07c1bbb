#pragma once
#include <algorithm>
#include <cmath>
#include <limits>

namespace tribode {

// The static curve of an amplifier: saturation, then dead zone, power law and gain.
//
//     w = clip(u, -limit, limit);  0 where abs(w) <= half_width, else gain power(w -+ half_width)
//     power(w) = size (abs(w)/size)^exponent sign(w)
struct Amplifier {
    double limit = std::numeric_limits<double>::infinity(); // [N], > 0
    double half_width = 0;                                  // of the dead zone [N], >= 0
    double exponent = 1, size = 1;                          // of the power law; both > 0, size in N
    double gain = 1;

    // Whether it changes anything.
    bool shapes() const { return gain != 1 || exponent != 1 || half_width > 0 || std::isfinite(limit); }

    double operator()(double u) const {
        const double w = std::clamp(u, -limit, limit);
        return gain * std::copysign(power(std::max(std::abs(w) - half_width, 0.0)), w);
    }
    // Of a thrust that is not below zero.
    double power(double w) const { return exponent == 1 ? w : size * std::pow(w / size, exponent); }

    // d output / d u
    double slope(double u) const {
        if (std::abs(u) > limit || std::abs(u) < half_width) return 0;
        if (exponent == 1) return gain;
        // At zero a root is infinitely steep: as over the first thousandth.
        const double share = std::max((std::abs(u) - half_width) / size, exponent < 1 ? 1e-3 : 0);
        return gain * exponent * std::pow(share, exponent - 1);
    }
};

} // namespace tribode
