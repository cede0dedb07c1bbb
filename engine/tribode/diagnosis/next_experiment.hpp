#pragma once
#include "tribode/base/run_control.hpp"

#include <optional>
#include <string>

namespace tribode {

struct Diagnosis;

// Where names could not be told apart: of a menu of records within the stroke, speed and thrust already seen, the one on
// which the rivals, simulated as they were fitted, differ most. Nothing where there is nothing to decide.
std::optional<std::string> next_experiment(const Diagnosis& diagnosis, const RunControl& control);

} // namespace tribode
