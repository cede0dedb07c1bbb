#include "tribode/base/error.hpp"
#include "tribode/experiment/system_run.hpp"
#include "tribode/fmu/fmu_export.hpp"
#include "tribode/system/equations_json.hpp"
#include "tribode/system/system_builder.hpp"
#include "unit/fmu/units.hpp"

#include <cmath>

namespace tribode {
namespace {

// A mass that a sampled controller holds, pushed by an input, between walls that it bounces off: affine.
Equations pushed_mass() {
    SystemBuilder builder("pushed mass");
    const Expression x = builder.state("x", 0, "m"), v = builder.state("v", 0.5, "m/s");
    const Expression u = builder.discrete("u", 0, "N");
    const auto graph = builder.time().graph();
    const Expression push(graph, graph->variable("push")), mass(graph, graph->variable("mass"));
    builder.rate(x, v);
    builder.rate(v, (u + push) / mass);
    builder.when("wall", x > 0.05, {{v, -0.5 * v}});
    builder.sample("control", 1e-2, 3e-3, {{u, -40 * x - 4 * v + 0.1 * push}});
    builder.output("power", push * v, "W");
    builder.output("position", x, "m");
    Equations made = builder.equations();
    made.inputs.push_back({"push", "N", 1.5, push.in(*made.graph)});
    made.parameters.push_back({"mass", "kg", 2, mass.in(*made.graph)});
    return made;
}

// A block on a belt whose speed is an input.
Equations block_on_a_belt() {
    SystemBuilder builder("block");
    const Expression v = builder.state("v", 0.5, "m/s"), mode = builder.discrete("f.mode", 0);
    const auto graph = builder.time().graph();
    const Expression belt(graph, graph->variable("belt")), force(graph, graph->variable("f.force"));
    const Expression velocity = v - belt;
    builder.rate(v, -force);
    Equations made = builder.equations();
    made.inputs.push_back({"belt", "m/s", 0, belt.in(*made.graph)});
    made.contacts.push_back({.name = "f",
                             .force = force.in(*made.graph),
                             .mode = mode.in(*made.graph),
                             .quantity = velocity.in(*made.graph),
                             .level = made.graph->constant(1),
                             .release = made.graph->constant(1)});
    return made;
}

Equations bouncing_ball() {
    SystemBuilder builder("ball");
    const Expression h = builder.state("h", 1, "m"), v = builder.state("v", 0, "m/s");
    builder.rate(h, v);
    builder.rate(v, -9.81 - 0.01 * v * v * where(v > 0, 1, -1));
    builder.when("impact", h < 0, {{h, 0}, {v, -0.8 * v}});
    builder.stop_when("high", h > 5, {});
    builder.output("height", h, "m");
    return builder.equations();
}

FmuOptions options(FmiVersion version, bool model_exchange = false) {
    return {.version = version, .model_exchange = model_exchange, .name = "unit"};
}

SystemRun own_run(const Equations& equations, double end, double step) {
    SystemRunOptions run;
    run.end = end;
    run.output_step = step;
    return run_system(EquationSystem(equations), run);
}

TEST(SystemUnit, ASystemWithClocksAndEventsIsThatOfTheProgram) {
    const UnpackedUnit unit(fmu_of_system(pushed_mass(), options(FmiVersion::fmi2)));
    const Fmi2Unit one(unit);
    one.initialize();
    const double step = 1e-3;
    const SystemRun own = own_run(pushed_mass(), 1, step);
    ASSERT_EQ(own.method, Method::exact);
    ASSERT_GT(own.events.size(), 0u);
    for (std::size_t k = 0; k < own.table.rows(); ++k) {
        for (const char* name : {"x", "v", "u", "power", "position"}) {
            ASSERT_NEAR(one.get(name), own.table.find(name)->values[k], 1e-12) << name << " " << k;
        }
        ASSERT_EQ(one.step(static_cast<double>(k) * step, step), fmi2OK) << last_message();
    }
}

// Fifty samples in each communication step, whose instants differ from the communication points by rounding.
TEST(SystemUnit, AValueAtASampleIsTheLeftLimitHoweverItIsRounded) {
    SystemBuilder builder("counter");
    const Expression x = builder.state("x", 0), samples = builder.discrete("samples", 0);
    builder.rate(x, 1 + 0 * x);
    builder.sample("count", 1e-4, 0, {{samples, samples + 1}, {x, 0}});
    const UnpackedUnit unit(fmu_of_system(builder.equations(), options(FmiVersion::fmi2)));
    const Fmi2Unit one(unit);
    one.initialize();
    for (int i = 0; i < 100; ++i) {
        ASSERT_EQ(one.get("samples"), 50.0 * i) << i;
        ASSERT_EQ(one.step(i * 5e-3, 5e-3), fmi2OK) << last_message();
    }
}

// An input acts from the communication point at which it is set, on sampled parts of this instant, too.
TEST(SystemUnit, AnInputActsAtOnce) {
    const UnpackedUnit unit(fmu_of_system(pushed_mass(), options(FmiVersion::fmi3)));
    const Fmi3Unit one(unit);
    one.set("v", -0.1); // away from the wall
    one.initialize();
    const double at = 0.103; // of a sample
    ASSERT_EQ(one.step(0, at).status, fmi3OK) << last_message();
    ASSERT_EQ(one.set("push", -4), fmi3OK);
    EXPECT_DOUBLE_EQ(one.get("power"), -4 * one.get("v"));
    const double x = one.get("x"), v = one.get("v");
    ASSERT_EQ(one.step(at, 5e-3).status, fmi3OK);
    const double u = -40 * x - 4 * v + 0.1 * -4;
    EXPECT_NEAR(one.get("u"), u, 1e-12);
    EXPECT_NEAR(one.get("v"), v + 5e-3 * (u - 4) / 2, 1e-12);
}

TEST(SystemUnit, ParametersAndStartValuesAreSetBefore) {
    Equations other = pushed_mass();
    other.parameters[0].value = 3.5;
    other.states[1].start = -0.25;
    const UnpackedUnit unit(fmu_of_system(pushed_mass(), options(FmiVersion::fmi3)));
    const Fmi3Unit one(unit);
    ASSERT_EQ(one.set("mass", 3.5), fmi3OK);
    ASSERT_EQ(one.set("v", -0.25), fmi3OK);
    one.initialize();
    EXPECT_EQ(one.get("v"), -0.25);
    ASSERT_EQ(one.step(0, 0.5).status, fmi3OK);
    EXPECT_NEAR(one.get("x"), own_run(other, 0.5, 0.5).table.find("x")->values.back(), 1e-12);
    EXPECT_EQ(one.set("power", 1), fmi3Error);
}

TEST(SystemUnit, ASystemThatIsNotAffineComesNearTheTruth) {
    const Equations ball = bouncing_ball();
    const UnpackedUnit unit(fmu_of_system(ball, options(FmiVersion::fmi2)));
    const Fmi2Unit one(unit);
    one.initialize();
    const SystemRun own = own_run(ball, 1.5, 0.01);
    ASSERT_EQ(own.events.size(), 2u);
    for (std::size_t k = 0; k < own.table.rows(); ++k) {
        ASSERT_NEAR(one.get("height"), own.table.find("height")->values[k], 2e-7) << k;
        ASSERT_EQ(one.step(static_cast<double>(k) * 0.01, 0.01), fmi2OK) << last_message();
    }
}

TEST(SystemUnit, AnEventThatEndsTheRunEndsTheUnit) {
    Equations up = bouncing_ball();
    up.states[1].start = 12;
    const double end = own_run(up, 3, 0.01).outcome.t;
    {
        const UnpackedUnit unit(fmu_of_system(up, options(FmiVersion::fmi2)));
        const Fmi2Unit one(unit);
        one.initialize();
        EXPECT_EQ(one.step(0, 3), fmi2Discard);
        fmi2Boolean terminated = fmi2False;
        double time = 0;
        unit.function<fmi2GetBooleanStatusTYPE>("fmi2GetBooleanStatus")(one.c, fmi2Terminated, &terminated);
        unit.function<fmi2GetRealStatusTYPE>("fmi2GetRealStatus")(one.c, fmi2LastSuccessfulTime, &time);
        EXPECT_TRUE(terminated);
        EXPECT_NEAR(time, end, 1e-7);
    }
    const UnpackedUnit unit(fmu_of_system(up, options(FmiVersion::fmi3)));
    const Fmi3Unit one(unit);
    one.initialize();
    const auto step = one.step(0, 3);
    EXPECT_EQ(step.status, fmi3OK);
    EXPECT_TRUE(step.terminate && step.early);
    EXPECT_NEAR(step.last_time, end, 1e-7);
    EXPECT_NEAR(one.get("height"), 5, 1e-6);
}

// A classical method with small steps and bisection of the indicators stands for the importing program.
TEST(SystemUnit, ModelExchangeGivesRatesIndicatorsAndEvents) {
    const UnpackedUnit unit(fmu_of_system(bouncing_ball(), options(FmiVersion::fmi2, true)));
    const Fmi2Unit one(unit, fmi2ModelExchange);
    one.initialize();
    const auto new_states = [&] {
        fmi2EventInfo info{};
        EXPECT_EQ(one.call("fmi2EnterEventMode"), fmi2OK);
        EXPECT_EQ(unit.function<fmi2NewDiscreteStatesTYPE>("fmi2NewDiscreteStates")(one.c, &info), fmi2OK)
            << last_message();
        EXPECT_FALSE(info.newDiscreteStatesNeeded);
        EXPECT_EQ(one.call("fmi2EnterContinuousTimeMode"), fmi2OK);
        return info;
    };
    const auto put = [&](double t, const std::array<double, 2>& x) {
        unit.function<fmi2SetTimeTYPE>("fmi2SetTime")(one.c, t);
        unit.function<fmi2SetContinuousStatesTYPE>("fmi2SetContinuousStates")(one.c, x.data(), 2);
    };
    const auto rate = [&](double t, const std::array<double, 2>& x) {
        std::array<double, 2> dx{};
        put(t, x);
        EXPECT_EQ(unit.function<fmi2GetDerivativesTYPE>("fmi2GetDerivatives")(one.c, dx.data(), 2), fmi2OK);
        return dx;
    };
    const std::string count = "numberOfEventIndicators=\"";
    std::vector<double> z(std::stoul(unit.description().substr(unit.description().find(count) + count.size())));
    ASSERT_GE(z.size(), 3u);
    const auto crossed = [&](double t, const std::array<double, 2>& x) {
        put(t, x);
        EXPECT_EQ(unit.function<fmi2GetEventIndicatorsTYPE>("fmi2GetEventIndicators")(one.c, z.data(), z.size()),
                  fmi2OK);
        return std::any_of(z.begin(), z.end(), [](double value) { return value < 0; });
    };
    const auto step = [&](double t, const std::array<double, 2>& x, double h) {
        const auto add = [](std::array<double, 2> a, double s, const std::array<double, 2>& b) {
            for (int i = 0; i < 2; ++i) a[i] += s * b[i];
            return a;
        };
        const auto k1 = rate(t, x), k2 = rate(t + h / 2, add(x, h / 2, k1)), k3 = rate(t + h / 2, add(x, h / 2, k2));
        const auto k4 = rate(t + h, add(x, h, k3));
        return add(add(add(add(x, h / 6, k1), h / 3, k2), h / 3, k3), h / 6, k4);
    };
    new_states();
    std::array<double, 2> x{};
    ASSERT_EQ(unit.function<fmi2GetContinuousStatesTYPE>("fmi2GetContinuousStates")(one.c, x.data(), 2), fmi2OK);
    EXPECT_EQ(x[0], 1);
    double t = 0;
    int bounces = 0;
    while (t < 1.5 - 1e-12) {
        double h = std::min(1e-3, 1.5 - t);
        if (crossed(t + h, step(t, x, h))) {
            double low = 0, high = h;
            for (int i = 0; i < 60; ++i) {
                const double middle = (low + high) / 2;
                (crossed(t + middle, step(t, x, middle)) ? high : low) = middle;
            }
            x = step(t, x, high);
            put(t += high, x);
            if (new_states().valuesOfContinuousStatesChanged) ++bounces;
            unit.function<fmi2GetContinuousStatesTYPE>("fmi2GetContinuousStates")(one.c, x.data(), 2);
            continue;
        }
        x = step(t, x, h);
        put(t += h, x);
    }
    const SystemRun own = own_run(bouncing_ball(), 1.5, 1.5);
    EXPECT_EQ(bounces, 2);
    EXPECT_NEAR(x[0], own.table.find("h")->values.back(), 1e-6);
    EXPECT_NEAR(one.get("height"), x[0], 0);
}

std::string refusal(const Equations& equations, bool model_exchange) {
    try {
        fmu_of_system(equations, options(FmiVersion::fmi2, model_exchange));
        return "";
    } catch (const InputError& problem) {
        return problem.what();
    }
}

TEST(SystemUnit, WhatCannotBeOneIsRefusedWithTheReason) {
    EXPECT_NE(refusal(pushed_mass(), true).find("sample clock control"), std::string::npos);
    EXPECT_NE(refusal(block_on_a_belt(), true).find("how the input belt changes"), std::string::npos);
    EXPECT_EQ(refusal(block_on_a_belt(), false), "");
    Equations calls = pushed_mass();
    calls.clocks[0].function = Equations::Function{};
    EXPECT_NE(refusal(calls, false).find("calls a function of the script"), std::string::npos);
    Equations delayed = pushed_mass();
    auto& graph = *delayed.graph;
    delayed.outputs[0].value = graph.make(Op::delay, delayed.inputs[0].symbol, graph.constant(0.1));
    EXPECT_NE(refusal(delayed, false).find("is an input of an earlier time"), std::string::npos);
}

TEST(EquationsJson, AreReadAsTheyWereWritten) {
    SystemBuilder builder("all of it");
    const Expression x = builder.state("x", 0.5, "m"), y = builder.state("y", 0.1, "m");
    auto& graph = *builder.time().graph();
    LookupTable::Points points;
    points.name = "stiffness";
    points.x = {0, 0.5, 1, 2};
    points.values = {0, 3, 4, 4.5};
    points.extrapolation = LookupTable::Extrapolation::hold;
    const auto table = std::make_shared<const LookupTable>(points);
    const Expression force(builder.time().graph(), graph.look_up(table, x.in(graph), 0));
    const Term slope = graph.derivatives(std::vector{force.in(graph)}, x.in(graph))[0];
    builder.rate(x, y + floor(builder.time()) - 1e300 * (1e300 * y) * 0.1);
    builder.rate(y, -force - Expression(builder.time().graph(), slope) * y);
    builder.output("root", where(x < 1e308 * 10, pow(x, 3), tanh(y)));
    const Equations written = builder.equations();
    const Json json = equations_json(written);
    const Equations read = equations_from(Json::parse(json.dump()));
    EXPECT_EQ(read.fingerprint(), written.fingerprint());
    EXPECT_EQ(equations_json(read), json);
    EXPECT_THROW(equations_from({{"name", "x"}}), InputError);
}

} // namespace
} // namespace tribode
