#pragma once
#include <string_view>

namespace tribode {

// The shared library of functional mock-up units, the same for all of them: it reads resources/model.json.
std::string_view fmu_shared_library();

} // namespace tribode
