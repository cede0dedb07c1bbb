#pragma once
#include "tribode/diagnosis/measurement.hpp"
#include "tribode/diagnosis/response.hpp"
#include "tribode/effect/clues.hpp"

namespace tribode {

// `bandwidth`: that of another one to compare with [Hz]; 0: the widest in which the force stands out of the noise.
ResidualForce residual_force(const MachineModel& machine, const Measurement& measurement,
                             const SimulatedSignals& simulated, double bandwidth = 0);

} // namespace tribode
