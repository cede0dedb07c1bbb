#pragma once

namespace tribode {

// The rigid body in two halves with play between them. The motor acts on the motor's body; encoder, friction and all
// other forces on the driven point, which is one of the two, and the vibration modes are of that body. With d = y_motor - y_load and half a gap g/2 on each side
//
//     force on the load = max(0, c d' + k (d - g/2))     while d > g/2, likewise the other way, else 0
//
//     k = m w^2,  c = 2 zeta w m,  w = 2 pi contact_hz,  m = m_motor m_load/(m_motor + m_load)
//
// so that a contact presses and never pulls.
struct Backlash {
    double gap;             // g [m], > 0: the whole play; the bodies start in its middle
    double load_fraction;   // m_load/(m_motor + m_load), between 0 and 1
    double contact_hz;      // > 0
    double contact_zeta;    // >= 0
    bool load_side = false; // whether the driven point is the load
};

// Of the contact in one direction: pressing, or parting: still within the contact's reach, but faster than it relaxes.
enum class ContactState : signed char {
    parting_backward = -2,
    pressing_backward = -1,
    open = 0,
    pressing_forward = 1,
    parting_forward = 2
};

} // namespace tribode
