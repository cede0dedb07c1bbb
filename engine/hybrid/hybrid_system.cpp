#include "hybrid/hybrid_system.hpp"

namespace tribode {

bool HybridSystem::jacobian(double, std::span<const double>, const DiscreteState&, std::span<double>) const {
    return false;
}

} // namespace tribode
