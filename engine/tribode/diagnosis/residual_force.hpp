#pragma once
#include "tribode/diagnosis/measurement.hpp"
#include "tribode/diagnosis/response.hpp"

#include <vector>

namespace tribode {

// What the driven point of a machine went through in a record, and the force that the model lacks there, by the paper's
// effective thrust read backwards:
//
//     d = P^-1 y + f(y, v) - Fm        P: rigid body and modes; f: the modelled friction; Fm: the delayed, lagged thrust
//
// All signals are low-passed alike, without phase (below `bandwidth`), so that encoder rounding does not fool the second
// derivative. The same is done to a simulated record and taken off: what hold, sampling and filter leave is in both.
struct ResidualForce {
    double sample_time = 0;               // of the arrays below [s]
    double bandwidth = 0;                 // [Hz]
    double noise = 0;                     // rms that rounding and noise of the machine leave in `force` [N]
    std::vector<std::size_t> index;       // of each entry in the record
    std::vector<double> time;             // from the record's start [s]
    std::vector<double> position;         // true position, the read-out delay undone [m]
    std::vector<double> velocity;         // [m/s]
    std::vector<double> inertial;         // P^-1 y [N]
    std::vector<double> thrust;           // Fm [N]
    std::vector<double> thrust_rate;      // Fm' [N/s]
    std::vector<double> reference_thrust; // u [N], not filtered
    std::vector<double> friction;         // modelled [N]
    std::vector<double> force;            // d, measured less simulated [N]: what pushes the machine and not the model
};

// `bandwidth`: that of another one to compare with [Hz]; 0: the widest in which the force stands out of the noise.
ResidualForce residual_force(const MachineModel& machine, const Measurement& measurement,
                             const SimulatedSignals& simulated, double bandwidth = 0);

} // namespace tribode
