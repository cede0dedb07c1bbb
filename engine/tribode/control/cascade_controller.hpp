#pragma once
#include "tribode/base/about.hpp"
#include "tribode/base/field_reader.hpp"
#include "tribode/control/loop_filter.hpp"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <limits>
#include <vector>

namespace tribode {

// Position and velocity loop, the first proportional, the second too (P-P) or with an integral part (P-PI), as drives have it:
//
//     qf[k] = (q[k] + q[k-1])/2,  dq[k] = (qf[k] - qf[k-1])/Ts
//     e[k] = kp (r[k] - q[k]) - dq[k],  I[k] = I[k-1] + ki Ts e[k]
//     u[k + delay_samples] = clip(filters(kv (e[k] + I[k])), limit)
//
// While u is beyond the limit, I rests where e would take it further.
// Before the first sample the axis rests where it is: q[-1] = q[0]. The output is zero until the first u arrives.
struct CascadeController {
    static constexpr double no_limit = std::numeric_limits<double>::infinity();
    static constexpr long max_delay_samples = 100000;

    double kp = 0; // [1/s]
    double kv = 0; // [N s/m]
    double ki = 0; // [1/s]
    std::vector<LoopFilter> filters = {};
    double limit = no_limit; // [N]
    std::size_t delay_samples = 0;

    static void describe(auto& c, auto& fields) {
        fields.required("kp", c.kp, "1/s", Allowed::finite, About("gain of the position loop").usually(1e-3, 1e5));
        fields.required("kv", c.kv, "N s/m", Allowed::finite, About("gain of the velocity loop").usually(1e-6, 1e9));
        fields.number("ki", c.ki, "1/s", Allowed::finite,
                      About("integral gain of the velocity loop; 0: proportional").usually(1e-3, 1e5));
        fields.list("filters", c.filters, "of the thrust reference, one behind another, before the limit");
        fields.optional("limit", c.limit, no_limit, "N", Allowed::positive,
                        About("of the thrust reference").usually(1e-3, 1e7));
        fields.integer("delay_samples", c.delay_samples, 0, max_delay_samples, "samples by which the output is late");
    }

    struct State {
        bool started = false;
        double previous_position = 0; // q[k-1] [m]
        double previous_mean = 0;     // qf[k-1] [m]
        double integral = 0;          // I [m/s]
        LoopFilterStates filters = {};
        std::vector<double> pending; // outputs on their way, the oldest first [N]
    };

    // sample_time: Ts [s].
    double step(State& s, double reference, double position, double sample_time) const {
        if (!s.started) {
            s = {true, position, position, 0, {}, std::vector<double>(delay_samples, 0.0)};
        }
        const double mean = (position + s.previous_position) / 2;
        const double velocity = (mean - s.previous_mean) / sample_time;
        s.previous_position = position;
        s.previous_mean = mean;
        const double error = kp * (reference - position) - velocity;
        const double rested = s.integral;
        if (ki != 0) s.integral += ki * sample_time * error;
        double u = ki != 0 ? kv * (error + s.integral) : kv * error;
        if (!filters.empty()) u = s.filters.step(filters, u, sample_time);
        if (std::abs(u) > limit && u * kv * (s.integral - rested) > 0) s.integral = rested;
        s.pending.push_back(std::clamp(u, -limit, limit));
        const double output = s.pending.front();
        s.pending.erase(s.pending.begin());
        return output;
    }
};

} // namespace tribode
