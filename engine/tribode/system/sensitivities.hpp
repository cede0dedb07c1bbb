#pragma once
#include "tribode/system/equations.hpp"

#include <string>
#include <vector>

namespace tribode {

// The equations with their variational equations: behind the states, discrete variables and outputs their derivatives by each
// of `names`, which are parameters or start values ("STATE.start"). For x' = f, s = dx/dp obeys s' = f_x s + f_d d_p + f_p;
// what a `when` or a clock sets is differentiated as it is set, where `instant` says how the time of the event moves. The
// jumps at events are those of EquationSystem. A function that jumps and is no event, such as floor in what a clock sets, has
// the derivative zero.
// Delays must have been taken out. Throws InputError where a name is unknown or stands twice, and where the equations hold
// what has no derivative: a function from outside that reads what depends on them, a jump below no_event.
Equations with_sensitivities(Equations equations, const std::vector<std::string>& names);

// Throws InputError where a delay depends on one of the parameters: a run has no derivative by it.
void check_delays(const Equations& equations, const std::vector<std::string>& names);

} // namespace tribode
