#pragma once
#include "tribode/base/about.hpp"
#include "tribode/base/field_reader.hpp"

#include <cmath>
#include <optional>

namespace tribode {

// The Stribeck effect: the dry level falls from the static one towards the Coulomb level as the speed grows.
struct Stribeck {
    double static_level = 0; // [N], >= 0
    double velocity = 1;     // Stribeck velocity [m/s], > 0
    double exponent = 1;     // > 0

    static void describe(auto& s, auto& fields) {
        fields.required("static", s.static_level, "N", Allowed::non_negative,
                        About("static level").usually(1e-4, 1e5).uncertain("friction.coulomb"));
        fields.required("velocity", s.velocity, "m/s", Allowed::positive, About("Stribeck velocity").usually(1e-6, 10));
        fields.number(
            "exponent", s.exponent, "", Allowed::positive,
            About("level(v) = coulomb + (static − coulomb) exp(−(abs(v)/velocity)^exponent)").usually(0.1, 10));
    }
};

// Set-valued dry friction: at v = 0 any force up to the static level, in slip
//
//     level(v) = coulomb + (static - coulomb) exp(-(|v|/velocity)^exponent)        against the motion
//
// Without a Stribeck effect the static level is the Coulomb level. Limits: level(0) = static, level(inf) = coulomb.
struct DryFriction {
    double coulomb = 0; // [N], >= 0
    std::optional<Stribeck> stribeck = {};

    static void describe(auto& d, auto& fields) {
        fields.number("coulomb", d.coulomb, "N", Allowed::non_negative,
                      About("level of set-valued friction: the axis truly sticks at v = 0")
                          .usually(1e-4, 1e5)
                          .uncertain("friction.coulomb"));
        fields.table("stribeck", d.stribeck, "Stribeck effect of the dry level");
    }

    double static_level() const { return stribeck ? stribeck->static_level : coulomb; }
    bool present() const { return coulomb > 0 || static_level() > 0; }
    bool velocity_dependent() const { return stribeck && stribeck->static_level != coulomb; }

    double level(double v) const {
        if (!velocity_dependent()) return coulomb;
        return coulomb + (stribeck->static_level - coulomb) *
                             std::exp(-std::pow(std::abs(v) / stribeck->velocity, stribeck->exponent));
    }

    // level - coulomb at `speed` = |v|; where it can be, it goes on smoothly below zero.
    double above_coulomb(double speed) const {
        if (!stribeck) return 0;
        const auto [static_level, velocity, exponent] = *stribeck;
        const double ratio = speed / velocity;
        if (exponent == 1) return (static_level - coulomb) * std::exp(-ratio);
        if (exponent == 2) return (static_level - coulomb) * std::exp(-ratio * ratio);
        return (static_level - coulomb) * std::exp(-std::pow(std::abs(ratio), exponent));
    }

    // Its derivatives, which go on as it does.
    struct AboveCoulomb {
        double speed, static_level, velocity, exponent; // by each of them; by the Coulomb level - static_level
    };
    AboveCoulomb above_coulomb_by(double speed) const {
        if (!stribeck) return {};
        const auto [static_level, velocity, exponent] = *stribeck;
        const double ratio = speed / velocity;
        // power: ratio^exponent; slope: its derivative by the ratio
        const double power = exponent == 1 ? ratio : std::pow(std::abs(ratio), exponent);
        const double slope =
            exponent == 1 ? 1 : std::copysign(exponent * std::pow(std::abs(ratio), exponent - 1), ratio);
        const double share = std::exp(-power), fall = -(static_level - coulomb) * share;
        return {fall * slope / velocity, share, -fall * slope * ratio / velocity,
                ratio == 0 ? 0 : fall * power * std::log(std::abs(ratio))};
    }

    // d level / d|v| [N s/m]; zero at v = 0, where an exponent below one has no finite slope.
    double slope(double v) const {
        if (!velocity_dependent() || v == 0) return 0;
        const auto [static_level, velocity, exponent] = *stribeck;
        const double power = std::pow(std::abs(v) / velocity, exponent);
        return -(static_level - coulomb) * std::exp(-power) * exponent * power / std::abs(v);
    }
};

} // namespace tribode
