#include "solver/run_outcome.hpp"

namespace tribode {

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
