#pragma once
#include "tribode/base/run_control.hpp"
#include "tribode/hybrid/observer.hpp"
#include "tribode/solver/integrator.hpp"

#include <functional>
#include <memory>
#include <span>
#include <vector>

namespace tribode {

// Runs a hybrid system. One order of things at one instant t, written x- before and x+ after:
//
//     1. where clocks are due, the observer sees the left limit (x-, d-)
//     2. guards that crossed zero are handled together (HybridSystem::on_crossings); then all guards are looked at again, and
//        those below zero handled, round after round, until none is (bounded: a system that never comes to rest is
//        chattering)
//     3. the clocks that are due fire in declared order; the observer sees (x+, d+) after each
//     4. step 2 again, where a sample said that x or the guards have changed
//     5. the integrator restarts if a handler said that anything it depends on has changed
//     6. integrate to the next sample instant or the end, stopping at the first guard that crosses zero
//
// An instant at which several clocks meet is one instant: clock instants that differ by rounding only (a few units in
// the last place) are the same. A guard and a sample at one time are handled in the order above.
// The output grid is read from the integrator's interpolation and never changes a step.
//
//     Simulator run(system, options);
//     RunOutcome outcome = run.advance_to(0.5);    // again and again, with growing times
//
// For one thread at a time; system and observer must outlive it. The constructor throws InputError where the method cannot
// run the system; what goes wrong in the run itself is told by the outcome.
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
    RunOutcome advance_to(double t_end) { return advance(t_end, true); }

    // The same without the clocks that are due at t_end, or within rounding of it: these fire first in the next call. So who
    // goes from instant to instant may say at each, by change(), what they are to see.
    RunOutcome advance_before(double t_end) { return advance(t_end, false); }
    // Between two calls, from outside. `body` changes the state and says what that did, as handlers of the system do.
    void change(const std::function<EventEffect(SystemState& state)>& body);

    void observe(Observer* observer) { observer_ = observer; } // not owned; null: nobody
    // Instants [s], ascending, at which the observer's output() is called.
    void set_output_grid(std::vector<double> instants);

    // For a run that goes on from the state of another one: the step that its integrator would take next [s].
    double proposed_step() const { return integrator_->proposed_step(); }
    void propose_step(double h) { integrator_->propose_step(h); }

    std::optional<double> stiff_from() const { return integrator_->stiff_from(); }

    const SystemState& state() const { return state_; }
    const EventLog& events() const { return events_; }
    RunStatistics statistics() const;

    // Chattering: this many crossings in a row, within a small part of the time since the run began, of guards that did not
    // move since their last crossing. A guard has moved if it is further above zero, in the step of its crossing, than
    // rounding and the tolerances; with a fixed step, if the crossings are more than four steps apart. So bounces that come to an
    // end (Zeno) and sliding along a surface end a run on any scale of time; a fast switch and a vibration that dies away do
    // not.
    static constexpr long chatter_limit = 500;
    static constexpr double chatter_part = 1e-2;

  private:
    struct DueClock {
        ClockId id;
        long k;
    };

    RunOutcome advance(double t_end, bool with_clocks);
    void try_instant(bool guards_fell, bool with_clocks = true);
    void handle_instant(bool guards_fell, bool with_clocks);
    bool settle_guards(std::span<const GuardId> crossed);
    bool handle_guards(std::span<const GuardId> guards);
    bool went_anywhere(GuardId guard);
    bool check_divergence();
    void begin_row();
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
    std::vector<double> instants_; // of each clock, the next one [s]
    double next_instant_ = 0;      // of a clock, once the first ones have fired [s]
    std::vector<double> guard_values_, guards_nearby_, x_nearby_;
    std::vector<Enclosure> enclosed_states_, enclosed_guards_;
    std::vector<double> output_grid_;
    std::size_t next_output_ = 0;
    SystemState output_state_;
    unsigned steps_timed_ = 0, instants_timed_ = 0; // of which every 64th is
    bool started_ = false, clocks_left_ = false;
    bool restart_needed_ = true, guards_changed_ = false;
    const double fixed_step_; // [s]; 0: none
    const long max_steps_;
    long steps_in_a_row_ = 0; // since the last output or sample, at
    double row_begin_;        // [s]
    double relative_tolerance_, absolute_tolerance_;
    double step_start_ = 0;             // of the last step [s]
    std::vector<double> last_crossing_; // of each guard [s]
    long crossings_without_motion_ = 0;
    double begin_, chatter_begin_; // of the run and of these crossings [s]
};

} // namespace tribode
