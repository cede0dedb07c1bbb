#pragma once
#include "tribode/plant/point_force.hpp"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <span>
#include <string>
#include <utility>
#include <vector>

namespace tribode {

// -1, 0 or 1 from a state that holds one of them, to which implicit integrators add the rounding of their equations.
inline double direction(double state) { return state > 0.5 ? 1 : state < -0.5 ? -1 : 0; }

// The direction of motion as a state, for laws whose equations have a kink at v = 0: it is a discrete value, so that a step
// never goes over the kink. It is 0 while the axis moves less than a hair, until the first motion and right after a reversal.
namespace motion {

inline constexpr double hair = 1e-12; // [m/s]

// 1 or -1; way v is the speed, or just below zero.
inline double way(double v, double state) {
    const double known = direction(state);
    return known != 0 ? known : std::copysign(1.0, v);
}
inline double guard(double v, double state) {
    return direction(state) == 0 ? hair - std::abs(v) : direction(state) * v;
}
inline double after_crossing(double v, double state) { return direction(state) != 0 ? 0 : std::copysign(1.0, v); }

} // namespace motion

// A friction law with one deflection z and the direction of motion.
class DirectedLaw : public FrictionLaw {
  public:
    explicit DirectedLaw(std::string name) : name_(std::move(name)) {}

    // way: the direction, 1 or -1; way v is the speed, or just below zero.
    virtual double friction(double v, double way, double z) const = 0;
    virtual double rate(double v, double way, double z) const = 0;

    // Where there are numbers(): what follows from a small change of v, z and each number.
    struct Derivatives {
        double velocity = 0, deflection = 0;
        std::span<double> numbers; // zero
    };
    virtual void differentiate(double /*v*/, double /*way*/, double /*z*/, Derivatives& /*friction*/,
                               Derivatives& /*rate*/) const {}

    void differentiate(double v, std::span<const double> s, std::span<double> rows) const final {
        const std::size_t width = rows.size() / 3; // v, z, the direction and the numbers
        std::fill(rows.begin(), rows.end(), 0.0);
        Derivatives friction{.numbers = rows.subspan(3, width - 3)};
        Derivatives rate{.numbers = rows.subspan(width + 3, width - 3)};
        differentiate(v, motion::way(v, s[1]), s[0], friction, rate);
        rows[0] = friction.velocity;
        rows[1] = friction.deflection;
        rows[width] = rate.velocity;
        rows[width + 1] = rate.deflection;
    }
    double friction(double v, std::span<const double> s) const final { return friction(v, motion::way(v, s[1]), s[0]); }
    void rates(double v, std::span<const double> s, std::span<double> dsdt) const final {
        dsdt[0] = rate(v, motion::way(v, s[1]), s[0]);
        dsdt[1] = 0;
    }
    std::size_t guard_count() const final { return 1; }
    void guards(double v, std::span<const double> s, std::span<double> g) const final { g[0] = motion::guard(v, s[1]); }
    void on_crossing(std::size_t, double v, std::span<double> s) const final { s[1] = motion::after_crossing(v, s[1]); }
    std::vector<StateVariable> states() const final {
        return {{"deflection of " + name_, "m"}, {"direction of " + name_, ""}};
    }
    std::string reason() const override { return "the friction law (" + name_ + ") is not linear in its state"; }

  private:
    std::string name_;
};

} // namespace tribode
