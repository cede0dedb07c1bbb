#pragma once

namespace tribode {

// dx/dt of three coupled masses with cubic springs, 30 terms of products alone: the worst case for a tape, because
// nothing in it takes longer than reading an instruction.
void products_by_hand(const double* x, double* dxdt);

// The same masses on pendulums with smooth friction: 30 terms with eight sines, cosines and hyperbolic tangents.
void functions_by_hand(const double* x, double* dxdt);

} // namespace tribode
