#pragma once
#include "scenario.hpp"

#include <array>

namespace tribode::bench {

// The table with twenty elements in seven states: position and velocity of the rigid body and of two modes, thrust.
// An element in stick follows the position, so that between events friction is affine in position and velocity:
//
//     f = force + stiffness (y - y0) + damping v      until y has gone `room` further, or v reverses
class ReducedTable {
  public:
    static constexpr std::size_t size = 7, bodies = 3, elements = 20;
    using State = std::array<double, size>;

    explicit ReducedTable(const problems::ServoProblem& table);

    double reference = 0; // thrust reference [N]

    static double position(const double* x) { return x[0] + x[2] + x[4]; }
    static double velocity(const double* x) { return x[1] + x[3] + x[5]; }
    double forward_velocity(const double* x) const { return direction_ * velocity(x); }
    double room_left(const double* x) const { return room_ - direction_ * (position(x) - y0_); }

    void derivative(const double* x, double* dxdt) const {
        const double thrust = lag_ > 0 ? x[6] : reference;
        const double effective = thrust - force_ - stiffness_ * (position(x) - y0_) - damping_ * velocity(x);
        for (std::size_t j = 0; j < bodies; ++j) {
            const double q = x[2 * j], p = x[2 * j + 1];
            dxdt[2 * j] = p;
            dxdt[2 * j + 1] = gain_[j] * effective - body_damping_[j] * p - body_stiffness_[j] * q;
        }
        dxdt[6] = lag_ * (reference - x[6]);
    }

    // The elements in stick follow to this state; those within `slack` of their limit, a share of it, go onto it and
    // slip. Then, where the velocity has reversed, all stick. Returns how many changes that were: slips, reversals.
    long catch_up(const double* x, double slack, bool reversed);

  private:
    std::array<double, bodies> gain_{}, body_damping_{}, body_stiffness_{};
    double lag_, viscous_; // [rad/s], [N s/m]
    std::array<double, elements> k_{}, d_{}, limit_{}, z_{};
    std::array<bool, elements> slips_{};
    double direction_ = 1;
    double y0_ = 0, force_ = 0, stiffness_ = 0, damping_ = 0, room_ = 0;
};

} // namespace tribode::bench
