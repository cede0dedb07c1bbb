#pragma once
#include "tribode/system/equations.hpp"

namespace tribode {

// How a term changes by time, along the equations. Throws InputError where it depends on an algebraic variable.
Term rate_of(const Equations& equations, Term term);

// Puts the forces of all contacts into the equations, and adds their events; then the equations have no contacts any more.
// Throws InputError where a force does not act on its velocity, or with the wrong sign, and where the equations are not linear in
// it.
void close_contacts(Equations& equations);

} // namespace tribode
