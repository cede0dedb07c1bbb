#include "friction/rolling_friction.hpp"

#include <limits>
#include <utility>

namespace tribode {

RollingFriction::RollingFriction(std::vector<MaxwellSlipElement> elements) : elements_(std::move(elements)) {
    for (const auto& element : elements_) limits_.push_back(element.limit());
}

RollingFriction::State RollingFriction::at_rest(double y) const {
    State s;
    s.z.assign(elements_.size(), 0.0);
    s.slip.assign(elements_.size(), SlipState::stick);
    s.reference = y;
    refresh(s);
    return s;
}

double RollingFriction::coulomb_level() const {
    double sum = 0;
    for (const auto& element : elements_) sum += element.level;
    return sum;
}

// Elements in stick follow the position.
void RollingFriction::move_reference(State& s, double y) const {
    const double travel = y - s.reference;
    for (std::size_t i = 0; i < elements_.size(); ++i) {
        if (s.slip[i] == SlipState::stick) s.z[i] += travel;
    }
    s.reference = y;
}

void RollingFriction::refresh(State& s) const {
    constexpr double never = std::numeric_limits<double>::infinity();
    double room_forward = never, room_backward = never;
    s.force = s.stiffness = s.damping = 0;
    s.direction = SlipState::stick;
    for (std::size_t i = 0; i < elements_.size(); ++i) {
        s.force += elements_[i].stiffness * s.z[i];
        if (s.slip[i] != SlipState::stick) {
            s.direction = s.slip[i];
            continue;
        }
        s.stiffness += elements_[i].stiffness;
        s.damping += elements_[i].damping;
        if (limits_[i] - s.z[i] < room_forward) {
            room_forward = limits_[i] - s.z[i];
            s.next_forward = i;
        }
        if (limits_[i] + s.z[i] < room_backward) {
            room_backward = limits_[i] + s.z[i];
            s.next_backward = i;
        }
    }
    s.forward_limit = s.reference + room_forward;
    s.backward_limit = s.reference - room_backward;
}

void RollingFriction::slip(State& s, double y, SlipState direction, const Report& report) const {
    move_reference(s, y);
    const std::size_t first = direction == SlipState::slip_forward ? s.next_forward : s.next_backward;
    const double towards = sign(direction);
    const double reached = towards * s.z[first] >= limits_[first] ? 0.0 : limits_[first] - towards * s.z[first];
    for (std::size_t i = 0; i < elements_.size(); ++i) {
        // Elements with the same limit go together, and none is left beyond its own.
        if (s.slip[i] != SlipState::stick) continue;
        if (i != first && towards * s.z[i] + reached < limits_[i]) continue;
        s.z[i] = towards * limits_[i];
        s.slip[i] = direction;
        report(i, direction);
    }
    refresh(s);
}

void RollingFriction::stick(State& s, double y, const Report& report) const {
    move_reference(s, y);
    for (std::size_t i = 0; i < elements_.size(); ++i) {
        if (s.slip[i] == SlipState::stick) continue;
        s.slip[i] = SlipState::stick;
        report(i, SlipState::stick);
    }
    refresh(s);
}

} // namespace tribode
