#pragma once
#include "tribode/diagnosis/system_model.hpp"

namespace tribode {

// The model with its inner signals as outputs behind its own: differences that something depends on, as the deflection q1 - q2 of a
// coupling or the error r - q of a loop, and what several derivatives share, as the torque of that coupling or the flow from
// one tank into another. A term of such a signal acts in all equations that it is in. As outputs they stay with the model
// while terms are put into it.
SystemModel with_inner_signals(SystemModel model);

// Without them.
Equations without_inner_signals(const SystemModel& model);

} // namespace tribode
