// The exact servo against closed forms: nothing here solves an equation of motion twice by the same means.
#include "problems/exact_servo.hpp"
#include "problems/golden_runs.hpp"

#include <cmath>
#include <gtest/gtest.h>
#include <numbers>
#include <stdexcept>

namespace tribode::problems {
namespace {

constexpr double pi = std::numbers::pi;

// Positions here are about 1e-4 m and velocities about 0.1 m/s: a double holds them to 1e-20 m and 1e-17 m/s,
// and the closed forms lose a few digits in sums of hundreds of terms.
constexpr double position_tolerance = 1e-17;
constexpr double velocity_tolerance = 1e-15;
// The resolution of a double near 0.1 s is 1.4e-17 s, that of the event search 3e-17 s.
constexpr double time_tolerance = 1e-16;

std::vector<double> constant(double value, std::size_t count) { return std::vector<double>(count, value); }

void expect_event(const ServoEvent& event, double t, int element, EventKind kind) {
    EXPECT_NEAR(event.t, t, time_tolerance);
    EXPECT_EQ(event.element, element);
    EXPECT_EQ(event.kind, kind);
}

// --- without friction ---

// Position at time t after a unit step of thrust: eq. (1) of the paper in closed form.
double step_response(const ServoProblem& p, double t) {
    if (t <= 0) return 0.0;
    double y = p.rigid_gain * t * t / 2;
    for (const auto& mode : p.modes) {
        const double w = 2 * pi * mode.freq_hz, root = std::sqrt(1 - mode.zeta * mode.zeta);
        const double decay = std::exp(-mode.zeta * w * t);
        y += mode.gain / (w * w) * (1 - decay * (std::cos(w * root * t) + mode.zeta / root * std::sin(w * root * t)));
    }
    return y;
}

// The modes' answer in the first steps is a difference of near-equal numbers in the closed form: 1e-16 of
// k/w^2 = 3e-7. Their sum over 200 steps of up to 3 N stays below 1e-17.
TEST(ExactServo, without_friction_is_the_sum_of_step_responses_also_with_a_fractional_delay) {
    ServoProblem p = linear_motor_table();
    p.elements.clear();
    p.viscous = 0.0;
    const double delay = 0.3 * p.sample_time;
    const auto u = sampled_sine(15.0, 34.0, p.sample_time, 200);
    const ServoSolution s = solve_exactly(p, u, delay);
    double largest = 0.0;
    for (std::size_t n = 0; n < u.size(); ++n) {
        double y = 0.0;
        for (std::size_t k = 0; k <= n; ++k)
            y += (u[k] - (k ? u[k - 1] : 0.0)) * step_response(p, (n - k) * p.sample_time - delay);
        EXPECT_NEAR(s.x[n], y, position_tolerance) << n;
        largest = std::max(largest, std::abs(y));
    }
    EXPECT_GT(largest, 1e-4); // or the tolerance would mean nothing
    EXPECT_TRUE(s.events.empty());
}

TEST(ExactServo, the_lag_delays_a_rigid_body_by_its_time_constant) {
    const ServoProblem p{.rigid_gain = 0.1, .lag_hz = 750.0};
    const double tau = 1 / (2 * pi * 750.0);
    const ServoSolution s = solve_exactly(p, constant(10.0, 60));
    for (std::size_t k = 0; k < s.t.size(); ++k) {
        const double t = s.t[k], gone = 1 - std::exp(-t / tau);
        EXPECT_NEAR(s.v[k], t - tau * gone, velocity_tolerance);
        EXPECT_NEAR(s.x[k], t * t / 2 - tau * t + tau * tau * gone, position_tolerance * 10) << t; // x to 4e-4 m
    }
}

TEST(ExactServo, viscous_friction_settles_a_rigid_body_exponentially) {
    const ServoProblem p{.rigid_gain = 0.1, .viscous = 50.0};
    const ServoSolution s = solve_exactly(p, constant(10.0, 400));
    for (std::size_t k = 0; k < s.t.size(); ++k) {
        const double v = 0.2 * (1 - std::exp(-5 * s.t[k])); // u/D_v, 1/(k0 D_v)
        EXPECT_NEAR(s.v[k], v, velocity_tolerance);
        EXPECT_NEAR(s.f[k], 50 * v, 1e-13); // D_v times the tolerance of v
    }
}

// --- one element ---

// 10 kg on a spring of 1e5 N/m that slips at 1 N: w = 100 rad/s, limit 10 um.
const ServoProblem one_element{.rigid_gain = 0.1, .elements = {{1e5, 1.0}}, .sample_time = 0.001};

TEST(ExactServo, one_element_is_a_spring_until_its_limit_and_a_constant_force_after) {
    const double u = 3.0, slip_time = std::acos(1 - 1 / u) / 100, slip_speed = u * 1e-3 * std::sin(100 * slip_time);
    const ServoSolution s = solve_exactly(one_element, constant(u, 40));
    ASSERT_EQ(s.events.size(), 1u);
    expect_event(s.events[0], slip_time, 1, EventKind::slip_forward);
    for (std::size_t k = 0; k < s.t.size(); ++k) {
        const double t = s.t[k], since = t - slip_time;
        const bool sticks = since < 0;
        const double x = sticks ? u * 1e-5 * (1 - std::cos(100 * t)) : 1e-5 + slip_speed * since + 0.1 * since * since;
        EXPECT_NEAR(s.x[k], x, position_tolerance) << t;
        EXPECT_NEAR(s.v[k], sticks ? u * 1e-3 * std::sin(100 * t) : slip_speed + 0.2 * since, velocity_tolerance);
        EXPECT_NEAR(s.f[k], sticks ? 1e5 * x : 1.0, 1e5 * position_tolerance); // K times the tolerance of x
    }
}

TEST(ExactServo, a_reversal_makes_the_element_stick_and_it_slips_back_after_twice_its_limit) {
    std::vector<double> u = constant(3.0, 60);
    for (std::size_t k = 20; k < u.size(); ++k) u[k] = -3.0;
    const ServoSolution s = solve_exactly(one_element, u);
    ASSERT_EQ(s.events.size(), 3u);
    // From the instant of the jump -(3 + 1) N brake, that is 0.4 m/s^2.
    const double reversal = s.t[20] + s.v[20] / 0.4, turning_point = s.x[20] + s.v[20] * s.v[20] / 0.8;
    expect_event(s.events[1], reversal, 1, EventKind::stick);
    // Back: the spring holds +1 N, so it swings about -3 N with an amplitude of 4 N, and slips at -1 N.
    const double slip = reversal + std::acos(0.5) / 100;
    expect_event(s.events[2], slip, 1, EventKind::slip_backward);
    const double since = s.t[59] - slip, speed = 4e-3 * std::sin(std::acos(0.5));
    EXPECT_NEAR(s.x[59], turning_point - 2e-5 - speed * since - 0.1 * since * since, 10 * position_tolerance);
}

// A closed form with damping D in stick: zeta = k0 D/(2 w) = 0.25. At the slip the force falls by D v at
// once.
TEST(ExactServo, the_damping_of_an_element_acts_in_stick_only) {
    ServoProblem p = one_element;
    p.elements[0].D = 500.0;
    const double u = 3.0, zeta = 0.25, root = std::sqrt(1 - zeta * zeta), w = 100.0;
    const ServoSolution s = solve_exactly(p, constant(u, 40));
    ASSERT_EQ(s.events.size(), 1u);
    const auto speed = [&](double t) { return u * 1e-3 / root * std::exp(-zeta * w * t) * std::sin(w * root * t); };
    const double slip = s.events[0].t;
    for (std::size_t k = 0; k < s.t.size(); ++k) {
        const double t = s.t[k];
        EXPECT_NEAR(s.v[k], t < slip ? speed(t) : speed(slip) + 0.2 * (t - slip), velocity_tolerance);
        if (t > slip) {
            EXPECT_EQ(s.f[k], 1.0);
        }
    }
}

// --- Coulomb level ---

// 10 kg, 10 N.
const ServoProblem block{.rigid_gain = 0.1, .coulomb = 10.0, .sample_time = 0.001};

TEST(ExactServo, a_block_below_the_coulomb_level_stays_where_it_is) {
    const ServoSolution s = solve_exactly(block, sampled_sine(9.999, 10.0, block.sample_time, 200));
    EXPECT_TRUE(s.events.empty());
    for (std::size_t k = 1; k < s.t.size(); ++k) {
        EXPECT_EQ(s.x[k], 0.0);
        EXPECT_EQ(s.v[k], 0.0);
    }
    EXPECT_EQ(s.f[26], 9.999 * std::sin(2 * pi * 10.0 * 0.025)); // left limit: the constraint carries u[25]
}

TEST(ExactServo, a_block_stops_where_energy_says_and_starts_again_when_pushed_beyond_the_level) {
    std::vector<double> u = constant(15.0, 20); // 0.5 m/s^2 for 20 ms: 10 mm/s at 0.1 mm
    u.resize(40, 7.0);                          // brakes with 3 N, 0.3 m/s^2: stops after 33.3 ms ...
    u.resize(100, -9.0);                        // ... unless at 40 ms 19 N begin to brake, 1.9 m/s^2
    u.resize(120, -12.0);                       // and back with 0.2 m/s^2
    const ServoSolution s = solve_exactly(block, u);
    const double stop = 0.04 + 0.004 / 1.9, where = 1e-4 + 0.02 * 0.007 + 0.004 * 0.004 / 3.8;
    ASSERT_EQ(s.events.size(), 3u);
    expect_event(s.events[0], 0.0, 0, EventKind::slip_forward);
    expect_event(s.events[1], stop, 0, EventKind::stick);
    expect_event(s.events[2], 0.1, 0, EventKind::slip_backward);
    EXPECT_NEAR(s.x[100], where, position_tolerance);
    EXPECT_EQ(s.x[50], s.x[100]);
    EXPECT_EQ(s.v[50], 0.0);
    EXPECT_EQ(s.f[50], -9.0);
    EXPECT_NEAR(s.x[119], where - 0.1 * 0.019 * 0.019, position_tolerance);
    EXPECT_EQ(s.f[119], -10.0);
}

TEST(ExactServo, a_block_pushed_hard_goes_straight_through_the_level) {
    std::vector<double> u = constant(15.0, 20);
    u.resize(40, -30.0); // 40 N brake the 10 mm/s, 4 m/s^2; then 20 N push back
    const ServoSolution s = solve_exactly(block, u);
    ASSERT_EQ(s.events.size(), 3u);
    expect_event(s.events[1], 0.0225, 0, EventKind::stick);
    expect_event(s.events[2], 0.0225, 0, EventKind::slip_backward);
    EXPECT_NEAR(s.v[39], -2.0 * 0.0165, velocity_tolerance);
}

TEST(ExactServo, behind_a_lag_the_level_gives_way_when_the_thrust_has_grown_to_it) {
    ServoProblem p = block;
    p.lag_hz = 20.0;
    const double corner = 2 * pi * 20.0, release = -std::log(1 - 10.0 / 15.0) / corner;
    const ServoSolution s = solve_exactly(p, constant(15.0, 100));
    ASSERT_EQ(s.events.size(), 1u);
    expect_event(s.events[0], release, 0, EventKind::slip_forward);
    const double since = s.t[99] - release; // the excess is 5 N (1 - exp(-corner since))
    EXPECT_NEAR(s.v[99], 0.5 * (since + (std::exp(-corner * since) - 1) / corner), velocity_tolerance);
}

// While the driven point is held, rigid body and mode swing against each other at w sqrt(k0/(k0 + k1)), here
// undamped: three successive values of the holding force obey the recurrence of a sine.
TEST(ExactServo, a_mode_swings_on_while_the_coulomb_level_holds_the_table) {
    const ServoProblem p{.rigid_gain = 0.1, .modes = {{0.02, 30.0, 0.0}}, .coulomb = 10.0, .sample_time = 0.001};
    std::vector<double> u = constant(14.0, 20);
    u.resize(200, 0.0);
    const ServoSolution s = solve_exactly(p, u);
    ASSERT_EQ(s.events.back().kind, EventKind::stick);
    ASSERT_LT(s.events.back().t, 0.1);
    const double twice_cosine = 2 * std::cos(2 * pi * 30.0 * std::sqrt(0.1 / 0.12) * p.sample_time);
    double largest = 0.0;
    for (std::size_t k = 102; k < s.t.size(); ++k) {
        EXPECT_EQ(s.x[k], s.x[101]);
        EXPECT_NEAR(s.v[k], 0.0, 1e-20); // rounding of two velocities of 1e-3 m/s in 64 bits
        EXPECT_NEAR(s.f[k] - twice_cosine * s.f[k - 1] + s.f[k - 2], 0.0, 1e-14); // 1 N in double
        largest = std::max(largest, std::abs(s.f[k]));
    }
    EXPECT_GT(largest, 0.1);
    EXPECT_LT(largest, 10.0);
}

// The level stops the table and releases it with an element deflected to its limit: it slips again at the
// same instant.
TEST(ExactServo, a_stop_on_the_level_makes_the_elements_stick_too) {
    ServoProblem p = block;
    p.elements = {{1e5, 1.0}};
    std::vector<double> u = constant(15.0, 20);
    u.resize(60, 0.0);
    u.resize(80, 15.0);
    const ServoSolution s = solve_exactly(p, u);
    ASSERT_EQ(s.events.size(), 6u);
    const double stop = 0.02 + s.v[20] / 1.1; // 11 N brake
    expect_event(s.events[2], stop, 0, EventKind::stick);
    expect_event(s.events[3], stop, 1, EventKind::stick);
    expect_event(s.events[4], 0.06, 0, EventKind::slip_forward);
    expect_event(s.events[5], 0.06, 1, EventKind::slip_forward);
    EXPECT_EQ(s.f[60], 0.0); // the constraint carries the spring's 1 N, nothing is left for the thrust
    EXPECT_NEAR(s.f[79], 11.0, 1e-12);
}

// --- energy ---

// Held thrust: its work over a sample is u times the way. One element: its deflection is f/K, the rest of the
// way is slip, and F times that is what is lost. No quadrature, so only rounding is left: 1e-16 of 1e-3 J
// over 1000 terms.
TEST(ExactServo, work_is_kinetic_energy_and_spring_energy_and_slip_work) {
    const double K = 1e5, F = 1.0;
    const auto u = sampled_sine(3.0, 7.0, one_element.sample_time, 1000);
    const ServoSolution s = solve_exactly(one_element, u);
    double work = 0.0, slipped = 0.0;
    for (std::size_t k = 0; k + 1 < u.size(); ++k) {
        const double way = s.x[k + 1] - s.x[k];
        work += u[k] * way;
        slipped += std::abs(way - (s.f[k + 1] - s.f[k]) / K);
        const double stored = s.v[k + 1] * s.v[k + 1] / 0.2 + s.f[k + 1] * s.f[k + 1] / (2 * K);
        EXPECT_NEAR(work, stored + F * slipped, 1e-15) << k;
    }
    EXPECT_GT(F * slipped, 1e-3);
}

// All of the table's friction on a rigid body: the thrust's work less the kinetic energy is what friction
// took. Its integral is by trapezes of h = 50 us, each wrong by h^3/12 times the second derivative of f v,
// about (2 pi 34)^2 of it: relatively (h 2 pi 34)^2/12 = 1e-5, and the kinks at events come on top.
TEST(ExactServo, friction_takes_what_the_thrust_gives_beyond_kinetic_energy) {
    ServoProblem p = linear_motor_table();
    p.modes.clear();
    p.sample_time = 5e-5;
    const auto u = sampled_sine(30.0, 34.0, p.sample_time, 2000);
    const ServoSolution s = solve_exactly(p, u);
    double work = 0.0, lost = 0.0;
    for (std::size_t k = 0; k + 1 < u.size(); ++k) {
        work += u[k] * (s.x[k + 1] - s.x[k]);
        lost += (s.f[k] * s.v[k] + s.f[k + 1] * s.v[k + 1]) / 2 * p.sample_time;
    }
    const double kinetic = s.v.back() * s.v.back() / (2 * p.rigid_gain);
    EXPECT_NEAR((kinetic + lost) / work, 1.0, 1e-4);
    EXPECT_GT(lost / work, 0.5);
    EXPECT_GT(s.events.size(), 100u);
}

// --- delays and the loop ---

// A delay of 3/8 sample is three samples of a machine sampled eight times as often.
TEST(ExactServo, a_fractional_input_delay_is_a_shift_on_a_finer_grid) {
    ServoProblem fine = linear_motor_table();
    fine.sample_time /= 8;
    const auto u = sampled_sine(15.0, 34.0, 0.0005, 60);
    std::vector<double> shifted(3, 0.0);
    for (double value : u) shifted.insert(shifted.end(), 8, value);
    const ServoSolution s = solve_exactly(linear_motor_table(), u, 3 * fine.sample_time);
    const ServoSolution reference = solve_exactly(fine, shifted);
    for (std::size_t k = 0; k < u.size(); ++k) EXPECT_NEAR(s.x[k], reference.x[8 * k], position_tolerance) << k;
    EXPECT_GT(s.events.size(), 20u);
}

TEST(ExactServo, the_loop_is_the_open_loop_under_its_own_thrust_and_detects_delayed_rounded_positions) {
    ServoProblem table = linear_motor_table();
    table.lag_hz = 750.0;
    const LoopSettings loop{.kp = 2.05e4,
                            .ki = 1.8e5,
                            .kd = 653.0,
                            .input_delay = 0.00055,
                            .output_delay = 0.0005 * 11 / 8,
                            .encoder_resolution = 1e-7};
    const auto exc = sampled_sine(15.0, 34.0, table.sample_time, 80);
    const LoopSolution s = solve_loop_exactly(table, loop, constant(1e-4, 80), exc);

    const ServoSolution machine = solve_exactly(table, s.u, loop.input_delay);
    EXPECT_EQ(s.events.size(), machine.events.size());
    for (std::size_t k = 0; k < s.t.size(); ++k) {
        EXPECT_NEAR(s.x[k], machine.x[k], position_tolerance);
        EXPECT_NEAR(s.f[k], machine.f[k],
                    3.5e6 * position_tolerance); // sum of all K times the tolerance of x
    }

    ServoProblem fine = table;
    fine.sample_time /= 8;
    std::vector<double> repeated;
    for (double value : s.u) repeated.insert(repeated.end(), 8, value);
    const ServoSolution between = solve_exactly(fine, repeated, loop.input_delay);
    for (std::size_t k = 0; k < s.t.size(); ++k) {
        const double then = 8 * k < 11 ? 0.0 : between.x[8 * k - 11];
        EXPECT_LE(std::abs(s.y[k] - then), 0.5e-7 * (1 + 1e-12)) << k;     // half a step, and its rounding
        EXPECT_NEAR(s.y[k] / 1e-7, std::round(s.y[k] / 1e-7), 1e-12) << k; // a whole number of steps
    }
}

// The machine barely moves, so y = 0 and e = r: the controller's answer to a step, by hand.
TEST(ExactServo, the_controller_answers_a_step_as_a_filtered_pid) {
    const ServoProblem heavy{.rigid_gain = 1e-12, .sample_time = 0.001};
    const LoopSettings loop{.kp = 100.0,
                            .ki = 50.0,
                            .kd = 2.0,
                            .derivative_filter_hz = std::log(2.0) / (2 * pi * 0.001), // a = 1/2
                            .encoder_resolution = 1e-3};
    const LoopSolution s = solve_loop_exactly(heavy, loop, constant(0.1, 3), {1.0, 2.0, 3.0});
    // P 10, I 0.005 per sample, D 2 * 100 * (1/2, 1/4, 1/8), excitation. Rounding of a sum near 100 N.
    EXPECT_NEAR(s.u[0], 10 + 0.005 + 100 + 1, 1e-12);
    EXPECT_NEAR(s.u[1], 10 + 0.010 + 50 + 2, 1e-12);
    EXPECT_NEAR(s.u[2], 10 + 0.015 + 25 + 3, 1e-12);
    EXPECT_EQ(s.y[2], 0.0);
}

TEST(ExactServo, problems_without_sense_are_refused) {
    EXPECT_THROW(solve_exactly({}, {0.0}), std::invalid_argument);
    EXPECT_THROW(solve_exactly(one_element, {0.0}, -1e-4), std::invalid_argument);
    EXPECT_THROW(solve_exactly(one_element, {std::nan(""), 0.0}), std::invalid_argument);
    EXPECT_THROW(solve_loop_exactly(one_element, {}, {0.0}, {}), std::invalid_argument);
}

} // namespace
} // namespace tribode::problems
