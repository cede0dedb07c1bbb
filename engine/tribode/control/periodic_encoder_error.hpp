#pragma once
#include <cmath>
#include <numbers>

namespace tribode {

// What the encoder adds to the position: A sin(2 pi y/period + phase) and its second harmonic, A2 sin(4 pi y/period +
// phase2).
struct PeriodicEncoderError {
    double amplitude;        // A [m]
    double period;           // [m], > 0
    double phase;            // [rad]
    double second_amplitude; // A2 [m]
    double second_phase;     // [rad]

    double operator()(double y) const {
        const double angle = 2 * std::numbers::pi * y / period;
        return amplitude * std::sin(angle + phase) + second_amplitude * std::sin(2 * angle + second_phase);
    }
};

} // namespace tribode
