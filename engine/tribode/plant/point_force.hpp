#pragma once
#include "tribode/hybrid/hybrid_system.hpp"

#include <optional>
#include <span>
#include <string>
#include <vector>

namespace tribode {

// A force on the driven point that is not affine between events: F(t, y, v; s), smooth but for isolated points, with
// states s of its own that are zero at the start. [N], t [s], y [m], v [m/s].
class PointForce {
  public:
    struct Slopes {
        double position = 0; // dF/dy [N/m]
        double velocity = 0; // dF/dv [N s/m]
    };

    virtual ~PointForce() = default;
    virtual double force(double t, double y, double v, std::span<const double> s) const = 0;
    // Nothing where they are not known, or where there are states: then the machine has no Jacobian of its own.
    virtual std::optional<Slopes> slopes(double /*t*/, double /*y*/, double /*v*/) const { return std::nullopt; }
    // Why the machine is not affine with it, as part of a sentence.
    virtual std::string reason() const = 0;
    virtual std::vector<StateVariable> states() const { return {}; }
    // ds/dt, one entry a state.
    virtual void rates(double /*t*/, double /*y*/, double /*v*/, std::span<const double> /*s*/,
                       std::span<double> /*dsdt*/) const {}
};

// A factor on all friction of the driven point, a function of time and position; never below zero.
class FrictionScale {
  public:
    virtual ~FrictionScale() = default;
    virtual double factor(double t, double y) const = 0;
    virtual double slope(double t, double y) const = 0; // d factor / dy [1/m]
    virtual std::string reason() const = 0;             // as above
};

} // namespace tribode
