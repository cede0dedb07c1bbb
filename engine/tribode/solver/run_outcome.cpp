#include "tribode/solver/run_outcome.hpp"

#include <cmath>

namespace tribode {

std::optional<NotFinite> not_finite_in(std::span<const double> derivatives, double t) {
    for (std::size_t i = 0; i < derivatives.size(); ++i) {
        if (!std::isfinite(derivatives[i])) return NotFinite{i, t};
    }
    return std::nullopt;
}

RunStatistics& RunStatistics::operator+=(const RunStatistics& other) {
    for (const auto& [name, count] : counts) this->*count += other.*count;
    seconds_integrating += other.seconds_integrating;
    seconds_events += other.seconds_events;
    return *this;
}

} // namespace tribode
