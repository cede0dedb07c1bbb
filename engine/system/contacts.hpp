#pragma once
#include "system/equations.hpp"

namespace tribode {

// A force that nature chooses: dry friction, which holds a velocity at zero as long as that takes no more than a level, or a
// contact that lets a gap not close. The rates of change depend on the force, which is a variable that stands in them.
//
// In stick, and at rest, the force is what keeps the velocity at zero: the solution of a linear equation, of as many as there
// are such forces. So they may act on one another, in any number. The laws:
//
//     friction   mode 0 stick, 1 forward, 2 backward: force = +-level in slip; beyond +-release stick ends
//     impact     mode 0 free, 1 rest: force = 0 in the air; where the gap closes, its rate of change v becomes -e v by an
//                impulse. Where e |v| is below rest_speed, and the gap would close again, it rests, until it takes a pull
struct Contact {
    enum class Law { friction, impact };
    Law law = Law::friction;
    std::string name;         // of the part
    Term force = 0, mode = 0; // variables
    Term quantity = 0;        // the velocity of friction, the gap of an impact
    Term level = 0;           // of friction, in slip; may depend on the forces of others
    Term release = 0;         // of friction
    Term restitution = 0;     // of an impact
    std::optional<Term> rest_speed;
};

// How a term changes by time, along the equations.
Term rate_of(const Equations& equations, Term term);

// Puts the forces into the equations and adds the events; returns what stands for each force now. Throws InputError where a force does not act on its velocity, or with
// the wrong sign, where the equations are not linear in it, and where two hold the same motion.
Expressions::Replacement close_contacts(Equations& equations, const std::vector<Contact>& contacts);

} // namespace tribode
