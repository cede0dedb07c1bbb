#pragma once
#include "tribode/base/lanes.hpp"

#include <cstddef>
#include <functional>
#include <span>
#include <vector>

namespace tribode {

// The sensitivities of a system that is smooth but not affine between events, with the states themselves: dz/dt = f(t, z), by the
// explicit midpoint rule with 2, 4, 6, ... substeps, extrapolated to none [Gragg 1965], [Hairer 1993, II.9]. Each extrapolation gains
// two orders; they go on until the last two agree to near rounding, and where they do not a step is halved.
// Forces may have kinks at isolated points.
//
// z has the sensitivities of each state, side by side, then the states. The error is that of the sensitivities by each parameter,
// against the largest one: positions, velocities and forces in the proportions of `scale`.
class ExtrapolatedMidpoint {
  public:
    using Rates = std::function<void(double t, std::span<const Lanes> z, std::span<Lanes> rates)>;

    // scale: of each state. z has `entries` lanes, the first ones those of the states.
    ExtrapolatedMidpoint(std::vector<double> scale, std::size_t entries);

    // z over h from t; false where it is no number.
    bool advance(double t, double h, std::span<Lanes> z, const Rates& rates);

  private:
    bool step(double t, double h, bool at_least, std::span<Lanes> z, const Rates& rates);
    double change(std::span<const Lanes> z, std::span<const Lanes> moved) const;

    std::vector<double> inverse_scale_;
    const std::size_t entries_;
    double longest_;                                               // step that was short enough [s]
    std::size_t columns_ = 0;                                      // that the last one took
    std::vector<Lanes> slope_, start_slope_, before_, now_, next_; // of the midpoint rule
    std::vector<std::vector<Lanes>> table_;                        // of the last number of substeps, by order
};

} // namespace tribode
