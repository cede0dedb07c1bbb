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

void HybridSystem::linear_part(std::span<double>) const {}

std::optional<std::string> HybridSystem::why_not_affine() const {
    return "its equations are not known to be affine between events";
}

void HybridSystem::affine_derivative(int, double, double, std::span<const double>, const DiscreteState&,
                                     std::span<double>) const {
    assert(!"a system that is affine says how");
}

void HybridSystem::affine_guards(int, double, double, std::span<const double>, const DiscreteState&,
                                 std::span<double>) const {
    assert(!"a system that is affine says how");
}

std::optional<AffinePattern> HybridSystem::affine_pattern(const DiscreteState&) const { return std::nullopt; }

std::optional<std::string> HybridSystem::why_not_nearly_affine() const {
    return "its equations are not known to be nearly affine between events";
}

std::size_t HybridSystem::forcing_count() const { return 0; }

void HybridSystem::forcing(double, std::span<const double>, const DiscreteState&, std::span<double>) const {}

void HybridSystem::forcing_columns(const DiscreteState&, std::span<double>, std::span<double>) const {}

AffinePattern HybridSystem::forced_pattern(const DiscreteState&) const {
    assert(!"a system that is nearly affine says how");
    return {};
}

} // namespace tribode
