#include "tribode/control/sampled_friction.hpp"

#include <algorithm>
#include <cmath>

namespace tribode {

SampledFriction::SampledFriction(const std::vector<MaxwellSlipElement>& elements, double viscous, double sample_time)
    : viscous_(viscous),
      sample_time_(sample_time),
      z_(elements.size()) {
    for (const auto& element : elements) {
        if (element.damping != 0) damped_.push_back(stiffness_.size());
        stiffness_.push_back(element.stiffness);
        damping_.push_back(element.damping);
        limit_.push_back(element.limit());
    }
}

double SampledFriction::step(double position) {
    const double travel = position - previous_.value_or(position);
    const double velocity = travel / sample_time_;
    previous_ = position;
    double force = viscous_ * velocity;
    for (std::size_t i = 0; i < z_.size(); ++i) {
        z_[i] = std::clamp(z_[i] + travel, -limit_[i], limit_[i]);
        force += stiffness_[i] * z_[i];
    }
    for (const std::size_t i : damped_) {
        if (std::abs(z_[i]) < limit_[i]) force += damping_[i] * velocity;
    }
    return force;
}

void SampledFriction::reset() {
    std::fill(z_.begin(), z_.end(), 0.0);
    previous_.reset();
}

} // namespace tribode
