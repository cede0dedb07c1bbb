#pragma once
#include "tribode/base/options.hpp"

#include <cstddef>
#include <optional>
#include <vector>

namespace tribode {

// Moves from rest to rest through a list of positions, each as fast as the limits allow.
struct TrajectoryOptions {
    double sample_time = 5e-4; // [s]
    std::vector<double> points = {0, 0.1};
    double max_velocity = 0.1;      // [m/s]
    double max_acceleration = 1;    // [m/s^2]
    std::optional<double> max_jerk; // [m/s^3]; none: the acceleration jumps, a trapezoid of the velocity
    double dwell = 0.1;             // rest at each point but the first [s]

    static void describe(auto& o, auto& fields) {
        constexpr std::size_t max_points = 100'000;
        fields.number("sample_time_s", o.sample_time, "s", Allowed::positive, "of the signal");
        fields.numbers("points_m", o.points, "m", Allowed::finite, max_points,
                       "positions, the first where it starts; two or more");
        fields.number("max_velocity", o.max_velocity, "m/s", Allowed::positive, "of a move");
        fields.number("max_acceleration", o.max_acceleration, "m/s^2", Allowed::positive, "of a move");
        fields.number("max_jerk", o.max_jerk, "m/s^3", Allowed::positive,
                      "of a move, which is then an S-curve of third order; none: the velocity is a trapezoid");
        fields.number("dwell_s", o.dwell, "s", Allowed::non_negative, "rest at each point but the first");
    }
};

struct Trajectory {
    std::vector<double> position, velocity, acceleration; // at the samples [m], [m/s], [m/s^2]
    std::vector<double> arrival;                          // of each move [s]
};

// A move begins at a sample, and ends when it does: the next sample is at rest. Throws InputError where there are fewer than two
// points or more than 1e8 samples.
Trajectory make_trajectory(const TrajectoryOptions& options);

} // namespace tribode
