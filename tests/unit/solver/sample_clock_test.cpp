// Sample clocks: which instants, which order, how they meet.
#include "function_system.hpp"
#include "tribode/solver/simulator.hpp"

#include <fmt/format.h>
#include <gtest/gtest.h>

namespace tribode {
namespace {

struct Firing {
    ClockId clock;
    long k;
    double t;
};

// Every firing of the clocks of a system that does nothing else.
std::vector<Firing> firings(std::vector<SampleClock> clocks, const std::vector<double>& stops,
                            std::vector<double> start = {0.0}) {
    std::vector<Firing> fired;
    FunctionSystem system;
    system.start = std::move(start);
    system.sample_clocks = std::move(clocks);
    system.slope = [](double, auto, auto&, auto dxdt) {
        for (auto& s : dxdt) s = 0;
    };
    system.sample = [&](ClockId id, long k, double t, auto&, auto&) {
        fired.push_back({id, k, t});
        return EventEffect::none;
    };
    Simulator run(system, {});
    for (const double t : stops) {
        const RunOutcome outcome = run.advance_to(t);
        EXPECT_TRUE(outcome.ok()) << outcome.message;
    }
    return fired;
}

std::string text(const std::vector<Firing>& fired) {
    std::string all;
    for (const auto& f : fired) all += fmt::format("{}:{}@{:.4g} ", f.clock, f.k, f.t);
    return all;
}

TEST(SampleClocks, two_rates_with_offsets_fire_at_offset_plus_k_periods_in_time_order) {
    EXPECT_EQ(text(firings({{"a", 0.4, 0.0}, {"b", 0.3, 0.1}}, {1.0})),
              "0:0@0 1:0@0.1 0:1@0.4 1:1@0.4 1:2@0.7 0:2@0.8 1:3@1 ");
}

TEST(SampleClocks, clocks_that_meet_fire_in_declared_order_once_each) {
    EXPECT_EQ(text(firings({{"slow", 0.2, 0.0}, {"fast", 0.1, 0.0}, {"late", 0.2, 0.2}}, {0.4})),
              "0:0@0 1:0@0 1:1@0.1 0:1@0.2 1:2@0.2 2:0@0.2 1:3@0.3 0:2@0.4 1:4@0.4 2:1@0.4 ");
}

// 3 * 0.1 is not 0.3 in doubles; the instants are one all the same.
TEST(SampleClocks, instants_that_differ_by_rounding_are_one_instant) {
    int lefts = 0;
    struct CountLefts final : Observer {
        explicit CountLefts(int& count) : lefts(count) {}
        void left_limit(const SystemState&) override { ++lefts; }
        int& lefts;
    } observer(lefts);
    FunctionSystem system = decay();
    system.sample_clocks = {{"a", 0.3, 0.0}, {"b", 0.1, 0.0}, {"c", 0.1, 0.1}};
    Simulator run(system, {});
    run.observe(&observer);
    ASSERT_TRUE(run.advance_to(3.05).ok());
    EXPECT_EQ(lefts, 31); // 0, 0.1, .. 3.0
    EXPECT_EQ(run.statistics().samples, 11 + 31 + 30);
}

TEST(SampleClocks, a_run_to_an_instant_that_differs_from_a_sample_by_rounding_includes_the_sample) {
    for (const double end : {0.3, 3 * 0.1, 0.1 + 0.2}) {
        EXPECT_EQ(firings({{"a", 0.1, 0.0}}, {end}).size(), 4u) << end;
        // And the sample is not repeated when the run goes on.
        EXPECT_EQ(firings({{"a", 0.1, 0.0}}, {end, 0.35}).size(), 4u) << end;
    }
}

TEST(SampleClocks, stopping_anywhere_neither_loses_nor_repeats_a_sample) {
    std::vector<double> stops;
    for (int i = 0; i <= 100; ++i) stops.push_back(0.01 * i);
    const std::vector<SampleClock> clocks = {{"a", 0.1, 0.0}, {"b", 0.07, 0.03}};
    EXPECT_EQ(text(firings(clocks, stops)), text(firings(clocks, {1.0})));
}

TEST(SampleClocks, a_million_instants_are_exact_multiples_not_a_running_sum) {
    const double period = 5e-4, offset = 8.2e-5;
    const auto fired = firings({{"a", period, offset}}, {period * 1e6});
    ASSERT_EQ(fired.size(), 1'000'000u);
    long wrong = 0;
    for (std::size_t k = 0; k < fired.size(); ++k) {
        wrong += fired[k].k != static_cast<long>(k) || fired[k].t != offset + static_cast<double>(k) * period;
    }
    EXPECT_EQ(wrong, 0);
}

TEST(SampleClocks, two_clocks_with_the_same_instants_stay_together_for_a_million_samples) {
    // Other doubles at nearly every instant: 2 k T/2 + T against (k + 1) T.
    const double period = 5e-4;
    const auto fired = firings({{"a", period, period}, {"b", period / 3, 0.0}}, {period * 3e5});
    long apart = 0;
    for (std::size_t i = 1; i < fired.size(); ++i) {
        if (fired[i - 1].clock == 0) apart += fired[i].t != fired[i - 1].t || fired[i].k != 3 * (fired[i - 1].k + 1);
    }
    EXPECT_EQ(apart, 0);
    EXPECT_EQ(fired.size(), 300'000u + 900'001u);
}

TEST(SampleClocks, a_system_without_continuous_states_counts) {
    for (const Method method : {Method::erk, Method::adams, Method::bdf, Method::ida, Method::fixed}) {
        FunctionSystem counter;
        counter.start_memory = {0};
        counter.sample_clocks = {{"count", 0.25, 0.0}};
        counter.sample = [](ClockId, long, double, auto&, auto& d) {
            d[0] += 1;
            return EventEffect::restart;
        };
        Simulator run(counter, tight(method));
        const RunOutcome outcome = run.advance_to(2.0);
        EXPECT_TRUE(outcome.ok()) << name_of(method) << ": " << outcome.message;
        EXPECT_EQ(FunctionSystem::memory(run.state())[0], 9) << name_of(method);
    }
}

TEST(SampleClocks, a_run_may_begin_late) {
    FunctionSystem system = decay();
    std::vector<long> indices;
    system.sample_clocks = {{"a", 0.1, 0.05}};
    system.sample = [&](ClockId, long k, double, auto&, auto&) {
        indices.push_back(k);
        return EventEffect::none;
    };
    SystemState start = system.initial_state();
    start.t = 1.0;
    Simulator run(system, {}, start);
    ASSERT_TRUE(run.advance_to(1.3).ok());
    EXPECT_EQ(indices, (std::vector<long>{10, 11, 12}));
}

} // namespace
} // namespace tribode
