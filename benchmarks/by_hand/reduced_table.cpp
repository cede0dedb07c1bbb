#include "by_hand/reduced_table.hpp"

#include <algorithm>
#include <limits>
#include <numbers>

namespace tribode::bench {

ReducedTable::ReducedTable(const problems::ServoProblem& table)
    : lag_(2 * std::numbers::pi * table.lag_hz),
      viscous_(table.viscous) {
    gain_[0] = table.rigid_gain;
    for (std::size_t j = 1; j < bodies; ++j) {
        const auto& mode = table.modes.at(j - 1);
        const double omega = 2 * std::numbers::pi * mode.freq_hz;
        gain_[j] = mode.gain;
        body_damping_[j] = 2 * mode.zeta * omega;
        body_stiffness_[j] = omega * omega;
    }
    for (std::size_t i = 0; i < elements; ++i) {
        k_[i] = table.elements.at(i).K;
        d_[i] = table.elements[i].D;
        limit_[i] = table.elements[i].F / k_[i];
    }
    catch_up(State{}.data(), 0, false);
}

long ReducedTable::catch_up(const double* x, double slack, bool reversed) {
    const double travel = position(x) - y0_;
    y0_ += travel;
    long changes = reversed ? 1 : 0;
    for (std::size_t i = 0; i < elements; ++i) {
        if (slips_[i]) continue;
        z_[i] += travel;
        if (direction_ * z_[i] < limit_[i] * (1 - slack)) continue;
        z_[i] = direction_ * limit_[i];
        slips_[i] = true;
        ++changes;
    }
    if (reversed) {
        slips_.fill(false);
        direction_ = -direction_;
    }
    force_ = stiffness_ = 0;
    damping_ = viscous_;
    room_ = std::numeric_limits<double>::infinity();
    for (std::size_t i = 0; i < elements; ++i) {
        force_ += k_[i] * z_[i];
        if (slips_[i]) continue;
        stiffness_ += k_[i];
        damping_ += d_[i];
        room_ = std::min(room_, limit_[i] - direction_ * z_[i]);
    }
    return changes;
}

} // namespace tribode::bench
