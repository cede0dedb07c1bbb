#pragma once
#include "tribode/solver/integrator.hpp"

#include <vector>

namespace tribode {

// A method for readers.
struct MethodEntry {
    Method method;
    const char* what;
    const char* suited_to;
};

// All methods, in the order of Method. The table of docs/hybrid-simulation.md says the same at more length.
const std::vector<MethodEntry>& method_list();

} // namespace tribode
