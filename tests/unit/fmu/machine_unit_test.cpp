#include "physics/reference_machine.hpp"
#include "tribode/base/error.hpp"
#include "tribode/experiment/simulation.hpp"
#include "tribode/fmu/fmu_export.hpp"
#include "unit/fmu/units.hpp"

#include <cmath>

namespace tribode {
namespace {

constexpr double ts = 5e-4;
constexpr std::size_t samples = 600;

Json open_loop_axis() {
    Json d = reference_description();
    d.erase("controller");
    d["encoder_resolution_m"] = 1e-7;
    d["noise_rms_m"] = 2e-7;
    d["friction"]["coulomb"] = 0.5;
    return d;
}

double thrust(std::size_t k) { return 6 * std::sin(2 * M_PI * 7 * static_cast<double>(k) * ts) + (k > 200 ? 3 : 0); }
double reference(std::size_t k) { return 1e-3 * std::sin(2 * M_PI * 3 * static_cast<double>(k) * ts); }

ServoTrace own_run(const Json& description, bool closed) {
    const MachineModel machine = machine_of(description);
    DriveRecord record;
    for (std::size_t k = 0; k < samples; ++k) {
        record.t.push_back(static_cast<double>(k) * ts);
        (closed ? record.reference : record.u).push_back(closed ? reference(k) : thrust(k));
    }
    return simulate(machine, record).trace;
}

FmuOptions options(FmiVersion version) { return {.version = version, .name = "axis"}; }

// The instants are added up, as many programs do.
TEST(MachineUnit, AnOpenLoopIsThatOfTheProgramToTheBit) {
    const Json axis = open_loop_axis();
    const UnpackedUnit unit(fmu_of_machine(axis, options(FmiVersion::fmi2)));
    const Fmi2Unit one(unit);
    one.initialize();
    const ServoTrace own = own_run(axis, false);
    double t = 0, largest = 0;
    for (std::size_t k = 0; k < samples; ++k) {
        ASSERT_EQ(one.get("y"), own.y[k]) << k;
        ASSERT_EQ(one.get("x"), own.x[k]) << k;
        ASSERT_EQ(one.get("v"), own.v[k]) << k;
        ASSERT_EQ(one.get("f"), own.f[k]) << k;
        largest = std::max(largest, std::abs(own.x[k]));
        ASSERT_EQ(one.set("u", thrust(k)), fmi2OK);
        ASSERT_EQ(one.step(t, ts), fmi2OK) << last_message();
        t += ts;
    }
    EXPECT_GT(largest, 1e-4); // it moved
}

TEST(MachineUnit, AClosedLoopIsThatOfTheProgramToTheBit) {
    const Json axis = reference_description();
    const UnpackedUnit unit(fmu_of_machine(axis, options(FmiVersion::fmi3)));
    const Fmi3Unit one(unit);
    one.initialize();
    const ServoTrace own = own_run(axis, true);
    for (std::size_t k = 0; k + 1 < samples; ++k) {
        ASSERT_EQ(one.set("r", reference(k)), fmi3OK);
        const auto step = one.step(static_cast<double>(k) * ts, ts);
        ASSERT_EQ(step.status, fmi3OK) << last_message();
        ASSERT_EQ(one.get("u"), own.u[k]) << k;
        ASSERT_EQ(one.get("y"), own.y[k + 1]) << k;
        ASSERT_EQ(one.get("x"), own.x[k + 1]) << k;
        ASSERT_EQ(one.get("f"), own.f[k + 1]) << k;
    }
}

// Sampled parts keep their instants, whatever the communication step is.
TEST(MachineUnit, TheCommunicationStepDoesNotMatter) {
    const Json axis = reference_description();
    const UnpackedUnit unit(fmu_of_machine(axis, options(FmiVersion::fmi2)));
    const auto end = [&](double step, int count) {
        const Fmi2Unit one(unit);
        one.initialize();
        one.set("r", 1e-3);
        for (int i = 0; i < count; ++i) EXPECT_EQ(one.step(i * step, step), fmi2OK) << last_message();
        return one.get("x");
    };
    const double expected = end(0.1, 1);
    EXPECT_GT(expected, 1e-4);
    EXPECT_EQ(end(5e-4, 200), expected);
    EXPECT_NEAR(end(1.3e-4, 769) - expected, end(0.09997, 1) - expected, 1e-13); // 769 steps end there
}

TEST(MachineUnit, ParametersAreFieldsByTheirPath) {
    Json axis = reference_description();
    const UnpackedUnit unit(fmu_of_machine(axis, options(FmiVersion::fmi2)));
    const Fmi2Unit one(unit);
    EXPECT_EQ(one.get("modes[1].freq_hz"), 33.32);
    ASSERT_EQ(one.set("friction.elements[20].D", 25), fmi2OK);
    ASSERT_EQ(one.set("controller.kp", 15000), fmi2OK);
    one.initialize();
    EXPECT_EQ(one.set("friction.viscous", 3), fmi2Error);
    EXPECT_EQ(last_message(), "friction.viscous can be set up to the end of the initialization only");
    axis["friction"]["elements"][19]["D"] = 25;
    axis["controller"]["kp"] = 15000;
    const ServoTrace own = own_run(axis, true);
    for (std::size_t k = 0; k + 1 < samples; ++k) {
        one.set("r", reference(k));
        ASSERT_EQ(one.step(static_cast<double>(k) * ts, ts), fmi2OK);
        ASSERT_EQ(one.get("x"), own.x[k + 1]) << k;
    }
    EXPECT_NE(own.x.back(), own_run(reference_description(), true).x.back());
}

TEST(MachineUnit, AWrongParameterIsRefusedWithItsField) {
    const UnpackedUnit unit(fmu_of_machine(reference_description(), options(FmiVersion::fmi2)));
    const Fmi2Unit one(unit);
    one.set("modes[2].freq_hz", -5);
    EXPECT_EQ(one.call("fmi2EnterInitializationMode"), fmi2OK);
    EXPECT_EQ(one.call("fmi2ExitInitializationMode"), fmi2Error);
    EXPECT_EQ(last_message(), "axis: modes[2].freq_hz = -5 Hz, must be positive and finite");
}

// A state that is kept and restored goes on as if nothing had been between.
TEST(MachineUnit, AStateIsKeptAndRestored) {
    const UnpackedUnit unit(fmu_of_machine(reference_description(), options(FmiVersion::fmi2)));
    const Fmi2Unit one(unit);
    one.initialize();
    const auto run = [&](std::size_t from, std::size_t to) {
        std::vector<double> x;
        for (std::size_t k = from; k < to; ++k) {
            one.set("r", reference(k));
            EXPECT_EQ(one.step(static_cast<double>(k) * ts, ts), fmi2OK) << last_message();
            x.push_back(one.get("x"));
        }
        return x;
    };
    run(0, 100);
    fmi2FMUstate state = nullptr;
    ASSERT_EQ(unit.function<fmi2GetFMUstateTYPE>("fmi2GetFMUstate")(one.c, &state), fmi2OK);
    const auto first = run(100, 200);
    ASSERT_EQ(unit.function<fmi2SetFMUstateTYPE>("fmi2SetFMUstate")(one.c, state), fmi2OK);
    const auto second = run(100, 200);
    ASSERT_EQ(unit.function<fmi2FreeFMUstateTYPE>("fmi2FreeFMUstate")(one.c, &state), fmi2OK);
    EXPECT_EQ(state, nullptr);
    for (std::size_t i = 0; i < first.size(); ++i) ASSERT_NEAR(first[i], second[i], 1e-15) << i;
}

TEST(MachineUnit, AResetBeginsAnewWithTheValuesOfTheFile) {
    const UnpackedUnit unit(fmu_of_machine(reference_description(), options(FmiVersion::fmi2)));
    const Fmi2Unit one(unit);
    const auto run = [&] {
        one.initialize();
        one.set("r", 1e-3);
        EXPECT_EQ(one.step(0, 0.05), fmi2OK);
        return one.get("x");
    };
    one.set("friction.viscous", 200);
    const double damped = run();
    ASSERT_EQ(one.call("fmi2Reset"), fmi2OK);
    const double first = run();
    EXPECT_GT(first, damped);
    ASSERT_EQ(one.call("fmi2Reset"), fmi2OK);
    EXPECT_EQ(run(), first);
}

TEST(MachineUnit, TimeMayBeginLater) {
    const UnpackedUnit unit(fmu_of_machine(reference_description(), options(FmiVersion::fmi2)));
    const auto end = [&](double start) {
        const Fmi2Unit one(unit);
        one.initialize(start);
        one.set("r", 1e-3);
        for (int i = 0; i < 100; ++i) EXPECT_EQ(one.step(start + i * ts, ts), fmi2OK) << last_message();
        return one.get("x");
    };
    EXPECT_EQ(end(0), end(3.7));
}

TEST(MachineUnit, AStepBeginsWhereTheLastOneEnded) {
    const UnpackedUnit unit(fmu_of_machine(reference_description(), options(FmiVersion::fmi2)));
    const Fmi2Unit one(unit);
    EXPECT_EQ(one.step(0, ts), fmi2Error);
    one.initialize();
    EXPECT_EQ(one.step(0, ts), fmi2OK);
    EXPECT_EQ(one.step(0, ts), fmi2Error);
    EXPECT_NE(last_message().find("must begin at 0.0005"), std::string::npos) << last_message();
    EXPECT_EQ(one.step(ts, -ts), fmi2Error);
    EXPECT_EQ(one.step(ts, ts), fmi2OK);
    EXPECT_EQ(one.call("fmi2Terminate"), fmi2OK);
    EXPECT_EQ(one.step(2 * ts, ts), fmi2Error);
}

TEST(MachineUnit, OneIsMadeForItsTokenAndKindOnly) {
    const UnpackedUnit unit(fmu_of_machine(reference_description(), options(FmiVersion::fmi3)));
    EXPECT_THROW(Fmi3Unit(unit, true), std::runtime_error);
    EXPECT_EQ(last_message(), "the unit was exported for co-simulation, not for model exchange");
    const auto instantiate = unit.function<fmi3InstantiateCoSimulationTYPE>("fmi3InstantiateCoSimulation");
    const auto made = [&](const char* token, const std::string& resources) {
        return instantiate("a", token, resources.c_str(), false, false, false, false, nullptr, 0, nullptr, log_of_fmi3,
                           nullptr);
    };
    EXPECT_EQ(made("{0}", unit.resources()), nullptr);
    EXPECT_EQ(made(unit.token().c_str(), "/nowhere"), nullptr);
    EXPECT_EQ(last_message(), "/nowhere/model.json: cannot be read");
}

std::string refusal(const Json& machine, bool model_exchange = false) {
    try {
        fmu_of_machine(machine, {.model_exchange = model_exchange, .name = "axis"});
        return "";
    } catch (const InputError& problem) {
        return problem.what();
    }
}

TEST(MachineUnit, WhatCannotBeOneIsRefusedWithTheReason) {
    EXPECT_EQ(refusal(reference_description()), "");
    EXPECT_NE(refusal(reference_description(), true).find("sample clocks"), std::string::npos);
    Json fitted = reference_description();
    fitted["initial"] = "fitted";
    EXPECT_NE(refusal(fitted).find("must be \"rest\""), std::string::npos);
    Json band_limited = open_loop_axis();
    band_limited["input"] = "band_limited";
    EXPECT_NE(refusal(band_limited).find("must be \"hold\""), std::string::npos);
}

TEST(MachineUnit, TheArchiveHasItsPartsAndIsTheSameEachTime) {
    const std::string archive = fmu_of_machine(reference_description(), options(FmiVersion::fmi2));
    EXPECT_EQ(archive, fmu_of_machine(reference_description(), options(FmiVersion::fmi2)));
    const auto files = unzipped(archive);
    EXPECT_TRUE(files.contains("binaries/linux64/axis.so"));
    EXPECT_TRUE(unzipped(fmu_of_machine(reference_description(), options(FmiVersion::fmi3)))
                    .contains("binaries/x86_64-linux/axis.so"));
    const std::string& xml = files.at("modelDescription.xml");
    EXPECT_NE(xml.find("<Unit name=\"N s/m\"><BaseUnit kg=\"1\" s=\"-1\"/></Unit>"), std::string::npos) << xml;
    EXPECT_NE(xml.find("stepSize=\"5e-04\""), std::string::npos);
}

// What is freed is free, and instances do not know of each other.
TEST(MachineUnit, InstancesComeAndGo) {
    const UnpackedUnit unit(fmu_of_machine(reference_description(), options(FmiVersion::fmi2)));
    const Fmi2Unit still(unit);
    still.initialize();
    for (int i = 0; i < 200; ++i) {
        const Fmi2Unit other(unit);
        other.initialize();
        other.set("r", 1e-3 * i);
        ASSERT_EQ(other.step(0, 2e-3), fmi2OK);
    }
    ASSERT_EQ(still.step(0, 2e-3), fmi2OK);
    EXPECT_EQ(still.get("x"), 0);
}

} // namespace
} // namespace tribode
