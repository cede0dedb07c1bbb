#pragma once
#include "tribode/base/options.hpp"
#include "tribode/friction/rolling_friction.hpp"

#include <cstddef>
#include <span>
#include <string>
#include <vector>

namespace tribode {

// Rolling friction from a measured hysteresis loop, section IV-A: N Maxwell-slip elements whose sum follows a record of
// position and force.
//
// With the limit X_i of an element known, its deflection is known from the position alone,
//
//     z_i[k] = clip(z_i[k-1] + y[k] - y[k-1], -X_i, X_i),
//
// and the force is a combination of known curves, f = sum K_i z_i with K_i >= 0: linear least squares with bounds. So
// nested loops and any other history are data as good as a plain loop.
struct FrictionFitOptions {
    int elements = 20; // N
    // Break points: displacements from a reversal at which an element begins to slip, 2 X_i [m]. Least and greatest
    // one; a greatest of zero is the whole range of the fitted positions.
    double shortest = 2e-7;
    double longest = 0;
    // geometric: a geometric series from least to greatest. optimized: each in turn is moved to the best of a dense geometric
    // grid between the two, until none moves.
    enum class BreakPoints { geometric, optimized };
    BreakPoints break_points = BreakPoints::geometric;
    // Samples before this one move the elements and are not fitted. The elements start relaxed; after a reversal
    // and a motion longer than `longest` their start no longer matters.
    std::size_t first_fitted = 0;

    static void describe(auto& o, auto& fields) {
        fields.integer("elements", o.elements, 1, 200,
                       "number of elements; fewer are returned if the best stiffness of one is zero");
        fields.number("shortest_m", o.shortest, "m", Allowed::positive,
                      "least displacement from a reversal at which an element slips, 2F/K");
        fields.number("longest_m", o.longest, "m", Allowed::non_negative,
                      "greatest one; 0: the range of the positions");
        fields.choice("break_points", o.break_points, {"geometric", "optimised"},
                      "these displacements: a geometric series, or each of them fitted in turn");
        fields.index("first_fitted", o.first_fitted, 1L << 53,
                     "the samples before this one only set the state of the elements");
    }
};

struct FrictionFit {
    // By ascending limit; fewer than asked for where the best share of one is zero. Without damping, which a slow
    // record does not show.
    std::vector<MaxwellSlipElement> elements;
    double residual_rms = 0; // over the fitted samples [N]
    double residual_max = 0; // largest magnitude [N]
};

// position [m] and force [N] at the same instants; the force is that of rolling friction alone (thrust at these
// instants, less viscous and inertial force). Uniform weight per sample. Throws InputError, which begins with `where`,
// on options that do not fit the record: unequal lengths, values that are not finite, nothing to fit, no motion.
FrictionFit fit_friction(std::span<const double> position, std::span<const double> force,
                         const FrictionFitOptions& options, const std::string& where = "friction fit");

// The quasi-static force of the elements along the positions, relaxed at the first one [N]. Damping is left out.
std::vector<double> rolling_force(std::span<const MaxwellSlipElement> elements, std::span<const double> position);

} // namespace tribode
