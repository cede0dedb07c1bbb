#pragma once
#include <cmath>

namespace tribode {

// Set-valued dry friction with the Stribeck effect: at v = 0 any force up to the static level, in slip
//
//     level(v) = coulomb + (static - coulomb) exp(-(|v|/velocity)^exponent)        against the motion
//
// static == coulomb: plain Coulomb friction. Both zero: none. Limits: level(0) = static, level(inf) = coulomb.
struct DryFriction {
    double coulomb = 0;      // [N], >= 0
    double static_level = 0; // [N], >= 0
    double velocity = 1;     // Stribeck velocity [m/s], > 0
    double exponent = 1;     // > 0

    bool present() const { return coulomb > 0 || static_level > 0; }
    bool velocity_dependent() const { return static_level != coulomb; }

    double level(double v) const {
        if (!velocity_dependent()) return coulomb;
        return coulomb + (static_level - coulomb) * std::exp(-std::pow(std::abs(v) / velocity, exponent));
    }

    // level - coulomb at `speed` = |v|; where it can be, it goes on smoothly below zero.
    double above_coulomb(double speed) const {
        const double ratio = speed / velocity;
        if (exponent == 1) return (static_level - coulomb) * std::exp(-ratio);
        if (exponent == 2) return (static_level - coulomb) * std::exp(-ratio * ratio);
        return (static_level - coulomb) * std::exp(-std::pow(std::abs(ratio), exponent));
    }

    // d level / d|v| [N s/m]; zero at v = 0, where an exponent below one has no finite slope.
    double slope(double v) const {
        if (!velocity_dependent() || v == 0) return 0;
        const double power = std::pow(std::abs(v) / velocity, exponent);
        return -(static_level - coulomb) * std::exp(-power) * exponent * power / std::abs(v);
    }
};

} // namespace tribode
