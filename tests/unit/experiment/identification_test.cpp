#include "physics/reference_machine.hpp"
#include "tribode/analysis/multisine.hpp"
#include "tribode/base/error.hpp"
#include "tribode/experiment/identification.hpp"
#include "tribode/experiment/simulation.hpp"

#include <algorithm>
#include <cmath>
#include <fmt/format.h>
#include <gtest/gtest.h>
#include <numbers>

namespace tribode {
namespace {

using std::numbers::pi;

Json description() {
    Json d = reference_description();
    d["modes"].erase(1);
    d["friction"] = {{"viscous", 8.0}, {"coulomb", 1.0}};
    double limit = 2e-6;
    for (int i = 0; i < 3; ++i, limit *= 10) d["friction"]["elements"].push_back({{"K", 1 / limit}, {"F", 1.0}});
    d["noise_rms_m"] = 5e-8;
    return d;
}

// A multisine beside a slow sine of the reference, with the columns named.
GivenRecord log_of(const MachineModel& machine, std::uint64_t seed, const std::vector<std::string>& columns,
                   double origin = 0) {
    const Multisine excitation = make_multisine({.sample_time = machine.sample_time,
                                                 .period = 2,
                                                 .periods = 3,
                                                 .f_min_hz = 5,
                                                 .f_max_hz = 100,
                                                 .amplitude = 60});
    DriveRecord drive;
    for (std::size_t k = 0; k < excitation.values.size(); ++k) {
        drive.t.push_back(static_cast<double>(k) * machine.sample_time);
        drive.reference.push_back(0.01 * std::sin(2 * pi * drive.t.back()));
    }
    drive.excitation = excitation.values;
    const Simulation run = simulate(machine, drive, {.seed = seed});
    GivenRecord record;
    record.table.source = "log";
    record.table.add("t", "s", drive.t);
    for (const auto& name : columns) {
        std::vector<double> values = name == "r"     ? drive.reference
                                     : name == "exc" ? drive.excitation
                                     : name == "u"   ? run.trace.u
                                                     : run.trace.y;
        if (name == "y") std::ranges::for_each(values, [&](double& y) { y += origin; });
        record.table.add(name, "", values);
    }
    return record;
}

MachineModel rough(const MachineModel& truth) {
    const Json factors = {{"rigid_gain_per_kg", 1.1},      {"modes[1].gain", 0.8},          {"modes[1].freq_hz", 1.02},
                          {"modes[1].zeta", 1.5},          {"friction.viscous", 0.7},       {"friction.coulomb", 1.2},
                          {"friction.elements[*].F", 0.9}, {"friction.elements[*].K", 0.9}, {"input_delay_s", 0.9}};
    return truth.with_fields(Json::object(), factors, "rough");
}

void expect_truth(const Identification& found, const MachineModel& truth) {
    EXPECT_TRUE(found.converged);
    EXPECT_TRUE(found.notes.empty());
    EXPECT_LT(found.excess, 2);
    for (const auto& parameter : found.parameters) {
        const bool is_element = parameter.name.ends_with("]");
        const double wanted = truth.field(parameter.name + (is_element ? ".F" : "")).get<double>();
        EXPECT_LT(std::abs(parameter.value - wanted), 3.5 * parameter.standard_error) << parameter.name;
        EXPECT_LT(parameter.standard_error, 0.02 * wanted) << parameter.name;
        EXPECT_EQ(found.machine.field(parameter.name + (is_element ? ".F" : "")).get<double>(), parameter.value);
    }
}

TEST(Identification, FindsAllParametersFromThrustAndPosition) {
    const MachineModel truth = machine_of(description());
    MachineModel start = rough(truth);
    start.controller = {}; // of the drive nothing need be known
    // Two records at other places of the axis.
    const Identification found =
        identify(start, {log_of(truth, 1, {"u", "y"}), log_of(truth, 2, {"u", "y"}, 0.25)}, {}, {});
    ASSERT_EQ(found.parameters.size(), 10u);
    EXPECT_EQ(found.parameters[4].name, "friction.coulomb");
    EXPECT_EQ(found.parameters[6].name, "friction.elements[1]");
    EXPECT_EQ(found.parameters[6].unit, "N");
    EXPECT_NEAR(found.parameters[6].start, 0.9, 1e-12);
    expect_truth(found, truth);
    // Displacement at which an element slips, and what is no parameter: as before.
    EXPECT_NEAR(found.machine.elements[0].limit(), 2e-6, 1e-15);
    EXPECT_EQ(found.machine.encoder_resolution, truth.encoder_resolution);
    ASSERT_EQ(found.residuals.size(), 2u);
    double square = 0;
    for (const double e : found.residuals[1]) square += e * e / static_cast<double>(found.residuals[1].size());
    EXPECT_LT(std::sqrt(square),
              1e-6); // noise of 0.05 um, and what it makes of the thrust below the observer's bandwidth
}

TEST(Identification, FindsThemInClosedLoopWithoutThrust) {
    const MachineModel truth = machine_of(description());
    IdentifyOptions options;
    options.parameters = {"modes", "rigid_gain_per_kg", "friction.elements[*].F", "friction.viscous"};
    MachineModel start = rough(truth);
    start.input_delay = truth.input_delay;
    start.dry = truth.dry;
    for (std::size_t i = 0; i < start.elements.size(); ++i) start.elements[i].stiffness = truth.elements[i].stiffness;
    const Identification found = identify(start, {log_of(truth, 3, {"r", "exc", "y"})}, {}, options);
    ASSERT_EQ(found.parameters.size(), 8u);
    EXPECT_EQ(found.parameters[4].name, "friction.elements[1].F");
    expect_truth(found, truth);
}

// The usual ones are those that are not zero; a delay that the machine has not is none of them.
TEST(Identification, FitsWhatTheMachineHas) {
    Json d = description();
    d.erase("input_delay_s");
    d["friction"] = {{"viscous", 8.0}};
    const MachineModel truth = machine_of(d);
    IdentifyOptions options;
    options.f_max = 300;
    const MachineModel start = truth.with_fields(Json::object(), {{"friction.viscous", 0.5}}, "rough");
    const Identification found = identify(start, {log_of(truth, 5, {"u", "y"})}, {}, options);
    ASSERT_EQ(found.parameters.size(), 2 + 3 * truth.modes.size());
    EXPECT_EQ(found.parameters.back().name, "friction.viscous");
    expect_truth(found, truth);
}

// Without exact derivatives: a Stribeck curve.
TEST(Identification, FindsAStribeckCurve) {
    Json d = description();
    d["friction"] = {{"viscous", 8.0}, {"coulomb", 3.0}, {"stribeck", {{"static", 4.5}, {"velocity", 0.01}}}};
    const MachineModel truth = machine_of(d);
    const Json factors = {{"friction.stribeck.static", 1.1}, {"friction.stribeck.velocity", 0.8}};
    const MachineModel start = truth.with_fields(Json::object(), factors, "rough");
    IdentifyOptions options;
    options.parameters = {"friction.coulomb", "friction.stribeck.static", "friction.stribeck.velocity"};
    options.f_max = 300;
    // Also from where both levels are equal: that machine has exact derivatives, those near it have not.
    const MachineModel level = start.with_fields({{"friction.stribeck.static", start.dry.coulomb}}, Json::object(), "");
    for (const MachineModel& from : {start, level}) {
        const Identification found = identify(from, {log_of(truth, 4, {"u", "y"})}, {}, options, {.workers = 2});
        for (const auto& parameter : found.parameters) {
            const double wanted = truth.field(parameter.name).get<double>();
            EXPECT_LT(std::abs(parameter.value - wanted), 4 * parameter.standard_error) << parameter.name;
            EXPECT_LT(parameter.standard_error, 0.05 * wanted) << parameter.name;
        }
    }
}

// The shares of a level stay one level: what is found is a machine.
TEST(Identification, FindsSharesWhoseSumStaysOne) {
    Json d = description();
    const auto law = [](double first, double second) {
        return Json::parse(fmt::format(R"([{{"name": "gms_friction", "parameters": {{"F": 3, "Fs": 4, "velocity": 0.01,
            "attraction": 300, "elements": [{{"K": 3e5, "share": {}}}, {{"K": 3e4, "share": {}}}, {{"K": 1e4, "share": {}}}]}}}}])",
                                       first, second, 1 - first - second));
    };
    d["friction"] = {{"viscous", 8.0}};
    d["effects"] = law(0.4, 0.4);
    const MachineModel truth = machine_of(d);
    d["effects"] = law(0.6, 0.2);
    IdentifyOptions options;
    const std::string path = "effects[1].parameters.elements";
    options.parameters = {path + "[*].share"}; // the last one follows
    options.f_max = 300;
    const Identification found = identify(machine_of(d), {log_of(truth, 9, {"u", "y"})}, {}, options, {.workers = 2});
    ASSERT_EQ(found.parameters.size(), 2u);
    double sum = 0;
    for (const char* place : {"[1].share", "[2].share", "[3].share"}) {
        sum += found.machine.field(path + place).get<double>();
    }
    EXPECT_NEAR(sum, 1, 1e-12);
    EXPECT_NO_THROW(found.machine.with_fields(Json::object(), Json::object(), "found"));
    for (const auto& parameter : found.parameters) {
        const double wanted = truth.field(parameter.name).get<double>();
        EXPECT_LT(std::abs(parameter.value - wanted), 4 * parameter.standard_error) << parameter.name;
        EXPECT_LT(parameter.standard_error, 0.05 * wanted) << parameter.name;
    }
}

bool has_note(const Identification& found, const std::string& part) {
    return std::ranges::any_of(found.notes,
                               [&](const std::string& note) { return note.find(part) != std::string::npos; });
}

TEST(Identification, TellsTheObjectiveOfAMachineAsItIs) {
    const MachineModel truth = machine_of(description());
    const GivenRecord record = log_of(truth, 1, {"u", "y"});
    IdentifyOptions options;
    options.iterations = 0;
    const Identification as_is = identify(truth, {record}, {}, options);
    const Identification start = identify(rough(truth), {record}, {}, options);
    EXPECT_EQ(as_is.iterations, 0);
    EXPECT_EQ(as_is.simulations, 1);
    EXPECT_FALSE(as_is.converged);
    EXPECT_TRUE(as_is.notes.empty());
    EXPECT_TRUE(as_is.covariance.empty());
    ASSERT_EQ(as_is.parameters.size(), 10u);
    for (const auto& parameter : as_is.parameters) {
        EXPECT_EQ(parameter.value, parameter.start);
        EXPECT_TRUE(std::isinf(parameter.standard_error));
    }
    EXPECT_LT(as_is.objective, start.objective - 1000);
    options.iterations = 40;
    const Identification found = identify(rough(truth), {record}, {}, options);
    EXPECT_LT(found.objective, as_is.objective);          // the minimum
    EXPECT_GT(found.objective, as_is.objective - 10 * 4); // of ten parameters
}

// Of Dahl's law on a machine with dry friction the stiffness grows beyond all bounds.
TEST(Identification, GivesUpSimulationsOfALawThatIsTooSteep) {
    Json d = description();
    d["friction"] = {{"viscous", 8.0}, {"coulomb", 3.0}};
    const GivenRecord record = log_of(machine_of(d), 4, {"u", "y"});
    d["friction"] = {{"viscous", 8.0}};
    d["effects"] = Json::parse(R"([{"name": "dahl_friction", "parameters": {"F": 3, "K": 1e6}}])");
    IdentifyOptions options;
    options.parameters = {"effects[1].parameters.F", "effects[1].parameters.K"};
    options.iterations = 4;
    const Identification found = identify(machine_of(d), {record}, {}, options);
    EXPECT_TRUE(has_note(found, "dry friction may describe the machine better"));
    // A budget ends it with the best values so far.
    options.simulations = 6;
    const Identification stopped = identify(machine_of(d), {record}, {}, options);
    EXPECT_FALSE(stopped.converged);
    EXPECT_LT(stopped.iterations, found.iterations);
    EXPECT_GE(stopped.simulations, 6);
    EXPECT_TRUE(has_note(stopped, fmt::format("Not converged after {} iterations and {} simulations",
                                              stopped.iterations, stopped.simulations)));
}

// A machine whose friction the model has not: the standard errors are larger than those of noise, and the mode is still found.
TEST(Identification, ShowsThatAModelIsWrong) {
    Json d = description();
    const GivenRecord record = log_of(machine_of(d), 5, {"u", "y"});
    d["friction"].erase("coulomb");
    const MachineModel wrong = machine_of(d);
    const Identification found = identify(wrong, {record}, {}, {});
    EXPECT_GT(found.excess, 1.3);
    EXPECT_NEAR(found.machine.rigid_gain / wrong.rigid_gain, 1, 5e-3);
    EXPECT_NEAR(found.machine.modes[0].freq_hz / wrong.modes[0].freq_hz, 1, 1e-3);
    EXPECT_NEAR(found.machine.modes[0].zeta / wrong.modes[0].zeta, 1, 0.05);
}

TEST(Identification, NamesWhatTheRecordsDoNotDetermine) {
    const MachineModel truth = machine_of(description());
    MachineModel start = truth;
    start.elements.push_back({1e-3, 1.0}); // slips after a kilometre
    IdentifyOptions options;
    options.parameters = {"rigid_gain_per_kg", "friction.elements[4].F"};
    const Identification found = identify(start, {log_of(truth, 6, {"u", "y"})}, {}, options);
    EXPECT_TRUE(std::isinf(found.parameters[1].standard_error));
    ASSERT_EQ(found.notes.size(), 1u);
    EXPECT_NE(found.notes[0].find("do not determine friction.elements[4].F"), std::string::npos) << found.notes[0];
    EXPECT_EQ(found.covariance[1][1], 0);
}

std::string refusal(const MachineModel& machine, const std::vector<GivenRecord>& records,
                    const std::vector<std::string>& parameters = {}) {
    try {
        IdentifyOptions options;
        options.parameters = parameters;
        identify(machine, records, {}, options);
    } catch (const InputError& problem) {
        return problem.what();
    }
    return "";
}

TEST(Identification, RefusesWhatCannotBeFitted) {
    const MachineModel truth = machine_of(description());
    const auto expect_part = [](const std::string& text, const std::string& part) {
        EXPECT_NE(text.find(part), std::string::npos) << text;
    };
    expect_part(refusal(truth, {}), "at least one record");
    expect_part(refusal(truth, {log_of(truth, 7, {"u"})}), "no column y");
    expect_part(refusal(truth, {log_of(truth, 7, {"y"})}), "no column u");
    const GivenRecord good = log_of(truth, 7, {"u", "y"});
    expect_part(refusal(truth, {good}, {"friction.viscos"}), "did you mean");
    expect_part(refusal(truth, {good, good}), "a record that is given again is no repetition");
    expect_part(refusal(truth, {good}, {"friction.elements[1].D"}), "= 0 is no start of a fit");
    GivenRecord still = good;
    std::ranges::fill(still.table.columns.back().values, 0.1);
    expect_part(refusal(truth, {still}), "y is constant");
    GivenRecord few = good;
    for (auto& column : few.table.columns) column.values.resize(100);
    expect_part(refusal(truth, {few}), "100 samples, must be 256 at least");
    const auto with = [&](const char* name, auto change) {
        GivenRecord other = good;
        for (auto& column : other.table.columns) {
            if (column.name == name) change(column.values);
        }
        return other;
    };
    const auto clip = [](auto& values) {
        const double most = 0.6 * std::ranges::max(values);
        for (double& value : values) value = std::min(value, most);
    };
    expect_part(refusal(truth, {with("u", [](auto& u) { std::ranges::fill(u, 0.0); })}), "u is zero throughout");
    const auto aliased = [](auto& values) {
        for (std::size_t k = 0; k < values.size(); ++k) values[k] = 20 * std::sin(3.0 * static_cast<double>(k));
    };
    expect_part(refusal(truth, {with("u", aliased)}), "most of u lies above 0.45 of the sampling rate");
    expect_part(refusal(truth, {with("y", clip)}), "y stands at its largest values");
    MachineModel late = truth;
    late.input_delay = 7;
    expect_part(refusal(late, {good}), "s is longer than the record");
    // A drive may limit the thrust: that is said, not refused.
    IdentifyOptions options;
    options.parameters = {"rigid_gain_per_kg"};
    options.iterations = 1;
    const auto notes = identify(truth, {with("u", clip)}, {}, options).notes;
    EXPECT_TRUE(std::ranges::any_of(notes, [](const auto& note) {
        return note.find("u stands at its largest values") != std::string::npos;
    })) << (notes.empty() ? "no note" : notes.front());
}

} // namespace
} // namespace tribode
