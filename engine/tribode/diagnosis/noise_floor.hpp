#pragma once
#include "tribode/base/run_control.hpp"
#include "tribode/diagnosis/measurement.hpp"
#include "tribode/machine/machine_model.hpp"

#include <optional>
#include <vector>

namespace tribode {

// What sensor noise, rounding and force noise of a machine leave of y_measured - y, carried round the loop: the error
// of the true machine simulated without them. Found by simulating the machine with noise, a few seeds, and without.
struct NoiseFloor {
    double rms = 0;                // [m]
    std::vector<double> predictor; // a_j of e[k] = sum a_j e[k-j] + innovation, j from 1
    double innovation = 1;         // rms of the innovation [m]
    // Relative deviation of the whitened sum of squares from seed to seed, besides that of so many independent numbers:
    // of machines on which noise decides when a body lets go.
    double spread = 0;

    // Errors e in units in which those of the true machine are white with variance one.
    std::vector<double> whitened(const std::vector<double>& errors) const;
};

// Where the machine tells no noise and no rounding, the fine part of the measured positions takes their place.
// Nothing where the machine could not be simulated under the record.
std::optional<NoiseFloor> noise_floor(const MachineModel& machine, const Measurement& measurement,
                                      const RunControl& control);

} // namespace tribode
