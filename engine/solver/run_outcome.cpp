#include "solver/run_outcome.hpp"

#include <cmath>

namespace tribode {

std::optional<NotFinite> not_finite_in(std::span<const double> derivatives, double t) {
    for (std::size_t i = 0; i < derivatives.size(); ++i) {
        if (!std::isfinite(derivatives[i])) return NotFinite{i, t};
    }
    return std::nullopt;
}

RunStatistics& RunStatistics::operator+=(const RunStatistics& other) {
    steps += other.steps;
    rejected_steps += other.rejected_steps;
    derivative_evaluations += other.derivative_evaluations;
    jacobian_evaluations += other.jacobian_evaluations;
    guard_evaluations += other.guard_evaluations;
    events += other.events;
    samples += other.samples;
    restarts += other.restarts;
    seconds_integrating += other.seconds_integrating;
    seconds_events += other.seconds_events;
    return *this;
}

} // namespace tribode
