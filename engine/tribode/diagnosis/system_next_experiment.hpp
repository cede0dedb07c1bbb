#pragma once
#include "tribode/base/run_control.hpp"
#include "tribode/diagnosis/system_search.hpp"

#include <optional>
#include <string>
#include <vector>

namespace tribode {

struct SystemExperiment {
    std::string text;    // which record, and how far it separates the rivals
    SystemRecord record; // its inputs; its outputs are what the first of its rivals foretells
    double apart = 0;    // by how much the rivals differ there at least, rms, over the error that the first leaves now
};

// The record on which rivals that could not be told apart differ most from the first, whatever values the free parameters of
// the one with fewer of them take: one of a list, within the inputs already seen, simulated as all were fitted; of several rivals the one that differs least
// counts. Nothing where no record on the list tells more than the present ones. `records`: the fitted ones. `left`: error of the
// first, rms, over `scale`.
std::optional<SystemExperiment> next_system_experiment(const SystemCandidate& first,
                                                       const std::vector<SystemCandidate>& rivals,
                                                       const std::vector<SystemRecord>& records,
                                                       const std::vector<double>& scale, Interpolation between,
                                                       double left, const RunControl& control);

} // namespace tribode
