#pragma once
#include <numbers>

namespace tribode {

inline constexpr double two_pi = 2 * std::numbers::pi;

} // namespace tribode
