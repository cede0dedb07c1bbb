#pragma once
#include "tribode/base/run_control.hpp"

#include <optional>
#include <string>

namespace tribode {

struct Diagnosis;

// The record on which rivals that could not be told apart differ most, simulated as they were fitted: one of a list, within
// the stroke, speed and thrust already seen. Nothing where there is nothing to decide.
std::optional<std::string> next_experiment(const Diagnosis& diagnosis, const RunControl& control);

} // namespace tribode
