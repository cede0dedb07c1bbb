#pragma once
#include "tribode/machine/friction_model.hpp"
#include "tribode/machine/machine_model.hpp"

#include <complex>
#include <vector>

namespace tribode {

// The parts of the analysis "Improved" (frequency_sweep.hpp, docs/open-question.md).

// A: what the actuator makes of a phasor of u, with hold, dead time and thrust lag.
std::complex<double> actuator_response(const MachineModel& machine, double frequency_hz);

// The dead time by which a response of the position to u is late at low frequencies: half a sample where u is held, delays,
// and thrust lag [s].
double loop_dead_time(const MachineModel& machine);

// A U - F: the thrust on the linear dynamics, in the time of the driven point, from the phasor U of u and the harmonics of
// the detected position.
std::complex<double> improved_thrust(const MachineModel& machine, const FrictionModel& model, double frequency_hz,
                                     std::complex<double> thrust, std::vector<std::complex<double>> position);

// The position of the driven point over that thrust [m/N].
std::complex<double> improved_response(const MachineModel& machine, const FrictionModel& model, double frequency_hz,
                                       std::complex<double> thrust, const std::vector<std::complex<double>>& position);

// The same for any record: A u, with the exact gain and phase of hold, dead times and lag at every frequency, at the instants
// at which the samples of y are taken. Before and behind the record u is taken to go on smoothly.
std::vector<double> actuator_thrust(const MachineModel& machine, const std::vector<double>& thrust);

// The friction F at those instants [N], of a model along a measured position. The position is interpolated within its band, so
// that reversals between the samples count, and what friction has above half the sampling rate is left out, so that it does not
// fold. thrust: of the motor, for laws that see the load [N].
std::vector<double> friction_along(const MachineModel& machine, const FrictionModel& model,
                                   const std::vector<double>& position, const std::vector<double>& thrust);

} // namespace tribode
