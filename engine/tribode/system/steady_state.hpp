#pragma once
#include "tribode/system/equations.hpp"
#include "tribode/system/linearization.hpp"

#include <string>
#include <vector>

namespace tribode {

// A point at which all derivatives are zero.
struct SteadyState {
    std::vector<double> values; // of the free variables
    double residual = 0;        // the greatest derivative over the nominal value of its state [1/s]
    int iterations = 0;
    std::vector<std::string> conditions; // names of the `when`s that hold there
};

// Looks for it by Newton's method on the exact Jacobian, with steps shortened (Levenberg-Marquardt) as long as the
// derivatives do not fall. It begins at `point` and at the values of inputs and parameters. `free`: states, inputs and
// parameters, at most as many as there are states; all else stays as it is, discrete variables and modes too.
// Throws InputError: there is no steady state near, and which derivative remains most; a free variable on which nothing
// depends there, so that it may be anything; a `when` whose condition holds there and not at the start, so that the event
// would have changed the system on the way.
SteadyState find_steady_state(const Equations& equations, const OperatingPoint& point, const std::vector<Term>& free);

} // namespace tribode
