#include "tribode/machine/machine_model.hpp"
#include "unit/script/messages.hpp"

#include <gtest/gtest.h>

#include <cmath>

namespace tribode {
namespace {

// Every field of the machine description.
const char* const complete = R"({
    "comment": "a table",
    "Ts": 0.0005,
    "rigid_gain_per_kg": 0.09428,
    "modes": [{"gain": 0.01308, "freq_hz": 33.32, "zeta": 0.0248}, {"gain": 0.00527, "freq_hz": 82.22, "zeta": 0}],
    "friction": {
        "coulomb": 1.5,
        "viscous": 2.35,
        "stribeck": {"static": 2.5, "velocity": 0.01, "exponent": 0.8},
        "elements": [{"K": 210000, "F": 0.5, "D": 1.25}, {"K": 3600, "F": 0.36}]
    },
    "input_delay_s": 0.0005,
    "output_delay_s": 0.000418,
    "current_loop_hz": 750.0,
    "encoder_resolution_m": 1e-7,
    "noise_rms_m": 2e-8,
    "controller": {"type": "pid", "kp": 2.05e4, "ki": 1.8e5, "kd": 653, "derivative_filter_hz": 400},
    "closed_loop": true,
    "input": "hold",
    "initial": "fitted",
    "tolerance": {"rigid_gain_per_kg": 0.01, "modes.gain": 0.02, "modes.freq_hz": 0.03, "modes.zeta": 0.04,
                  "friction.coulomb": 0.05, "friction.viscous": 0.06, "friction.elements": 0.07,
                  "input_delay_s": 0.08, "current_loop_hz": 0.09},
    "process_noise_rms_N": 0.3,
    "effects": []
})";

MachineModel model(const Json& description) { return MachineModel::from_description(description, "x.json"); }
MachineModel parsed(const std::string& text) { return model(Json::parse(text)); }

// What is said of the complete description with one field changed; "none: " where it is accepted.
std::string problem(const std::string& pointer, const std::string& value) {
    Json description = Json::parse(complete);
    description[Json::json_pointer(pointer)] = Json::parse(value);
    return problem_of([&] { model(description); });
}

std::string problem_without(const std::string& table, const std::string& field) {
    Json description = Json::parse(complete);
    description[Json::json_pointer(table)].erase(field);
    return problem_of([&] { model(description); });
}

TEST(MachineModel, ReadsACompleteDescription) {
    const MachineModel m = parsed(complete);
    EXPECT_EQ(m.sample_time, 0.0005);
    EXPECT_EQ(m.rigid_gain, 0.09428);
    ASSERT_EQ(m.modes.size(), 2u);
    EXPECT_EQ(m.modes[0].gain, 0.01308);
    EXPECT_EQ(m.modes[0].freq_hz, 33.32);
    EXPECT_EQ(m.modes[0].zeta, 0.0248);
    EXPECT_EQ(m.modes[1].zeta, 0);
    EXPECT_EQ(m.dry.coulomb, 1.5);
    EXPECT_EQ(m.dry.static_level(), 2.5);
    EXPECT_EQ(m.dry.stribeck->velocity, 0.01);
    EXPECT_EQ(m.dry.stribeck->exponent, 0.8);
    EXPECT_EQ(m.viscous, 2.35);
    ASSERT_EQ(m.elements.size(), 2u);
    EXPECT_EQ(m.elements[0].stiffness, 210000);
    EXPECT_EQ(m.elements[0].level, 0.5);
    EXPECT_EQ(m.elements[0].damping, 1.25);
    EXPECT_EQ(m.elements[1].damping, 0);
    EXPECT_EQ(m.input_delay, 0.0005);
    EXPECT_EQ(m.output_delay, 0.000418);
    EXPECT_EQ(m.current_loop_hz, 750);
    EXPECT_EQ(m.encoder_resolution, 1e-7);
    EXPECT_EQ(m.noise_rms, 2e-8);
    EXPECT_EQ(m.process_noise_rms, 0.3);
    const auto& pid = std::get<PidController>(m.controller);
    EXPECT_EQ(pid.kp, 2.05e4);
    EXPECT_EQ(pid.ki, 1.8e5);
    EXPECT_EQ(pid.kd, 653);
    EXPECT_EQ(pid.derivative_filter_hz, 400);
    EXPECT_TRUE(m.has_controller());
    EXPECT_TRUE(m.in_closed_loop());
    EXPECT_EQ(m.input, InputKind::hold);
    EXPECT_EQ(m.initial, InitialKind::fitted);
    EXPECT_EQ(m.tolerance, (std::map<std::string, double>{{"rigid_gain_per_kg", 0.01},
                                                          {"modes.gain", 0.02},
                                                          {"modes.freq_hz", 0.03},
                                                          {"modes.zeta", 0.04},
                                                          {"friction.coulomb", 0.05},
                                                          {"friction.viscous", 0.06},
                                                          {"friction.elements", 0.07},
                                                          {"input_delay_s", 0.08},
                                                          {"current_loop_hz", 0.09}}));
    EXPECT_EQ(model(m.description()).hash(), m.hash());
}

TEST(MachineModel, ReadsACascade) {
    const MachineModel m = parsed(R"({"rigid_gain_per_kg": 1, "controller":
        {"type": "cascade", "kp": 160.18, "kv": 243.45, "limit": 351.5, "delay_samples": 1}})");
    const auto& cascade = std::get<CascadeController>(m.controller);
    EXPECT_EQ(cascade.kp, 160.18);
    EXPECT_EQ(cascade.kv, 243.45);
    EXPECT_EQ(cascade.limit, 351.5);
    EXPECT_EQ(cascade.delay_samples, 1u);
    const MachineModel unlimited =
        parsed(R"({"rigid_gain_per_kg": 1, "controller": {"type": "cascade", "kp": 1, "kv": 1, "limit": null}})");
    EXPECT_EQ(std::get<CascadeController>(unlimited.controller).limit, CascadeController::no_limit);
    EXPECT_EQ(std::get<CascadeController>(unlimited.controller).delay_samples, 0u);
}

TEST(MachineModel, WhatIsAbsentIsNoneOrZero) {
    for (const char* text :
         {R"({"rigid_gain_per_kg": 1})",
          R"({"rigid_gain_per_kg": 1, "modes": null, "friction": {"stribeck": null, "elements": []},
              "controller": null, "current_loop_hz": null, "tolerance": null, "effects": null, "input": null})",
          R"({"rigid_gain_per_kg": 1, "modes": {}, "friction": {}, "tolerance": {}, "effects": {}})"}) {
        const MachineModel m = parsed(text);
        EXPECT_EQ(m.sample_time, 5e-4);
        EXPECT_TRUE(m.modes.empty());
        EXPECT_TRUE(m.elements.empty());
        EXPECT_FALSE(m.dry.present());
        EXPECT_EQ(m.viscous, 0);
        EXPECT_EQ(m.input_delay, 0);
        EXPECT_EQ(m.output_delay, 0);
        EXPECT_EQ(m.current_loop_hz, 0);
        EXPECT_EQ(m.encoder_resolution, 0);
        EXPECT_EQ(m.noise_rms, 0);
        EXPECT_EQ(m.process_noise_rms, 0);
        EXPECT_FALSE(m.has_controller());
        EXPECT_FALSE(m.in_closed_loop());
        EXPECT_EQ(m.input, InputKind::hold);
        EXPECT_EQ(m.initial, InitialKind::rest);
        EXPECT_TRUE(m.tolerance.empty());
    }
}

TEST(MachineModel, DefaultsOfFieldsInsideATable) {
    const MachineModel m = parsed(R"({"rigid_gain_per_kg": 1, "controller": {"kp": 5},
        "friction": {"coulomb": 3, "stribeck": {"static": 4, "velocity": 0.1}}})");
    EXPECT_EQ(m.dry.stribeck->exponent, 1);
    const auto& pid = std::get<PidController>(m.controller);
    EXPECT_EQ(pid.ki, 0);
    EXPECT_EQ(pid.kd, 0);
    EXPECT_EQ(pid.derivative_filter_hz, 0);
    EXPECT_TRUE(m.in_closed_loop()); // there is a controller
    const MachineModel plain = parsed(R"({"rigid_gain_per_kg": 1, "friction": {"coulomb": 3}})");
    EXPECT_EQ(plain.dry.static_level(), 3);
    EXPECT_FALSE(plain.dry.velocity_dependent());
}

TEST(MachineModel, EachNumberIsRefusedWithItsPathItsUnitAndWhatIsAllowed) {
    const std::string positive = ", must be positive and finite";
    const std::string not_negative = ", must be zero or positive and finite";
    const struct {
        const char* pointer;
        const char* value;
        std::string text;
    } cases[] = {
        {"/Ts", "0", "Ts = 0 s" + positive},
        {"/rigid_gain_per_kg", "-1", "rigid_gain_per_kg = -1 m/(N s^2)" + not_negative},
        {"/modes/1/gain", "0", "modes[2].gain = 0 m/(N s^2)" + positive},
        {"/modes/0/freq_hz", "-33.5", "modes[1].freq_hz = -33.5 Hz" + positive},
        {"/modes/0/zeta", "-0.5", "modes[1].zeta = -0.5" + not_negative},
        {"/friction/coulomb", "-1", "friction.coulomb = -1 N" + not_negative},
        {"/friction/viscous", "-1", "friction.viscous = -1 N s/m" + not_negative},
        {"/friction/stribeck/static", "-1", "friction.stribeck.static = -1 N" + not_negative},
        {"/friction/stribeck/velocity", "0", "friction.stribeck.velocity = 0 m/s" + positive},
        {"/friction/stribeck/exponent", "0", "friction.stribeck.exponent = 0" + positive},
        {"/friction/elements/1/K", "-210000", "friction.elements[2].K = -210000 N/m" + positive},
        {"/friction/elements/0/F", "0", "friction.elements[1].F = 0 N" + positive},
        {"/friction/elements/0/D", "-1", "friction.elements[1].D = -1 N s/m" + not_negative},
        {"/input_delay_s", "-1", "input_delay_s = -1 s" + not_negative},
        {"/output_delay_s", "-1", "output_delay_s = -1 s" + not_negative},
        {"/current_loop_hz", "0", "current_loop_hz = 0 Hz" + positive},
        {"/encoder_resolution_m", "-1", "encoder_resolution_m = -1 m" + not_negative},
        {"/noise_rms_m", "-1", "noise_rms_m = -1 m" + not_negative},
        {"/process_noise_rms_N", "-1", "process_noise_rms_N = -1 N" + not_negative},
        {"/controller/derivative_filter_hz", "0", "controller.derivative_filter_hz = 0 Hz" + positive},
        {"/tolerance/modes.gain", "-0.5", "tolerance.modes.gain = -0.5" + not_negative},
        {"/controller/kp", "\"high\"", "controller.kp = \"high\", must be a number"},
        {"/controller/type", "\"lqr\"", "controller.type = \"lqr\", must be one of pid, cascade"},
        {"/closed_loop", "1", "closed_loop = 1, must be true or false"},
        {"/input", "\"foh\"", "input = \"foh\", must be one of hold, band_limited"},
        {"/initial", "\"moving\"", "initial = \"moving\", must be one of rest, fitted"},
        {"/friction", "3", "friction is 3, must be a table of named fields"},
        {"/modes", "3", "modes = 3, must be a list of tables"},
        {"/friction/elements", "{\"K\": 1}", "friction.elements = a table, must be a list of tables"},
        // 100000 sample times are 50 s.
        {"/input_delay_s", "51", "input_delay_s = 51 s, must be 100000 sample times at most"},
        {"/output_delay_s", "51", "output_delay_s = 51 s, must be 100000 sample times at most"},
    };
    for (const auto& [pointer, value, text] : cases) {
        EXPECT_EQ(problem(pointer, value), "input: x.json: " + text);
    }
}

TEST(MachineModel, AnInfiniteGainOfTheControllerIsRefused) {
    Json description = Json::parse(complete);
    description["controller"]["kd"] = -HUGE_VAL;
    EXPECT_EQ(problem_of([&] { model(description); }), "input: x.json: controller.kd = -inf N s/m, must be finite");
}

TEST(MachineModel, ANegativeGainOfTheControllerIsAllowed) { EXPECT_EQ(problem("/controller/kp", "-5"), "none: "); }

TEST(MachineModel, AMissingFieldIsNamedWithItsUnit) {
    EXPECT_EQ(problem_without("/modes/1", "freq_hz"), "input: x.json: modes[2].freq_hz is missing (a number in Hz)");
    EXPECT_EQ(problem_without("/modes/1", "zeta"), "input: x.json: modes[2].zeta is missing");
    EXPECT_EQ(problem_without("/friction/elements/0", "K"),
              "input: x.json: friction.elements[1].K is missing (a number in N/m)");
    EXPECT_EQ(problem_without("/friction/elements/0", "F"),
              "input: x.json: friction.elements[1].F is missing (a number in N)");
    EXPECT_EQ(problem_without("/friction/stribeck", "static"),
              "input: x.json: friction.stribeck.static is missing (a number in N)");
    EXPECT_EQ(problem_without("/controller", "kp"), "input: x.json: controller.kp is missing (a number in N/m)");
    EXPECT_EQ(problem("/controller", R"({"type": "cascade", "kp": 1})"),
              "input: x.json: controller.kv is missing (a number in N s/m)");
}

TEST(MachineModel, SamplesOfDelayAreAWholeNumber) {
    EXPECT_EQ(problem("/controller", R"({"type": "cascade", "kp": 1, "kv": 1, "delay_samples": 1.5})"),
              "input: x.json: controller.delay_samples = 1.5, must be a whole number from 0 to 100000");
}

TEST(MachineModel, AnUnknownFieldIsRefusedWithTheNearestKnownOne) {
    EXPECT_EQ(problem("/rigid_gain", "1"),
              "input: x.json: rigid_gain is not a known field (did you mean \"rigid_gain_per_kg\"?)");
    EXPECT_EQ(problem("/modes/0/frequency", "1"),
              "input: x.json: modes[1].frequency is not a known field (known: gain, freq_hz, zeta)");
    EXPECT_EQ(problem("/friction/viscuos", "1"),
              "input: x.json: friction.viscuos is not a known field (did you mean \"viscous\"?)");
    EXPECT_EQ(problem("/friction/elements/1/k", "1"),
              "input: x.json: friction.elements[2].k is not a known field (known: K, F, D)");
    EXPECT_EQ(problem("/friction/stribeck/speed", "1"),
              "input: x.json: friction.stribeck.speed is not a known field (known: static, velocity, exponent)");
    EXPECT_EQ(problem("/controller/derivative_filter", "1"),
              "input: x.json: controller.derivative_filter is not a known field (did you mean "
              "\"derivative_filter_hz\"?)");
    EXPECT_EQ(problem("/tolerance/modes.frequency_hz", "0.1"),
              "input: x.json: tolerance.modes.frequency_hz is not a known field (did you mean \"modes.freq_hz\"?)");
    // What belongs to the other kind of controller.
    EXPECT_EQ(problem("/controller/kv", "1"),
              "input: x.json: controller.kv is not a known field (did you mean \"kp\"?)");
}

TEST(MachineModel, NotesAreIgnoredAtEveryLevel) {
    const Json notes = {
        {"comment", "c"}, {"units", {{"K", "N/m"}}}, {"conventions", 1}, {"records", 2}, {"equations", 3}};
    for (const char* table :
         {"", "/modes/0", "/friction", "/friction/stribeck", "/friction/elements/1", "/controller", "/tolerance"}) {
        Json description = Json::parse(complete);
        description[Json::json_pointer(table)].update(notes);
        EXPECT_EQ(problem_of([&] { model(description); }), "none: ") << table;
    }
}

TEST(MachineModel, AMachineThatCannotMoveIsRefused) {
    for (const char* text : {"{}", R"({"rigid_gain_per_kg": 0, "modes": []})"}) {
        EXPECT_EQ(problem_of([&] { parsed(text); }), "input: x.json: rigid_gain_per_kg is zero or missing (or give "
                                                     "mass_kg) and there is no mode: nothing could move");
    }
    EXPECT_NO_THROW(parsed(R"({"modes": [{"gain": 1, "freq_hz": 10, "zeta": 0.1}]})"));
}

TEST(MachineModel, ABandLimitedInputNeedsAnOpenLoop) {
    EXPECT_EQ(problem("/input", "\"band_limited\""),
              "input: x.json: input = \"band_limited\" needs u as a whole record, so closed_loop must be false");
    EXPECT_EQ(parsed(R"({"rigid_gain_per_kg": 1, "input": "band_limited"})").input, InputKind::band_limited);
    EXPECT_NO_THROW(parsed(R"({"rigid_gain_per_kg": 1, "input": "band_limited", "controller": {"kp": 1},
                              "closed_loop": false})"));
}

TEST(MachineModel, PlantParametersAreThoseOfTheModel) {
    const auto p = parsed(complete).axis().plant;
    EXPECT_EQ(p.rigid_gain, 0.09428);
    EXPECT_EQ(p.modes.size(), 2u);
    EXPECT_DOUBLE_EQ(p.rolling.coulomb_level(), 0.86);
    EXPECT_EQ(p.dry.static_level(), 2.5);
    EXPECT_EQ(p.viscous, 2.35);
    EXPECT_EQ(p.current_loop_hz, 750);
}

TEST(MachineModel, HashIsThatOfTheFields) {
    const std::string hash = parsed(complete).hash();
    EXPECT_EQ(hash.size(), 64u);
    EXPECT_EQ(parsed(complete).hash(), hash);
    Json other = Json::parse(complete);
    other["friction"]["viscous"] = 2.36;
    EXPECT_NE(model(other).hash(), hash);
}

TEST(MachineModel, RefusesGainsThatUnderflowAndDelaysWithoutEnd) {
    const auto problem = [](const std::string& text) { return problem_of([&] { parsed(text); }); };
    const auto with = [&](const std::string& gain, const std::string& effect) {
        return problem("{\"rigid_gain_per_kg\": " + gain + ", \"effects\": [" + effect + "]}");
    };
    const std::string range = " m/(N s^2), must be from 1e-100 to 1e+100";
    EXPECT_EQ(with("1e-300", ""), "input: x.json: the gains sum up to 1e-300" + range);
    EXPECT_EQ(with("1", R"({"name": "payload_mass", "parameters": {"ratio": 1e308}})"),
              "input: x.json: effects: the gains sum up to 1e-308" + range);
    EXPECT_EQ(problem(R"({"modes": [{"gain": 1e101, "freq_hz": 10, "zeta": 0.1}]})"),
              "input: x.json: the gains sum up to 1e+101" + range);
    EXPECT_EQ(with("1", R"({"name": "input_delay", "parameters": {"extra_s": 65536}})"),
              "input: x.json: effects: they leave an input delay of 65536 s, must be 100000 sample times at most");
    EXPECT_EQ(with("1", R"({"name": "input_delay", "parameters": {"extra_s": 49}})"), "none: ");
}

} // namespace
} // namespace tribode
