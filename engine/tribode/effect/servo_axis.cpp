#include "tribode/effect/servo_axis.hpp"
#include "tribode/base/error.hpp"
#include "tribode/base/text.hpp"

#include <fmt/format.h>

namespace tribode {

static void require_not_below_zero(double value, const char* what, const char* unit) {
    if (value >= 0) return;
    throw InputError(fmt::format("they leave {} of {} {}, must not be below zero", what, to_text(value), unit));
}

void ServoAxis::require_possible() const {
    // Far from where products of gains underflow or overflow.
    constexpr double min_gain = 1e-100, max_gain = 1e100;
    double gain = plant.rigid_gain;
    for (const auto& mode : plant.modes) gain += mode.gain;
    if (!(gain >= min_gain && gain <= max_gain)) {
        throw InputError(fmt::format("the gains sum up to {} m/(N s^2), must be from {} to {}", to_text(gain),
                                     to_text(min_gain), to_text(max_gain)));
    }
    for (const auto& [level, viscous] : {plant.forward, plant.backward}) {
        require_not_below_zero(plant.viscous + viscous, "viscous friction", "N s/m");
        require_not_below_zero(plant.dry.coulomb + level, "a dry friction level", "N");
        require_not_below_zero(plant.dry.static_level() + level, "a static friction level", "N");
    }
    require_not_below_zero(input_delay, "an input delay", "s");
    if (plant.backlash && plant.rigid_gain == 0) {
        throw InputError("backlash needs a machine with a rigid_gain_per_kg above zero");
    }
}

} // namespace tribode
