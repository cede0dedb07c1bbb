// Looking at a run, stopping it, copying its state: none of it shows in the numbers.
#include "function_system.hpp"
#include "tribode/solver/simulator.hpp"

#include <cmath>
#include <gtest/gtest.h>

namespace tribode {
namespace {

class RunContinuity : public testing::TestWithParam<Method> {};
INSTANTIATE_TEST_SUITE_P(Methods, RunContinuity,
                         testing::Values(Method::erk, Method::adams, Method::bdf, Method::ida, Method::fixed),
                         method_of);

// A held force on an oscillator that bounces off walls at +-1: events, samples and smooth motion in one.
FunctionSystem sampled_oscillator(double idle_offset = 0.01) {
    FunctionSystem system = oscillator();
    system.start = {0.5, 0.0};
    system.start_memory = {0.0, 0.0};
    system.sample_clocks = {{"hold", 0.1, 0.0}, {"idle", 0.03, idle_offset}};
    system.slope = [](double t, auto x, auto& d, auto dxdt) {
        dxdt[0] = x[1];
        dxdt[1] = -x[0] + d[0] + 0.1 * std::sin(7 * t);
    };
    system.guard = {[](double, auto x, auto&) { return 1 - x[0]; }, [](double, auto x, auto&) { return 1 + x[0]; }};
    system.crossing = [](GuardId id, double, auto& x, auto&) {
        x = {id == 0 ? 1.0 : -1.0, -0.9 * x[1]};
        return EventEffect::restart;
    };
    system.sample = [](ClockId id, long, double, auto& x, auto& d) {
        if (id == 1) return EventEffect::none;
        d[0] = 0.8 * x[1]; // drives the oscillation up against the walls
        d[1] += 1;
        return EventEffect::restart;
    };
    return system;
}

struct Result {
    std::vector<double> x, memory, event_times;
    long steps, rejected;
    std::vector<double> output;
};

class Outputs final : public Observer {
  public:
    void output(const SystemState& s) override {
        t.push_back(s.t);
        x.push_back(s.x[0]);
    }
    std::vector<double> t, x;
};

Result result_of(Simulator& run, const Outputs& seen = {}) {
    Result result{run.state().x,          FunctionSystem::memory(run.state()), {},
                  run.statistics().steps, run.statistics().rejected_steps,     seen.x};
    for (const auto& event : run.events()) result.event_times.push_back(event.t);
    return result;
}

Result run_with_outputs(Method method, std::size_t count) {
    const FunctionSystem system = sampled_oscillator();
    Simulator run(system, tight(method));
    Outputs seen;
    std::vector<double> grid;
    for (std::size_t i = 0; i < count; ++i) grid.push_back(10.0 * static_cast<double>(i) / static_cast<double>(count));
    run.observe(&seen);
    run.set_output_grid(grid);
    EXPECT_TRUE(run.advance_to(10.0).ok());
    EXPECT_EQ(seen.t, grid);
    return result_of(run, seen);
}

TEST_P(RunContinuity, the_output_grid_changes_no_bit_of_states_events_and_steps) {
    const Result none = run_with_outputs(GetParam(), 0);
    EXPECT_GT(none.event_times.size(), 2u);
    for (const std::size_t count : {10u, 1000u, 100000u}) {
        const Result with = run_with_outputs(GetParam(), count);
        EXPECT_EQ(with.x, none.x) << count;
        EXPECT_EQ(with.memory, none.memory) << count;
        EXPECT_EQ(with.event_times, none.event_times) << count;
        EXPECT_EQ(with.steps, none.steps) << count;
        EXPECT_EQ(with.rejected, none.rejected) << count;
    }
}

TEST_P(RunContinuity, the_output_at_an_instant_does_not_depend_on_the_rest_of_the_grid) {
    const Result coarse = run_with_outputs(GetParam(), 10), fine = run_with_outputs(GetParam(), 100000);
    for (std::size_t i = 0; i < 10; ++i) EXPECT_EQ(coarse.output[i], fine.output[i * 10000]) << i;
}

TEST_P(RunContinuity, outputs_between_the_steps_are_accurate) {
    const FunctionSystem system = oscillator();
    SolverOptions options = tight(GetParam());
    options.relative_tolerance = 1e-8;
    options.absolute_tolerance = 1e-10;
    options.fixed_step = 1e-2;
    Simulator run(system, options);
    Outputs seen;
    std::vector<double> grid;
    for (int i = 0; i <= 1000; ++i) grid.push_back(0.01003 * i);
    run.observe(&seen);
    run.set_output_grid(grid);
    ASSERT_TRUE(run.advance_to(grid.back()).ok());
    ASSERT_EQ(seen.t, grid);
    double worst = 0;
    for (std::size_t i = 0; i < grid.size(); ++i) worst = std::max(worst, std::abs(seen.x[i] - std::cos(grid[i])));
    // The interpolants are of lower order than the steps: a hundred times the tolerance. Fixed: h^4/384 =
    // 3e-11 between the points, 1e-9 in them.
    EXPECT_LT(worst, 1e-6);
    if (GetParam() == Method::fixed) {
        EXPECT_LT(worst, 1e-8);
    }
}

TEST_P(RunContinuity, a_run_in_pieces_that_end_at_sample_instants_gives_the_same_bits) {
    const FunctionSystem system = sampled_oscillator(0.005);
    Simulator whole(system, tight(GetParam())), pieces(system, tight(GetParam()));
    ASSERT_TRUE(whole.advance_to(5.0).ok());
    for (const long k : {1, 2, 7, 20, 21, 49, 50}) {
        ASSERT_TRUE(pieces.advance_to(system.sample_clocks[0].instant(k)).ok());
    }
    const Result a = result_of(whole), b = result_of(pieces);
    EXPECT_EQ(a.x, b.x);
    EXPECT_EQ(a.memory, b.memory);
    EXPECT_EQ(a.event_times, b.event_times);
    EXPECT_EQ(a.steps, b.steps);
}

TEST_P(RunContinuity, a_run_goes_on_from_a_copy_of_its_state_as_from_itself) {
    const FunctionSystem system = sampled_oscillator();
    // In the midst of an interval, and at an instant where both clocks have fired already.
    for (const double when : {1.234, 1.0}) {
        Simulator original(system, tight(GetParam()));
        ASSERT_TRUE(original.advance_to(when).ok());
        const SystemState snapshot = original.state();
        ASSERT_TRUE(original.advance_to(2.5).ok());

        Simulator continued(system, tight(GetParam()), snapshot);
        ASSERT_TRUE(continued.advance_to(2.5).ok());
        EXPECT_EQ(FunctionSystem::memory(continued.state())[1], FunctionSystem::memory(original.state())[1]) << when;
        for (std::size_t i = 0; i < 2; ++i) {
            // The step sizes are chosen afresh: equal to the tolerance times the number of intervals. The
            // fixed step begins anew at each sample, so only the interval of the snapshot is cut otherwise.
            EXPECT_NEAR(continued.state().x[i], original.state().x[i], 1e-8) << when;
        }
    }
}

TEST_P(RunContinuity, a_copy_of_the_state_does_not_change_with_the_run) {
    const FunctionSystem system = sampled_oscillator();
    Simulator run(system, tight(GetParam()));
    ASSERT_TRUE(run.advance_to(1.0).ok());
    const SystemState snapshot = run.state();
    const std::vector<double> x = snapshot.x, memory = FunctionSystem::memory(snapshot);
    ASSERT_TRUE(run.advance_to(2.0).ok());
    EXPECT_EQ(snapshot.x, x);
    EXPECT_EQ(FunctionSystem::memory(snapshot), memory);
    EXPECT_NE(run.state().x, x);
}

TEST_P(RunContinuity, everything_due_up_to_the_end_is_handled_when_a_run_stops) {
    // The guard crosses within the last step before an end that is no sample instant.
    FunctionSystem system;
    system.start = {1.0};
    system.start_memory = {1};
    system.slope = [](double, auto, auto&, auto dxdt) { dxdt[0] = -1; };
    system.guard = {[](double, auto x, auto& d) { return d[0] > 0 ? x[0] - 0.5 : 1.0; }};
    system.crossing = [](GuardId, double, auto&, auto& d) {
        d[0] = 0;
        return EventEffect::restart;
    };
    SolverOptions options = tight(GetParam());
    options.fixed_step = 0.15; // ends of steps: 0.45, then the end of the run
    Simulator run(system, options);
    ASSERT_TRUE(run.advance_to(0.52).ok());
    EXPECT_EQ(run.events().size(), 1u);
}

FunctionSystem decay_that_sets_after_5_s(std::atomic<bool>& flag) {
    FunctionSystem system = decay();
    system.sample_clocks = {{"tick", 0.01, 0.0}};
    system.sample = [&flag](ClockId, long k, double, auto&, auto&) {
        if (k == 500) flag = true;
        return EventEffect::restart;
    };
    return system;
}

TEST_P(RunContinuity, a_run_that_is_late_ends_early) {
    std::atomic<bool> late{false};
    const FunctionSystem system = decay_that_sets_after_5_s(late);
    Simulator run(system, tight(GetParam()), RunControl{.late = [&] { return late.load(); }});
    const RunOutcome outcome = run.advance_to(1000.0);
    EXPECT_EQ(outcome.end, RunEnd::interrupted);
    EXPECT_NE(outcome.message.find("out of time"), std::string::npos) << outcome.message;
    EXPECT_GE(outcome.t, 5.0);
    EXPECT_LT(outcome.t, 8.0);
}

TEST_P(RunContinuity, a_stop_request_interrupts_and_keeps_what_was_done) {
    std::atomic<bool> stop{false};
    const FunctionSystem system = decay_that_sets_after_5_s(stop);
    RunControl control;
    control.stop = &stop;
    Simulator run(system, tight(GetParam()), control);
    const RunOutcome outcome = run.advance_to(1000.0);
    EXPECT_EQ(outcome.end, RunEnd::interrupted);
    EXPECT_FALSE(outcome.message.empty());
    EXPECT_GE(outcome.t, 5.0);
    EXPECT_LT(outcome.t, 8.0); // asked every 200 steps: 2 s of samples at most
    EXPECT_EQ(run.state().t, outcome.t);
    EXPECT_NEAR(run.state().x[0], std::exp(-outcome.t), 1e-8);
}

} // namespace
} // namespace tribode
