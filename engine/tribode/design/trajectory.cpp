#include "tribode/design/trajectory.hpp"
#include "tribode/base/error.hpp"

#include <algorithm>
#include <cmath>
#include <fmt/format.h>

namespace tribode {

namespace {

struct Segment {
    double duration, acceleration, jerk; // [s], at its beginning [m/s^2], [m/s^3]
};

// From rest to rest over a distance > 0.
std::vector<Segment> segments_of(double distance, const TrajectoryOptions& o) {
    double velocity = o.max_velocity, acceleration = o.max_acceleration;
    if (!o.max_jerk) {
        if (velocity * velocity / acceleration > distance) velocity = std::sqrt(distance * acceleration);
        const double ramp = velocity / acceleration;
        return {{ramp, acceleration, 0}, {distance / velocity - ramp, 0, 0}, {ramp, -acceleration, 0}};
    }
    const double jerk = *o.max_jerk, rise = acceleration / jerk;
    // The peak velocity of a move without a part at constant velocity, whose acceleration comes to its limit.
    const double peak = acceleration / 2 * (std::sqrt(rise * rise + 4 * distance / acceleration) - rise);
    const double short_peak = std::cbrt(distance * distance * jerk / 4); // whose acceleration does not
    velocity = std::min(velocity, peak >= acceleration * rise ? peak : short_peak);
    // Likewise the acceleration where the velocity is there before.
    acceleration = std::min(acceleration, std::sqrt(velocity * jerk));
    const double build_up = acceleration / jerk, hold = velocity / acceleration - build_up;
    const double cruise = distance / velocity - (2 * build_up + hold);
    return {{build_up, 0, jerk},  {hold, acceleration, 0},  {build_up, acceleration, -jerk}, {cruise, 0, 0},
            {build_up, 0, -jerk}, {hold, -acceleration, 0}, {build_up, -acceleration, jerk}};
}

} // namespace

Trajectory make_trajectory(const TrajectoryOptions& o) {
    if (o.points.size() < 2) {
        throw InputError(fmt::format("points_m has {} entries, must have two or more", o.points.size()));
    }
    constexpr double max_samples = 1e8;
    const double ts = o.sample_time, dwell = std::round(o.dwell / ts);
    Trajectory made;
    const auto rest_at = [&](double position, double samples) {
        if (static_cast<double>(made.position.size()) + samples > max_samples) {
            throw InputError("the trajectory has more than 1e8 samples; make it shorter or sample_time_s longer");
        }
        const auto count = made.position.size() + static_cast<std::size_t>(samples);
        made.position.resize(count, position);
        made.velocity.resize(count, 0);
        made.acceleration.resize(count, 0);
    };
    for (std::size_t i = 1; i < o.points.size(); ++i) {
        const double distance = std::abs(o.points[i] - o.points[i - 1]);
        const double way = o.points[i] < o.points[i - 1] ? -1 : 1;
        const double start = static_cast<double>(made.position.size()) * ts;
        double duration = 0;
        if (distance > 0) {
            const auto segments = segments_of(distance, o);
            for (const auto& segment : segments) duration += segment.duration;
            const double samples = std::ceil(duration / ts * (1 - 1e-12));
            const std::size_t first = made.position.size();
            rest_at(o.points[i], samples);
            const auto along = [&](double t, double& p, double& v, double& a) {
                p = v = 0;
                for (const auto& [length, at, jerk] : segments) {
                    const double s = std::min(t, length);
                    p += s * (v + s * (at / 2 + s * jerk / 6));
                    v += s * (at + s * jerk / 2);
                    a = at + s * jerk;
                    t -= length;
                    if (t < 0) return;
                }
            };
            for (std::size_t k = 0; k < static_cast<std::size_t>(samples); ++k) {
                const double t = static_cast<double>(k) * ts;
                double p = 0, v = 0, a = 0;
                along(t, p, v, a);
                made.position[first + k] = o.points[i - 1] + way * p;
                made.velocity[first + k] = way * v;
                made.acceleration[first + k] = way * a;
            }
        }
        made.arrival.push_back(start + duration);
        rest_at(o.points[i], dwell);
    }
    rest_at(o.points.back(), 1);
    return made;
}

} // namespace tribode
