#pragma once
#include "tribode/analysis/signal_fit.hpp"
#include "tribode/effect/servo_axis.hpp"

#include <cstddef>
#include <vector>

namespace tribode {

// What the driven point of a machine went through in a record, and the force that the model lacks there, by the paper's
// effective thrust read backwards:
//
//     d = P^-1 y + f(y, v) - Fm        P: rigid body and modes; f: the modeled friction; Fm: the delayed, lagged thrust
//
// All signals are low-passed alike, without phase (below `bandwidth`), so that encoder rounding does not fool the second
// derivative. The same is done to a simulated record and taken off: what hold, sampling and filter leave is in both.
struct ResidualForce {
    double sample_time = 0;         // of the arrays below [s]
    double bandwidth = 0;           // [Hz]
    double noise = 0;               // rms that rounding and noise of the machine leave in `force` [N]
    std::vector<std::size_t> index; // of each entry in the record
    Signal time;                    // from the record's start [s]
    Signal position;                // true position, the read-out delay undone [m]
    Signal velocity;                // [m/s]
    Signal inertial;                // P^-1 y [N]
    Signal thrust;                  // Fm [N]
    Signal thrust_rate;             // Fm' [N/s]
    Signal reference_thrust;        // u [N], not filtered
    Signal friction;                // modeled [N]
    Signal force;                   // d, measured less simulated [N]: what pushes the machine and not the model
};

// How a machine and a record disagree, before an effect is fitted: the signals from which the forms of an effect read their
// starts, and the sizes that bound their parameters.
struct Clues {
    // What is referred to must outlive it. `axis`: of the fields of the machine, without effects; `measured`: positions of the
    // record [m]; `whitened`: their errors, white [m times 1/innovation]; `innovation` [m]; `longest_stroke`: of all records of
    // the machine [m], if one is longer than this.
    Clues(const ServoAxis& axis, double sample_time, const ResidualForce& residual, const Signal& measured,
          const Signal& whitened, double innovation, double longest_stroke);

    const ServoAxis& axis;
    double sample_time; // of the record [s]
    const ResidualForce& residual;
    const Signal &force, &position, &velocity; // of the residual
    const Signal &measured, &whitened;
    double innovation;

    Signal direction;                  // sign of the velocity, in between about zero
    double min_position, max_position; // [m]
    double stroke;                     // their difference [m]
    double longest_stroke;             // of all records, this one or a longer one [m]
    double shortest_period;            // over the travel, that `force` shows [m]
    double reach;                      // the larger magnitude [m]
    double max_speed, max_thrust;      // [m/s], [N]
    double duration;                   // [s]
    double gain;                       // of the machine, modes included [m/(N s^2)]

    double typical_force() const;                        // [N]
    double max_force() const { return 20 * max_thrust; } // that no plausible machine comes near [N]
    bool has_friction() const;                           // modeled friction that can vary
    // A start, but no nearer to zero than what the first differences see.
    static double at_least(double least, double value);
    double noticeable(double start) const { return at_least(0.02 * typical_force(), start); }
};

} // namespace tribode
