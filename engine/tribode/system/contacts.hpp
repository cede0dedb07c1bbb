#pragma once
#include "tribode/system/equations.hpp"

namespace tribode {

// Puts in the rates of change that the equations speak of, and the forces of all contacts, and adds their events; then the
// equations have no contacts any more. What moves by a function of time or by samples must have been put in the place of inputs:
// those that are left do not move, but by jumps.
//
// Throws InputError where a force does not act on its velocity, or with the wrong sign, where the equations are not linear in
// it, and where a rate of change is that of an algebraic variable or needs itself.
void close_contacts(Equations& equations);

} // namespace tribode
