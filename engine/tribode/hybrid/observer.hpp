#pragma once
#include "tribode/hybrid/hybrid_system.hpp"

namespace tribode {

// Looks at a run without changing it. Called by the thread of the run; what it throws ends the run and reaches the caller of
// Simulator::advance_to.
class Observer {
  public:
    virtual ~Observer() = default;

    // An instant, before anything is handled and after all is.
    virtual void before_instant(const SystemState&) {}
    virtual void after_instant(const SystemState&) {}
    // An instant at which clocks are due, before anything is handled.
    virtual void left_limit(const SystemState&) {}
    // A clock has fired; discrete values are those after it.
    virtual void sampled(ClockId, long /*k*/, const SystemState&) {}
    // An instant of the output grid: x from the integrator's dense output, left limits.
    virtual void output(const SystemState&) {}
};

} // namespace tribode
