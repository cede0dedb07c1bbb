#include "physics/reference_machine.hpp"
#include "tribode/base/error.hpp"
#include "tribode/experiment/comparison.hpp"
#include "tribode/record/csv.hpp"
#include "tribode/record/table.hpp"
#include "unit/script/temporary_folder.hpp"

#include <algorithm>
#include <cmath>
#include <fstream>
#include <gtest/gtest.h>
#include <sstream>

namespace tribode {
namespace {

constexpr double ts = 5e-4, gain = 0.1;
using Values = std::vector<double>;

Values sine(double amplitude, double frequency_hz, std::size_t count, double phase = 0) {
    Values u(count);
    for (std::size_t k = 0; k < count; ++k) {
        u[k] = amplitude * std::sin(2 * std::numbers::pi * frequency_hz * static_cast<double>(k) * ts + phase);
    }
    return u;
}

DriveRecord open_loop(Values u) {
    DriveRecord record;
    for (std::size_t k = 0; k < u.size(); ++k) record.t.push_back(static_cast<double>(k) * ts);
    record.u = std::move(u);
    return record;
}

DriveRecord closed_loop(Values reference, Values excitation) {
    DriveRecord record = open_loop(std::move(reference));
    record.reference = std::move(record.u);
    record.u.clear();
    record.excitation = std::move(excitation);
    return record;
}

MachineModel mass() { return machine_of({{"rigid_gain_per_kg", gain}}); }
MachineModel reference() { return machine_of(reference_description()); }

// A mass on one element that never slips: a spring.
MachineModel mass_on_spring(double stiffness) {
    return machine_of({{"rigid_gain_per_kg", gain}, {"friction", {{"elements", {{{"K", stiffness}, {"F", 1e300}}}}}}});
}

// Few methods, so that a test is quick.
ComparisonOptions some(std::vector<long> divisions, std::vector<double> tolerances = {}) {
    return {.tolerances = std::move(tolerances), .divisions = std::move(divisions)};
}

const MethodResult& of(const Comparison& comparison, Method method, long division, double sample_time = ts) {
    for (const auto& m : comparison.methods) {
        if (m.solver.method == method && m.solver.fixed_step == sample_time / static_cast<double>(division)) return m;
    }
    throw std::out_of_range("there is no such method");
}

bool any_contains(const std::vector<std::string>& texts, const std::vector<std::string>& parts) {
    return std::any_of(texts.begin(), texts.end(), [&](const std::string& text) {
        return std::all_of(parts.begin(), parts.end(),
                           [&](const std::string& part) { return text.find(part) != std::string::npos; });
    });
}

// ---- what is run -------------------------------------------------------------------------------------------------

TEST(Comparison, has_each_tolerance_of_each_variable_step_and_each_fixed_step) {
    const auto c = compare(mass(), open_loop(sine(1, 10, 100)), some({1, 10}, {1e-5, 1e-7}));
    std::vector<std::string> names;
    for (const auto& m : c.methods) names.push_back(m.name);
    EXPECT_EQ(names, (std::vector<std::string>{"erk 1e-05", "erk 1e-07", "adams 1e-05", "adams 1e-07", "bdf 1e-05",
                                               "bdf 1e-07", "fixed 500 us", "fixed 50 us", "euler 500 us",
                                               "euler 50 us", "semi_implicit_euler 500 us", "semi_implicit_euler 50 us",
                                               "zoh 500 us", "zoh 50 us"}));
    EXPECT_EQ(c.exact.name, "exact");
    EXPECT_EQ(c.reference, "exact");
    for (const auto& m : c.methods) EXPECT_EQ(m.trace.x.size(), 100u) << m.name;
}

TEST(Comparison, steps_and_phase_delays_go_with_the_sample_time_of_the_machine) {
    const auto machine = machine_of({{"rigid_gain_per_kg", gain}, {"Ts", 1e-3}});
    DriveRecord record = open_loop(sine(1, 10, 400));
    for (double& t : record.t) t *= 2; // 5 Hz now
    const auto c = compare(machine, record, some({1}));
    EXPECT_EQ(c.methods.front().name, "fixed 1000 us");
    ASSERT_TRUE(c.excitation_hz);
    EXPECT_NEAR(*c.excitation_hz, 5.0, 1e-6); // the search closes in to rounding of a sum of squares, 1e-8 relative
    EXPECT_NEAR(*of(c, Method::euler, 1, 1e-3).phase_error_deg, -360 * 5.0 * 0.5e-3, 1e-4);
}

TEST(Comparison, the_reference_of_a_stribeck_machine_is_erk_and_says_why) {
    const auto machine =
        machine_of({{"rigid_gain_per_kg", gain},
                    {"friction", {{"coulomb", 1.0}, {"stribeck", {{"static", 1.5}, {"velocity", 1e-2}}}}}});
    const auto c = compare(machine, open_loop(sine(3, 10, 400)), some({10}, {1e-8}));
    EXPECT_EQ(c.exact.name, "erk 1e-12");
    EXPECT_EQ(c.exact.solver.method, Method::erk);
    EXPECT_NE(c.reference.find("because"), std::string::npos) << c.reference;
    EXPECT_NE(c.reference.find("Stribeck"), std::string::npos) << c.reference;
    EXPECT_GT(c.exact.events_found, 0);
    EXPECT_LT(c.methods.front().max_difference, 1e-6); // erk 1e-8 beside it: in the same world, not the same bits
    EXPECT_GT(c.methods.front().max_difference, 0);
}

TEST(Comparison, differences_are_those_of_the_traces) {
    const auto machine = reference();
    const auto record = open_loop(sine(15, 10, 200));
    const auto c = compare(machine, record, some({5}));
    for (const auto& m : c.methods) {
        const auto exact = simulate(machine, record, {.solver = {.method = Method::exact}}).trace.x;
        const auto own = simulate(machine, record, {.solver = m.solver}).trace.x;
        double largest = 0, sum = 0;
        for (std::size_t k = 0; k < own.size(); ++k) {
            largest = std::max(largest, std::abs(own[k] - exact[k]));
            sum += std::pow(own[k] - exact[k], 2);
        }
        EXPECT_EQ(m.max_difference, largest) << m.name;
        EXPECT_DOUBLE_EQ(m.rms_difference, std::sqrt(sum / 200)) << m.name;
    }
}

TEST(Comparison, in_closed_loop_every_method_follows_the_reference) {
    const auto c = compare(reference(), closed_loop(Values(401, 0.0), sine(15, 10, 401)), some({10}, {1e-8}));
    ASSERT_TRUE(c.excitation_hz);
    EXPECT_NEAR(*c.excitation_hz, 10.0, 1e-6);
    for (const auto& m : c.methods) {
        EXPECT_FALSE(m.diverged) << m.name;
        // A hundredth of the motion, 1e-4 m: Euler's error at 50 us.
        EXPECT_LT(m.max_difference, 1e-5) << m.name;
    }
}

TEST(Comparison, an_unstable_loop_or_a_stop_ends_it_early) {
    const auto machine = machine_of({{"rigid_gain_per_kg", gain}, {"controller", {{"type", "pid"}, {"kp", -1e9}}}});
    EXPECT_THROW(compare(machine, closed_loop(Values(2000, 1e-3), {}), some({1})), EndedEarly);
    std::atomic<bool> stop{false};
    RunControl control;
    control.stop = &stop;
    std::size_t runs = 0;
    control.progress = [&](const std::string&, std::size_t done, std::size_t) { stop = (runs = done) == 2; };
    EXPECT_THROW(compare(mass(), open_loop(sine(1, 10, 400)), some({1, 2, 5}), control), EndedEarly);
    EXPECT_EQ(runs, 2u);
}

// ---- events ------------------------------------------------------------------------------------------------------

// The largest number of pairs of one element and kind at most `window` apart: augmenting paths over all choices.
long max_pairs(const EventLog& exact, const EventLog& own, double window) {
    std::vector<long> partner(own.size(), -1);
    std::vector<bool> seen;
    std::function<bool(std::size_t)> place = [&](std::size_t i) {
        for (std::size_t j = 0; j < own.size(); ++j) {
            const bool fits = own[j].subject == exact[i].subject && own[j].kind == exact[i].kind &&
                              std::abs(own[j].t - exact[i].t) <= window;
            if (!fits || seen[j]) continue;
            seen[j] = true;
            if (partner[j] < 0 || place(static_cast<std::size_t>(partner[j]))) {
                partner[j] = static_cast<long>(i);
                return true;
            }
        }
        return false;
    };
    long pairs = 0;
    for (std::size_t i = 0; i < exact.size(); ++i) {
        seen.assign(own.size(), false);
        pairs += place(i);
    }
    return pairs;
}

TEST(ComparisonOfEvents, pairs_as_many_as_there_can_be) {
    const auto machine = reference();
    const auto record = open_loop(sine(15, 10, 401));
    const auto exact = simulate(machine, record, {.solver = {.method = Method::exact}}).events;
    const auto c = compare(machine, record, some({1, 2, 5}));
    EXPECT_EQ(c.exact.events_found, static_cast<long>(exact.size()));
    long missed = 0;
    for (const auto& m : c.methods) {
        const auto own = simulate(machine, record, {.solver = m.solver}).events;
        EXPECT_EQ(m.events_found, max_pairs(exact, own, ts)) << m.name;
        EXPECT_EQ(m.events_found + m.events_missed, static_cast<long>(exact.size())) << m.name;
        EXPECT_EQ(m.events_found + m.events_extra, static_cast<long>(own.size())) << m.name;
        missed += m.events_missed;
    }
    EXPECT_GT(missed, 0); // Euler's method at 250 us is wild here, so there is something to count
}

// A mass with a mode of 1500 Hz under a constant thrust, and an element too weak to matter: v = k0 t + k1/w sin(w t)
// reverses twice in each of the periods in which it does, and after each reversal the element slips again. A step of a
// sample time, three quarters of a period, cannot see all that. The motion itself zoh has without error.
TEST(ComparisonOfEvents, a_step_too_long_misses_reversals_and_a_short_one_none) {
    const double k0 = 0.01, k1 = 1, omega = 2 * std::numbers::pi * 1500;
    const auto machine = machine_of({{"rigid_gain_per_kg", k0},
                                     {"modes", {{{"gain", k1}, {"freq_hz", 1500}, {"zeta", 0}}}},
                                     {"friction", {{"elements", {{{"K", 1.0}, {"F", 1e-12}}}}}}});
    const std::size_t count = 30; // 15 ms; beyond k1/(k0 w) = 10.6 ms there is no reversal
    const auto c = compare(machine, open_loop(Values(count, 1.0)), some({1, 100}));
    long reversals = 0;
    const auto velocity = [&](double t) { return k0 * t + k1 / omega * std::sin(omega * t); };
    for (double t = 1e-7; t < 14.5e-3; t += 1e-7) reversals += (velocity(t) > 0) != (velocity(t + 1e-7) > 0);
    EXPECT_GT(reversals, 20);
    // The first slip, then a stick and a slip for each reversal.
    EXPECT_EQ(c.exact.events_found, 1 + 2 * reversals);
    EXPECT_GT(of(c, Method::zoh, 1).events_missed, reversals / 2);
    // Several events of the reference lie within a sample of one of the method: each is taken once.
    const auto record = open_loop(Values(count, 1.0));
    const auto exact = simulate(machine, record, {.solver = {.method = Method::exact}}).events;
    const auto own = simulate(machine, record, {.solver = of(c, Method::zoh, 1).solver}).events;
    EXPECT_EQ(of(c, Method::zoh, 1).events_found, max_pairs(exact, own, ts));
    EXPECT_LT(of(c, Method::zoh, 1).max_difference, 1e-11); // 1e-12 N on the whole for 15 ms
    EXPECT_EQ(of(c, Method::zoh, 100).events_missed, 0);
    EXPECT_EQ(of(c, Method::zoh, 100).events_extra, 0);
    EXPECT_TRUE(any_contains(c.findings(), {"zoh 500 us misses", "transitions", "every 500 us"}));
    EXPECT_FALSE(any_contains(c.findings(), {"zoh 5 us misses"}));
}

TEST(ComparisonOfEvents, without_friction_there_are_none) {
    const auto c = compare(mass(), open_loop(sine(1, 10, 200)), some({1, 10}, {1e-6}));
    EXPECT_EQ(c.friction_stiffness, 0);
    for (const auto& m : c.methods) {
        EXPECT_EQ(m.events_found + m.events_missed + m.events_extra, 0) << m.name;
    }
    EXPECT_FALSE(any_contains(c.findings(), {"transitions"}));
}

// ---- the frequency of the input ----------------------------------------------------------------------------------

std::optional<double> frequency_of(const DriveRecord& record) {
    const bool open = !record.closed_loop();
    const auto machine =
        open ? mass()
             : machine_of({{"rigid_gain_per_kg", gain}, {"controller", {{"type", "pid"}, {"kp", 1e3}, {"kd", 1e2}}}});
    return compare(machine, record, {.tolerances = {}, .divisions = {}}).excitation_hz;
}

Values sum_of(Values a, const Values& b) {
    for (std::size_t k = 0; k < a.size(); ++k) a[k] += b[k];
    return a;
}

TEST(ComparisonFrequency, of_a_sine_is_found_wherever_it_lies) {
    for (const double f : {2.5, 10.0, 13.37, 77.7, 200.0}) {
        const auto found = frequency_of(open_loop(sum_of(sine(3, f, 2000, 0.7), Values(2000, 5.0))));
        ASSERT_TRUE(found) << f;
        EXPECT_NEAR(*found, f, 1e-6 * f); // rounding of the least squares the search goes by
    }
}

TEST(ComparisonFrequency, is_the_strongest_of_two_where_one_stands_out) {
    const auto found = frequency_of(open_loop(sum_of(sine(3, 20, 2000), sine(1, 47, 2000))));
    ASSERT_TRUE(found);            // nine tenths of the power
    EXPECT_NEAR(*found, 20, 1e-2); // a hundredth of the record's resolution: the other one pulls a little
    EXPECT_FALSE(frequency_of(open_loop(sum_of(sine(3, 20, 2000), sine(3, 47, 2000)))));
}

TEST(ComparisonFrequency, of_a_constant_a_step_a_ramp_or_a_few_samples_is_none) {
    Values step(2000, 0.0), ramp(2000);
    std::fill(step.begin() + 1000, step.end(), 1.0); // one period of a square wave, if you like
    for (std::size_t k = 0; k < ramp.size(); ++k) ramp[k] = static_cast<double>(k);
    EXPECT_FALSE(frequency_of(open_loop(Values(2000, 1.0))));
    EXPECT_FALSE(frequency_of(open_loop(step)));
    EXPECT_FALSE(frequency_of(open_loop(ramp)));
    EXPECT_FALSE(frequency_of(open_loop(sine(1, 100, 49))));
}

TEST(ComparisonFrequency, in_closed_loop_is_that_of_the_excitation_or_else_of_the_reference) {
    EXPECT_NEAR(frequency_of(closed_loop(sine(1e-3, 5, 2000), sine(1, 20, 2000))).value_or(0), 20, 1e-5);
    EXPECT_NEAR(frequency_of(closed_loop(sine(1e-3, 5, 2000), Values(2000, 2.0))).value_or(0), 5, 1e-5);
    EXPECT_NEAR(frequency_of(closed_loop(sine(1e-3, 5, 2000), {})).value_or(0), 5, 1e-5);
}

// ---- phasors -----------------------------------------------------------------------------------------------------

// A mass under a held thrust: exactly x = k Ts^2 (z + 1)/(2 (z - 1)^2) u. With n steps of Ts/n explicit Euler makes
// (1 - 1/n)(z - 1) + 2 of z + 1, semi-implicit Euler (1 + 1/n)(z - 1) + 2: the ratio to the exact one is
// 1 -+ (j/n) tan(w Ts/2), half a step late or early. Runge-Kutta and the hold are exact.
TEST(ComparisonPhasors, of_eulers_methods_are_half_a_step_late_or_early) {
    for (const double f : {10.0, 100.0}) {
        const auto c = compare(mass(), open_loop(sine(1, f, 2000)), some({1, 2, 10}));
        for (const long n : {1, 2, 10}) {
            const double tangent = std::tan(std::numbers::pi * f * ts) / static_cast<double>(n);
            const double angle = std::atan(tangent) * 180 / std::numbers::pi, gain_error = std::hypot(1, tangent) - 1;
            const auto& explicit_euler = of(c, Method::euler, n);
            const auto& semi_implicit = of(c, Method::semi_implicit_euler, n);
            // The fit takes the drift away to its conditioning.
            EXPECT_NEAR(*explicit_euler.phase_error_deg, -angle, 1e-5) << f << " " << n;
            EXPECT_NEAR(*semi_implicit.phase_error_deg, angle, 1e-5) << f << " " << n;
            EXPECT_NEAR(*explicit_euler.gain_error, gain_error, 1e-6) << f << " " << n;
            EXPECT_NEAR(*semi_implicit.gain_error, gain_error, 1e-6) << f << " " << n;
            for (const Method method : {Method::fixed, Method::zoh}) {
                EXPECT_NEAR(*of(c, method, n).phase_error_deg, 0, 1e-6) << f << " " << n;
                EXPECT_NEAR(*of(c, method, n).gain_error, 0, 1e-8) << f << " " << n;
            }
        }
    }
    const auto c = compare(mass(), open_loop(sine(1, 10, 2000)), some({1}));
    EXPECT_TRUE(any_contains(c.findings(), {"euler 500 us turns the position at 10 Hz by -0.900 deg",
                                            "a delay of +250.0 us or +0.50 steps"}));
    EXPECT_TRUE(any_contains(c.findings(), {"semi_implicit_euler 500 us", "+0.900 deg", "-0.50 steps"}));
    EXPECT_FALSE(any_contains(c.findings(), {"zoh"}));
}

TEST(ComparisonPhasors, are_there_only_with_a_frequency_and_two_periods) {
    const auto step = compare(mass(), open_loop(Values(400, 1.0)), some({1}));
    for (const auto& m : step.methods) EXPECT_FALSE(m.phase_error_deg || m.gain_error) << m.name;
    EXPECT_FALSE(any_contains(step.findings(), {"turns"}));
}

// ---- stability ---------------------------------------------------------------------------------------------------

// A mass on a spring, a = h^2 k K. Largest growth per step: explicit Euler sqrt(1 + a); semi-implicit Euler one up to
// a = 4; Runge-Kutta one up to a = 8; the hold, which knows the mass but not the spring, sqrt(1 + a/2). The limit is
// twofold a second, and a millionth a sample more.
TEST(ComparisonStability, of_a_mass_on_a_spring_is_that_of_hand) {
    const auto c = compare(mass(), open_loop(Values(2, 0.0)), some({1, 10}));
    for (const long n : {1, 10}) {
        const double h = ts / static_cast<double>(n), per_step = std::pow(std::exp2(ts) * (1 + 1e-6), 1.0 / n);
        const double slow = (per_step * per_step - 1) / (h * h * gain);
        const auto stiffness = [&](Method method) { return of(c, method, n).stable_stiffness.value() / slow; };
        EXPECT_NEAR(stiffness(Method::euler), 1, 1e-6) << n; // 1e-9 of the bisection, rounding of growth - 1
        EXPECT_NEAR(stiffness(Method::zoh), 2, 2e-6) << n;
        // Beyond these the growth sets in as a square root and as a straight line.
        EXPECT_NEAR(*of(c, Method::semi_implicit_euler, n).stable_stiffness * h * h * gain, 4, 1e-6) << n;
        EXPECT_NEAR(*of(c, Method::fixed, n).stable_stiffness * h * h * gain, 8, 2e-3) << n;
    }
    EXPECT_FALSE(any_contains(c.findings(), {"unstable"})); // there is no friction to make it so
}

TEST(ComparisonStability, is_that_of_the_runs) {
    for (const Method method : {Method::fixed, Method::semi_implicit_euler}) {
        const double limit = *of(compare(mass(), open_loop(Values(2, 0.0)), some({1})), method, 1).stable_stiffness;
        const auto pushed = [&](double stiffness) {
            Values u(1001, 0.0);
            u[0] = 1;
            return compare(mass_on_spring(stiffness), open_loop(u), some({1}));
        };
        EXPECT_FALSE(of(pushed(0.98 * limit), method, 1).diverged) << name_of(method);
        const auto beyond = pushed(1.02 * limit);
        EXPECT_TRUE(of(beyond, method, 1).diverged) << name_of(method);
        EXPECT_TRUE(any_contains(beyond.findings(), {of(beyond, method, 1).name + " ends early", "diverges"}));
        EXPECT_TRUE(any_contains(beyond.findings(), {of(beyond, method, 1).name + " is unstable above a stiffness of",
                                                     "N/m at the driven point"}));
    }
}

// The clocks of a delayed encoder and a delayed hold cut a sample of 500 us into pieces of 82, 218 and 200 us: a method
// that steps over 500 us at most takes the longest of them, so its limit lies between those of 200 and of 500 us.
TEST(ComparisonStability, takes_the_cuts_at_the_clocks_into_account) {
    const auto delayed =
        machine_of({{"rigid_gain_per_kg", gain}, {"output_delay_s", 4.18e-4}, {"input_delay_s", 3e-4}});
    const double cut =
        *of(compare(delayed, open_loop(Values(2, 0.0)), some({1})), Method::semi_implicit_euler, 1).stable_stiffness;
    EXPECT_GT(cut * ts * ts * gain, 4 * 1.5);
    EXPECT_LT(cut * 2e-4 * 2e-4 * gain, 4);
}

TEST(ComparisonStability, of_an_undamped_mode_under_eulers_method_is_nothing) {
    const auto machine =
        machine_of({{"rigid_gain_per_kg", gain}, {"modes", {{{"gain", 0.02}, {"freq_hz", 200}, {"zeta", 0}}}}});
    const auto c = compare(machine, open_loop(Values(2, 0.0)), some({1}));
    EXPECT_EQ(of(c, Method::euler, 1).stable_stiffness, 0);
    EXPECT_TRUE(any_contains(c.findings(), {"euler 500 us is unstable for this machine even without friction"}));
    EXPECT_GT(*of(c, Method::zoh, 1).stable_stiffness, 0);
    EXPECT_GT(*of(c, Method::semi_implicit_euler, 1).stable_stiffness, 0);
}

TEST(ComparisonStability, is_not_known_of_variable_steps) {
    const auto c = compare(mass(), open_loop(Values(2, 0.0)), some({1}, {1e-6}));
    for (const auto& m : c.methods)
        EXPECT_EQ(m.stable_stiffness.has_value(), has_fixed_step(m.solver.method)) << m.name;
}

// Explicit Euler multiplies the motion by sqrt(1 + a) at each of 1000 steps, a = h^2 k K: by 4 and by 50.
TEST(Comparison, a_motion_beyond_ten_times_the_reference_has_diverged) {
    for (const auto& [growth, diverged] : {std::pair{4.0, false}, {50.0, true}}) {
        Values u(1001, 0.0);
        u[0] = 1;
        const double stiffness = std::expm1(2 * std::log(growth) / 1000) / (ts * ts * gain);
        const auto c = compare(mass_on_spring(stiffness), open_loop(u), some({1}));
        EXPECT_EQ(of(c, Method::euler, 1).diverged, diverged) << growth;
        EXPECT_TRUE(of(c, Method::euler, 1).outcome.ok()) << growth;
        EXPECT_EQ(any_contains(c.findings(), {"euler 500 us diverges"}), diverged) << growth;
    }
}

// An undamped mode of 2 kHz: Euler's method multiplies it by abs(1 + j w h) = 6.4 at each step, and a kilometer is passed
// before the 100th.
TEST(Comparison, a_run_that_ends_early_is_compared_as_far_as_it_came) {
    const auto machine =
        machine_of({{"rigid_gain_per_kg", gain}, {"modes", {{{"gain", 0.02}, {"freq_hz", 2000}, {"zeta", 0}}}}});
    const auto c = compare(machine, open_loop(sine(1, 10, 601)), some({1}));
    const auto& euler = of(c, Method::euler, 1);
    EXPECT_EQ(euler.outcome.end, RunEnd::diverged);
    EXPECT_TRUE(euler.diverged);
    EXPECT_LT(euler.trace.x.size(), 100u);
    EXPECT_GT(euler.trace.x.size(), 20u);
    EXPECT_FALSE(euler.phase_error_deg);
    EXPECT_TRUE(any_contains(c.findings(), {"euler 500 us ends early", "diverges"}));
    EXPECT_NE(c.text().find("ended early"), std::string::npos);
    const auto row = static_cast<std::size_t>(&euler - c.methods.data());
    EXPECT_EQ(c.table()["completed"].values[row + 1], 0); // the reference comes first
}

// ---- table, text and files ---------------------------------------------------------------------------------------

TEST(ComparisonTable, has_a_row_per_method_and_its_columns_with_units) {
    const auto c = compare(reference(), open_loop(sine(15, 10, 200)), some({1, 5}, {1e-6}));
    const Table table = c.table();
    EXPECT_EQ(table.names(), (std::vector<std::string>{"tolerance", "step_s", "completed", "max_difference_m",
                                                       "rms_difference_m", "events_found", "events_missed",
                                                       "events_extra", "gain_error", "phase_error_deg",
                                                       "stable_stiffness_N_per_m", "derivative_evaluations", "steps"}));
    const auto methods = c.all();
    EXPECT_EQ(methods.front(), &c.exact);
    ASSERT_EQ(table.rows(), methods.size());
    ASSERT_EQ(methods.size(), c.methods.size() + 1);
    EXPECT_TRUE(std::isnan(table["tolerance"].values[0])); // the exact solver has none
    for (std::size_t i = 0; i < methods.size(); ++i) {
        const bool fixed = has_fixed_step(methods[i]->solver.method);
        EXPECT_EQ(std::isnan(table["tolerance"].values[i]), fixed || i == 0) << i;
        EXPECT_EQ(std::isnan(table["step_s"].values[i]), !fixed) << i;
        EXPECT_EQ(std::isnan(table["stable_stiffness_N_per_m"].values[i]), !fixed) << i;
        EXPECT_EQ(table["max_difference_m"].values[i], methods[i]->max_difference) << i;
        EXPECT_EQ(table["steps"].values[i], static_cast<double>(methods[i]->statistics.steps)) << i;
        EXPECT_NE(c.text().find(methods[i]->name), std::string::npos) << i;
    }
}

TEST(ComparisonTable, is_the_same_bytes_in_two_runs) {
    Json description = reference_description();
    description["noise_rms_m"] = 1e-7;
    const auto machine = machine_of(description);
    const auto record = closed_loop(Values(200, 0.0), sine(15, 10, 200));
    ComparisonOptions options = some({1, 10}, {1e-6});
    options.seed = 3;
    const auto first = compare(machine, record, options), second = compare(machine, record, options);
    EXPECT_EQ(to_csv(first.table()), to_csv(second.table()));
    EXPECT_EQ(first.findings(), second.findings());
    options.seed = 4;
    EXPECT_NE(to_csv(compare(machine, record, options).table()), to_csv(first.table()));
}

TEST(ComparisonFiles, name_the_methods_in_front_of_each_row) {
    const TemporaryFolder folder;
    RunFolder results(folder / "out");
    const auto machine = reference();
    const auto c = compare(machine, open_loop(sine(15, 10, 200)), some({1, 10}, {1e-6}));
    write_comparison(c, machine, results);
    std::vector<std::string> files;
    for (const auto& [name, hash] : results.files()) files.push_back(name);
    EXPECT_EQ(files, (std::vector<std::string>{"comparison.csv", "cost.csv", "differences.png", "differences.svg",
                                               "findings.txt", "hysteresis.png", "hysteresis.svg", "trajectories.png",
                                               "trajectories.svg", "work_precision.png", "work_precision.svg"}));
    for (const auto& [file, columns] : {std::pair{"comparison.csv", "method,tolerance,step_s"},
                                        {"cost.csv", "method,processor_time_s,per_sample_us"}}) {
        std::ifstream lines(folder / ("out/" + std::string(file)));
        std::string line;
        ASSERT_TRUE(std::getline(lines, line));
        EXPECT_TRUE(line.starts_with(columns)) << line;
        for (const auto* m : c.all()) {
            ASSERT_TRUE(std::getline(lines, line)) << m->name;
            EXPECT_TRUE(line.starts_with(m->name + ",")) << line;
        }
        EXPECT_FALSE(std::getline(lines, line)) << line;
    }
    std::stringstream findings;
    findings << std::ifstream(folder / "out/findings.txt").rdbuf();
    EXPECT_TRUE(findings.str().starts_with("Reference: exact. 200 samples of "));
    for (const auto& text : c.findings()) EXPECT_NE(findings.str().find(text), std::string::npos) << text;
}

// Curves of one point, of nothing but zeros, of no method at all.
TEST(ComparisonFiles, are_drawn_also_where_there_is_next_to_nothing_to_draw) {
    for (const std::size_t count : {1u, 60u}) {
        const TemporaryFolder folder;
        RunFolder results(folder / "out");
        EXPECT_NO_THROW(
            write_comparison(compare(mass(), open_loop(Values(count, 0.0)), some({1}, {1e-6})), mass(), results));
    }
    const TemporaryFolder folder;
    RunFolder results(folder / "out");
    EXPECT_NO_THROW(write_comparison(compare(mass(), open_loop(sine(1, 10, 60)), some({})), mass(), results));
}

// ---- options -----------------------------------------------------------------------------------------------------

TEST(ComparisonOptions, are_read_and_checked) {
    const auto read = [](const Json& json) {
        FieldReader fields(json, "compare");
        ComparisonOptions options;
        read_options(options, fields);
        fields.finish();
        return options;
    };
    const auto options = read({{"tolerances", {1e-3}}, {"divisions", {3, 1}}, {"seed", 7}});
    EXPECT_EQ(options.tolerances, std::vector<double>{1e-3});
    EXPECT_EQ(options.divisions, (std::vector<long>{3, 1}));
    EXPECT_EQ(options.seed, 7u);
    EXPECT_EQ(read(Json::object()).divisions, ComparisonOptions{}.divisions);
    for (const Json& wrong :
         {Json{{"tolerances", {0.0}}}, Json{{"tolerances", "tight"}}, Json{{"divisions", {1.5}}},
          Json{{"divisions", {0}}}, Json{{"divisions", {2e6}}}, Json{{"seed", -1}}, Json{{"sed", 1}}}) {
        EXPECT_THROW(read(wrong), InputError) << wrong;
    }
}

} // namespace
} // namespace tribode
