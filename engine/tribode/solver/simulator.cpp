#include "tribode/solver/simulator.hpp"
#include "tribode/base/error.hpp"

#include <algorithm>
#include <chrono>
#include <cmath>
#include <fmt/format.h>
#include <limits>

namespace tribode {

namespace {

// Adds the wall time of its life to a sum. Reading the clock costs as much as a short step, so only every 64th one of
// each kind is timed, and counts for all.
class Stopwatch {
  public:
    Stopwatch(double& seconds, unsigned& turn) : seconds_(seconds), on_(turn++ % every == 0) {
        if (on_) start_ = std::chrono::steady_clock::now();
    }
    ~Stopwatch() {
        if (!on_) return;
        seconds_ += every * std::chrono::duration<double>(std::chrono::steady_clock::now() - start_).count();
    }
    Stopwatch(const Stopwatch&) = delete;
    Stopwatch& operator=(const Stopwatch&) = delete;

  private:
    static constexpr unsigned every = 64;
    double& seconds_;
    const bool on_;
    std::chrono::steady_clock::time_point start_;
};

// Times nearer than rounding are one instant.
constexpr double rounding_of_time = 4 * std::numeric_limits<double>::epsilon(); // relative

bool same_instant(double a, double b) {
    return std::abs(a - b) <= rounding_of_time * std::max(std::abs(a), std::abs(b));
}

} // namespace

Simulator::Simulator(const HybridSystem& system, const SolverOptions& options, const RunControl& control)
    : Simulator(system, options, system.initial_state(), control) {}

Simulator::Simulator(const HybridSystem& system, const SolverOptions& options, SystemState start,
                     const RunControl& control)
    : system_(system),
      clocks_(system.clocks()),
      control_(control),
      state_(std::move(start)),
      integrator_(make_integrator(system, options)),
      guard_values_(system.guard_count()),
      guards_nearby_(system.guard_count()),
      x_nearby_(state_.x.size()),
      output_state_(state_),
      fixed_step_(has_fixed_step(options.method) ? options.fixed_step : 0),
      max_steps_(options.max_steps),
      row_begin_(state_.t),
      relative_tolerance_(options.relative_tolerance),
      absolute_tolerance_(options.absolute_tolerance),
      last_crossing_(system.guard_count(), -std::numeric_limits<double>::infinity()),
      begin_(state_.t),
      chatter_begin_(state_.t) {
    if (resolved(options.method, system) == Method::exact) { // it has rounding only
        relative_tolerance_ = 16 * std::numeric_limits<double>::epsilon();
        absolute_tolerance_ = 0;
    }
    if (state_.next_sample.empty()) { // else it is a snapshot of another run
        for (const auto& clock : clocks_) {
            long k = static_cast<long>(std::ceil((state_.t - clock.offset) / clock.period));
            k = std::max(k - 1, 0L);
            while (clock.instant(k) < state_.t && !same_instant(clock.instant(k), state_.t)) ++k;
            state_.next_sample.push_back(k);
        }
    }
    for (ClockId id = 0; id < clocks_.size(); ++id) instants_.push_back(clocks_[id].instant(state_.next_sample[id]));
}

void Simulator::set_output_grid(std::vector<double> instants) {
    output_grid_ = std::move(instants);
    next_output_ = static_cast<std::size_t>(std::lower_bound(output_grid_.begin(), output_grid_.end(), state_.t) -
                                            output_grid_.begin());
}

RunStatistics Simulator::statistics() const {
    RunStatistics all = statistics_;
    all += integrator_->statistics();
    return all;
}

void Simulator::fail(RunEnd end, std::string message) { outcome_ = RunOutcome{end, state_.t, std::move(message)}; }

RunOutcome Simulator::advance(double t_end, bool with_clocks) {
    if (outcome_.end != RunEnd::reached) return outcome_;
    if (!started_) {
        started_ = true;
        if (!output_grid_.empty()) emit_outputs(state_.t);
        try_instant(true);
    } else if (clocks_left_) {
        clocks_left_ = false;
        try_instant(false);
    }
    // An instant of a clock that rounding has put just before the end is the end.
    if (!with_clocks && same_instant(next_instant_, t_end)) t_end = next_instant_;
    long steps_to_look = 0;
    while (outcome_.end == RunEnd::reached && state_.t < t_end) {
        if (control_.stop_requested()) {
            fail(RunEnd::interrupted, fmt::format("interrupted at t = {:.6g} s", state_.t));
            break;
        }
        if (steps_to_look-- == 0) {
            if (!check_divergence()) break;
            if (control_.is_late()) {
                fail(RunEnd::interrupted, fmt::format("out of time at t = {:.6g} s", state_.t));
                break;
            }
            steps_to_look = 100;
        }
        if (++steps_in_a_row_ > max_steps_) {
            fail(RunEnd::too_many_steps,
                 fmt::format("{} steps from t = {:.9g} s have come to t = {:.9g} s only; the problem may be stiff for "
                             "this solver, or the tolerances too tight; max_steps allows more",
                             max_steps_, row_begin_, state_.t));
            break;
        }
        const double t_stop = std::min(next_instant_, t_end);

        // A guard crossed within rounding of the next instant: there is nothing to integrate, and the integrator would
        // refuse so short a step.
        auto progress = Integrator::Progress::stopped;
        step_start_ = state_.t;
        if (same_instant(state_.t, t_stop)) {
            state_.t = t_stop;
            restart_needed_ = true;
        } else {
            const Stopwatch watch(statistics_.seconds_integrating, steps_timed_);
            if (restart_needed_) {
                integrator_->restart(state_);
                ++statistics_.restarts;
                restart_needed_ = false;
            } else if (guards_changed_) {
                integrator_->change_guards(state_);
            }
            guards_changed_ = false;
            progress = integrator_->step(t_stop);
        }
        if (progress == Integrator::Progress::failed) {
            const RunOutcome& failure = integrator_->failure();
            fail(failure.end, failure.message);
            outcome_.not_finite = failure.not_finite;
            break;
        }
        if (next_output_ < output_grid_.size()) emit_outputs(state_.t);
        if (progress != Integrator::Progress::stepped) {
            clocks_left_ = !with_clocks && same_instant(state_.t, t_end);
            if (clocks_left_ && state_.t != t_end) {
                state_.t = t_end;
                restart_needed_ = true;
            }
            try_instant(progress == Integrator::Progress::crossing, !clocks_left_);
        }
    }
    if (outcome_.end == RunEnd::reached && check_divergence()) outcome_.t = state_.t;
    return outcome_;
}

// A solution that grows without bound stays finite for long, and means nothing.
bool Simulator::check_divergence() {
    const auto& states = system_.states();
    for (std::size_t i = 0; i < states.size(); ++i) {
        if (std::abs(state_.x[i]) <= states[i].limit) continue;
        fail(RunEnd::diverged,
             fmt::format("the solution diverges: {} = {:.3g}{}{} at t = {:.9g} s; the loop or the model is unstable{}",
                         states[i].name, state_.x[i], states[i].unit.empty() ? "" : " ", states[i].unit, state_.t,
                         fixed_step_ > 0 ? fmt::format(", or the fixed step of {:g} s too long", fixed_step_) : ""));
        return false;
    }
    return true;
}

void Simulator::change(const std::function<EventEffect(SystemState& state)>& body) {
    try {
        const EventEffect effect = body(state_);
        restart_needed_ = restart_needed_ || effect > EventEffect::guards;
        guards_changed_ = guards_changed_ || effect == EventEffect::guards;
        if (effect == EventEffect::restart) settle_guards({});
    } catch (const NoSolution& problem) {
        fail(RunEnd::no_solution, problem.what());
    }
    if (outcome_.ok() && system_.ends_run(state_)) fail(RunEnd::stopped, "");
}

void Simulator::try_instant(bool guards_fell, bool with_clocks) {
    try {
        handle_instant(guards_fell, with_clocks);
    } catch (const NoSolution& problem) {
        fail(RunEnd::no_solution, problem.what());
    }
}

// Steps 1 to 4 of the class comment.
void Simulator::handle_instant(bool guards_fell, bool with_clocks) {
    const Stopwatch watch(statistics_.seconds_events, instants_timed_);
    if (observer_) observer_->before_instant(state_);
    due_.clear();
    if (with_clocks) collect_due_clocks();
    if (observer_ && !due_.empty()) observer_->left_limit(state_);

    const bool ok = !guards_fell || settle_guards(integrator_->crossed());
    bool guards_changed = false;
    for (const auto& [id, k] : due_) {
        const EventEffect effect = system_.on_sample(id, k, state_);
        restart_needed_ = restart_needed_ || effect != EventEffect::none;
        guards_changed = guards_changed || effect == EventEffect::restart;
        ++statistics_.samples;
        if (observer_) observer_->sampled(id, k, state_);
    }
    if (ok && guards_changed) settle_guards({});
    if (observer_) observer_->after_instant(state_);
    if (outcome_.ok() && system_.ends_run(state_)) fail(RunEnd::stopped, "");
}

// Handles the guards that crossed, then all that are below zero, until none is.
bool Simulator::settle_guards(std::span<const GuardId> crossed) {
    if (!crossed.empty() && !handle_guards(crossed)) return false;
    const std::size_t max_rounds = 10 + 2 * system_.guard_count();
    for (std::size_t round = 0; round < max_rounds; ++round) {
        system_.guards(state_.t, state_.x, *state_.discrete, guard_values_);
        ++statistics_.guard_evaluations;
        bool calm = true;
        for (GuardId guard = 0; guard < guard_values_.size(); ++guard) {
            if (guard_values_[guard] >= 0) continue;
            calm = false;
            if (!handle_guards(std::span(&guard, 1))) return false;
            system_.guards(state_.t, state_.x, *state_.discrete, guard_values_);
            ++statistics_.guard_evaluations;
        }
        if (calm) return true;
    }
    // Where a condition loses its value, the right side may have lost it with it, and says more.
    system_.derivative(state_.t, state_.x, *state_.discrete, x_nearby_);
    if (const auto not_finite = not_finite_in(x_nearby_, state_.t)) {
        fail(RunEnd::non_finite, fmt::format("the derivative is not finite at t = {:.9g} s", state_.t));
        outcome_.not_finite = not_finite;
        return false;
    }
    const auto worst = std::min_element(guard_values_.begin(), guard_values_.end()) - guard_values_.begin();
    fail(RunEnd::chattering,
         fmt::format("{} does not come to rest at t = {:.9g} s: after {} rounds it still asks for an event",
                     system_.guard_name(static_cast<GuardId>(worst), state_), state_.t, max_rounds));
    return false;
}

// Whether the guard, which crosses now, was above zero by more than rounding and the tolerances since its last crossing.
bool Simulator::went_anywhere(GuardId guard) {
    const double before = last_crossing_[guard];
    constexpr double resolved = 4; // fixed steps: fewer show nothing of what a guard does
    if (fixed_step_ > 0) return state_.t - before > resolved * fixed_step_;
    if (!std::isfinite(before)) return false;                                // its first one
    if (state_.t - before > chatter_part * (state_.t - begin_)) return true; // too seldom to be chattering
    // Each instant is known to a few roundings of the time, and sliding goes from one to the next.
    constexpr double roundings = 64;
    if (state_.t - before <= roundings * std::numeric_limits<double>::epsilon() * std::abs(state_.t)) return false;
    const auto is_away_at = [&](double t) {
        integrator_->interpolate(t, x_nearby_);
        system_.guards(t, x_nearby_, *state_.discrete, guards_nearby_);
        statistics_.guard_evaluations += 2; // this one, and one nearby
        const double height = guards_nearby_[guard];
        const auto& states = system_.states();
        const auto tolerance = [&](std::size_t i) {
            return relative_tolerance_ * std::abs(x_nearby_[i]) + absolute_tolerance_ * states[i].scale;
        };
        if (system_.encloses_guards()) { // the tolerances of two states do not cancel in their difference
            enclosed_states_.resize(states.size());
            enclosed_guards_.resize(guards_nearby_.size());
            for (std::size_t i = 0; i < states.size(); ++i) {
                const double x = x_nearby_[i];
                enclosed_states_[i] = {{x - tolerance(i), x + tolerance(i)}, {0, 0}};
            }
            system_.enclose_guards(Enclosure::constant(t), enclosed_states_, *state_.discrete, enclosed_guards_);
            const Interval& value = enclosed_guards_[guard].value;
            if (std::isfinite(value.high - value.low)) return !value.contains(0);
        }
        for (std::size_t i = 0; i < x_nearby_.size(); ++i) x_nearby_[i] += tolerance(i);
        system_.guards(t, x_nearby_, *state_.discrete, guards_nearby_);
        return std::abs(height) > std::abs(guards_nearby_[guard] - height);
    };
    // In the last step, which is enough for what crosses again and again.
    const double from = std::max(before, step_start_);
    return is_away_at(0.5 * (from + state_.t)) || (before < step_start_ && is_away_at(from));
}

bool Simulator::handle_guards(std::span<const GuardId> guards) {
    bool any_went = false;
    for (const GuardId guard : guards) {
        ++statistics_.events;
        any_went = went_anywhere(guard) || any_went;
        last_crossing_[guard] = state_.t;
    }
    if (any_went) crossings_without_motion_ = 0;
    if (crossings_without_motion_++ == 0) chatter_begin_ = state_.t;
    if (crossings_without_motion_ > chatter_limit && fixed_step_ == 0 &&
        state_.t - chatter_begin_ > chatter_part * (state_.t - begin_)) {
        crossings_without_motion_ = 0;
    }
    if (crossings_without_motion_ > chatter_limit) {
        fail(RunEnd::chattering,
             fmt::format(
                 "{} is chattering at t = {:.9g} s: {} events in a row between which it moves by less than the "
                 "tolerances; give what slides or rests there a mode of its own, or check its stiffness and level",
                 system_.guard_name(guards.front(), state_), state_.t, chatter_limit));
        return false;
    }
    const EventEffect effect = system_.on_crossings(guards, state_, events_);
    guards_changed_ = guards_changed_ || effect == EventEffect::guards;
    restart_needed_ = restart_needed_ || effect > EventEffect::guards;
    return true;
}

void Simulator::begin_row() {
    steps_in_a_row_ = 0;
    row_begin_ = state_.t;
}

// Those due at this instant take their next one.
void Simulator::collect_due_clocks() {
    const auto is_due = [&](double instant) { return instant <= state_.t || same_instant(instant, state_.t); };
    due_.clear();
    if (!is_due(next_instant_)) return;
    begin_row();
    next_instant_ = std::numeric_limits<double>::infinity();
    for (ClockId id = 0; id < instants_.size(); ++id) {
        double& next = instants_[id];
        if (is_due(next)) {
            long& k = state_.next_sample[id];
            due_.push_back({id, k});
            next = clocks_[id].instant(++k);
        }
        next_instant_ = std::min(next_instant_, next);
    }
}

// A row that rounding alone puts behind an instant is of that instant, and so a left limit.
void Simulator::emit_outputs(double up_to) {
    const double limit = up_to + rounding_of_time * std::abs(up_to);
    if (next_output_ < output_grid_.size() && output_grid_[next_output_] <= limit) begin_row();
    while (next_output_ < output_grid_.size() && output_grid_[next_output_] <= limit) {
        const double t = output_grid_[next_output_++];
        if (!observer_) continue;
        output_state_ = state_;
        output_state_.t = t;
        if (t < state_.t) integrator_->interpolate(t, output_state_.x);
        observer_->output(output_state_);
    }
}

} // namespace tribode
