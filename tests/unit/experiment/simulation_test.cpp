#include "physics/reference_machine.hpp"
#include "tribode/base/error.hpp"
#include "tribode/experiment/simulation.hpp"
#include "tribode/record/csv.hpp"

#include <cmath>
#include <gtest/gtest.h>

namespace tribode {
namespace {

constexpr double ts = 5e-4;
using Values = std::vector<double>;

Values times(std::size_t count, double first = 0) {
    Values t(count);
    for (std::size_t k = 0; k < count; ++k) t[k] = first + static_cast<double>(k) * ts;
    return t;
}

Values sine(double amplitude, double frequency_hz, std::size_t count) {
    Values u(count);
    for (std::size_t k = 0; k < count; ++k) {
        u[k] = amplitude * std::sin(2 * std::numbers::pi * frequency_hz * static_cast<double>(k) * ts);
    }
    return u;
}

Table table_of(const std::vector<std::pair<std::string, Values>>& columns) {
    Table table;
    for (const auto& [name, values] : columns) table.add(name, "", values);
    return table;
}

MachineModel reference() { return machine_of(reference_description()); }
MachineModel bare_mass() { return machine_of({{"rigid_gain_per_kg", 0.1}}); }

DriveRecord record_of(const std::vector<std::pair<std::string, Values>>& columns, const MachineModel& machine) {
    return DriveRecord::from_table(table_of(columns), machine, "in.csv");
}

// The message of the InputError.
std::string refusal(const std::vector<std::pair<std::string, Values>>& columns, const MachineModel& machine) {
    try {
        record_of(columns, machine);
    } catch (const InputError& error) {
        return error.what();
    }
    return "nothing was refused";
}

const SolverOptions erk{.method = Method::erk, .relative_tolerance = 1e-8, .absolute_tolerance = 1e-12};

Simulation run(const MachineModel& machine, const DriveRecord& record, std::uint64_t seed = 0) {
    Simulation result = simulate(machine, record, {.solver = erk, .seed = seed});
    EXPECT_TRUE(result.outcome.ok()) << result.outcome.message;
    return result;
}

std::string bytes(const Simulation& s) { return to_csv(to_table(s.trace)) + to_csv(s.events); }

TEST(DriveRecord, columns_decide_between_open_and_closed_loop) {
    const Values v(5, 0.1);
    EXPECT_FALSE(record_of({{"t", times(5)}, {"u", v}}, reference()).closed_loop());
    EXPECT_FALSE(record_of({{"t", times(5)}, {"u", v}, {"y", v}}, reference()).closed_loop());
    EXPECT_TRUE(record_of({{"t", times(5)}, {"r", v}, {"exc", v}}, reference()).closed_loop());
    EXPECT_TRUE(record_of({{"t", times(5)}, {"r", v}}, reference()).closed_loop());
    EXPECT_TRUE(record_of({{"t", times(5)}, {"exc", v}}, reference()).closed_loop());
}

TEST(DriveRecord, where_both_are_given_the_machine_decides) {
    const Values v(5, 0.1);
    Json open = reference_description();
    open["closed_loop"] = false;
    const std::vector<std::pair<std::string, Values>> both = {{"t", times(5)}, {"r", v}, {"u", v}, {"y", v}};
    EXPECT_TRUE(record_of(both, reference()).closed_loop());
    const DriveRecord record = record_of(both, machine_of(open));
    EXPECT_FALSE(record.closed_loop());
    EXPECT_TRUE(record.reference.empty());
    EXPECT_EQ(record.measured, v);
    EXPECT_FALSE(record_of(both, bare_mass()).closed_loop());
}

TEST(DriveRecord, refuses_what_does_not_fit_and_says_what) {
    const Values v(5, 0.1);
    EXPECT_NE(refusal({{"t", times(5)}, {"y", v}}, reference()).find("no column u"), std::string::npos);
    EXPECT_NE(refusal({{"t", times(5)}, {"u", v}, {"exx", v}}, reference()).find("\"exc\""), std::string::npos);
    EXPECT_NE(refusal({{"t", times(5)}, {"r", v}}, bare_mass()).find("the machine has none"), std::string::npos);
    EXPECT_NE(refusal({{"u", v}}, reference()).find("no column t"), std::string::npos);
    Values gap = times(5);
    gap[3] += ts;
    gap[4] += ts;
    EXPECT_NE(refusal({{"t", gap}, {"u", v}}, reference()).find("gap in time"), std::string::npos);
    EXPECT_NE(refusal({{"t", {}}, {"u", {}}}, reference()).find("no rows"), std::string::npos);
}

// A pure mass under a constant force of 2 N, gain 0.1: everything is known.
TEST(Simulate, columns_are_left_limits_at_the_sample_instants) {
    Json description = {{"rigid_gain_per_kg", 0.1}, {"input_delay_s", ts}, {"output_delay_s", ts / 2}};
    description["friction"]["viscous"] = 0.0;
    const std::size_t count = 101;
    const auto s =
        run(machine_of(description), record_of({{"t", times(count, 7.0)}, {"u", Values(count, 2.0)}}, bare_mass()));
    ASSERT_EQ(s.trace.t, times(count, 7.0)); // as in the record
    const auto position = [](double t) { return t < ts ? 0.0 : 0.1 * 2 * (t - ts) * (t - ts) / 2; };
    for (std::size_t k = 0; k < count; ++k) {
        const double t = static_cast<double>(k) * ts;
        EXPECT_EQ(s.trace.u[k], 2.0);
        EXPECT_EQ(s.trace.r[k], 0.0);
        EXPECT_EQ(s.trace.f[k], 0.0);
        // 1e-14: a second-order polynomial is exact but for rounding.
        EXPECT_NEAR(s.trace.x[k], position(t), 1e-14) << k;
        EXPECT_NEAR(s.trace.v[k], std::max(0.2 * (t - ts), 0.0), 1e-14) << k;
        EXPECT_NEAR(s.trace.y[k], position(t - ts / 2), 1e-14) << k;
    }
}

TEST(Simulate, friction_is_that_before_the_thrust_jumps) {
    const MachineModel machine = machine_of({{"rigid_gain_per_kg", 0.1}, {"friction", {{"coulomb", 5.0}}}});
    const auto s = run(machine, record_of({{"t", times(4)}, {"u", {1.0, 2.0, 3.0, 4.0}}}, machine));
    EXPECT_EQ(s.trace.f, (Values{0.0, 1.0, 2.0, 3.0}));
}

TEST(Simulate, the_encoder_rounds_the_detected_position_only) {
    const MachineModel machine = machine_of({{"rigid_gain_per_kg", 0.1}, {"encoder_resolution_m", 1e-5}});
    const auto s = run(machine, record_of({{"t", times(200)}, {"u", Values(200, 1.0)}}, machine));
    for (std::size_t k = 0; k < s.trace.y.size(); ++k) {
        EXPECT_EQ(s.trace.y[k], 1e-5 * std::floor(s.trace.x[k] / 1e-5 + 0.5)) << k;
    }
    EXPECT_NE(s.trace.y, s.trace.x);
}

TEST(Simulate, in_closed_loop_the_axis_follows_and_u_is_the_whole_thrust) {
    Json description = reference_description();
    description["friction"] = {{"viscous", 2.35}};
    const MachineModel machine = machine_of(description);
    const auto s =
        run(machine, record_of({{"t", times(4001)}, {"r", Values(4001, 1e-3)}, {"exc", Values(4001, 1.5)}}, machine));
    EXPECT_NEAR(s.trace.x.back(), 1e-3, 1e-6); // integral action after 2 s
    EXPECT_NEAR(s.trace.u.back(), 0.0, 1e-2);  // at rest the controller takes back the excitation
    const double kp = description["controller"]["kp"], ki = description["controller"]["ki"],
                 kd = description["controller"]["kd"];
    EXPECT_NEAR(s.trace.u.front(), (kp + ki * ts + kd / ts) * 1e-3 + 1.5, 1e-9); // rounding
}

TEST(Simulate, without_a_controller_closed_loop_is_refused) {
    DriveRecord record;
    record.t = times(3);
    record.reference = Values(3, 0.0);
    EXPECT_THROW(simulate(bare_mass(), record, {.solver = erk}), InputError);
}

TEST(Simulate, events_are_written_with_time_element_and_kind) {
    const MachineModel machine = machine_of(
        {{"rigid_gain_per_kg", 0.1}, {"friction", {{"coulomb", 0.5}, {"elements", {{{"K", 1e5}, {"F", 0.3}}}}}}});
    const auto s = run(machine, record_of({{"t", times(201)}, {"u", sine(3, 20, 201)}}, machine));
    const std::string text = to_csv(s.events);
    EXPECT_EQ(text.substr(0, text.find('\n')), "t,element,kind");
    EXPECT_NE(text.find(",0,slip_forward\n"), std::string::npos);
    EXPECT_NE(text.find(",1,slip_forward\n"), std::string::npos);
    EXPECT_NE(text.find(",0,stick\n"), std::string::npos);
    EXPECT_EQ(to_csv(EventLog{{0.1, 0, 0}, {0.25, 3, -1}, {0.5, 12, 1}}),
              "t,element,kind\n0.1,0,stick\n0.25,3,slip_backward\n0.5,12,slip_forward\n");
    EXPECT_EQ(to_table(s.trace).names(), (std::vector<std::string>{"t", "r", "u", "y", "x", "v", "f"}));
}

TEST(Simulate, the_same_seed_gives_the_same_bytes_and_another_one_other_noise) {
    Json description = reference_description();
    description["noise_rms_m"] = 2e-7;
    description["process_noise_rms_N"] = 0.1;
    const MachineModel machine = machine_of(description);
    const DriveRecord record = record_of({{"t", times(301)}, {"exc", sine(15, 10, 301)}}, machine);
    EXPECT_EQ(bytes(run(machine, record, 3)), bytes(run(machine, record, 3)));
    EXPECT_NE(run(machine, record, 3).trace.y, run(machine, record, 4).trace.y);
    EXPECT_NE(run(machine, record, 3).trace.x, run(machine, record, 4).trace.x);
}

TEST(Simulate, noise_has_the_stated_size) {
    const double rms = 3e-6;
    const MachineModel machine = machine_of({{"rigid_gain_per_kg", 0.1}, {"noise_rms_m", rms}});
    const auto s = run(machine, record_of({{"t", times(20000)}, {"u", Values(20000, 0.0)}}, machine));
    double power = 0;
    for (const double y : s.trace.y) power += y * y;
    EXPECT_NEAR(std::sqrt(power / 20000) / rms, 1, 0.03); // six standard deviations, 1/sqrt(2 20000)
}

TEST(Simulate, a_fitted_start_takes_position_and_velocity_from_the_record) {
    Json description = {{"rigid_gain_per_kg", 0.1}, {"output_delay_s", 4e-4}, {"initial", "fitted"}};
    const MachineModel machine = machine_of(description);
    Values y(200);
    for (std::size_t k = 0; k < y.size(); ++k) y[k] = 0.02 + 0.3 * (static_cast<double>(k) * ts - 4e-4);
    const auto s = run(machine, record_of({{"t", times(200)}, {"u", Values(200, 0.0)}, {"y", y}}, machine));
    for (std::size_t k = 0; k < y.size(); ++k) {
        EXPECT_NEAR(s.trace.y[k], y[k], 1e-12) << k; // the conditioning of a line through ten samples
        EXPECT_NEAR(s.trace.v[k], 0.3, 1e-10) << k;
    }
    EXPECT_THROW(run(machine, record_of({{"t", times(200)}, {"u", Values(200, 0.0)}}, machine)), InputError);
}

TEST(Simulate, a_fitted_start_within_the_encoder_resolution_is_at_rest) {
    const MachineModel machine =
        machine_of({{"rigid_gain_per_kg", 0.1}, {"encoder_resolution_m", 1e-6}, {"initial", "fitted"}});
    Values y(50, 3e-6);
    y[4] = 4e-6;
    const auto s = run(machine, record_of({{"t", times(50)}, {"u", Values(50, 0.0)}, {"y", y}}, machine));
    EXPECT_EQ(s.trace.v, Values(50, 0.0));
    EXPECT_NEAR(s.trace.x[0], 3.1e-6, 1e-12); // the mean of the first ten
}

TEST(Simulate, a_stop_request_ends_early_and_keeps_the_samples_so_far) {
    std::atomic<bool> stop{false};
    RunControl control;
    control.stop = &stop;
    control.progress = [&](const std::string&, std::size_t done, std::size_t) { stop = done >= 1000; };
    const MachineModel machine = bare_mass();
    const auto s =
        simulate(machine, record_of({{"t", times(4001)}, {"u", Values(4001, 1.0)}}, machine), {.solver = erk}, control);
    EXPECT_EQ(s.outcome.end, RunEnd::interrupted);
    EXPECT_GE(s.trace.t.size(), 1000u);
    EXPECT_LT(s.trace.t.size(), 1100u);
    EXPECT_EQ(s.trace.x.size(), s.trace.t.size());
}

double value(const std::array<double, 4>& c, double s) { return c[0] + s * (c[1] + s * (c[2] + s * c[3])); }

TEST(BandLimited, a_sine_well_below_nyquist_is_interpolated) {
    // The cubic between samples errs by (w Ts)^4/384, 1.2e-5 at 80 Hz and 3e-5 at 100 Hz.
    for (const double f : {5.0, 40.0, 80.0, 100.0}) {
        const Values u = sine(1, f, 400);
        const auto pieces = band_limited(u);
        ASSERT_EQ(pieces.size(), u.size());
        double worst = 0;
        for (std::size_t k = 40; k < 360; ++k) { // away from the ends, beyond which u is not known
            for (const double s : {0.0, 0.25, 0.5, 0.75}) {
                const double t = (static_cast<double>(k) + s) * ts;
                worst = std::max(worst, std::abs(value(pieces[k], s) - std::sin(2 * std::numbers::pi * f * t)));
            }
        }
        EXPECT_LT(worst, 1e-4) << f;
    }
}

TEST(BandLimited, pieces_pass_through_the_samples_and_join_smoothly) {
    const Values u = {0, 1, -2, 3, 3, 3, 0.5, 0};
    const auto pieces = band_limited(u);
    for (std::size_t k = 0; k + 1 < u.size(); ++k) {
        EXPECT_EQ(pieces[k][0], u[k]) << k;
        EXPECT_NEAR(value(pieces[k], 1), u[k + 1], 1e-14) << k; // rounding
        const auto& c = pieces[k];
        if (k + 2 < u.size()) {
            EXPECT_NEAR(c[1] + 2 * c[2] + 3 * c[3], pieces[k + 1][1], 1e-13) << k;
        }
    }
    EXPECT_EQ(pieces.back(), (std::array{0.0, 0.0, 0.0, 0.0}));
    EXPECT_TRUE(band_limited({}).empty());
    EXPECT_EQ(band_limited({2.0})[0], (std::array{2.0, 0.0, 0.0, 0.0}));
}

TEST(BandLimited, drives_a_machine_without_the_lag_of_the_hold) {
    const auto motion = [](const char* input) {
        const MachineModel machine =
            machine_of({{"rigid_gain_per_kg", 0.1}, {"input", input}, {"friction", {{"viscous", 50.0}}}});
        return run(machine, record_of({{"t", times(2001)}, {"u", sine(3, 50, 2001)}}, machine)).trace;
    };
    const auto smooth = motion("band_limited"), held = motion("hold");
    // v' = 0.1 (u - 50 v): a lag with 5 1/s; in the end v lags u by atan(w/5).
    const double omega = 2 * std::numbers::pi * 50, amplitude = 0.3 / std::hypot(omega, 5.0),
                 lag = std::atan2(omega, 5.0);
    double error = 0, error_held = 0;
    for (std::size_t k = 1900; k < 1960; ++k) { // the start is gone to exp(-4.7) of a small offset
        const double v = amplitude * std::sin(omega * static_cast<double>(k) * ts - lag);
        error = std::max(error, std::abs(smooth.v[k] - v));
        error_held = std::max(error_held, std::abs(held.v[k] - v));
    }
    EXPECT_LT(error, 0.02 * amplitude);
    EXPECT_GT(error_held, 0.07 * amplitude); // w Ts/2 = 0.079
}

TEST(Simulate, ARecordWithoutInstantsOrWithColumnsOfOtherLengthsIsRefused) {
    EXPECT_THROW(simulate(bare_mass(), {}), InputError);
    DriveRecord record{.t = times(3), .u = {1, 2}, .reference = {}, .excitation = {}, .measured = {}};
    EXPECT_THROW(simulate(bare_mass(), record), InputError);
    record.u.push_back(3);
    EXPECT_EQ(simulate(bare_mass(), record).trace.t, record.t);
}

TEST(Simulate, ARecordThatIsNotFiniteIsRefused) {
    constexpr double infinity = std::numeric_limits<double>::infinity();
    for (const double bad : {infinity, -infinity, std::nan(""), -std::nan("")}) {
        for (const std::size_t place : {0U, 7U, 20U}) {
            DriveRecord record{.t = times(21), .u = Values(21, 1.0), .reference = {}, .excitation = {}, .measured = {}};
            record.u[place] = bad;
            EXPECT_THROW(simulate(bare_mass(), record), InputError) << bad << place;
        }
    }
    // The largest number and the least one are finite.
    DriveRecord record{.t = times(3), .u = {0, 5e-324, -5e-324}, .reference = {}, .excitation = {}, .measured = {}};
    EXPECT_NO_THROW(simulate(bare_mass(), record));
    record.u[1] = std::numeric_limits<double>::max();
    EXPECT_NO_THROW(simulate(bare_mass(), record));
}

TEST(Simulate, InTheMemoryOfAnEarlierRunItIsTheSameRun) {
    const MachineModel machine = bare_mass();
    const DriveRecord longer{.t = times(301), .u = Values(301, 2.0), .reference = {}, .excitation = {}, .measured = {}};
    const DriveRecord record{.t = times(40), .u = Values(40, -1.0), .reference = {}, .excitation = {}, .measured = {}};
    const Simulation expected = simulate(machine, record);
    Simulation before = simulate(machine, longer);
    const double* const memory = before.trace.x.data();
    const Simulation run = simulate(machine, record, {}, {}, std::move(before.trace));
    EXPECT_EQ(run.trace.x.data(), memory);
    for (const auto column : ServoTrace::columns) EXPECT_EQ(run.trace.*column, expected.trace.*column);
    // Without instants of its own a record has those of the machine from 0.
    EXPECT_EQ(simulate(machine, DriveView{.samples = 40, .u = record.u}).trace.x, expected.trace.x);
}

} // namespace
} // namespace tribode
