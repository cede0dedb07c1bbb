#pragma once
#include "tribode/system/equations.hpp"

namespace tribode {

// An input as it was some time ago.
struct DelayedInput {
    Term symbol = 0;  // a variable, in the place of the delayed one
    Term input = 0;   // the symbol of the input
    Term seconds = 0; // the delay as a term of parameters
    double delay = 0; // its value, not negative [s]
};

// Takes the delays out of the equations: the time becomes an earlier time, each input a delayed one, a parameter stays, and
// delays of delays add up. `as_numbers`: with the values of the parameters put in, so that equal delays are one; else a delay
// that a parameter moves goes on moving with it.
// Throws InputError: a delay that is negative or depends on more than parameters; a delay of what depends on a state or a
// discrete variable.
std::vector<DelayedInput> take_out_delays(Equations& equations, bool as_numbers = true);

// What a function of the time alone was some time ago, where it has delays itself.
Term delayed_in_time(const Equations& equations, Term function, double delay);

} // namespace tribode
