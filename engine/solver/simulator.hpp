#pragma once
#include "base/run_control.hpp"
#include "hybrid/observer.hpp"
#include "solver/integrator.hpp"

#include <memory>
#include <span>
#include <vector>

namespace tribode {

// Runs a hybrid system. One order of things at one instant t, written x- before and x+ after:
//
//     1. where clocks are due, the observer sees the left limit (x-, d-)
//     2. where guards fell they are handled in declared order; then all guards are looked at again, and those below
//        zero handled, round after round, until none is (bounded: a system that never comes to rest is chattering)
//     3. the clocks that are due fire in declared order; the observer sees (x+, d+) after each
//     4. step 2 again, where a sample said that x or the guards have changed
//     5. the integrator restarts if a handler said that anything it depends on has changed
//     6. integrate to the next sample instant or the end, stopping at the first guard that falls
//
// An instant at which several clocks meet is one instant: clock instants that differ by rounding only (a few units in
// the last place) are the same. A guard and a sample at one time are handled in the order above.
// The output grid is read from the integrator's interpolation and never changes a step.
//
//     Simulator run(system, options);
//     RunOutcome outcome = run.advance_to(0.5);    // again and again, with growing times
class Simulator {
  public:
    Simulator(const HybridSystem& system, const SolverOptions& options, const RunControl& control = {});
    Simulator(const HybridSystem& system, const SolverOptions& options, SystemState start,
              const RunControl& control = {});

    Simulator(const Simulator&) = delete; // the integrator points into the state
    Simulator& operator=(const Simulator&) = delete;

    // Integrates to t_end [s] and handles everything due up to and including it. Stopping there and going on leaves
    // the numbers as they would have been where t_end is a sample instant.
    // Once it has failed, the run stays where it is and every further call returns the same outcome.
    RunOutcome advance_to(double t_end);

    void observe(Observer* observer) { observer_ = observer; } // not owned; null: nobody
    // Instants [s], ascending, at which the observer's output() is called.
    void set_output_grid(std::vector<double> instants);

    const SystemState& state() const { return state_; }
    const EventLog& events() const { return events_; }
    RunStatistics statistics() const;

    // Chattering: more than this many falls of guards within the window.
    static constexpr long chatter_limit = 5000;
    static constexpr double chatter_window = 1e-3; // [s]

  private:
    struct DueClock {
        ClockId id;
        long k;
    };

    void handle_instant(bool guards_fell);
    bool settle_guards(std::span<const GuardId> fallen);
    bool handle_guard(GuardId guard);
    void collect_due_clocks();
    void emit_outputs(double up_to);
    void fail(RunEnd end, std::string message);

    const HybridSystem& system_;
    const std::vector<SampleClock>& clocks_;
    RunControl control_;
    SystemState state_;
    std::unique_ptr<Integrator> integrator_;
    Observer* observer_ = nullptr;
    EventLog events_;
    RunStatistics statistics_;
    RunOutcome outcome_;
    std::vector<DueClock> due_;
    double next_instant_ = 0; // of a clock, once the first ones have fired [s]
    std::vector<double> guard_values_;
    std::vector<double> output_grid_;
    std::size_t next_output_ = 0;
    SystemState output_state_;
    unsigned steps_timed_ = 0, instants_timed_ = 0; // of which every 64th is
    bool started_ = false;
    bool restart_needed_ = true;
    double chatter_start_ = 0; // begin of the present window [s]
    long chatter_count_ = 0;
};

} // namespace tribode
