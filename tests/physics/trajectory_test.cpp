// The engine against the exact servo: the same machine by a road that shares no code with it.
#include "physics/oracle.hpp"

namespace tribode {
namespace {

using problems::EventKind;
using problems::LoopSettings;
using problems::ServoProblem;

SolverOptions with_tolerance(Method method, double relative) {
    return {.method = method, .relative_tolerance = relative, .absolute_tolerance = 1e-3 * relative};
}

struct OpenLoopRun {
    const char* name;
    double amplitude, frequency_hz; // of the thrust [N], [Hz]
    long slips, sticks;             // known from two independent programs (tests/golden/README.md)
};

constexpr OpenLoopRun g1{"g1", 15, 10, 173, 156}, g2{"g2", 30, 34, 540, 524};

struct Exact {
    std::vector<double> u;
    problems::ServoSolution solution;
};

// Solved once for all tests.
const Exact& exact(const OpenLoopRun& run) {
    const auto solve = [](const OpenLoopRun& r) {
        auto u = problems::sampled_sine(r.amplitude, r.frequency_hz, 5e-4, 1001);
        auto solution = problems::solve_exactly(problems::linear_motor_table(), u);
        return Exact{std::move(u), std::move(solution)};
    };
    static const Exact first = solve(g1), second = solve(g2);
    return &run == &g1 ? first : second;
}

TEST(ReferenceMachine, is_the_table_of_the_oracle) {
    EXPECT_EQ(machine_of(bare_description()).axis().plant.rolling.elements().size(), 20u);
    const auto run = [&](const Json& d) {
        return run_open_loop(d, exact(g1).u, with_tolerance(Method::erk, 1e-6)).trace.x;
    };
    EXPECT_EQ(run(bare_description()), run(description_of(problems::linear_motor_table())));
}

class OpenLoop : public testing::TestWithParam<const OpenLoopRun*> {};
INSTANTIATE_TEST_SUITE_P(Runs, OpenLoop, testing::Values(&g1, &g2),
                         [](const auto& test) { return std::string(test.param->name); });

TEST_P(OpenLoop, events_are_those_of_the_oracle_in_number_kind_and_order) {
    const Exact& e = exact(*GetParam());
    for (const Method method : {Method::erk, Method::adams, Method::bdf}) {
        const auto run =
            run_open_loop(description_of(problems::linear_motor_table()), e.u, with_tolerance(method, 1e-10));
        // 1e-7 s: position errors of 1e-9 m at velocities of 10 mm/s and more.
        EXPECT_LT(largest_time_difference(run.events, e.solution.events), 1e-7) << name_of(method);
        long slips = 0, sticks = 0;
        for (const auto& event : run.events) ++(event.kind == 0 ? sticks : slips);
        EXPECT_EQ(slips, GetParam()->slips) << name_of(method);
        EXPECT_EQ(sticks, GetParam()->sticks) << name_of(method);
    }
}

TEST_P(OpenLoop, trajectories_at_tight_tolerance_are_the_exact_ones) {
    const Exact& e = exact(*GetParam());
    // Stated bounds [m] at rtol 1e-10, atol 1e-13 m; what is reached lies below by a factor of ten or so.
    for (const auto& [method, bound] : {std::pair{Method::erk, 1e-9}, {Method::adams, 5e-9}, {Method::bdf, 1e-8}}) {
        const auto run =
            run_open_loop(description_of(problems::linear_motor_table()), e.u, with_tolerance(method, 1e-10));
        EXPECT_LT(largest_difference(run.trace.x, e.solution.x), bound) << name_of(method);
        // Velocity and force follow with the fastest rates of the friction, 200 1/s and 4e6 N/m.
        EXPECT_LT(largest_difference(run.trace.v, e.solution.v), 200 * bound) << name_of(method);
        EXPECT_LT(largest_difference(run.trace.f, e.solution.f), 4e6 * bound) << name_of(method);
    }
}

TEST_P(OpenLoop, the_exact_method_leaves_rounding_errors_only) {
    const Exact& e = exact(*GetParam());
    const auto run = run_open_loop(description_of(problems::linear_motor_table()), e.u, {.method = Method::exact});
    // Some ten times the rounding of a position of 1 mm, 1e-19 m, summed up over a thousand samples; velocity
    // and force follow as above.
    EXPECT_LT(largest_difference(run.trace.x, e.solution.x), 1e-15);
    EXPECT_LT(largest_difference(run.trace.v, e.solution.v), 200 * 1e-15);
    EXPECT_LT(largest_difference(run.trace.f, e.solution.f), 4e6 * 1e-15);
    EXPECT_LT(largest_time_difference(run.events, e.solution.events), 1e-13);
}

TEST_P(OpenLoop, errors_fall_with_the_tolerance) {
    const Exact& e = exact(*GetParam());
    const auto error = [&](Method method, double tolerance) {
        return largest_difference(
            run_open_loop(description_of(problems::linear_motor_table()), e.u, with_tolerance(method, tolerance))
                .trace.x,
            e.solution.x);
    };
    for (const Method method : {Method::adams, Method::bdf}) {
        double previous = 1;
        for (const double tolerance : {1e-6, 1e-8, 1e-10}) {
            const double now = error(method, tolerance);
            EXPECT_LT(now, previous / 5) << name_of(method) << " " << tolerance; // a hundred times tighter
            previous = now;
        }
    }
    // erk is held below its tolerance by the sample time already; 1e-4 lets it take its full steps.
    EXPECT_LT(error(Method::erk, 1e-10), error(Method::erk, 1e-6) / 5);
    EXPECT_LT(error(Method::erk, 1e-6), 1e-8);
}

TEST_P(OpenLoop, erk_and_cvode_agree_with_each_other) {
    const Json table = description_of(problems::linear_motor_table());
    const auto erk = run_open_loop(table, exact(*GetParam()).u, with_tolerance(Method::erk, 1e-10));
    const auto bdf = run_open_loop(table, exact(*GetParam()).u, with_tolerance(Method::bdf, 1e-10));
    EXPECT_LT(largest_difference(erk.trace.x, bdf.trace.x), 1e-8); // the bound of bdf above
    ASSERT_EQ(erk.events.size(), bdf.events.size());
    for (std::size_t i = 0; i < erk.events.size(); ++i) {
        EXPECT_EQ(erk.events[i].subject, bdf.events[i].subject) << i;
        EXPECT_EQ(erk.events[i].kind, bdf.events[i].kind) << i;
    }
}

TEST(FixedStep, is_near_the_exact_trajectory_and_comes_nearer_with_the_step) {
    const Exact& e = exact(g1);
    double previous = 1;
    for (const double step : {2.5e-4, 1e-4, 5e-5, 1e-5}) {
        const auto run = run_open_loop(description_of(problems::linear_motor_table()), e.u,
                                       {.method = Method::fixed, .fixed_step = step});
        const double error = largest_difference(run.trace.x, e.solution.x);
        EXPECT_LT(error, previous / 1.5) << step;
        if (step == 5e-5) {
            EXPECT_LT(error, 1e-7); // events up to 50 us late, each a force error for that long
        }
        previous = error;
    }
    EXPECT_LT(previous, 5e-9); // first order in the step, because events are late by part of one
}

TEST(StepSize, survives_the_restarts_at_samples_and_events) {
    const auto run =
        run_open_loop(description_of(problems::linear_motor_table()), exact(g1).u, with_tolerance(Method::erk, 1e-8));
    // One step of seven stages a sample, and a few more at an event; an estimate of the first step at each
    // restart would climb up from 1e-12 s in several steps, 60 evaluations and more.
    EXPECT_LT(static_cast<double>(run.statistics.derivative_evaluations) / 1000, 15);
    EXPECT_LT(static_cast<double>(run.statistics.steps) / 1000, 1.6);
}

struct LoopCase {
    const char* name;
    LoopSettings loop;
};

const LoopCase whole_sample{
    "golden",
    {.kp = 2.05e4, .ki = 1.8e5, .kd = 653, .input_delay = 5e-4, .output_delay = 4.18e-4, .encoder_resolution = 1e-7}};
const LoopCase fractional{"fractional_delays",
                          {.kp = 2.5e3,
                           .ki = 6e3,
                           .kd = 218,
                           .derivative_filter_hz = 300,
                           .input_delay = 7.3e-4,
                           .output_delay = 1.37e-3,
                           .encoder_resolution = 1e-7}};
const LoopCase unrounded{"no_encoder", {.kp = 2.5e3, .ki = 6e3, .kd = 218, .input_delay = 1.5e-4, .output_delay = 0}};

class Loop : public testing::TestWithParam<const LoopCase*> {};
INSTANTIATE_TEST_SUITE_P(Cases, Loop, testing::Values(&whole_sample, &fractional, &unrounded),
                         [](const auto& test) { return std::string(test.param->name); });

TEST_P(Loop, with_lag_and_delays_is_the_exact_one) {
    const LoopSettings& loop = GetParam()->loop;
    ServoProblem table = problems::linear_motor_table();
    table.lag_hz = 750;
    const auto excitation = problems::sampled_sine(15, 10, 5e-4, 1001);
    const auto reference = problems::sampled_sine(1e-4, 3, 5e-4, 1001);
    const auto solution = problems::solve_loop_exactly(table, loop, reference, excitation);
    Json machine = description_of(table);
    add_loop(machine, loop);
    // A position on the edge of an encoder step may be rounded the other way; so the roundings of the oracle
    // are met exactly only while the errors are far below the resolution, 1e-7 m.
    for (const auto& [method, bound] :
         {std::pair{Method::exact, 1e-14}, {Method::erk, 1e-12}, {Method::adams, 1e-10}, {Method::bdf, 1e-9}}) {
        const auto run = run_closed_loop(machine, reference, excitation, with_tolerance(method, 1e-10));
        EXPECT_LT(largest_difference(run.trace.x, solution.x), bound) << name_of(method);
        EXPECT_LT(largest_difference(run.trace.y, solution.y), bound) << name_of(method);
        // kp + kd/Ts is 1.3e6 N/m at most.
        EXPECT_LT(largest_difference(run.trace.u, solution.u), 3e6 * bound) << name_of(method);
        EXPECT_LT(largest_time_difference(run.events, solution.events), 1e-7) << name_of(method);
    }
}

} // namespace
} // namespace tribode
