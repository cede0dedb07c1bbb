#include "tribode/effect/clues.hpp"

#include <algorithm>
#include <cmath>

namespace tribode {

Clues::Clues(const ServoAxis& axis_, double sample_time_, const ResidualForce& residual_, const Signal& measured_,
             const Signal& whitened_, double innovation_, double longest_stroke_)
    : axis(axis_),
      sample_time(sample_time_),
      residual(residual_),
      force(residual.force),
      position(residual.position),
      velocity(residual.velocity),
      measured(measured_),
      whitened(whitened_),
      innovation(innovation_) {
    const auto [low, high] = std::minmax_element(position.begin(), position.end());
    min_position = *low;
    max_position = *high;
    stroke = max_position - min_position;
    longest_stroke = std::max(stroke, longest_stroke_);
    reach = std::max(std::abs(min_position), std::abs(max_position));
    max_speed = largest(velocity);
    // A quarter of the motion is slow enough that a force over so short a way stays below the bandwidth.
    Signal speeds;
    for (const double v : velocity) {
        if (std::abs(v) > 0.05 * max_speed) speeds.push_back(std::abs(v));
    }
    shortest_period = 2e-6;
    if (!speeds.empty()) {
        const auto quarter = speeds.begin() + static_cast<std::ptrdiff_t>(speeds.size() / 4);
        std::nth_element(speeds.begin(), quarter, speeds.end());
        shortest_period =
            std::max({shortest_period, 4 * axis.encoder_resolution, 1.25 * *quarter / residual.bandwidth});
    }
    max_thrust = largest(residual.reference_thrust);
    duration = static_cast<double>(measured.size()) * sample_time;
    const double slow = 0.01 * max_speed;
    direction = map(velocity, [slow](double v) { return std::clamp(v / slow, -1.0, 1.0); });
    gain = axis.plant.rigid_gain;
    for (const auto& mode : axis.plant.modes) gain += mode.gain;
}

double Clues::typical_force() const { return std::max(rms(force), 1e-3 * max_thrust); }

bool Clues::has_friction() const { return largest(residual.friction) > 1e-3 * max_thrust; }

double Clues::at_least(double least, double value) {
    return std::abs(value) > least ? value : std::copysign(least, value);
}

} // namespace tribode
