#pragma once
#include <array>

namespace tribode {

// The thrust reference between two of its samples: a cubic in the time since the last one. A zero-order hold has
// the first coefficient only.
struct HeldInput {
    std::array<double, 4> coefficient{}; // [N], of powers of (t - start)/period
    double start = 0;                    // [s]
    double rate = 0;                     // 1/period [1/s]; 0: constant

    double operator()(double t) const {
        const double s = (t - start) * rate;
        return coefficient[0] + s * (coefficient[1] + s * (coefficient[2] + s * coefficient[3]));
    }
};

} // namespace tribode
