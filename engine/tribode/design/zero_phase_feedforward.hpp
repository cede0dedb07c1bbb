#pragma once
#include "tribode/design/feedforward.hpp"

namespace tribode {

// Zero phase error tracking [Tomizuka 1987]. N(z) = z^-1 Bc(z^-1) Bu(z^-1), Bc with the zeros that may be cancelled; with
// p zeros in Bu and a demanded path r_d,
//
//     u_ff[k] = D(z^-1) Bu(z) / (Bc(z^-1) Bu(1)^2) r_d[k+1],   r* = Bu(z) Bu(z^-1) / Bu(1)^2 r_d.
//
// r* has the phase of r_d at every frequency; r_d is a fourth-order S-curve, p samples later and 2 p samples shorter than
// the task, so that nothing happens before k = 0 and r* ends in time. Not cancelled: zeros on or outside the unit circle,
// and zeros near z = -1 (absolute value above 0.8, negative real part), *chosen*: their inverse would ring from sample
// to sample, as the one does that a hold gives to every plant of this kind. The inverse of anti-resonances rings on after
// the move, at rest of the position.
Feedforward zero_phase_feedforward(const ModalModel& model, const MoveTask& task);

} // namespace tribode
