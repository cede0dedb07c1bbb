#pragma once
#include <cmath>
#include <numbers>

namespace tribode {

// Discrete PID without anti-windup:
//
//     I[k] = I[k-1] + ki Ts e[k]
//     d[k] = a d[k-1] + (1-a) (e[k] - e[k-1])/Ts,  a = exp(-2 pi f Ts), or 0 without a filter
//     u[k] = kp e[k] + I[k] + kd d[k]
//
// All states are zero at the start.
struct PidController {
    double kp = 0;                   // [N/m]
    double ki = 0;                   // [N/(m s)]
    double kd = 0;                   // [N s/m]
    double derivative_filter_hz = 0; // f; 0: no filter
    double sample_time = 0;          // Ts [s]

    struct State {
        double integral = 0;       // I [N]
        double derivative = 0;     // d [m/s]
        double previous_error = 0; // [m]
    };

    double step(State& s, double error) const {
        const double a =
            derivative_filter_hz > 0 ? std::exp(-2 * std::numbers::pi * derivative_filter_hz * sample_time) : 0.0;
        s.integral += ki * sample_time * error;
        s.derivative = a * s.derivative + (1 - a) * (error - s.previous_error) / sample_time;
        s.previous_error = error;
        return kp * error + s.integral + kd * s.derivative;
    }
};

} // namespace tribode
