#pragma once
#include "tribode/plant/point_force.hpp"

#include <cmath>
#include <cstddef>
#include <span>
#include <string>
#include <utility>
#include <vector>

namespace tribode {

// -1, 0 or 1 from a state that holds one of them, to which implicit integrators add the rounding of their equations.
inline double direction(double state) { return state > 0.5 ? 1 : state < -0.5 ? -1 : 0; }

// A friction law with one deflection z, whose equations have a kink at v = 0: the direction of motion is a discrete value, so
// that a step never goes over the kink. It is 0 while the axis moves less than a hair, until the first motion and right after a
// reversal.
class DirectedLaw : public FrictionLaw {
  public:
    explicit DirectedLaw(std::string name) : name_(std::move(name)) {}

    // way: the direction, 1 or -1; way v is the speed, or just below zero.
    virtual double friction(double v, double way, double z) const = 0;
    virtual double rate(double v, double way, double z) const = 0;

    double friction(double v, std::span<const double> s) const final { return friction(v, way(v, s), s[0]); }
    void rates(double v, std::span<const double> s, std::span<double> dsdt) const final {
        dsdt[0] = rate(v, way(v, s), s[0]);
        dsdt[1] = 0;
    }
    std::size_t guard_count() const final { return 1; }
    void guards(double v, std::span<const double> s, std::span<double> g) const final {
        g[0] = direction(s[1]) == 0 ? hair - std::abs(v) : direction(s[1]) * v;
    }
    void on_crossing(std::size_t, double v, std::span<double> s) const final {
        s[1] = direction(s[1]) != 0 ? 0 : std::copysign(1.0, v);
    }
    std::vector<StateVariable> states() const final {
        return {{"deflection of " + name_, "m"}, {"direction of " + name_, ""}};
    }
    std::string reason() const override { return "the friction law (" + name_ + ") is not linear in its state"; }

  private:
    static constexpr double hair = 1e-12; // [m/s]
    static double way(double v, std::span<const double> s) {
        const double known = direction(s[1]);
        return known != 0 ? known : std::copysign(1.0, v);
    }

    std::string name_;
};

} // namespace tribode
