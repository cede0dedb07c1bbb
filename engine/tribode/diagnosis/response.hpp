#pragma once
#include "tribode/diagnosis/measurement.hpp"
#include "tribode/machine/machine_model.hpp"

#include <cstdint>
#include <optional>
#include <vector>

namespace tribode {

// The positions y[k] that the machine gives under the record's reference and excitation, or u: a run of its own, which
// the measured y does not touch. Without noise and rounding, unless a seed is given. Nothing where the run did not come
// to its end or the positions run away, as an unstable loop's do.
std::optional<std::vector<double>> simulated_position(const MachineModel& machine, const Measurement& measurement,
                                                      std::optional<std::uint64_t> noise_seed = std::nullopt);

struct SimulatedSignals {
    std::vector<double> position; // y[k] [m]
    std::vector<double> thrust;   // u[k] [N]
};
std::optional<SimulatedSignals> simulated_signals(const MachineModel& machine, const Measurement& measurement,
                                                  std::optional<std::uint64_t> noise_seed = std::nullopt);

} // namespace tribode
