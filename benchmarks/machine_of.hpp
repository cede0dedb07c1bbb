#pragma once
#include "scenario.hpp"
#include "tribode/machine/machine_model.hpp"

namespace tribode::bench {

MachineModel machine_of(const Scenario& scenario);

} // namespace tribode::bench
