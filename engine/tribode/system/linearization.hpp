#pragma once
#include "tribode/system/equations.hpp"

#include <Eigen/Core>
#include <complex>
#include <string>
#include <vector>

namespace tribode {

// Where equations are linearized.
struct OperatingPoint {
    double t = 0;                 // [s]
    std::vector<double> states;   // in the order of the equations
    std::vector<double> discrete; // the same; inputs and parameters have the values of the equations
};

// A linear system about a point. Without sample clocks
//
//     dz/dt = A z + B u,   y = C z + D u,   z = x - x0
//
// With clocks, over one period T of all of them together, u held from k T on, y the left limit at k T:
//
//     z[k+1] = A z[k] + B u[k],   y[k] = C z[k] + D u[k],   z = (x, d) - (x0, d0)
//
// Between the clocks the rates are linearized at the point and solved by the matrix exponential; at their instants what
// they set is linearized, functions from outside by central differences with index 0. Conditions are as they are at the
// point, rounding (floor) has the slope 1.
struct Linearization {
    Eigen::MatrixXd a, b, c, d;
    double sample_time = 0; // T [s]; 0: continuous
    std::vector<std::string> states, inputs, outputs;
    // How far the point is from rest: the greatest rate over its state's nominal value [1/s], and the greatest change of
    // a variable by a clock over its nominal value. Both are zero where the linear system means what it says.
    double rate_left = 0, jump_left = 0;
    // What is no part of it: "the event impact" of a `when`, "the steps of floor(x)", "the other side of x < 0" where the
    // point lies on that edge.
    std::vector<std::string> left_out;

    std::vector<std::complex<double>> poles() const; // in s [1/s], or in z
    bool is_stable() const;                          // all poles left of the imaginary axis, or inside the unit circle

    // Output over input at e^{j 2 pi f T} or j 2 pi f.
    std::complex<double> response(double frequency_hz, std::size_t input, std::size_t output) const;
};

// Throws InputError where the clocks have no common period of at most 1000 of the longest, and where a sample at the
// point makes an event happen.
Linearization linearize(const Equations& equations, const OperatingPoint& point);

} // namespace tribode
