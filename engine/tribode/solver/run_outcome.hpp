#pragma once
#include <cstddef>
#include <optional>
#include <span>
#include <string>
#include <utility>

namespace tribode {

enum class RunEnd {
    reached,
    interrupted,
    chattering,
    step_too_small,
    non_finite,
    diverged,
    stopped,
    too_many_steps,
    no_solution // of algebraic equations
};
constexpr RunEnd last_run_end = RunEnd::no_solution;

// A state whose derivative was not finite, and when.
struct NotFinite {
    std::size_t state;
    double t; // [s]
};

// The first of the derivatives at the time t that is not finite.
std::optional<NotFinite> not_finite_in(std::span<const double> derivatives, double t);

// How a run ended: a value, for what a run may legitimately meet. An empty message means success.
struct RunOutcome {
    RunEnd end = RunEnd::reached;
    double t = 0;                        // time reached [s]
    std::string message;                 // one sentence with advice
    std::optional<NotFinite> not_finite; // the last one, where it kept the run from going on

    // Stopped: by an event that ends the run.
    bool ok() const { return end == RunEnd::reached || end == RunEnd::stopped; }
};

// Counts and times of one run.
struct RunStatistics {
    long steps = 0;          // accepted internal steps
    long rejected_steps = 0; // steps tried and given up
    long derivative_evaluations = 0;
    long jacobian_evaluations = 0;
    long guard_evaluations = 0;
    long events = 0;                // zero crossings of guards
    long samples = 0;               // clock instants handled
    long restarts = 0;              // of the integrator, by events and samples
    double seconds_integrating = 0; // wall time inside the integrator, from every 64th step
    double seconds_events = 0;      // the same in events, sampled blocks, observers

    // Those that are the same in every run of the same thing, which times are not.
    static constexpr std::pair<const char*, long RunStatistics::*> counts[] = {
        {"steps", &RunStatistics::steps},
        {"rejected_steps", &RunStatistics::rejected_steps},
        {"derivative_evaluations", &RunStatistics::derivative_evaluations},
        {"jacobian_evaluations", &RunStatistics::jacobian_evaluations},
        {"guard_evaluations", &RunStatistics::guard_evaluations},
        {"events", &RunStatistics::events},
        {"samples", &RunStatistics::samples},
        {"restarts", &RunStatistics::restarts}};

    RunStatistics& operator+=(const RunStatistics& other);
};

} // namespace tribode
