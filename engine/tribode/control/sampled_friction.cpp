#include "tribode/control/sampled_friction.hpp"
#include "tribode/base/lanes.hpp"

#include <algorithm>
#include <cmath>

namespace tribode {

namespace {

// Moves the elements and leaves the force of each; in pointers, so that several are moved at a time.
TRIBODE_CLONES void move_elements(double travel, std::size_t count, const double* limit, const double* stiffness,
                                  double* z, double* force) {
    for (std::size_t i = 0; i < count; ++i) {
        const double moved = z[i] + travel, least = -limit[i];
        const double held = moved < least ? least : moved;
        z[i] = held > limit[i] ? limit[i] : held;
        force[i] = stiffness[i] * z[i];
    }
}

} // namespace

SampledFriction::SampledFriction(const std::vector<MaxwellSlipElement>& elements, double viscous, double sample_time)
    : viscous_(viscous),
      sample_time_(sample_time),
      z_(elements.size()),
      own_(elements.size()) {
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
    move_elements(travel, z_.size(), limit_.data(), stiffness_.data(), z_.data(), own_.data());
    for (const double own : own_) force += own;
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
