#pragma once
#include "tribode/effect/effect.hpp"
#include "tribode/friction/dry_friction.hpp"

#include <string>
#include <utility>

// What the friction laws have in common, as phase_parameter() is what waves have.
namespace tribode {

inline EffectParameter friction_level_parameter(std::string name, std::string meaning) { // [N]
    return {.name = std::move(name),
            .unit = "N",
            .meaning = std::move(meaning),
            .allowed = Allowed::positive,
            .plausible_min = 0.1,
            .plausible_max = 50};
}

inline EffectParameter friction_stiffness_parameter(std::string meaning) { // K [N/m]
    return {.name = "K",
            .unit = "N/m",
            .meaning = std::move(meaning),
            .allowed = Allowed::positive,
            .plausible_min = 1e3,
            .plausible_max = 1e8};
}

// Of Maxwell-slip elements and what is made of them.
inline EffectParameter element_stiffness_field() { // K [N/m]
    return {.name = "K",
            .unit = "N/m",
            .meaning = "stiffness",
            .allowed = Allowed::positive,
            .plausible_min = 1e2,
            .plausible_max = 1e7};
}

inline EffectParameter element_level_field(std::string meaning) { // F [N]
    return {.name = "F",
            .unit = "N",
            .meaning = std::move(meaning),
            .allowed = Allowed::positive,
            .plausible_min = 0.05,
            .plausible_max = 20};
}

inline EffectParameter stribeck_velocity_parameter() { // velocity [m/s]
    return {.name = "velocity",
            .unit = "m/s",
            .meaning = "Stribeck velocity",
            .allowed = Allowed::positive,
            .plausible_min = 1e-4,
            .plausible_max = 0.1};
}

inline EffectParameter stribeck_exponent_parameter(std::string meaning, double fallback) {
    return {.name = "exponent",
            .meaning = std::move(meaning),
            .allowed = Allowed::positive,
            .plausible_min = 0.5,
            .plausible_max = 2,
            .fallback = fallback};
}

inline EffectParameter law_viscous_parameter() { // [N s/m]
    return {.name = "viscous",
            .unit = "N s/m",
            .meaning = "viscous friction",
            .allowed = Allowed::non_negative,
            .plausible_min = 0.1,
            .plausible_max = 500,
            .fallback = 0};
}

// F + (Fs - F) exp(-(|v|/velocity)^exponent) [N], of the parameters of these names.
inline DryFriction stribeck_level(const Effect& e) {
    return {e.number("F"), Stribeck{e.number("Fs"), e.number("velocity"), e.number("exponent")}};
}

} // namespace tribode
