#pragma once
#include "tribode/base/json.hpp"

namespace tribode::fuzz {

// The machine of a description, for twenty samples: in open loop, and in closed loop where it has a controller. A run that
// says ok has finite numbers, and the description after a round trip is the same machine.
void run_machine(const Json& description);

} // namespace tribode::fuzz
