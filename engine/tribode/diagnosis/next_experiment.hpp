#pragma once
#include "tribode/base/run_control.hpp"
#include "tribode/experiment/simulation.hpp"

#include <optional>
#include <string>

namespace tribode {

struct Diagnosis;

struct NextExperiment {
    std::string text; // which record, and how far it separates the rivals; or that none does
    DriveRecord
        drive; // what drives the machine there, without a measured position; empty where no record separates them
};

// The record on which rivals that could not be told apart differ most, simulated as they were fitted: one of a list, within
// the stroke, speed and thrust already seen. `machine`: as it was searched, of which the rivals' fields are so many deviations off.
// Nothing where there is nothing to decide.
std::optional<NextExperiment> next_experiment(const MachineModel& machine, const Diagnosis& diagnosis,
                                              const RunControl& control);

} // namespace tribode
