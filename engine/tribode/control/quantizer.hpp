#pragma once
#include <cmath>

namespace tribode {

// Rounds to the nearest multiple of the resolution, halves upwards; a resolution of zero leaves the value as it is.
inline double quantize(double value, double resolution) {
    return resolution > 0 ? resolution * std::floor(value / resolution + 0.5) : value;
}

} // namespace tribode
