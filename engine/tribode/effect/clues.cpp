#include "tribode/effect/clues.hpp"

#include <algorithm>
#include <cmath>

namespace tribode {

Clues::Clues(const ServoAxis& axis_, double sample_time_, const ResidualForce& residual_, const Signal& measured_,
             const Signal& whitened_, double innovation_)
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
    reach = std::max(std::abs(min_position), std::abs(max_position));
    max_speed = largest(velocity);
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
