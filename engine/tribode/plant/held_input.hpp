#pragma once
#include <array>

namespace tribode {

// The thrust reference between two of its samples: a cubic in the time since the last one. A zero-order hold has
// the first coefficient only.
struct HeldInput {
    std::array<double, 4> coefficient{}; // [N], of powers of (t - start)/period
    double start = 0;                    // [s]
    double rate = 0;                     // 1/period [1/s]; 0: constant

    // The n-th coefficient in s of its value at t0 + s h.
    double taylor(int n, double t0, double h) const {
        if (n > 3 || (rate == 0 && n > 0)) return 0;
        if (rate == 0) return coefficient[0];
        const double at = (t0 - start) * rate, step = h * rate;
        double sum = 0, binomial = 1, power = 1; // C(k, n), at^(k-n)
        for (int k = n; k <= 3; ++k) {
            sum += binomial * power * coefficient[static_cast<std::size_t>(k)];
            binomial = binomial * (k + 1) / (k + 1 - n);
            power *= at;
        }
        for (int k = 0; k < n; ++k) sum *= step;
        return sum;
    }

    double operator()(double t) const {
        const double s = (t - start) * rate;
        return coefficient[0] + s * (coefficient[1] + s * (coefficient[2] + s * coefficient[3]));
    }
};

} // namespace tribode
