#include "control/sampled_friction.hpp"

#include <algorithm>
#include <cmath>

namespace tribode {

SampledFriction::SampledFriction(std::vector<MaxwellSlipElement> elements, double viscous, double sample_time)
    : elements_(std::move(elements)),
      viscous_(viscous),
      sample_time_(sample_time),
      z_(elements_.size()) {}

double SampledFriction::step(double position) {
    const double travel = position - previous_.value_or(position);
    const double velocity = travel / sample_time_;
    previous_ = position;
    double force = viscous_ * velocity;
    for (std::size_t i = 0; i < elements_.size(); ++i) {
        const double limit = elements_[i].limit();
        z_[i] = std::clamp(z_[i] + travel, -limit, limit);
        force += elements_[i].stiffness * z_[i];
        if (std::abs(z_[i]) < limit) force += elements_[i].damping * velocity;
    }
    return force;
}

void SampledFriction::reset() {
    std::fill(z_.begin(), z_.end(), 0.0);
    previous_.reset();
}

} // namespace tribode
