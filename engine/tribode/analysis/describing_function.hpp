#pragma once
#include "tribode/friction/rolling_friction.hpp"

#include <complex>
#include <vector>

namespace tribode {

// Describing function of Maxwell-slip elements: the fundamental of their force over that of a sinusoidal motion of
// amplitude a, x = a cos wt, in the steady state. An element sticks from each reversal until it has travelled 2 X_i,
//
//     N(a, s) = sum (K_i + D_i s) n(a/X_i),   n = (th - sin th cos th + j sin^2 th)/pi,   cos th = 1 - 2 X_i/a
//
// with s = jw, or what stands for the velocity in a sampled model, (1 - z^-1)/Ts. Limits: a <= X_i gives n = 1, a spring;
// for a much greater than X_i, K_i n tends to j 4 F_i/(pi a), the describing function of dry friction. The imaginary part
// is that of the loop's area. Exact for a sinusoidal motion; harmonics of the motion are left out.
struct DescribingFunction {
    std::complex<double> stiffness; // sum K_i n [N/m]
    std::complex<double> damping;   // sum D_i n [N s/m]

    std::complex<double> operator()(std::complex<double> s) const { return stiffness + damping * s; } // N [N/m]
};

// amplitude >= 0 [m]; 0 stands for every amplitude below the least X_i.
DescribingFunction describing_function(const std::vector<MaxwellSlipElement>& elements, double amplitude);

} // namespace tribode
