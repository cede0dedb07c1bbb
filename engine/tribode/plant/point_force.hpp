#pragma once
#include "tribode/hybrid/hybrid_system.hpp"

#include <cstddef>
#include <optional>
#include <span>
#include <string>
#include <vector>

namespace tribode {

// A force on the driven point that is not affine between events: F(t, y, v; s), smooth but for isolated points, with
// states s of its own that are zero at the start. [N], t [s], y [m], v [m/s].
//
// Its laws may change at zero crossings of v and s: guards() and on_crossing(). What is discrete then, such as whether an
// element slips, is a state whose rate is zero.
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
    // The numbers that it is made of, and dF/d of each, where runs with it can be differentiated: then it knows its slopes, or is
    // a FrictionLaw.
    virtual std::optional<std::vector<double>> numbers() const { return std::nullopt; }
    virtual void by_numbers(double /*t*/, double /*y*/, double /*v*/, std::span<double> /*by*/) const {}
    // Why the machine is not affine with it, as part of a sentence.
    virtual std::string reason() const = 0;
    virtual std::vector<StateVariable> states() const { return {}; }
    // Whether the solver for machines that are affine but for smooth forces may take it: its guards must not depend on its
    // states, and these should not decay much faster than a sample, or steps get short.
    virtual bool is_nearly_affine() const { return states().empty(); }
    // ds/dt, one entry a state.
    virtual void rates(double /*t*/, double /*y*/, double /*v*/, std::span<const double> /*s*/,
                       std::span<double> /*dsdt*/) const {}
    virtual std::size_t guard_count() const { return 0; }
    virtual void guards(double /*v*/, std::span<const double> /*s*/, std::span<double> /*g*/) const {}
    // The guard has come to zero from above.
    virtual void on_crossing(std::size_t /*guard*/, double /*v*/, std::span<double> /*s*/) const {}
};

// A friction law with states of its own, driven by the motion alone: the force is -friction(v, s), grown with the load where
// it says so. As an analysis subtracts it and as a machine has it, it is the same object.
class FrictionLaw : public PointForce {
  public:
    virtual double friction(double v, std::span<const double> s) const = 0; // [N]
    virtual void rates(double v, std::span<const double> s, std::span<double> dsdt) const = 0;
    // Whether the friction is that of a load of 1 N, and grows with the load, which is the magnitude of the motor force.
    virtual bool per_load() const { return false; }
    // Where there are numbers(): of the friction, and then of each rate, a row of derivatives by v, the states and the numbers.
    // Rates are zero at rest.
    virtual void differentiate(double /*v*/, std::span<const double> /*s*/, std::span<double> /*rows*/) const {}
    // The fastest rate at which a state decays at this velocity [1/s], for steps of fixed length.
    virtual double fastest_rate(double v, std::span<const double> s) const = 0;

    double force(double, double, double v, std::span<const double> s) const final { return -friction(v, s); }
    void rates(double, double, double v, std::span<const double> s, std::span<double> dsdt) const final {
        rates(v, s, dsdt);
    }
};

// A factor on all friction of the driven point, a function of time and position; never below zero.
class FrictionScale {
  public:
    virtual ~FrictionScale() = default;
    virtual double factor(double t, double y) const = 0;
    virtual double slope(double t, double y) const = 0; // d factor / dy [1/m]
    // As above; of a factor above zero.
    virtual std::optional<std::vector<double>> numbers() const { return std::nullopt; }
    virtual void by_numbers(double /*t*/, double /*y*/, std::span<double> /*by*/) const {}
    virtual std::string reason() const = 0; // as above
};

} // namespace tribode
