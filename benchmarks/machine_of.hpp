#pragma once
#include "machine/machine_model.hpp"
#include "scenario.hpp"

namespace tribode::bench {

MachineModel machine_of(const Scenario& scenario);

} // namespace tribode::bench
