#pragma once
#include "tribode/system/equations.hpp"

#include <cstddef>
#include <vector>

namespace tribode {

// Gives each algebraic variable an equation in which it stands: `rate`, `equation` and `where` of the variables change
// places. That is a maximum matching of equations and variables; where it leaves some out, the system is structurally singular
// or, where an equation ties states alone, of higher index. Throws InputError, which names them.
void assign_equations(Equations& equations);

// The algebraic variables as places in equations.states, in groups to be solved one after the other: each needs only those
// before it, and its own equations are solved together. Equations must have been assigned.
std::vector<std::vector<std::size_t>> algebraic_blocks(const Equations& equations);

} // namespace tribode
