#include "tribode/friction/rolling_friction.hpp"

#include <algorithm>
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
    begin(s);
    return s;
}

double RollingFriction::coulomb_level() const {
    double sum = 0;
    for (const auto& element : elements_) sum += element.level;
    return sum;
}

// Sums and limits with all elements in stick.
void RollingFriction::begin(State& s) const {
    constexpr double never = std::numeric_limits<double>::infinity();
    double room_forward = never, room_backward = never;
    s.force = s.stiffness = s.damping = 0;
    for (std::size_t i = 0; i < elements_.size(); ++i) {
        s.force += elements_[i].stiffness * s.z[i];
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
    s.direction = SlipState::stick;
    s.slipped = 0;
}

// The order in which elements let go in this direction, with the sums after each.
void RollingFriction::make_ladder(State& s, double towards) const {
    if (s.ladder.empty()) {
        s.ladder.resize(elements_.size());
        for (std::size_t i = 0; i < elements_.size(); ++i) s.ladder[i].element = i;
    }
    // Mostly it is that of the last ladder.
    for (auto& rung : s.ladder) rung.room = limits_[rung.element] - towards * s.z[rung.element];
    const auto is_before = [](const Rung& a, const Rung& b) {
        return a.room != b.room ? a.room < b.room : a.element < b.element;
    };
    if (!std::is_sorted(s.ladder.begin(), s.ladder.end(), is_before)) {
        std::sort(s.ladder.begin(), s.ladder.end(), is_before);
    }
    double level = 0, spring = 0, stiffness = 0, damping = 0;
    for (auto& rung : s.ladder) rung.level = level += elements_[rung.element].level;
    for (auto rung = s.ladder.rbegin(); rung != s.ladder.rend(); ++rung) {
        rung->spring = spring;
        rung->stiffness = stiffness;
        rung->damping = damping;
        const auto& element = elements_[rung->element];
        spring += element.stiffness * s.z[rung->element];
        stiffness += element.stiffness;
        damping += element.damping;
    }
}

void RollingFriction::slip(State& s, double y, SlipState direction, const Report& report) const {
    const double towards = sign(direction);
    if (s.direction == SlipState::stick) make_ladder(s, towards);
    // The next one goes in any case; elements with the same limit go with it, and none is left beyond its own.
    const double reached = std::max(towards * (y - s.reference), s.ladder[s.slipped].room);
    while (s.slipped < s.ladder.size() && s.ladder[s.slipped].room <= reached) {
        const std::size_t i = s.ladder[s.slipped++].element;
        s.z[i] = towards * limits_[i];
        s.slip[i] = direction;
        report(i, direction);
    }
    const Rung& rung = s.ladder[s.slipped - 1];
    s.force = towards * rung.level + rung.spring;
    s.stiffness = rung.stiffness;
    s.damping = rung.damping;
    s.direction = direction;
    // Until the next reversal elements can slip in this direction only.
    constexpr double never = std::numeric_limits<double>::infinity();
    const bool more = s.slipped < s.ladder.size();
    const double next = more ? s.reference + towards * s.ladder[s.slipped].room : towards * never;
    s.forward_limit = towards > 0 ? next : never;
    s.backward_limit = towards < 0 ? next : -never;
    if (more) (towards > 0 ? s.next_forward : s.next_backward) = s.ladder[s.slipped].element;
}

void RollingFriction::stick(State& s, double y, const Report& report) const {
    const double travel = y - s.reference;
    for (std::size_t i = 0; i < elements_.size(); ++i) {
        if (s.slip[i] == SlipState::stick) {
            s.z[i] += travel;
            continue;
        }
        s.slip[i] = SlipState::stick;
        report(i, SlipState::stick);
    }
    s.reference = y;
    begin(s);
}

} // namespace tribode
