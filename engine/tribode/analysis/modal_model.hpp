#pragma once
#include "tribode/plant/vibration_mode.hpp"

#include <complex>
#include <vector>

namespace tribode {

// A free mass with vibration modes, from force to position:
//
//     P(s) = k0/s^2 + sum_j k_j / (s^2 + 2 zeta_j w_j s + w_j^2),     w_j = 2 pi f_j.
//
// Far above all modes P(s) -> (k0 + sum_j k_j)/s^2; with all gains positive and little damping there is one
// anti-resonance below each mode.
struct ModalModel {
    double rigid_gain = 0; // k0 [m/(N s^2)], the inverse of the mass
    std::vector<VibrationMode> modes;

    // P(j 2 pi f) [m/N]; infinite at f = 0 where there is a rigid gain.
    std::complex<double> response(double frequency_hz) const;
};

} // namespace tribode
