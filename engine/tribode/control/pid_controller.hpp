#pragma once
#include "tribode/base/about.hpp"
#include "tribode/base/field_reader.hpp"
#include "tribode/control/loop_filter.hpp"

#include <cmath>
#include <numbers>
#include <vector>

namespace tribode {

// Discrete PID without anti-windup:
//
//     I[k] = I[k-1] + ki Ts e[k]
//     d[k] = a d[k-1] + (1-a) (e[k] - e[k-1])/Ts,  a = exp(-2 pi f Ts), or 0 without a filter
//     u[k] = filters(kp e[k] + I[k] + kd d[k])
//
// All states are zero at the start.
struct PidController {
    double kp = 0;                   // [N/m]
    double ki = 0;                   // [N/(m s)]
    double kd = 0;                   // [N s/m]
    double derivative_filter_hz = 0; // f; 0: no filter
    std::vector<LoopFilter> filters = {};

    static void describe(auto& c, auto& fields) {
        fields.required("kp", c.kp, "N/m", Allowed::finite, About("proportional gain").usually(1e-3, 1e12));
        fields.number("ki", c.ki, "N/(m s)", Allowed::finite, About("integral gain").usually(1e-3, 1e15));
        fields.number("kd", c.kd, "N s/m", Allowed::finite, About("derivative gain").usually(1e-6, 1e9));
        fields.optional("derivative_filter_hz", c.derivative_filter_hz, 0.0, "Hz", Allowed::positive,
                        About("corner of the first-order filter of the derivative").usually(0.1, 1e6));
        fields.list("filters", c.filters, "of the thrust reference, one behind another");
    }

    struct State {
        double integral = 0;       // I [N]
        double derivative = 0;     // d [m/s]
        double previous_error = 0; // [m]
        LoopFilterStates filters = {};
    };

    // sample_time: Ts [s].
    double step(State& s, double error, double sample_time) const {
        const double a =
            derivative_filter_hz > 0 ? std::exp(-2 * std::numbers::pi * derivative_filter_hz * sample_time) : 0.0;
        s.integral += ki * sample_time * error;
        s.derivative = a * s.derivative + (1 - a) * (error - s.previous_error) / sample_time;
        s.previous_error = error;
        const double u = kp * error + s.integral + kd * s.derivative;
        return filters.empty() ? u : s.filters.step(filters, u, sample_time);
    }
};

} // namespace tribode
