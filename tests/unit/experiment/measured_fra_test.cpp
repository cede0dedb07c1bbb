#include "physics/reference_machine.hpp"
#include "tribode/analysis/multisine.hpp"
#include "tribode/base/error.hpp"
#include "tribode/experiment/frequency_sweep.hpp"
#include "tribode/experiment/measured_fra.hpp"
#include "tribode/experiment/simulation.hpp"

#include <algorithm>
#include <cmath>
#include <gtest/gtest.h>
#include <numbers>

namespace tribode {
namespace {

using std::numbers::pi;

MachineModel reference() { return machine_of(reference_description()); }

// The machine under an excitation, as a log: t, exc, u, y.
Table log_of(const MachineModel& machine, const std::vector<double>& excitation) {
    DriveRecord drive;
    for (std::size_t k = 0; k < excitation.size(); ++k) {
        drive.t.push_back(static_cast<double>(k) * machine.sample_time);
    }
    drive.reference.assign(excitation.size(), 0);
    drive.excitation = excitation;
    const SolverOptions solver{.relative_tolerance = 1e-6, .absolute_tolerance = 1e-10};
    const Simulation run = simulate(machine, drive, {.solver = solver});
    Table table;
    table.source = "log";
    table.add("t", "s", drive.t);
    table.add("exc", "N", excitation);
    table.add("u", "N", run.trace.u);
    table.add("y", "m", run.trace.y);
    return table;
}

std::vector<double> sine(double frequency, double amplitude, std::size_t count, double sample_time) {
    std::vector<double> x;
    for (std::size_t k = 0; k < count; ++k) {
        x.push_back(amplitude * std::sin(2 * pi * frequency * static_cast<double>(k) * sample_time));
    }
    return x;
}

TEST(MeasuredFra, IsTheSweepOverTheSameWindows) {
    const MachineModel machine = reference();
    SweepOptions options;
    options.frequency_hz = {12.3, 33, 82, 140};
    options.measure_time = 0;
    options.improved = true;
    const SweepResult sweep = run_sweep(machine, options);
    std::vector<Table> records;
    for (const auto& point : sweep.points) {
        const double f = point.frequency_hz;
        const auto settled = static_cast<std::size_t>(std::lround(point.settling_time / machine.sample_time));
        const std::size_t count = settled + whole_periods(0, 10, machine.sample_time, f).count;
        records.push_back(log_of(machine, sine(f, options.amplitude, count, machine.sample_time)));
    }
    MeasuredFraOptions measure;
    measure.methods = {"fra1", "fra2", "proposed", "improved"};
    measure.delay = options.delay;
    measure.sine.periods = 10;
    measure.sine.keep_transients = true;
    const MeasuredFra fra = measure_fra(machine, records, measure);
    ASSERT_EQ(fra.analyses.size(), 4u);
    for (std::size_t a = 0; a < 4; ++a) {
        const FrequencyResponse wanted = a < 3 ? sweep.response(a) : sweep.improved();
        ASSERT_EQ(fra.analyses[a].points.size(), wanted.size());
        for (std::size_t i = 0; i < wanted.size(); ++i) {
            const auto& point = fra.analyses[a].points[i];
            EXPECT_NEAR(point.frequency_hz, wanted.frequency_hz[i], 1e-11);
            EXPECT_LT(std::abs(point.value / wanted.value[i] - 1.0), 1e-12) << fra.analyses[a].method << " " << i;
        }
    }
}

TEST(MeasuredFra, OneLogOfManySinesGivesTheMachine) {
    MachineModel machine = reference();
    std::vector<double> excitation;
    for (const double f :
         {150.0, 20.0, 60.0, 25.0, 29.0, 33.0, 37.0, 45.0, 75.0, 79.0, 82.0, 85.0, 90.0, 110.0, 190.0}) {
        const auto one = sine(f, 30, 2000, machine.sample_time);
        excitation.insert(excitation.end(), one.begin(), one.end());
    }
    Table log = log_of(machine, excitation);
    MeasuredFraOptions options;
    options.methods = {"fra1", "proposed", "improved", "bla"};
    const MeasuredFra fra = measure_fra(machine, {log}, options);
    ASSERT_EQ(fra.analyses.size(), 3u); // no best linear approximation from sines, and that is said
    EXPECT_EQ(fra.analyses[0].points.size(), 15u);
    EXPECT_GE(response_of(fra.analyses[0].points).size(), 13u); // next to 82 Hz a second is too short for a transient
    const auto& fit = *fra.find("improved")->fit;
    const ModalModel truth = modal_model_of(machine);
    EXPECT_NEAR(fit.model.rigid_gain / truth.rigid_gain, 1, 5e-3);
    EXPECT_NEAR(fit.model.modes[0].freq_hz / truth.modes[0].freq_hz, 1, 2e-3);
    EXPECT_NEAR(fit.model.modes[1].freq_hz / truth.modes[1].freq_hz, 1, 2e-3);
    // Without the column exc the excitation is recovered through the controller.
    Table recovered = log;
    std::erase_if(recovered.columns, [](const Column& column) { return column.name == "exc"; });
    const MeasuredFra same = measure_fra(machine, {recovered}, options);
    ASSERT_EQ(same.analyses[1].points.size(), 15u);
    for (std::size_t i = 0; i < 15; ++i) {
        const auto &one = fra.analyses[1].points[i], &other = same.analyses[1].points[i];
        EXPECT_EQ(one.missing, other.missing);
        if (one.missing.empty()) {
            EXPECT_LT(std::abs(other.value / one.value - 1.0), 1e-6);
        }
    }
}

// Hold, lag and dead times have a gain, which the delay model of the proposed analysis has not: its k0 is low by as much.
TEST(MeasuredFra, ImprovedTakesOutTheGainOfHoldAndLagFromMultisines) {
    Json description = reference_description();
    description["friction"] = nullptr;
    description["modes"][1]["zeta"] = 0.03; // settles within a period
    description["encoder_resolution_m"] = 0;
    const MachineModel machine = machine_of(description);
    const Multisine excitation =
        make_multisine({.sample_time = machine.sample_time, .period = 2, .periods = 4, .amplitude = 30});
    const Table log = log_of(machine, excitation.values);
    const ModalModel truth = modal_model_of(machine);
    const MeasuredFra fra = measure_fra(machine, {log}, {.methods = {"proposed", "improved"}});
    // A pure dead time gives sin(x)/x/sqrt(1 + (f/750 Hz)^2), x = pi f Ts, at 100 Hz 0.987.
    for (const auto& point : fra.find("improved")->points) {
        // What the samples fold back from above half the rate is 1e-3 at 200 Hz.
        EXPECT_LT(std::abs(point.value / truth.response(point.frequency_hz) - 1.0), 2e-3) << point.frequency_hz;
    }
    EXPECT_NEAR(fra.find("improved")->fit->model.rigid_gain / truth.rigid_gain, 1, 5e-4);
    EXPECT_LT(fra.find("proposed")->fit->model.rigid_gain / truth.rigid_gain, 0.995);
}

TEST(MeasuredFra, SaysWhereRoundingMakesTheErrorsUncertain) {
    Json description = reference_description();
    description["friction"] = nullptr;
    const auto measured = [&](double noise) {
        description["noise_rms_m"] = noise;
        const MachineModel machine = machine_of(description);
        std::vector<double> excitation;
        for (const double f : {20.0, 28.0, 33.0, 40.0, 60.0, 75.0, 90.0, 110.0, 150.0}) {
            const auto one = sine(f, 15, 4000, machine.sample_time);
            excitation.insert(excitation.end(), one.begin(), one.end());
        }
        MeasuredFraOptions options;
        options.methods = {"improved"};
        return measure_fra(machine, {log_of(machine, excitation)}, options);
    };
    const MeasuredFra still = measured(0), noisy = measured(1e-7);
    EXPECT_TRUE(still.find("improved")->fit->rounding);
    EXPECT_FALSE(noisy.find("improved")->fit->rounding);
    const auto says = [](const MeasuredFra& fra) {
        return std::ranges::any_of(fra.notes,
                                   [](const auto& note) { return note.find("rounding") != std::string::npos; });
    };
    EXPECT_TRUE(says(still));
    EXPECT_FALSE(says(noisy));
}

std::string refusal(const MachineModel& machine, const std::vector<Table>& logs,
                    const MeasuredFraOptions& options = {}) {
    try {
        measure_fra(machine, logs, options);
    } catch (const InputError& problem) {
        return problem.what();
    }
    return "";
}

void expect_part(const std::string& text, const std::string& part) {
    EXPECT_NE(text.find(part), std::string::npos) << text;
}

TEST(MeasuredFra, RefusesWhatCannotBeAnalyzed) {
    const MachineModel machine = reference();
    const Table good = log_of(machine, sine(20, 30, 1000, machine.sample_time));
    const auto with = [&](const char* name, auto change) {
        Table log = good;
        for (auto& column : log.columns) {
            if (column.name == name) change(column.values);
        }
        return log;
    };
    const auto constant = [](auto& values) { std::ranges::fill(values, 0.0); };
    expect_part(refusal(machine, {good, good}), "log has the same samples as one before it");
    expect_part(refusal(machine, {with("u", constant)}), "u is constant");
    expect_part(refusal(machine, {with("y", constant)}), "y is constant: nothing moves");
    const auto slower = [](auto& t) {
        for (double& value : t) value *= 4;
    };
    expect_part(refusal(machine, {with("t", slower)}), "sample time");
    const auto clip = [](auto& y) {
        const double most = 0.6 * *std::max_element(y.begin() + 200, y.end());
        for (double& value : y) value = std::min(value, most);
    };
    expect_part(refusal(machine, {with("y", clip)}), "y stands at its largest values");
    // What the controller makes of noise is no excitation: Y/U would be its inverse.
    MachineModel noisy = machine;
    noisy.noise_rms = 1e-6;
    const Table idle = log_of(noisy, std::vector<double>(1000, 0.0));
    expect_part(refusal(machine, {idle}), "neither r nor exc changes and u is what the controller makes of y");
    MeasuredFraOptions slow;
    slow.delay = 3;
    expect_part(refusal(machine, {good}, slow), "the delay of 3 s is longer than the record of 0.5 s");
    expect_part(refusal(machine, {log_of(machine, sine(960, 30, 1000, machine.sample_time))}), "alias");
    MeasuredFraOptions unknown;
    unknown.methods = {"fra3"};
    expect_part(refusal(machine, {good}, unknown), "methods has \"fra3\", must have some of fra1");
}

} // namespace
} // namespace tribode
