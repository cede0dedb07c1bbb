#include "problems/exponential_ladder.hpp"

namespace tribode::problems {

ExponentialLadder::ExponentialLadder(const RealMatrix& rates, Real tick, int levels) {
    const RealMatrix increment = rates * tick;
    rungs_.reserve(levels);
    rungs_.push_back(increment + increment * increment / 2);
    while (static_cast<int>(rungs_.size()) < levels) {
        const RealMatrix& below = rungs_.back();
        rungs_.push_back(2 * below + below * below);
    }
}

} // namespace tribode::problems
