#pragma once
#include "tribode/design/discrete_plant.hpp"
#include "tribode/design/feedforward.hpp"

#include <vector>

namespace tribode {

// The deadbeat feedforward of the paper, section V-C. With the plant N(z)/D(z) of the model behind a hold,
//
//     r* = N(z) K(z) r,   u_ff = D(z) K(z) r,   K(z) = sum_{i<n} K_i z^-i,   N(1) K(1) = 1.
//
// r* is what u_ff makes of the model; both are finite: for a step of r, r* rests at its end from sample n - 1 + order
// on, and u_ff is zero from there on (a model with a rigid body: D(1) = 0). n follows from the duration,
// n = settling sample - order + 1.
//
// The paper asks for a smooth K and leaves open which. *Chosen*: the K of least sum of squares of the difference of order
// `smoothness` of u_ff, a least-squares problem with one linear constraint. For a step of r the first difference of u_ff
// has the coefficients of D(z) K(z). Least squares of the differences of K itself would leave corners at its ends, which
// D(z), a difference of the model's order, turns into thousands of newtons.
Feedforward deadbeat_feedforward(const ModalModel& model, const MoveTask& task, int smoothness);

// K_0 .. K_{count-1} [N/m]. Throws InputError where count is zero or N(1) is.
std::vector<double> deadbeat_taps(const DiscretePlant& plant, std::size_t count, int smoothness);

} // namespace tribode
