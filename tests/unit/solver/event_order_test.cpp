// What happens at one instant, and in which order: the class comment of Simulator.
#include "function_system.hpp"
#include "tribode/solver/simulator.hpp"

#include <fmt/format.h>
#include <gtest/gtest.h>

namespace tribode {
namespace {

using Log = std::vector<std::string>;

class LoggingObserver final : public Observer {
  public:
    explicit LoggingObserver(Log& log) : log_(log) {}
    void left_limit(const SystemState& s) override { log_.push_back(fmt::format("left limit, x = {:.6g}", s.x[0])); }
    void sampled(ClockId clock, long k, const SystemState& s) override {
        log_.push_back(fmt::format("seen {} {}, x = {:.6g}", clock, k, s.x[0]));
    }

  private:
    Log& log_;
};

class Events : public testing::TestWithParam<Method> {};
INSTANTIATE_TEST_SUITE_P(Methods, Events, testing::Values(Method::erk, Method::adams, Method::bdf, Method::ida),
                         method_of);

// x' = 1 from 0. At t = 1 guard 0 crosses (its zero is exactly there), clocks 0 and 1 are due, and the sample
// of clock 1 makes guard 1 cross.
TEST_P(Events, an_instant_is_left_limit_guards_clocks_in_declared_order_and_guards_again) {
    Log log;
    FunctionSystem system;
    system.start = {0.0};
    system.start_memory = {1, 1}; // what the guards are when they are calm
    system.sample_clocks = {{"fast", 1.0, 0.0}, {"slow", 1.0, 1.0}};
    system.slope = [](double, auto, auto&, auto dxdt) { dxdt[0] = 1; };
    system.guard = {[](double t, auto, auto& d) { return d[0] > 0 ? 1 - t : 1; },
                    [](double, auto, auto& d) { return d[1]; }};
    system.crossing = [&](GuardId id, double t, auto& x, auto& d) {
        log.push_back(fmt::format("guard {} at {:.6g}", id, t));
        if (id == 0) x[0] += 10;
        d[id] = id == 0 ? 0 : 1;
        return EventEffect::restart;
    };
    system.sample = [&](ClockId id, long k, double t, auto& x, auto& d) {
        log.push_back(fmt::format("sample {} {} at {:.6g}", id, k, t));
        x[0] += 100;
        if (id == 1) d[1] = -1;
        return EventEffect::restart;
    };
    LoggingObserver observer(log);
    Simulator run(system, tight(GetParam()));
    run.observe(&observer);
    ASSERT_TRUE(run.advance_to(1.0).ok());
    EXPECT_EQ(log, (Log{"left limit, x = 0", "sample 0 0 at 0", "seen 0 0, x = 100", //
                        "left limit, x = 101", "guard 0 at 1",                       //
                        "sample 0 1 at 1", "seen 0 1, x = 211",                      //
                        "sample 1 0 at 1", "seen 1 0, x = 311",                      //
                        "guard 1 at 1"}));
    EXPECT_EQ(run.state().t, 1.0);
}

// A jump of x at a sample is seen by the integrator although no guard crossed.
TEST_P(Events, the_motion_goes_on_from_the_right_limit) {
    FunctionSystem system = decay();
    system.sample_clocks = {{"doubler", 0.5, 0.5}};
    system.sample = [](ClockId, long, double, auto& x, auto&) {
        x[0] *= 2;
        return EventEffect::restart;
    };
    Simulator run(system, tight(GetParam()));
    ASSERT_TRUE(run.advance_to(1.25).ok());
    // 1e-8: a hundred times the tolerance, for the sum of the local errors of three intervals.
    EXPECT_NEAR(run.state().x[0], 4 * std::exp(-1.25), 1e-8);
}

TEST_P(Events, two_guards_that_fall_at_one_time_are_handled_once_each_in_declared_order) {
    FunctionSystem system;
    system.start = {1.0};
    system.start_memory = {0, 0};
    system.slope = [](double, auto, auto&, auto dxdt) { dxdt[0] = -1; };
    for (const std::size_t i : {0u, 1u}) {
        system.guard.push_back([i](double, auto x, auto& d) { return d[i] > 0 ? 1.0 : (x[0] - 0.5) * (1.0 + i); });
    }
    system.crossing = [](GuardId id, double, auto&, auto& d) {
        d[id] = 1;
        return EventEffect::restart;
    };
    Simulator run(system, tight(GetParam()));
    ASSERT_TRUE(run.advance_to(1.0).ok());
    ASSERT_EQ(run.events().size(), 2u);
    EXPECT_EQ(run.events()[0].subject, 0);
    EXPECT_EQ(run.events()[1].subject, 1);
    EXPECT_EQ(run.events()[0].t, run.events()[1].t);
    EXPECT_EQ(run.statistics().events, 2);
}

// The handler leaves the guard at exactly zero; it must not fire again before it was positive.
TEST_P(Events, a_guard_that_is_zero_at_a_restart_does_not_fire_there) {
    const FunctionSystem ball = bouncing_ball(1.0, 9.81, 1.0);
    Simulator run(ball, tight(GetParam()));
    const double fall = std::sqrt(2 / 9.81);
    ASSERT_TRUE(run.advance_to(20 * fall).ok());
    ASSERT_EQ(run.events().size(), 10u); // at fall (1 + 2 n)
    for (std::size_t n = 0; n < 10; ++n) {
        // 1e-8 s: without loss of energy the errors of twenty flights add up, each near the tolerance.
        EXPECT_NEAR(run.events()[n].t, fall * (1 + 2 * static_cast<double>(n)), 1e-8) << n;
    }
}

TEST_P(Events, impacts_of_a_bouncing_ball_come_at_the_times_of_the_closed_form) {
    const double e = 0.8;
    const FunctionSystem ball = bouncing_ball(1.0, 9.81, e);
    Simulator run(ball, tight(GetParam()));
    ASSERT_TRUE(run.advance_to(3.5).ok());
    const double fall = std::sqrt(2 / 9.81);
    double expected = fall, flight = 2 * fall * e;
    ASSERT_GE(run.events().size(), 8u);
    for (std::size_t n = 0; n < 8; ++n, expected += flight, flight *= e) {
        EXPECT_NEAR(run.events()[n].t, expected, 1e-8) << n; // as above
    }
}

TEST_P(Events, each_fall_is_found_once_however_the_clocks_cut_the_time) {
    for (const double period : {0.1, 0.25, 1.0 / 3, 0.5, 10.0}) {
        FunctionSystem system = oscillator();
        system.sample_clocks = {{"idle", period, 0.0}};
        // Turned round at each crossing, so that the guard crosses at every zero of cos t.
        system.start_memory = {1};
        system.guard = {[](double, auto x, auto& d) { return d[0] * x[0]; }};
        system.crossing = [](GuardId, double, auto&, auto& d) {
            d[0] = -d[0];
            return EventEffect::restart;
        };
        Simulator run(system, tight(GetParam()));
        ASSERT_TRUE(run.advance_to(10.0).ok());
        ASSERT_EQ(run.events().size(), 3u) << period;
        for (std::size_t n = 0; n < 3; ++n) {
            EXPECT_NEAR(run.events()[n].t, (static_cast<double>(n) + 0.5) * std::numbers::pi, 1e-8) << period;
        }
    }
}

// The guard crosses at a sample instant, or so near that only rounding tells: one event, one sample, and the
// run goes on.
TEST_P(Events, a_fall_at_a_sample_instant_or_within_rounding_of_it_is_one_event) {
    for (const double shift : {0.0, 1e-17, -1e-17, 5e-17, -5e-17, 2e-16, -2e-16, 1e-15, -1e-15, 1e-13, -1e-13}) {
        FunctionSystem system;
        system.start = {0.3 + shift};
        system.start_memory = {1, 0};
        system.sample_clocks = {{"tick", 0.1, 0.0}};
        system.slope = [](double, auto, auto& d, auto dxdt) { dxdt[0] = -d[0]; };
        system.crossing = [](GuardId, double, auto& x, auto& d) {
            x[0] = 0;
            d[0] = -1; // upwards from now on
            return EventEffect::restart;
        };
        system.guard = {[](double, auto x, auto& d) { return d[0] > 0 ? x[0] : 1.0; }};
        system.sample = [](ClockId, long, double, auto&, auto& d) {
            d[1] += 1;
            return EventEffect::restart;
        };
        Simulator run(system, tight(GetParam()));
        const RunOutcome outcome = run.advance_to(0.55);
        ASSERT_TRUE(outcome.ok()) << shift << ": " << outcome.message;
        ASSERT_EQ(run.events().size(), 1u) << shift;
        EXPECT_NEAR(run.events()[0].t, 0.3 + shift, 1e-13) << shift; // the root finding: 100 eps (t + h)
        EXPECT_EQ(FunctionSystem::memory(run.state())[1], 6) << shift;
        EXPECT_NEAR(run.state().x[0], 0.25 - shift, 1e-12) << shift;
    }
}

class EventsOfEveryMethod : public testing::TestWithParam<Method> {};
INSTANTIATE_TEST_SUITE_P(Methods, EventsOfEveryMethod,
                         testing::Values(Method::erk, Method::adams, Method::bdf, Method::ida, Method::fixed),
                         method_of);

// A thermostat with hysteresis: T' = (heater ? 20 : 0) - T, on below 9, off above 11.
TEST_P(EventsOfEveryMethod, a_thermostat_keeps_between_its_levels_with_the_period_of_the_closed_form) {
    FunctionSystem system;
    system.start = {9.0};
    system.start_memory = {1};
    system.slope = [](double, auto x, auto& d, auto dxdt) { dxdt[0] = 20 * d[0] - x[0]; };
    system.guard = {[](double, auto x, auto& d) { return d[0] > 0 ? 11 - x[0] : x[0] - 9; }};
    system.crossing = [](GuardId, double, auto&, auto& d) {
        d[0] = 1 - d[0];
        return EventEffect::restart;
    };
    Simulator run(system, tight(GetParam()));
    ASSERT_TRUE(run.advance_to(5.0).ok());
    const double phase = std::log(11.0 / 9.0); // heating and cooling take equally long
    ASSERT_EQ(run.events().size(), static_cast<std::size_t>(5.0 / phase));
    // The fixed step handles a crossing up to a step of 1 ms late, each time anew.
    const double each = GetParam() == Method::fixed ? 1e-3 : 1e-9;
    for (std::size_t n = 0; n < run.events().size(); ++n) {
        const auto count = static_cast<double>(n + 1);
        EXPECT_NEAR(run.events()[n].t, count * phase, count * each) << n;
    }
}

TEST_P(EventsOfEveryMethod, a_sliding_system_ends_as_chattering_and_names_the_guard) {
    FunctionSystem system;
    system.start = {0.1};
    system.start_memory = {1};
    system.slope = [](double, auto, auto& d, auto dxdt) { dxdt[0] = -d[0]; };
    system.guard = {[](double, auto, auto&) { return 1.0; }, [](double, auto x, auto& d) { return d[0] * x[0]; }};
    system.crossing = [](GuardId, double, auto&, auto& d) {
        d[0] = -d[0];
        return EventEffect::restart;
    };
    SolverOptions options = tight(GetParam());
    options.fixed_step = 1e-8;
    if (GetParam() == Method::fixed) system.start = {1e-8};
    Simulator run(system, options);
    const RunOutcome outcome = run.advance_to(1.0);
    EXPECT_EQ(outcome.end, RunEnd::chattering);
    EXPECT_NE(outcome.message.find("guard 1 is chattering"), std::string::npos) << outcome.message;
    // With a fixed step each crossing takes two of them.
    EXPECT_NEAR(outcome.t, system.start[0],
                GetParam() == Method::fixed ? 8e-8 * static_cast<double>(Simulator::chatter_limit) : 1e-9);
    // The outcome stays.
    EXPECT_EQ(run.advance_to(2.0).end, RunEnd::chattering);
    EXPECT_EQ(run.state().t, outcome.t);
}

TEST_P(EventsOfEveryMethod, a_guard_that_its_handler_leaves_below_zero_ends_the_run_and_is_named) {
    FunctionSystem system;
    system.start = {1.0};
    system.slope = [](double, auto, auto&, auto dxdt) { dxdt[0] = -1; };
    system.guard = {[](double, auto x, auto&) { return x[0] - 0.5; }};
    system.crossing = [](GuardId, double, auto& x, auto&) {
        x[0] -= 0.1;
        return EventEffect::restart;
    };
    Simulator run(system, tight(GetParam()));
    const RunOutcome outcome = run.advance_to(1.0);
    EXPECT_EQ(outcome.end, RunEnd::chattering);
    EXPECT_NE(outcome.message.find("guard 0 does not come to rest"), std::string::npos) << outcome.message;
}

// The bounces accumulate at t = fall (1 + e)/(1 - e): what comes after has no meaning, and the run says so.
TEST_P(Events, a_zeno_system_ends_with_an_outcome_at_its_accumulation_point) {
    const double e = 0.5;
    const FunctionSystem ball = bouncing_ball(1.0, 9.81, e);
    Simulator run(ball, tight(GetParam()));
    const RunOutcome outcome = run.advance_to(10.0);
    EXPECT_TRUE(outcome.end == RunEnd::chattering || outcome.end == RunEnd::step_too_small) << outcome.message;
    EXPECT_FALSE(outcome.message.empty());
    EXPECT_NEAR(outcome.t, std::sqrt(2 / 9.81) * (1 + e) / (1 - e), 1e-5); // bounces below the tolerances
}

} // namespace
} // namespace tribode
