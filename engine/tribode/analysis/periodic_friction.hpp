#pragma once
#include "tribode/friction/rolling_friction.hpp"

#include <complex>
#include <span>
#include <vector>

namespace tribode {

// The phasor at frequency f of the friction force on a point that moves periodically,
//
//     x(t) = sum_n Re(X_n exp(j 2 pi n f t)),     f1 = F exp(j 2 pi f t),
//
// in the steady state: each element of eqs. (11)-(15) has passed both turning points before the period that is read, so
// that where it began does not matter. Viscous friction adds j 2 pi f D_v X_1.
//
// The motion is followed at 2000 points of a period, between which the reversal of a sine is missed by at most 1.2e-6 of
// its amplitude: friction is known between the samples of a controller as well as at them. What the higher harmonics of
// the motion do to the force is contained as far as `position` holds them.
std::complex<double> friction_phasor(std::span<const std::complex<double>> position, // X_1 .. X_H [m]
                                     double frequency_hz, const std::vector<MaxwellSlipElement>& elements,
                                     double viscous); // D_v [N s/m]; the result is in N

} // namespace tribode
