#pragma once

namespace tribode {

// Of the plots in the reports of machines and of systems.
inline constexpr const char* measured_color = "#888888";
inline constexpr const char* before_color = "#c0392b";
inline constexpr const char* after_color = "#1f5f9e";

} // namespace tribode
