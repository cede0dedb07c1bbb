#pragma once
#include <string_view>

namespace tribode {

// The discrete state of a friction element or of the Coulomb level.
enum class SlipState : signed char { slip_backward = -1, stick = 0, slip_forward = 1 };

constexpr double sign(SlipState state) { return static_cast<double>(state); }
constexpr SlipState slip_towards(double direction) {
    return direction > 0 ? SlipState::slip_forward : SlipState::slip_backward;
}
constexpr std::string_view name_of(SlipState state) {
    return state == SlipState::stick ? "stick" : state == SlipState::slip_forward ? "slip_forward" : "slip_backward";
}

} // namespace tribode
