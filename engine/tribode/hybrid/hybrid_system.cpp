#include "tribode/hybrid/hybrid_system.hpp"

#include <algorithm>
#include <cassert>

namespace tribode {

bool HybridSystem::jacobian(double, std::span<const double>, const DiscreteState&, std::span<double>) const {
    return false;
}

bool HybridSystem::rates(double t, std::span<const double> x, const DiscreteState& d, std::span<double> dxdt) const {
    derivative(t, x, d, dxdt);
    return true;
}

void HybridSystem::enclose_guards(const Enclosure&, std::span<const Enclosure>, const DiscreteState&,
                                  std::span<Enclosure> g) const {
    std::fill(g.begin(), g.end(), Enclosure::unknown());
}

EventEffect HybridSystem::on_crossings(std::span<const GuardId> guards, SystemState& state, EventLog& log) const {
    EventEffect all = EventEffect::none;
    for (const GuardId guard : guards) all = std::max(all, on_crossing(guard, state, log));
    return all;
}

void HybridSystem::sparse_jacobian(double, std::span<const double>, const DiscreteState&, std::span<double>) const {
    assert(!"a system that knows the pattern of its Jacobian gives its entries");
}

} // namespace tribode
