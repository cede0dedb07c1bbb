// The methods themselves: accuracy, what they count, how they fail.
#include "function_system.hpp"
#include "tribode/base/error.hpp"
#include "tribode/solver/simulator.hpp"

#include <cmath>
#include <gtest/gtest.h>

namespace tribode {
namespace {

class EveryIntegrator : public testing::TestWithParam<Method> {};
INSTANTIATE_TEST_SUITE_P(Methods, EveryIntegrator,
                         testing::Values(Method::erk, Method::adams, Method::bdf, Method::ida, Method::fixed),
                         method_of);

class VariableStepIntegrator : public testing::TestWithParam<Method> {};
INSTANTIATE_TEST_SUITE_P(Methods, VariableStepIntegrator, testing::Values(Method::erk, Method::adams, Method::bdf),
                         method_of);

double oscillator_error(const SolverOptions& options) {
    const FunctionSystem system = oscillator();
    Simulator run(system, options);
    EXPECT_TRUE(run.advance_to(10.0).ok());
    EXPECT_EQ(run.state().t, 10.0);
    return std::hypot(run.state().x[0] - std::cos(10.0), run.state().x[1] + std::sin(10.0));
}

TEST(FixedStep, has_order_four) {
    double coarse = oscillator_error({.method = Method::fixed, .fixed_step = 0.1});
    for (const double step : {0.05, 0.025, 0.0125}) {
        const double fine = oscillator_error({.method = Method::fixed, .fixed_step = step});
        EXPECT_NEAR(std::log2(coarse / fine), 4.0, 0.1) << step; // the next term of the error is h times smaller
        coarse = fine;
    }
}

TEST(FixedStep, takes_steps_of_the_given_length_and_a_shorter_one_to_end) {
    const FunctionSystem system = decay();
    Simulator run(system, {.method = Method::fixed, .fixed_step = 0.3});
    ASSERT_TRUE(run.advance_to(1.0).ok());
    EXPECT_EQ(run.statistics().steps, 4);
    EXPECT_EQ(run.statistics().derivative_evaluations, 16);
    Simulator even(system, {.method = Method::fixed, .fixed_step = 0.1});
    ASSERT_TRUE(even.advance_to(1.0).ok());
    EXPECT_EQ(even.statistics().steps, 10); // ten times 0.1 is not 1 in doubles, and makes no eleventh step
}

// A user's force may refuse in the middle of a step, below a library that knows no exceptions.
TEST_P(EveryIntegrator, an_exception_of_the_system_arrives_as_it_is) {
    FunctionSystem system = decay();
    const auto slope = system.slope;
    system.slope = [&](double t, FunctionSystem::Values x, FunctionSystem::Held d, std::span<double> dxdt) {
        if (t > 0.5) throw InputError("no force beyond 0.5 s");
        slope(t, x, d, dxdt);
    };
    Simulator run(system, {.method = GetParam()});
    try {
        run.advance_to(1);
        ADD_FAILURE() << "no exception";
    } catch (const InputError& error) {
        EXPECT_STREQ(error.what(), "no force beyond 0.5 s");
    }
}

// The leak sanitizer watches.
TEST(ImplicitIntegrators, that_are_not_finished_leave_nothing_behind) {
    FunctionSystem system = decay();
    system.matrix = [](double, FunctionSystem::Values, std::span<double>) { throw InputError("no Jacobian"); };
    for (const Method method : {Method::bdf, Method::ida}) {
        EXPECT_THROW(make_integrator(system, {.method = method}), InputError) << name_of(method);
    }
}

TEST_P(VariableStepIntegrator, the_error_follows_the_tolerance) {
    double previous = 1;
    for (const double tolerance : {1e-4, 1e-6, 1e-8, 1e-10}) {
        const double error =
            oscillator_error({.method = GetParam(), .relative_tolerance = tolerance, .absolute_tolerance = tolerance});
        // Local errors are held at the tolerance; over 10 s their sum stays within a few hundred times of it.
        EXPECT_LT(error, 500 * tolerance) << tolerance;
        // A hundredth of the tolerance gives about a hundredth of the error; a fifth of that gain is asked
        // for.
        EXPECT_LT(error, previous / 20) << tolerance;
        previous = error;
    }
}

// x' = -1000 (x - cos t): fast and slow.
FunctionSystem stiff() {
    FunctionSystem system;
    system.start = {0.0};
    system.slope = [](double t, auto x, auto&, auto dxdt) { dxdt[0] = -1000 * (x[0] - std::cos(t)); };
    return system;
}

double stiff_solution(double t) { // without the start, which is gone after 0.1 s
    return (1e6 * std::cos(t) + 1000 * std::sin(t)) / (1e6 + 1);
}

TEST(Bdf, uses_and_counts_the_analytic_jacobian) {
    FunctionSystem with = stiff();
    with.matrix = [](double, auto, auto m) { m[0] = -1000; };
    const FunctionSystem without = stiff();
    const SolverOptions options{.method = Method::bdf, .relative_tolerance = 1e-8, .absolute_tolerance = 1e-10};
    Simulator analytic(with, options), differences(without, options);
    const long at_set_up = with.matrix_calls; // the integrator asks whether there is one
    ASSERT_TRUE(analytic.advance_to(10.0).ok());
    ASSERT_TRUE(differences.advance_to(10.0).ok());
    // 1e-6: a hundred times the tolerance.
    EXPECT_NEAR(analytic.state().x[0], stiff_solution(10.0), 1e-6);
    EXPECT_NEAR(differences.state().x[0], stiff_solution(10.0), 1e-6);
    EXPECT_GT(analytic.statistics().jacobian_evaluations, 0);
    EXPECT_EQ(analytic.statistics().jacobian_evaluations, with.matrix_calls - at_set_up);
    EXPECT_EQ(differences.statistics().jacobian_evaluations, 0);
}

TEST(Bdf, a_jacobian_of_several_states_is_read_by_columns) {
    // Two decays with a strong one-way coupling: a transposed matrix would spoil the convergence of Newton's
    // method.
    FunctionSystem system;
    system.start = {1.0, 0.0};
    system.slope = [](double, auto x, auto&, auto dxdt) {
        dxdt[0] = -x[0];
        dxdt[1] = 1e5 * x[0] - 1e5 * x[1];
    };
    const SolverOptions options{.method = Method::bdf, .relative_tolerance = 1e-8, .absolute_tolerance = 1e-10};
    const auto steps_with = [&](std::array<double, 4> by_columns) {
        system.matrix = [by_columns](double, auto, auto m) {
            std::copy(by_columns.begin(), by_columns.end(), m.begin());
        };
        Simulator run(system, options);
        EXPECT_TRUE(run.advance_to(1.0).ok());
        EXPECT_NEAR(run.state().x[1], std::exp(-1.0) / (1 - 1e-5), 1e-6); // a hundred times the tolerance
        return run.statistics().derivative_evaluations;
    };
    const long right = steps_with({-1, 1e5, 0, -1e5}), transposed = steps_with({-1, 0, 1e5, -1e5});
    EXPECT_LT(right, transposed);
}

TEST(Erk, does_not_ask_for_a_jacobian) {
    FunctionSystem system = stiff();
    system.matrix = [](double, auto, auto m) { m[0] = -1000; };
    Simulator run(system, tight(Method::erk));
    const long at_set_up = system.matrix_calls;
    ASSERT_TRUE(run.advance_to(0.1).ok());
    EXPECT_EQ(run.statistics().jacobian_evaluations, 0);
    EXPECT_EQ(system.matrix_calls, at_set_up);
}

TEST_P(EveryIntegrator, the_statistics_count_what_was_called) {
    FunctionSystem system = oscillator();
    system.sample_clocks = {{"tick", 0.1, 0.0}, {"idle", 0.3, 0.05}};
    system.start_memory = {1};
    system.guard = {[](double, auto x, auto& d) { return d[0] * x[0]; }};
    system.crossing = [](GuardId, double, auto&, auto& d) {
        d[0] = -d[0];
        return EventEffect::restart;
    };
    system.sample = [](ClockId id, long, double, auto&, auto&) {
        return id == 0 ? EventEffect::restart : EventEffect::none;
    };
    Simulator run(system, tight(GetParam()));
    ASSERT_TRUE(run.advance_to(10.0).ok());
    const RunStatistics s = run.statistics();
    EXPECT_EQ(s.derivative_evaluations, system.slope_calls);
    EXPECT_EQ(s.guard_evaluations, system.guard_calls);
    EXPECT_EQ(s.events, 3); // cos t at pi/2, 3 pi/2, 5 pi/2
    EXPECT_EQ(s.samples, 101 + 34);
    EXPECT_EQ(s.restarts, 1 + 99 + 3); // the start, the ticks but the first and the last, the events
    EXPECT_GE(s.steps, s.restarts);
    EXPECT_GE(s.rejected_steps, 0);
    EXPECT_GE(s.derivative_evaluations, s.steps);
    EXPECT_GT(s.seconds_integrating, 0);
}

TEST_P(EveryIntegrator, a_derivative_that_is_not_finite_ends_the_run_with_a_text) {
    FunctionSystem system;
    system.start = {0.0};
    system.slope = [](double, auto x, auto&, auto dxdt) { dxdt[0] = x[0] < 0.5 ? 1 : std::nan(""); };
    Simulator run(system, tight(GetParam()));
    const RunOutcome outcome = run.advance_to(1.0);
    EXPECT_EQ(outcome.end, RunEnd::non_finite);
    EXPECT_NE(outcome.message.find("finite"), std::string::npos) << outcome.message;
    ASSERT_TRUE(outcome.not_finite);
    EXPECT_EQ(outcome.not_finite->state, 0u);
    EXPECT_GE(outcome.not_finite->t, outcome.t);
    // Steps shrink before the method gives up; the fixed one stops a step of 1 ms before.
    EXPECT_NEAR(outcome.t, 0.5, 0.2);
    EXPECT_LE(run.state().t, 0.5 + 1e-9);
    EXPECT_TRUE(std::isfinite(run.state().x[0]));
}

TEST_P(EveryIntegrator, a_derivative_that_is_not_finite_at_the_start_is_an_outcome_too) {
    FunctionSystem system = decay();
    system.slope = [](double, auto, auto&, auto dxdt) { dxdt[0] = INFINITY; };
    Simulator run(system, tight(GetParam()));
    EXPECT_EQ(run.advance_to(1.0).end, RunEnd::non_finite);
}

// x' = x^2 from 1 reaches infinity at t = 1.
TEST_P(VariableStepIntegrator, a_solution_that_ends_in_finite_time_ends_the_run_there) {
    FunctionSystem system;
    system.start = {1.0};
    system.slope = [](double, auto x, auto&, auto dxdt) { dxdt[0] = x[0] * x[0]; };
    Simulator run(system, tight(GetParam()));
    const RunOutcome outcome = run.advance_to(2.0);
    EXPECT_FALSE(outcome.ok());
    EXPECT_FALSE(outcome.message.empty());
    EXPECT_NEAR(outcome.t, 1.0, 1e-6); // the error of the method moves the pole
}

// A step size found once is kept: restarts do not begin with an estimate of their own.
TEST(Erk, a_restart_at_each_sample_costs_one_step) {
    FunctionSystem system = oscillator();
    system.sample_clocks = {{"tick", 1e-3, 0.0}};
    system.sample = [](ClockId, long, double, auto&, auto&) { return EventEffect::restart; };
    Simulator run(system, {.method = Method::erk, .relative_tolerance = 1e-8, .absolute_tolerance = 1e-10});
    ASSERT_TRUE(run.advance_to(1.0).ok());
    // Dormand-Prince has seven stages, and 1 ms is short for this oscillation: one step a sample.
    EXPECT_LE(run.statistics().steps, 1000 + 10);
    EXPECT_LE(run.statistics().derivative_evaluations, 8 * 1000 + 100);
}

TEST(SolverOptions, a_method_is_known_by_the_name_the_user_writes) {
    for (const auto& name : SolverOptions::method_names()) EXPECT_EQ(name_of(method_named(name)), name);
    EXPECT_EQ(name_of(Method::bdf), "bdf");
    EXPECT_EQ(method_named("cvode"), Method::bdf);
    EXPECT_THROW(method_named("ode45"), InputError);
}

TEST(SolverOptions, are_read_from_fields_and_refuse_nonsense) {
    const Json given = {{"solver", "adams"}, {"relative_tolerance", 1e-5}, {"fixed_step_s", 1e-4}};
    FieldReader fields(given, "run");
    SolverOptions options;
    read_options(options, fields);
    fields.finish();
    EXPECT_EQ(options.method, Method::adams);
    EXPECT_EQ(options.relative_tolerance, 1e-5);
    EXPECT_EQ(options.absolute_tolerance, SolverOptions{}.absolute_tolerance);
    EXPECT_EQ(options.fixed_step, 1e-4);
    const Json alias = {{"solver", "cvode"}};
    FieldReader alias_fields(alias, "run");
    read_options(options, alias_fields);
    EXPECT_EQ(options_json(options)["solver"], "bdf");
    for (const Json& wrong : {Json{{"solver", "ode45"}}, Json{{"relative_tolerance", 0}}, Json{{"fixed_step_s", -1}}}) {
        FieldReader reader(wrong, "run");
        SolverOptions read;
        EXPECT_THROW(read_options(read, reader), InputError) << wrong;
    }
}

} // namespace
} // namespace tribode
