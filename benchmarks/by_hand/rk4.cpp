#include "by_hand/loop.hpp"
#include "by_hand/reduced_table.hpp"
#include "contender.hpp"

#include <fmt/format.h>

namespace tribode::bench {

namespace {

using State = ReducedTable::State;

State moved(State x, const State& slope, double h) {
    for (std::size_t i = 0; i < x.size(); ++i) x[i] += h * slope[i];
    return x;
}

State slope(const ReducedTable& table, const State& x) {
    State dxdt;
    table.derivative(x.data(), dxdt.data());
    return dxdt;
}

Run run_rk4(const Scenario& scenario, int divisions) {
    ReducedTable table(scenario.table);
    Loop loop(scenario);
    State x{};
    const double h = scenario.table.sample_time / divisions;
    Run result;
    result.x.reserve(scenario.samples + 1);
    result.x.push_back(0);
    for (std::size_t k = 0; k < scenario.samples; ++k) {
        table.reference = loop.thrust(result.x.back());
        for (int step = 0; step < divisions; ++step) {
            const State k1 = slope(table, x), k2 = slope(table, moved(x, k1, h / 2)),
                        k3 = slope(table, moved(x, k2, h / 2)), k4 = slope(table, moved(x, k3, h));
            for (std::size_t i = 0; i < x.size(); ++i) x[i] += h / 6 * (k1[i] + 2 * k2[i] + 2 * k3[i] + k4[i]);
            const bool reversed = table.forward_velocity(x.data()) < 0;
            if (reversed || table.room_left(x.data()) < 0) result.events += table.catch_up(x.data(), 0, reversed);
        }
        result.x.push_back(ReducedTable::position(x.data()));
    }
    result.samples = static_cast<long>(scenario.samples);
    result.steps = divisions * result.samples;
    return result;
}

} // namespace

Contender rk4_by_hand(int divisions) {
    return {fmt::format("RK4 {} us by hand", 500.0 / divisions),
            [divisions](const Scenario& scenario) { return run_rk4(scenario, divisions); }};
}

} // namespace tribode::bench
