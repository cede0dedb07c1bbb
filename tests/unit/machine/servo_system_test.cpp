#include "tribode/base/error.hpp"
#include "tribode/machine/servo_system.hpp"
#include "unit/script/messages.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <numeric>

namespace tribode {
namespace {

constexpr double period = 0.5e-3; // Ts [s]
constexpr double gain = 2;        // k0 [m/(N s^2)]

// A rigid body without friction: every motion has a closed form.
MachineModel free_body(double input_delay = 0, double output_delay = 0) {
    MachineModel m;
    m.sample_time = period;
    m.rigid_gain = gain;
    m.input_delay = input_delay;
    m.output_delay = output_delay;
    return m;
}

OpenLoop thrust(std::function<double(long)> u) {
    return {[u](long k) { return std::array<double, 4>{u(k), 0, 0, 0}; }};
}
OpenLoop no_thrust() {
    return thrust([](long) { return 0.0; });
}
ClosedLoop towards(double reference, double excitation) {
    return {[=](long) { return LoopInput{reference, excitation}; }};
}

// Goes from clock instant to clock instant; between them the thrust is constant and the motion of a free body
// a parabola.
struct FreeRun {
    explicit FreeRun(const ServoSystem& servo)
        : system(servo),
          state(servo.initial_state()),
          next(servo.clocks().size(), 0) {}

    // Handles everything due up to and including `t_end`; `sampled` sees the state after each controller
    // sample.
    void to(
        double t_end, const std::function<void(long k)>& sampled = [](long) {}) {
        constexpr double together = 1e-12; // [s], instants that differ by rounding
        const auto instant = [&](ClockId id) { return system.clocks()[id].instant(next[id]); };
        while (true) {
            const double t = std::min({instant(0), instant(1), instant(2)});
            if (t > t_end + together) break;
            move_to(t);
            for (ClockId id = 0; id < next.size(); ++id) {
                if (instant(id) > t + together) continue;
                effects.push_back(system.on_sample(id, next[id], state));
                if (id == ServoSystem::controller) sampled(next[id]);
                ++next[id];
            }
        }
        move_to(t_end);
    }

    void move_to(double t) {
        std::vector<double> dxdt(state.x.size());
        system.derivative(state.t, state.x, *state.discrete, dxdt);
        const double dt = t - state.t;
        state.x[0] += dt * (dxdt[0] + 0.5 * dt * dxdt[1]);
        state.x[1] += dt * dxdt[1];
        state.t = t;
    }

    const ServoSystem::State& values() const { return ServoSystem::values(state); }

    const ServoSystem& system;
    SystemState state;
    std::vector<long> next;
    std::vector<EventEffect> effects;
};

// y[k] of the first samples.
std::vector<double> detected(const ServoSystem& system, long samples) {
    FreeRun run(system);
    std::vector<double> y;
    run.to(static_cast<double>(samples - 1) * period, [&](long) { y.push_back(run.values().detected); });
    return y;
}

struct Delays {
    double input, output; // samples
};

class Delayed : public ::testing::TestWithParam<Delays> {
  protected:
    const double input = GetParam().input * period, output = GetParam().output * period;
};

INSTANTIATE_TEST_SUITE_P(Samples, Delayed,
                         ::testing::Values(Delays{0, 0}, Delays{1, 0}, Delays{0, 1}, Delays{3, 2}, Delays{0.25, 0},
                                           Delays{0, 0.836}, Delays{1, 0.836}, Delays{0.4, 0.4}, Delays{2.7, 3.1},
                                           Delays{0.001, 0.999}),
                         [](const auto& delays) {
                             return "In" + std::to_string(std::lround(1000 * delays.param.input)) + "Out" +
                                    std::to_string(std::lround(1000 * delays.param.output));
                         });

// Position 0.1 m and velocity 0.3 m/s at t = 0; 5 N from sample 3 on, which acts from 3 Ts + input delay.
TEST_P(Delayed, EverySampleIsThePositionOfTheClosedFormAtItsInstant) {
    const ServoSystem system(free_body(input, output), thrust([](long k) { return k >= 3 ? 5.0 : 0.0; }), 0,
                             {0.1, 0.3});
    const auto y = detected(system, 12);
    ASSERT_EQ(y.size(), 12u);
    for (std::size_t k = 0; k < y.size(); ++k) {
        const double t = static_cast<double>(k) * period - output;
        const double pushed = std::max(0.0, t - 3 * period - input);
        // Rounding of positions near 0.1 m; one sample too early or late would be 1.5e-4 m.
        EXPECT_NEAR(y[k], 0.1 + 0.3 * t + 0.5 * gain * 5 * pushed * pushed, 1e-15) << "k = " << k;
    }
}

TEST_P(Delayed, AThrustActsForOneSampleFromItsInstantOn) {
    const ServoSystem system(free_body(input, output), thrust([](long k) { return k == 2 ? 5.0 : 0.0; }));
    const double begin = 2 * period + input;
    FreeRun before(system), within(system), after(system);
    before.to(begin - 1e-6);
    EXPECT_EQ(before.state.x[1], 0);
    within.to(begin + 0.3 * period);
    EXPECT_NEAR(within.state.x[1], gain * 5 * 0.3 * period, 1e-15); // velocities of the order of 5 mm/s
    after.to(begin + 4 * period);
    EXPECT_NEAR(after.state.x[1], gain * 5 * period, 1e-15);
}

TEST_P(Delayed, ClocksAreOffsetByTheFractionOfASample) {
    const ServoSystem system(free_body(input, output), no_thrust());
    const auto& clocks = system.clocks();
    ASSERT_EQ(clocks.size(), 3u);
    EXPECT_EQ(clocks[0].name + clocks[1].name + clocks[2].name, "encodercontrollerhold");
    const double fraction_in = GetParam().input - std::floor(GetParam().input);
    const double fraction_out = std::ceil(GetParam().output) - GetParam().output;
    EXPECT_NEAR(clocks[ServoSystem::encoder].offset, fraction_out * period, 1e-18);
    EXPECT_EQ(clocks[ServoSystem::controller].offset, 0);
    EXPECT_NEAR(clocks[ServoSystem::hold].offset, fraction_in * period, 1e-18);
    for (const auto& clock : clocks) EXPECT_EQ(clock.period, period);
}

TEST(ServoSystem, ADelayOfWholeSamplesMeetsItsClockExactly) {
    for (int samples = 1; samples <= 200; ++samples) {
        // As a user writes it, which in binary is not always the product.
        const double written = std::stod(std::to_string(5 * samples) + "e-4");
        const ServoSystem system(free_body(written, written), no_thrust());
        EXPECT_EQ(system.clocks()[ServoSystem::encoder].offset, 0) << written;
        EXPECT_EQ(system.clocks()[ServoSystem::hold].offset, 0) << written;
    }
}

TEST(ServoSystem, AtOneInstantTheOrderIsEncoderControllerHold) {
    MachineModel m = free_body();
    m.controller = PidController{.kp = 100, .ki = 0, .kd = 0, .derivative_filter_hz = {}};
    const ServoSystem system(m, towards(0.5, 7), 0, {0.2, 0});
    FreeRun run(system);
    run.to(0);
    EXPECT_EQ(run.values().detected, 0.2);
    EXPECT_EQ(run.values().reference, 0.5);
    EXPECT_DOUBLE_EQ(run.values().thrust, 100 * 0.3 + 7); // on the position just read
    EXPECT_EQ(run.values().plant.input(0), run.values().thrust);
}

// kp = 100, ki = 1/Ts: e = 0.3 twice; the derivative of the error is 0.3/Ts at first and 0 then.
TEST(ServoSystem, ThePidHasItsGainsAndTheSampleTime) {
    MachineModel m = free_body();
    m.rigid_gain = 1e-12; // stays where it is
    m.controller = PidController{.kp = 100, .ki = 1 / period, .kd = period, .derivative_filter_hz = {}};
    const ServoSystem system(m, towards(0.3, 0));
    FreeRun run(system);
    std::vector<double> u;
    run.to(period, [&](long) { u.push_back(run.values().thrust); });
    ASSERT_EQ(u.size(), 2u);
    EXPECT_NEAR(u[0], 30 + 0.3 + 0.3, 1e-11); // the body moves by less than 1e-17 m
    EXPECT_NEAR(u[1], 30 + 0.6, 1e-11);
}

TEST(ServoSystem, TheExcitationIsAddedAfterTheLimitOfTheCascade) {
    MachineModel m = free_body();
    m.controller = CascadeController{.kp = 100, .kv = 10, .limit = 20, .delay_samples = 1};
    const ServoSystem system(m, towards(0.3, 5));
    FreeRun run(system);
    std::vector<double> u;
    run.to(period, [&](long) { u.push_back(run.values().thrust); });
    EXPECT_EQ(u, (std::vector<double>{5, 25})); // the first output of 300 N, limited to 20 N, comes a sample later
}

TEST(ServoSystem, WithoutAControllerItDoesNotRunInClosedLoop) {
    EXPECT_EQ(problem_of([] { ServoSystem(free_body(), towards(0, 0)); }),
              "input: the machine has no controller, so it cannot run in closed loop; give it one or drive it with "
              "u in open loop");
}

TEST(ServoSystem, AControllerIsLeftAloneInOpenLoop) {
    MachineModel m = free_body();
    m.controller = PidController{.kp = 100, .ki = 0, .kd = 0, .derivative_filter_hz = {}};
    const ServoSystem system(m, thrust([](long k) { return static_cast<double>(k) + 1; }), 0, {0.2, 0});
    FreeRun run(system);
    run.to(2 * period);
    EXPECT_EQ(run.values().thrust, 3);
}

TEST(ServoSystem, AThrustBetweenSamplesRunsFromTheInstantOfTheHold) {
    const OpenLoop drive{[](long k) { return std::array<double, 4>{static_cast<double>(k), 2, 4, 8}; }};
    const ServoSystem system(free_body(1.25 * period), drive);
    FreeRun run(system);
    run.to(4.5 * period); // u[3] acts from 4.25 Ts on
    const auto& input = run.values().plant.input;
    // Times near 2 ms, known to 4e-19 s, in samples.
    EXPECT_NEAR(input(4.25 * period), 3, 1e-12);
    EXPECT_NEAR(input(4.75 * period), 3 + 1 + 1 + 1, 1e-12);
}

TEST(ServoSystem, TheIntegratorRestartsOnlyWhereTheThrustChanges) {
    const ServoSystem system(free_body(), thrust([](long k) { return k == 1 ? 5.0 : 0.0; }));
    FreeRun run(system);
    run.to(3 * period);
    using enum EventEffect;
    EXPECT_EQ(run.effects, (std::vector{none, none, none, /**/ none, none, derivative, //
                                        none, none, derivative, /**/ none, none, none}));
}

TEST(ServoSystem, GuardsAreLookedAtAgainWhereTheThrustHoldsTheAxisItself) {
    const auto effect_of_a_jump = [](double current_loop_hz) {
        MachineModel m = free_body();
        m.dry.coulomb = 2;
        m.current_loop_hz = current_loop_hz;
        const ServoSystem system(m, thrust([](long) { return 1.0; }));
        FreeRun run(system);
        run.to(0);
        return run.effects.back();
    };
    EXPECT_EQ(effect_of_a_jump(0), EventEffect::restart);
    EXPECT_EQ(effect_of_a_jump(200), EventEffect::derivative); // the force follows, and does not jump
}

TEST(ServoSystem, InitialStateIsTheDrivenPointsPositionAndVelocity) {
    MachineModel m = free_body();
    m.modes = {{1, 30, 0.01}};
    m.elements = {{1000, 1, 0}};
    m.dry.coulomb = 1;
    const ServoSystem system(m, no_thrust(), 0, {0.1, -0.3});
    const SystemState state = system.initial_state();
    EXPECT_EQ(state.t, 0);
    EXPECT_EQ(state.x, (std::vector<double>{0.1, -0.3, 0, 0}));
    const auto& plant = ServoSystem::values(state).plant;
    EXPECT_EQ(plant.dry, SlipState::slip_backward);
    EXPECT_EQ(plant.rolling.force, 0);
    const auto out = system.outputs(state);
    EXPECT_EQ(out.position, 0.1);
    EXPECT_EQ(out.velocity, -0.3);
    EXPECT_DOUBLE_EQ(out.friction, -1);
}

TEST(ServoSystem, ACopyOfTheStateIsASnapshot) {
    const ServoSystem system(free_body(period, period), thrust([](long k) { return k + 1.0; }));
    FreeRun run(system);
    run.to(4 * period);
    const SystemState copy = run.state;
    const double y = ServoSystem::values(copy).detected;
    run.to(8 * period);
    EXPECT_EQ(ServoSystem::values(copy).detected, y);
    EXPECT_NE(run.values().detected, y);
}

// ---- noise

double rms(const std::vector<double>& x) {
    return std::sqrt(std::inner_product(x.begin(), x.end(), x.begin(), 0.0) / static_cast<double>(x.size()));
}

constexpr long many = 4000; // a sample rms of so many is known to 1/sqrt(2 * 4000) = 1.1 %

MachineModel noisy_body(double output_delay = 0) {
    MachineModel m = free_body(0, output_delay);
    m.noise_rms = 1e-6;
    return m;
}

TEST(ServoSystemNoise, OfTheSensorHasItsSizeAndIsReproducible) {
    const auto y = detected(ServoSystem(noisy_body(), no_thrust(), 11), many);
    EXPECT_NEAR(rms(y), 1e-6, 0.05e-6);
    EXPECT_EQ(detected(ServoSystem(noisy_body(), no_thrust(), 11), many), y);
    EXPECT_NE(detected(ServoSystem(noisy_body(), no_thrust(), 12), many), y);
}

// Also of the samples whose instants lie before t = 0.
TEST(ServoSystemNoise, OfSampleKIsTheSameWhateverTheDelay) {
    const auto y = detected(ServoSystem(noisy_body(), no_thrust(), 11), 20);
    for (const double delay : {1.0, 2.5, 7.0}) {
        EXPECT_EQ(detected(ServoSystem(noisy_body(delay * period), no_thrust(), 11), 20), y) << delay;
    }
}

TEST(ServoSystemNoise, IsAddedBeforeRounding) {
    MachineModel m = noisy_body();
    m.encoder_resolution = 0x1p-20; // 0.95 um: multiples are exact
    const auto y = detected(ServoSystem(m, no_thrust(), 11), 200);
    for (const double value : y) EXPECT_EQ(value * 0x1p20, std::round(value * 0x1p20));
    EXPECT_GT(rms(y), 0.5e-6);
}

TEST(ServoSystemNoise, OfTheForceIsANewOneEachSample) {
    MachineModel m = free_body();
    m.process_noise_rms = 0.3;
    const auto forces = [&](std::uint64_t seed) {
        const ServoSystem system(m, no_thrust(), seed);
        FreeRun run(system);
        std::vector<double> f;
        run.to(static_cast<double>(many - 1) * period, [&](long) { f.push_back(run.values().plant.disturbance); });
        return f;
    };
    const auto f = forces(11);
    EXPECT_NEAR(rms(f), 0.3, 0.015);
    EXPECT_EQ(forces(11), f);
    EXPECT_NE(forces(12), f);
    // Neighbors and the sensor's noise are independent: five standard deviations.
    const auto y = detected(ServoSystem(noisy_body(), no_thrust(), 11), many);
    const double most = 5 / std::sqrt(static_cast<double>(many));
    const double scale = 1 / static_cast<double>(many);
    EXPECT_LT(std::abs(std::inner_product(f.begin(), f.end() - 1, f.begin() + 1, 0.0)) * scale, most * 0.09);
    EXPECT_LT(std::abs(std::inner_product(f.begin(), f.end(), y.begin(), 0.0)) * scale, most * 0.3e-6);
}

// One element with the limit 0.01 m and D = 5 N s/m, D_v = 2 N s/m; a P controller of 10 N/m.
MachineModel body_with_friction() {
    MachineModel m = free_body();
    m.elements = {{100, 1, 5}};
    m.viscous = 2;
    m.controller = PidController{10, 0, 0, 0};
    return m;
}

// u at the samples k = first, first + 1, ... of a body that is put to these positions.
std::vector<double> thrust_at(const ServoSystem& system, SystemState& state, const std::vector<double>& positions,
                              long first = 0) {
    std::vector<double> u;
    for (std::size_t i = 0; i < positions.size(); ++i) {
        const long k = first + static_cast<long>(i);
        state.x[0] = positions[i];
        system.on_sample(ServoSystem::encoder, k, state);
        system.on_sample(ServoSystem::controller, k, state);
        u.push_back(ServoSystem::values(state).thrust);
    }
    return u;
}

// Rounding: positions near 0.3 m are known to 5e-17 m, and divided by 0.5 ms.
constexpr double velocity_rounding = 1e-11;

TEST(FrictionFeedback, AddsItsShareOfTheModelledFrictionToTheThrust) {
    for (const double share : {0.0, 0.8, 1.2}) {
        const ServoSystem system(body_with_friction(), ClosedLoop{[](long) { return LoopInput{0.1, 7}; }, share});
        SystemState state = system.initial_state();
        const std::vector<double> y = {0.300, 0.304, 0.312, 0.311};
        // First sample: the reference of the elements. Stick with z = 4 mm, v = 8 m/s; slip, no D, v = 16 m/s; back from
        // the limit with v = -2 m/s.
        const std::vector<double> friction = {0, 0.4 + 5 * 8 + 2 * 8, 1 + 2 * 16, 0.9 - 5 * 2 - 2 * 2};
        const auto u = thrust_at(system, state, y);
        for (std::size_t k = 0; k < y.size(); ++k) {
            EXPECT_NEAR(u[k], 10 * (0.1 - y[k]) + 7 + share * friction[k], velocity_rounding) << share << ", " << k;
        }
    }
}

TEST(FrictionFeedback, IsPartOfASnapshotAndBeginsAnewWithEachRun) {
    const ServoSystem system(body_with_friction(), ClosedLoop{[](long) { return LoopInput{}; }, 1});
    SystemState state = system.initial_state();
    const std::vector<double> before = {0.300, 0.304}, after = {0.312, 0.311};
    thrust_at(system, state, before);
    SystemState snapshot = state;
    const auto u = thrust_at(system, state, after, 2);
    EXPECT_EQ(thrust_at(system, snapshot, after, 2), u);
    SystemState anew = system.initial_state();
    EXPECT_NEAR(thrust_at(system, anew, {0.5})[0], -5, velocity_rounding);
}

TEST(FrictionFeedback, AShareBelowZeroIsRefused) {
    for (const double share : {-0.1, std::nan("")}) {
        EXPECT_THROW(ServoSystem(body_with_friction(), ClosedLoop{[](long) { return LoopInput{}; }, share}),
                     InputError);
    }
}

} // namespace
} // namespace tribode
