// What docs/library.md says may be shared by threads is shared here, and gives each thread the bits of one thread alone. The
// thread sanitizer watches (label threads).
#include "physics/reference_machine.hpp"
#include "tribode/experiment/simulation.hpp"
#include "tribode/experiment/system_run.hpp"
#include "tribode/system/system_builder.hpp"

#include <cmath>
#include <gtest/gtest.h>
#include <thread>

namespace tribode {
namespace {

// What `run` gives on each of four threads at one time.
template <class Run>
auto on_four_threads(const Run& run) {
    std::vector<decltype(run())> results(4);
    std::vector<std::thread> threads;
    for (auto& result : results) threads.emplace_back([&run, &result] { result = run(); });
    for (auto& thread : threads) thread.join();
    return results;
}

DriveRecord sine(const MachineModel& machine) {
    DriveRecord record;
    for (int k = 0; k < 400; ++k) {
        record.t.push_back(k * machine.sample_time);
        record.u.push_back(15 * std::sin(2 * std::numbers::pi * 20 * record.t.back()));
    }
    return record;
}

TEST(SharedByThreads, AMachineAndARecord) {
    const MachineModel machine = machine_of(reference_description());
    const DriveRecord record = sine(machine);
    for (const Method method : {Method::exact, Method::erk, Method::bdf}) {
        const auto run = [&] { return simulate(machine, record, {.solver = {.method = method}, .seed = 7}).trace.x; };
        const auto alone = run();
        ASSERT_EQ(alone.size(), record.t.size());
        for (const auto& result : on_four_threads(run)) EXPECT_EQ(result, alone) << name_of(method);
    }
}

// With an algebraic variable, events, a sample clock and an output.
TEST(SharedByThreads, ASystemOfEquations) {
    SystemBuilder b("shared");
    const Expression h = b.state("h", 1), v = b.state("v", 0), drag = b.algebraic("drag", 0), n = b.discrete("n", 0);
    b.rate(h, v);
    b.rate(v, -9.81 - drag);
    b.residual("drag", drag + 0.01 * pow(drag, 3) - 0.1 * v);
    b.when("impact", h < 0, {{h, 0}, {v, -0.8 * v}, {n, n + 1}});
    b.sample("kick", 0.25, 0, {{v, v + 0.1}});
    b.output("energy", v * v / 2 + 9.81 * h);
    const EquationSystem system(b.equations());
    const auto run = [&] {
        const SystemRun result = run_system(system, {.end = 2});
        std::vector<double> values = result.table["energy"].values;
        for (const auto& event : result.events) values.push_back(event.t);
        return values;
    };
    const auto alone = run();
    ASSERT_GT(alone.size(), 1000u);
    for (const auto& result : on_four_threads(run)) EXPECT_EQ(result, alone);
}

TEST(SharedByThreads, BuildersEachOnItsThread) {
    const auto run = [] {
        SystemBuilder b("own");
        const Expression x = b.state("x", 1);
        b.rate(x, where(x < 0.5, -2 * x, -x));
        return run_system(EquationSystem(b.equations()), {.end = 1}).final_states;
    };
    const auto alone = run();
    for (const auto& result : on_four_threads(run)) EXPECT_EQ(result, alone);
}

} // namespace
} // namespace tribode
