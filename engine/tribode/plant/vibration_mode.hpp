#pragma once
#include "tribode/base/about.hpp"
#include "tribode/base/field_reader.hpp"

namespace tribode {

// A vibration mode of eq. (1): q'' + 2 zeta w q' + w^2 q = gain u_e.
struct VibrationMode {
    double gain = 0;    // k_j [m/(N s^2)]
    double freq_hz = 0; // w_j / 2 pi [Hz], > 0
    double zeta = 0;    // z_j, >= 0

    static void describe(auto& mode, auto& fields) {
        fields.required("gain", mode.gain, "m/(N s^2)", Allowed::positive,
                        About("k_j, its share of the gain").usually(1e-9, 10).uncertain("modes.gain"));
        fields.required("freq_hz", mode.freq_hz, "Hz", Allowed::positive,
                        About("natural frequency").usually(0.1, 1e5).uncertain("modes.freq_hz"));
        fields.required("zeta", mode.zeta, "", Allowed::non_negative,
                        About("damping ratio").usually(1e-6, 1).uncertain("modes.zeta"));
    }
};

} // namespace tribode
