#pragma once
#include <Eigen/Dense>
#include <vector>

namespace tribode::problems {

using Real = long double;
using RealMatrix = Eigen::Matrix<Real, Eigen::Dynamic, Eigen::Dynamic>;
using RealVector = Eigen::Matrix<Real, Eigen::Dynamic, 1>;

// The exact flow of x' = A x over the steps tick * 2^k, k = 0 .. levels-1: any time that is a whole number of
// ticks is reached by a few of them, and an event is bracketed by descending the ladder one rung at a time.
//
// A rung holds E_k = exp(A tick 2^k) - I. The lowest one is the series M + M^2/2 with M = A tick, the others
// follow from exp(2B) - I = 2 E + E^2, which loses nothing although exp(B) itself is close to the identity.
// The terms left out below amount to (|A| tick)^2 of a rung: `tick` must be shorter than the time constants
// by a factor of 1e10 or more.
class ExponentialLadder {
  public:
    ExponentialLadder(const RealMatrix& rates, Real tick, int levels);

    // The state after tick * 2^level.
    RealVector step(const RealVector& state, int level) const { return state + rungs_[level] * state; }

  private:
    std::vector<RealMatrix> rungs_;
};

} // namespace tribode::problems
