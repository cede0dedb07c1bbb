#pragma once
#include "tribode/hybrid/hybrid_system.hpp"
#include "tribode/solver/integrator.hpp"

#include <functional>
#include <gtest/gtest.h>
#include <string>
#include <vector>

namespace tribode {

// A hybrid system out of functions, for small systems inside a test. What is not given is absent.
class FunctionSystem final : public HybridSystem {
  public:
    struct Memory final : DiscreteValues<Memory> {
        std::vector<double> value;
    };
    static const std::vector<double>& memory(const SystemState& state) {
        return static_cast<const Memory&>(*state.discrete).value;
    }

    using Values = std::span<const double>;
    using Held = const std::vector<double>&; // the discrete values

    std::vector<double> start;        // of the continuous states
    std::vector<double> start_memory; // of the discrete values
    std::vector<SampleClock> sample_clocks;
    std::function<void(double t, Values x, Held d, std::span<double> dxdt)> slope;
    std::function<void(double t, Values x, std::span<double> matrix)> matrix; // empty: none
    std::vector<std::function<double(double t, Values x, Held d)>> guard;
    std::function<EventEffect(GuardId, double t, std::vector<double>& x, std::vector<double>& d)> crossing;
    std::function<EventEffect(ClockId, long k, double t, std::vector<double>& x, std::vector<double>& d)> sample;

    // How often the functions were called, to be compared with the statistics of a run.
    mutable long slope_calls = 0, guard_calls = 0, matrix_calls = 0;

    const std::vector<StateVariable>& states() const override {
        variables_.assign(start.size(), StateVariable{"x", "m"});
        return variables_;
    }
    const std::vector<SampleClock>& clocks() const override { return sample_clocks; }
    std::size_t guard_count() const override { return guard.size(); }
    SystemState initial_state() const override {
        auto values = std::make_unique<Memory>();
        values->value = start_memory;
        return {0.0, start, std::move(values)};
    }
    void derivative(double t, Values x, const DiscreteState& d, std::span<double> dxdt) const override {
        ++slope_calls;
        if (slope) slope(t, x, static_cast<const Memory&>(d).value, dxdt);
    }
    bool jacobian(double t, Values x, const DiscreteState&, std::span<double> values) const override {
        if (!matrix) return false;
        ++matrix_calls;
        matrix(t, x, values);
        return true;
    }
    void guards(double t, Values x, const DiscreteState& d, std::span<double> g) const override {
        ++guard_calls;
        for (GuardId i = 0; i < guard.size(); ++i) g[i] = guard[i](t, x, static_cast<const Memory&>(d).value);
    }
    EventEffect on_crossing(GuardId id, SystemState& state, EventLog& log) const override {
        log.push_back({state.t, static_cast<int>(id), 0});
        return crossing(id, state.t, state.x, static_cast<Memory&>(*state.discrete).value);
    }
    EventEffect on_sample(ClockId id, long k, SystemState& state) const override {
        return sample ? sample(id, k, state.t, state.x, static_cast<Memory&>(*state.discrete).value)
                      : EventEffect::none;
    }
    std::string guard_name(GuardId id, const SystemState&) const override { return "guard " + std::to_string(id); }

  private:
    mutable std::vector<StateVariable> variables_;
};

// x' = -x, x(0) = 1.
inline FunctionSystem decay() {
    FunctionSystem system;
    system.start = {1.0};
    system.slope = [](double, auto x, auto&, auto dxdt) { dxdt[0] = -x[0]; };
    return system;
}

// x'' = -x, x(0) = 1, x'(0) = 0: x = cos t.
inline FunctionSystem oscillator() {
    FunctionSystem system;
    system.start = {1.0, 0.0};
    system.slope = [](double, auto x, auto&, auto dxdt) {
        dxdt[0] = x[1];
        dxdt[1] = -x[0];
    };
    return system;
}

// A ball of height x[0] that leaves the floor with `restitution` times the speed it came with.
inline FunctionSystem bouncing_ball(double height, double gravity, double restitution) {
    FunctionSystem system;
    system.start = {height, 0.0};
    system.slope = [gravity](double, auto x, auto&, auto dxdt) {
        dxdt[0] = x[1];
        dxdt[1] = -gravity;
    };
    system.guard = {[](double, auto x, auto&) { return x[0]; }};
    system.crossing = [restitution](GuardId, double, auto& x, auto&) {
        x = {0.0, -restitution * x[1]};
        return EventEffect::restart;
    };
    return system;
}

// The names of parameterized tests.
inline std::string method_of(const testing::TestParamInfo<Method>& test) { return name_of(test.param); }

inline SolverOptions tight(Method method) {
    return {.method = method, .relative_tolerance = 1e-10, .absolute_tolerance = 1e-12, .fixed_step = 1e-3};
}

} // namespace tribode
