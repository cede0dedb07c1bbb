#include "tribode/base/error.hpp"
#include "tribode/diagnosis/diagnosis.hpp"
#include "tribode/diagnosis/diagnosis_files.hpp"
#include "unit/diagnosis/small_case.hpp"

#include <cmath>
#include <gtest/gtest.h>
#include <map>
#include <numbers>
#include <set>
#include <string>
#include <utility>

namespace tribode {
namespace {

using namespace diagnosis_cases;

// Two records of two seconds: one to fit, one for validation. `more`: what drives a further one to fit.
Diagnosis diagnosed(const Json& hidden, const Json& believed = small_axis(), std::size_t max_effects = 1,
                    const DriveRecord* more = nullptr) {
    const MachineModel machine = MachineModel::from_description(believed, "case");
    const auto driven = [&](const DriveRecord& drive, std::uint64_t seed) {
        return measurement_from_table(measured(small_axis(), hidden, drive, seed), machine, "case");
    };
    std::vector<Measurement> fitted = {driven(sine_record(0.012, 1.5, 2), 1)};
    if (more) fitted.push_back(driven(*more, 3));
    DiagnosisOptions options;
    options.max_effects = max_effects;
    RunControl control;
    control.workers = 2;
    return diagnose(machine, std::move(fitted), driven(sine_record(0.02, 1, 2), 2), options, control);
}

// The effect that the machine `real` has beside `believed`, of a record to fit and one for validation, driven so.
Diagnosis diagnosed_between(const Json& real, const Json& hidden, const Json& believed, const DriveRecord& fitted,
                            const DriveRecord& validation, std::size_t max_effects = 1) {
    const MachineModel machine = MachineModel::from_description(believed, "case");
    const auto driven = [&](const DriveRecord& drive, std::uint64_t seed) {
        return measurement_from_table(measured(real, hidden, drive, seed), machine, "case");
    };
    DiagnosisOptions options;
    options.max_effects = max_effects;
    RunControl control;
    control.workers = 2;
    return diagnose(machine, {driven(fitted, 1)}, driven(validation, 2), options, control);
}

// Within three of its standard errors, and with some of them.
void expect_parameter(const NamedEffect& effect, const char* name, double truth) {
    const double value = effect.parameters[name].get<double>(), error = effect.standard_errors[name].get<double>();
    EXPECT_GT(error, 0);
    EXPECT_NEAR(value, truth, 3.5 * error) << name; // 3.5: once in two thousand
}

TEST(Diagnosis, NothingIsMissingFromTheMachineThatMadeTheRecord) {
    const Diagnosis d = diagnosed(Json::array());
    EXPECT_EQ(d.verdict, "nothing_missing");
    EXPECT_TRUE(d.effects.empty());
    // Noise and rounding are all that is left; six seeds know their rms to a few per cent.
    EXPECT_NEAR(d.validation_gap.before / d.validation_gap.floor, 1, 0.1);
}

TEST(Diagnosis, AHiddenGainIsNamedAndMeasured) {
    const Diagnosis d = diagnosed(Json::parse(R"([{"name": "thrust_gain", "parameters": {"gain": 0.93}}])"));
    ASSERT_EQ(d.verdict, "effect_found");
    EXPECT_EQ(d.effects[0].name, "thrust_gain");
    expect_parameter(d.effects[0], "gain", 0.93);
    EXPECT_GT(d.validation_gap.before, 10 * d.validation_gap.floor);
    EXPECT_LT(d.validation_gap.after, 1.2 * d.validation_gap.floor);
}

TEST(Diagnosis, AHiddenRippleIsNamedWithItsPitch) {
    const Diagnosis d = diagnosed(Json::parse(
        R"([{"name": "force_ripple", "parameters": {"harmonics": [{"F": 1.2, "period_m": 0.004, "phase": 1}]}}])"));
    ASSERT_EQ(d.verdict, "effect_found");
    ASSERT_EQ(d.effects[0].name, "force_ripple");
    EXPECT_NEAR(d.effects[0].parameters["harmonics"][0]["period_m"].get<double>(), 0.004, 1e-6);
    EXPECT_NEAR(d.effects[0].parameters["harmonics"][0]["F"].get<double>(), 1.2, 0.02);
}

// Effects as rotary machines have them, and their neighbors, which have fewer parameters and so must come first.
TEST(Diagnosis, AnArmAFanAValveAndAGearAreFoundAndNotTakenForTheirNeighbors) {
    struct Case {
        const char *name, *parameters;
        std::vector<std::pair<const char*, double>> values;
    };
    for (const auto& [name, parameters, values] : std::vector<Case>{
             {"gravity", R"({"F": 6, "turn_m": 0.06, "phase": 0.5})", {{"F", 6}, {"turn_m", 0.06}, {"phase", 0.5}}},
             {"power_drag", R"({"c": 40, "exponent": 1.5})", {{"c", 40}, {"exponent", 1.5}}},
             {"thrust_power_law", R"({"exponent": 1.3, "size": 12})", {{"exponent", 1.3}, {"size", 12}}},
             {"load_dependent_friction", R"({"share": 0.2, "reach": 2e-4})", {{"share", 0.2}, {"reach", 2e-4}}},
             {"spring_force", R"({"k": 300, "y0": 0.004})", {{"k", 300}, {"y0", 0.004}}},
             {"quadratic_drag", R"({"c": 400})", {{"c", 400}}},
             {"dead_zone", R"({"half_width": 0.6})", {{"half_width", 0.6}}},
             {"constant_force", R"({"F": 1.5})", {{"F", 1.5}}}}) {
        const Json hidden = {{"name", name}, {"parameters", Json::parse(parameters)}};
        const Diagnosis d = diagnosed(Json::array({hidden}));
        ASSERT_EQ(d.verdict, "effect_found") << name;
        ASSERT_EQ(d.effects[0].name, name);
        for (const auto& [parameter, truth] : values) expect_parameter(d.effects[0], parameter, truth);
        EXPECT_LT(d.validation_gap.after, 1.2 * d.validation_gap.floor) << name;
    }
}

// Where the residual force of the record misleads: a limit that the reference exceeds many times over as the controller integrates, a
// period that a coarse list of periods misses, and a curve that shows only where the velocity is nearly noise.
TEST(Diagnosis, WhatBeginsFarFromTheResidualForceIsFound) {
    struct Case {
        const char *name, *parameters, *first;
        double value;
    };
    for (const auto& [name, parameters, first, value] :
         std::vector<Case>{{"thrust_saturation", R"({"limit": 5.6})", "limit", 5.6},
                           {"time_varying_friction", R"({"kind": "sine", "a": 0.5, "T": 0.45})", "T", 0.45},
                           {"stribeck_friction", R"({"dFs": 8, "velocity": 3e-4})", "dFs", 8}}) {
        const Diagnosis d = diagnosed(Json::array({{{"name", name}, {"parameters", Json::parse(parameters)}}}));
        ASSERT_EQ(d.verdict, "effect_found") << name;
        ASSERT_EQ(d.effects[0].name, name);
        expect_parameter(d.effects[0], first, value);
    }
}

// A dead zone adds its width to the friction of slow ramps, and so does a Coulomb level within its tolerance. Where the thrust changes
// its sign without the velocity, they differ.
TEST(Diagnosis, FieldsThatTheValidationRecordContradictDoNotReplaceAnEffect) {
    const Json believed =
        Json::parse(R"({"Ts": 0.0005, "rigid_gain_per_kg": 0.24, "friction": {"coulomb": 7, "viscous": 2.4},
        "input_delay_s": 0.0005, "current_loop_hz": 1000, "encoder_resolution_m": 5e-8, "noise_rms_m": 7e-8,
        "process_noise_rms_N": 0.1, "controller": {"type": "cascade", "kp": 38, "kv": 470},
        "tolerance": {"friction.coulomb": 0.05}})");
    Json real = believed;
    real.erase("tolerance");
    const Json hidden = Json::parse(R"([{"name": "dead_zone", "parameters": {"half_width": 0.6}}])");
    DriveRecord ramps, force;
    for (int k = 0; k < 6000; ++k) {
        const double t = k * 5e-4;
        ramps.t.push_back(t);
        ramps.reference.push_back(0.003 * std::asin(std::sin(2 * std::numbers::pi * 0.7 * t)) * 2 / std::numbers::pi);
        ramps.excitation.push_back(0);
        force.t.push_back(t);
        force.reference.push_back(0);
        double sum = 0;
        for (const double frequency : {2.3, 7.1, 19.0, 53.0, 117.0}) {
            sum += 7 * std::sin(2 * std::numbers::pi * frequency * t + frequency);
        }
        force.excitation.push_back(sum);
    }
    const Diagnosis d = diagnosed_between(real, hidden, believed, ramps, force);
    ASSERT_EQ(d.verdict, "effect_found");
    EXPECT_EQ(d.effects[0].name, "dead_zone");
    expect_parameter(d.effects[0], "half_width", 0.6);
    EXPECT_LT(d.validation_gap.after, 1.2 * d.validation_gap.floor);
}

// The record with the largest gap moves over a fifth of a period, where a ripple looks like a spring; the other shows it whole.
TEST(Diagnosis, ARippleIsReadFromTheRecordThatMovesFarthest) {
    const Json believed =
        Json::parse(R"({"Ts": 0.0005, "rigid_gain_per_kg": 0.15, "friction": {"coulomb": 9.5, "viscous": 5},
        "input_delay_s": 0.00075, "current_loop_hz": 1500, "encoder_resolution_m": 5e-8, "noise_rms_m": 8e-8,
        "controller": {"type": "cascade", "kp": 25, "kv": 500},
        "tolerance": {"friction.coulomb": 0.09, "rigid_gain_per_kg": 0.02}})");
    Json real = believed;
    real.erase("tolerance");
    real["friction"]["coulomb"] = 9.1;
    const Json hidden = Json::parse(R"([{"name": "force_ripple", "parameters": {"harmonics": [
        {"F": 3, "period_m": 0.005, "phase": 4.2}, {"F": 1.4, "period_m": 0.0025, "phase": 4.5}]}}])");
    DriveRecord far, near;
    for (int k = 0; k < 6000; ++k) {
        const double t = k * 5e-4;
        far.t.push_back(t);
        far.reference.push_back(0.003 * (1 - std::cos(2 * std::numbers::pi * std::min(t, 1.0))));
        far.excitation.push_back(0);
        near.t.push_back(t);
        near.reference.push_back(0);
        double sum = 0;
        for (const double frequency : {2.3, 7.1, 19.0, 53.0}) {
            sum += 8 * std::sin(2 * std::numbers::pi * frequency * t + frequency);
        }
        near.excitation.push_back(sum);
    }
    const Diagnosis d = diagnosed_between(real, hidden, believed, far, near);
    ASSERT_EQ(d.verdict, "effect_found");
    ASSERT_EQ(d.effects[0].name, "force_ripple");
    EXPECT_NEAR(d.effects[0].parameters["harmonics"][0]["period_m"].get<double>(), 0.005, 1e-5);
    EXPECT_LT(d.validation_gap.after, 1.5 * d.validation_gap.floor);
}

// Noise of the force that the description gives and the machine does not have hides slow errors: a mass alone leaves what is taken for
// noise. The Coulomb level and the viscous friction are off besides.
TEST(Diagnosis, WhatSlowErrorsShowIsSoughtAlthoughNoiseMayExplainThem) {
    Json believed = small_axis();
    believed["rigid_gain_per_kg"] = 0.16;
    believed["friction"] = Json::parse(R"({"coulomb": 9, "viscous": 9})");
    believed["process_noise_rms_N"] = 0.3;
    const Diagnosis d = diagnosed(Json::parse(R"([{"name": "payload_mass", "parameters": {"ratio": 0.58}},
        {"name": "coulomb_friction", "parameters": {"dF": 4.2}}])"),
                                  believed, 3);
    ASSERT_EQ(d.verdict, "effect_found");
    ASSERT_EQ(d.effects.size(), 3u);
    const std::map<std::string, std::pair<const char*, double>> truths = {{"payload_mass", {"ratio", 1.58 * 1.6 - 1}},
                                                                          {"coulomb_friction", {"dF", 9.2 - 9}},
                                                                          {"viscous_friction", {"dD", 4 - 9}}};
    for (const auto& effect : d.effects) {
        ASSERT_TRUE(truths.contains(effect.name)) << effect.name;
        const auto& [parameter, truth] = truths.at(effect.name);
        EXPECT_NEAR(effect.parameters[parameter].get<double>(), truth, 0.05) << parameter;
    }
}

// A ripple of a period longer than the stroke has the same equation as the weight of an arm, and is called that.
TEST(Diagnosis, WhatIsPeriodicOverMoreThanTheStrokeIsTheWeightOfAnArm) {
    const Diagnosis d = diagnosed(Json::parse(
        R"([{"name": "force_ripple", "parameters": {"harmonics": [{"F": 6, "period_m": 0.03, "phase": 0.5}]}}])"));
    ASSERT_EQ(d.verdict, "effect_found");
    ASSERT_EQ(d.effects.size(), 1u);
    ASSERT_EQ(d.effects[0].name, "gravity");
    expect_parameter(d.effects[0], "F", 6);
    expect_parameter(d.effects[0], "turn_m", 0.03);
    EXPECT_LT(d.validation_gap.after, 1.2 * d.validation_gap.floor);
}

// Friction by direction without a difference would be the same, and a level of one direction beside it takes less.
TEST(Diagnosis, ASimplerExplanationIsPreferredToTheRicherOne) {
    const Diagnosis d = diagnosed(Json::parse(R"([{"name": "viscous_friction", "parameters": {"dD": 6}},
        {"name": "asymmetric_friction", "parameters": {"dF_pos": 0.1}}])"),
                                  small_axis(), 2);
    ASSERT_EQ(d.verdict, "effect_found");
    ASSERT_EQ(d.effects.size(), 2u);
    ASSERT_EQ(d.effects[0].name, "viscous_friction");
    expect_parameter(d.effects[0], "dD", 6);
    ASSERT_EQ(d.effects[1].name, "asymmetric_friction");
    EXPECT_EQ(d.effects[1].parameters["dD_pos"], 0);
}

// Mass and friction both larger by a factor: a gain of the thrust alone does nearly the same, and each of them little.
TEST(Diagnosis, TwoEffectsThatAThirdImitatesAreFoundTogether) {
    const Diagnosis d = diagnosed(Json::parse(R"([{"name": "payload_mass", "parameters": {"ratio": 0.4}},
        {"name": "coulomb_friction", "parameters": {"dF": 1.3}}])"),
                                  small_axis(), 2);
    ASSERT_EQ(d.verdict, "effect_found");
    ASSERT_EQ(d.effects.size(), 2u);
    const bool first = d.effects[0].name == "payload_mass";
    expect_parameter(d.effects[first ? 0 : 1], "ratio", 0.4);
    expect_parameter(d.effects[first ? 1 : 0], "dF", 1.3);
}

// On a sine of one speed a longer delay does more of what they do than each of them, and nothing on another record.
TEST(Diagnosis, TwoEffectsOfWhichNoneDoesMuchAloneAreFoundTogether) {
    const Json axis = Json::parse(R"({"Ts": 0.0005, "rigid_gain_per_kg": 0.083, "friction": {"viscous": 8,
        "elements": [{"F": 2.5, "K": 4.4e6}, {"F": 1.7, "K": 2e5}, {"F": 2.5, "K": 5300}]},
        "input_delay_s": 0.0005, "output_delay_s": 0.0004, "current_loop_hz": 500, "encoder_resolution_m": 2e-7,
        "noise_rms_m": 1e-7,
        "controller": {"type": "pid", "kp": 28350, "ki": 264500, "kd": 1013, "derivative_filter_hz": 400}})");
    const Json hidden = Json::parse(R"([{"name": "viscous_friction", "parameters": {"dD": -4}},
        {"name": "force_ripple", "parameters": {"harmonics": [{"F": 1.27, "period_m": 2.93e-3, "phase": 0.33}]}}])");
    const Diagnosis d = diagnosed_between(axis, hidden, axis, sine_record(0.022, 3, 2), sine_record(0.01, 1, 2), 2);
    ASSERT_EQ(d.verdict, "effect_found");
    ASSERT_EQ(d.effects.size(), 2u);
    const bool first = d.effects[0].name == "viscous_friction";
    expect_parameter(d.effects[first ? 0 : 1], "dD", -4);
    EXPECT_EQ(d.effects[first ? 1 : 0].name, "force_ripple");
}

// Six uncertain fields that no noise holds back, as the model is off by a thousand times the noise, take the pair to a negative spring.
TEST(Diagnosis, TwoEffectsAreFoundWhereTheFieldsOfTheMachineWouldBendFarBeyondTheirTolerance) {
    const Json real =
        Json::parse(R"({"Ts": 0.0005, "rigid_gain_per_kg": 0.1282, "friction": {"coulomb": 11.65, "viscous": 18.94},
        "modes": [{"freq_hz": 74.3, "gain": 0.003947, "zeta": 0.00906}], "input_delay_s": 0.00025,
        "output_delay_s": 0.0002, "current_loop_hz": 750, "encoder_resolution_m": 5e-8, "noise_rms_m": 1.6e-7,
        "controller": {"type": "pid", "kp": 4451, "ki": 20480, "kd": 322.4, "derivative_filter_hz": 400}})");
    Json believed = real;
    believed.merge_patch(Json::parse(R"({"rigid_gain_per_kg": 0.1284, "friction": {"coulomb": 11.89, "viscous": 18.73},
        "modes": [{"freq_hz": 74.12, "gain": 0.004513, "zeta": 0.006744}],
        "tolerance": {"friction.coulomb": 0.059, "friction.viscous": 0.096, "modes.freq_hz": 0.011, "modes.gain": 0.07,
        "modes.zeta": 0.24, "rigid_gain_per_kg": 0.017}})"));
    const Json hidden = Json::parse(R"([{"name": "spring_force", "parameters": {"k": 314.6, "y0": 0}},
        {"name": "payload_mass", "parameters": {"ratio": 0.52}}])");
    const Diagnosis d = diagnosed_between(real, hidden, believed, sine_record(0.02, 1, 2), sine_record(0.012, 2, 2), 2);
    ASSERT_EQ(d.verdict, "effect_found");
    ASSERT_EQ(d.effects.size(), 2u);
    const bool first = d.effects[0].name == "payload_mass";
    expect_parameter(d.effects[first ? 0 : 1], "ratio", 0.52);
    expect_parameter(d.effects[first ? 1 : 0], "k", 314.6);
}

// The first effect shows most on a record of small moves, which shows nothing of the other one.
TEST(Diagnosis, ASecondEffectIsSoughtOnTheRecordThatShowsMostBesideTheFirst) {
    const Json machine =
        Json::parse(R"({"Ts": 0.0005, "rigid_gain_per_kg": 0.0447, "friction": {"coulomb": 4.7, "viscous": 26.8},
        "input_delay_s": 0.00075, "output_delay_s": 0.0002, "current_loop_hz": 750, "encoder_resolution_m": 5e-8,
        "noise_rms_m": 2.1e-7, "process_noise_rms_N": 0.2,
        "controller": {"type": "pid", "kp": 52330, "ki": 487200, "kd": 1874, "derivative_filter_hz": 300}})");
    const Json hidden = Json::parse(R"([{"name": "coulomb_friction", "parameters": {"dF": -1.8}},
        {"name": "force_ripple", "parameters": {"harmonics": [{"F": 1.4, "period_m": 0.00385, "phase": 4.7},
                                                              {"F": 0.9, "period_m": 0.001925, "phase": 1.4}]}}])");
    DriveRecord moves = sine_record(0, 1, 3);
    const double places[] = {0,      0.007, -0.009, -0.0105, 0.01,  -0.003, -0.002, -0.0075,
                             0.0115, 0.016, -0.015, 0,       -0.01, 0.009,  0.0105, -0.013};
    for (std::size_t k = 0; k < moves.t.size(); ++k) {
        const std::size_t number = k / 400; // a move of 0.1 s and a rest as long
        const double share = std::min(1.0, static_cast<double>(k % 400) / 200);
        moves.reference[k] =
            places[number] + (places[number + 1] - places[number]) * (1 - std::cos(std::numbers::pi * share)) / 2;
    }
    const Diagnosis d = diagnosed_between(machine, hidden, machine, moves, sine_record(2.8e-4, 5, 3), 2);
    ASSERT_EQ(d.verdict, "effect_found");
    ASSERT_EQ(d.effects.size(), 2u);
    const bool first = d.effects[0].name == "coulomb_friction";
    expect_parameter(d.effects[first ? 0 : 1], "dF", -1.8);
    EXPECT_EQ(d.effects[first ? 1 : 0].name, "force_ripple");
}

// Less of a gain is more of a mass, but for friction, the level of which is known to some percent.
TEST(Diagnosis, AMassAndAGainAreRivalsBesideAnotherEffect) {
    const Json machine =
        Json::parse(R"({"Ts": 0.0005, "rigid_gain_per_kg": 0.241, "friction": {"viscous": 15.6, "elements":
        [{"F": 1.246, "K": 917800}, {"F": 1.012, "K": 116000}, {"F": 1.354, "K": 21670}, {"F": 0.86, "K": 2965}]},
        "input_delay_s": 0.00025, "output_delay_s": 0.0002, "current_loop_hz": 1500, "encoder_resolution_m": 2e-7,
        "noise_rms_m": 4.5e-8,
        "controller": {"type": "pid", "kp": 6128, "ki": 24700, "kd": 225.3, "derivative_filter_hz": 300}})");
    Json believed = machine;
    believed.merge_patch(Json::parse(R"({"friction": {"viscous": 15.2, "elements": [{"F": 1.19, "K": 876600},
        {"F": 0.967, "K": 110800}, {"F": 1.293, "K": 20695}, {"F": 0.821, "K": 2832}]},
        "tolerance": {"friction.elements": 0.07, "friction.viscous": 0.2, "rigid_gain_per_kg": 0.017}})"));
    const Json hidden = Json::parse(R"([{"name": "thrust_gain", "parameters": {"gain": 1.1}},
        {"name": "periodic_disturbance", "parameters": {"F": 0.7, "freq_hz": 3.9, "phase": 2.1}}])");
    const Diagnosis d =
        diagnosed_between(machine, hidden, believed, sine_record(0.02, 1.5, 3), sine_record(0.03, 1, 3), 2);
    std::map<std::string, double> said;
    for (const auto& effect : d.effects) {
        said[effect.name] = effect.probability;
        for (const auto& rival : effect.rivals) said[rival.name] = rival.probability;
    }
    EXPECT_GT(said["periodic_disturbance"], 0.9);
    EXPECT_GT(said["thrust_gain"], 0.2);
    EXPECT_GT(said["payload_mass"], 0.2);
}

// The chirp that is fitted ends below the mode: fits of a mode from a grid of frequencies end in local minima there, that of a
// backlash, which follows beginnings of the record, does not.
TEST(Diagnosis, ABacklashWithoutPlayIsAMode) {
    const Json machine = Json::parse(R"({"Ts": 0.0005, "closed_loop": false, "rigid_gain_per_kg": 0.1732,
        "friction": {"coulomb": 3.893, "viscous": 19.31}, "input_delay_s": 0.00075, "output_delay_s": 0.0002,
        "current_loop_hz": 1000, "encoder_resolution_m": 1e-7, "noise_rms_m": 2.4e-7})");
    const Json hidden =
        Json::parse(R"([{"name": "resonant_mode", "parameters": {"freq_hz": 52.4, "gain": 0.02, "zeta": 0.028}}])");
    const auto chirp = [](double amplitude, double from, double to) { // [N], [Hz], over 6 s
        DriveRecord record;
        const double rate = std::log(to / from) / 6;
        for (int k = 0; k < 12000; ++k) {
            const double t = k * 5e-4, turns = from * std::expm1(rate * t) / rate;
            record.t.push_back(t);
            record.u.push_back(amplitude * std::min(1.0, 5 * t) * std::sin(2 * std::numbers::pi * turns));
        }
        return record;
    };
    const Diagnosis d = diagnosed_between(machine, hidden, machine, chirp(12, 2.6, 51), chirp(13, 1.7, 84), 2);
    ASSERT_EQ(d.verdict, "effect_found");
    ASSERT_EQ(d.effects.size(), 1u);
    expect_parameter(d.effects[0], "freq_hz", 52.4);
    expect_parameter(d.effects[0], "gain", 0.02);
    expect_parameter(d.effects[0], "zeta", 0.028);
}

// Slow errors weigh little beside slow noise. A weak spring shows on the fitted record, which moves far, alone.
TEST(Diagnosis, AnswersThatLeaveMuchOnTheFittedRecordArePartial) {
    const Json machine = Json::parse(R"({"Ts": 0.0005, "rigid_gain_per_kg": 0.1, "friction": {"viscous": 20},
        "encoder_resolution_m": 1e-8, "noise_rms_m": 1e-8, "process_noise_rms_N": 0.5,
        "controller": {"type": "pid", "kp": 2000, "ki": 0, "kd": 100, "derivative_filter_hz": 300}})");
    const Json hidden = Json::parse(R"([{"name": "payload_mass", "parameters": {"ratio": 0.4}},
        {"name": "spring_force", "parameters": {"k": 3, "y0": 0}}])");
    const Diagnosis d =
        diagnosed_between(machine, hidden, machine, sine_record(0.05, 1, 3), sine_record(0.005, 3, 3), 1);
    ASSERT_EQ(d.effects.size(), 1u);
    EXPECT_EQ(d.effects[0].name, "payload_mass");
    EXPECT_GT(d.fitted_gap.after, 3 * d.fitted_gap.floor);
    EXPECT_LT(d.validation_gap.after, 3 * d.validation_gap.floor);
    EXPECT_EQ(d.verdict, "partial");
    EXPECT_LT(d.effects[0].probability, 0.76);
}

// Over less than its period a ripple is nearly a spring and a cubic one.
TEST(Diagnosis, APairTakesThePlaceOfThreeEffectsThatSayAsMuch) {
    const Json machine = Json::parse(R"({"Ts": 0.0005, "closed_loop": false, "rigid_gain_per_kg": 0.0389,
        "friction": {"coulomb": 3.87, "viscous": 28}, "input_delay_s": 0.0005, "current_loop_hz": 500,
        "encoder_resolution_m": 2e-7, "noise_rms_m": 8e-8, "process_noise_rms_N": 0.1})");
    const Json hidden = Json::parse(R"([{"name": "coulomb_friction", "parameters": {"dF": -2}},
        {"name": "gravity", "parameters": {"F": 1.33, "turn_m": 0.0026, "phase": 5.4}}])");
    const auto multisine = [](double lowest) {
        DriveRecord record;
        for (int k = 0; k < 6000; ++k) {
            const double t = k * 5e-4;
            double u = 0;
            for (int line = 0; line < 24; ++line) {
                u += 1.8 * std::sin(2 * std::numbers::pi * (lowest + 1.5 * line) * t - 0.13 * line * line);
            }
            record.t.push_back(t);
            record.u.push_back(u);
        }
        return record;
    };
    const Diagnosis d = diagnosed_between(machine, hidden, machine, multisine(4), multisine(4.17), 3);
    ASSERT_EQ(d.verdict, "effect_found");
    ASSERT_EQ(d.effects.size(), 2u);
    const bool first = d.effects[0].name == "coulomb_friction";
    EXPECT_EQ(d.effects[first ? 0 : 1].name, "coulomb_friction");
    EXPECT_EQ(d.effects[first ? 1 : 0].name, "gravity");
}

// Beside the first effect two fields do all that is missing, each by more than five of its tolerances.
TEST(Diagnosis, AnEffectIsSoughtForEachFieldThatIsBentBeyondItsTolerance) {
    const Json real =
        Json::parse(R"({"Ts": 0.0005, "rigid_gain_per_kg": 0.1353, "friction": {"coulomb": 6.57, "viscous": 1.95},
        "input_delay_s": 0.0005, "output_delay_s": 0.000418, "current_loop_hz": 500, "encoder_resolution_m": 1e-7,
        "noise_rms_m": 4.4e-8,
        "controller": {"type": "pid", "kp": 41010, "ki": 322000, "kd": 773.8, "derivative_filter_hz": 300}})");
    Json believed = real;
    believed.merge_patch(Json::parse(R"({"rigid_gain_per_kg": 0.137, "friction": {"coulomb": 6, "viscous": 2.1},
        "tolerance": {"friction.coulomb": 0.06, "friction.viscous": 0.1, "rigid_gain_per_kg": 0.038}})"));
    const Json hidden = Json::parse(R"([{"name": "spring_force", "parameters": {"k": 150, "y0": 0}},
        {"name": "coulomb_friction", "parameters": {"dF": -2.3}},
        {"name": "payload_mass", "parameters": {"ratio": 0.33}}])");
    const Diagnosis d =
        diagnosed_between(real, hidden, believed, sine_record(0.04, 1.2, 2), sine_record(0.02, 2, 2), 3);
    ASSERT_EQ(d.verdict, "effect_found");
    std::set<std::string> names;
    for (const auto& effect : d.effects) names.insert(effect.name);
    EXPECT_EQ(names, (std::set<std::string>{"coulomb_friction", "payload_mass", "spring_force"}));
    EXPECT_TRUE(d.fields_off.empty());
}

TEST(Diagnosis, BristlesAreToldFromElementsThatSlipByTheRecordThatIsAskedFor) {
    const Json hidden = Json::parse(R"([{"name": "lugre_friction",
        "parameters": {"F": 2, "Fs": 2, "velocity": 0.01, "K": 50000}}])");
    const Diagnosis d = diagnosed(hidden);
    ASSERT_EQ(d.verdict, "undecided");
    EXPECT_EQ(d.effects[0].name, "lugre_friction");
    expect_parameter(d.effects[0], "F", 2);
    ASSERT_EQ(d.effects[0].rivals.size(), 1u);
    EXPECT_EQ(d.effects[0].rivals[0].name, "presliding_hysteresis");
    ASSERT_TRUE(d.next_experiment.has_value());
    ASSERT_FALSE(d.next_experiment->drive.t.empty()) << d.next_experiment->text;
    const Diagnosis again = diagnosed(hidden, small_axis(), 1, &d.next_experiment->drive);
    ASSERT_EQ(again.verdict, "effect_found");
    EXPECT_EQ(again.effects[0].name, "lugre_friction");
    EXPECT_TRUE(again.effects[0].rivals.empty());
}

TEST(Diagnosis, ABacklashIsFoundThoughNoiseDecidesWhereTheBodiesMeet) {
    Json truth = small_axis();
    truth["friction"]["coulomb"] = 0;
    const MachineModel machine = MachineModel::from_description(truth, "case");
    const Json hidden = Json::parse(R"([{"name": "backlash", "parameters": {"gap_m": 3e-5, "load_fraction": 0.4,
        "contact_hz": 210, "contact_zeta": 0.15, "sensor": "motor"}}])");
    const auto record = [&](double phase, std::uint64_t seed) {
        DriveRecord drive = sine_record(0, 1, 2);
        for (std::size_t k = 0; k < drive.t.size(); ++k) {
            for (const double f : {7.0, 19.0, 43.0, 83.0, 131.0}) {
                drive.excitation[k] += 10 * std::sin(2 * std::numbers::pi * f * drive.t[k] + phase * f);
            }
        }
        return measurement_from_table(measured(truth, hidden, drive, seed), machine, "case");
    };
    DiagnosisOptions options;
    options.max_effects = 1;
    RunControl control;
    control.workers = 2;
    const Diagnosis d = diagnose(machine, {record(1, 1)}, record(2, 2), options, control);
    ASSERT_EQ(d.verdict, "effect_found");
    ASSERT_EQ(d.effects[0].name, "backlash");
    EXPECT_EQ(d.effects[0].parameters["sensor"], "motor");
    for (const char* name : {"gap_m", "load_fraction", "contact_hz", "contact_zeta"}) {
        expect_parameter(d.effects[0], name, hidden[0]["parameters"][name].get<double>());
    }
    // Some contacts are followed only, so the numbers are known to a few per cent.
    EXPECT_NEAR(d.effects[0].parameters["gap_m"].get<double>(), 3e-5, 2e-6);
    EXPECT_NEAR(d.effects[0].parameters["load_fraction"].get<double>(), 0.4, 0.03);
}

TEST(Diagnosis, ABacklashOfAHeavyLoadAndASoftContactIsFound) {
    Json stiff = small_axis();
    stiff["rigid_gain_per_kg"] = 0.034;
    stiff["friction"] = {{"coulomb", 4}, {"viscous", 2.6}};
    stiff["controller"] = {
        {"type", "pid"}, {"kp", 268100}, {"ki", 2672000}, {"kd", 3985}, {"derivative_filter_hz", 400}};
    const Json hidden = Json::parse(R"([{"name": "backlash", "parameters": {"gap_m": 2e-5, "load_fraction": 0.7,
        "contact_hz": 90, "contact_zeta": 0.14, "sensor": "load"}}])");
    DriveRecord shaken = sine_record(0, 1, 3);
    for (std::size_t k = 0; k < shaken.t.size(); ++k) {
        const double t = shaken.t[k];
        shaken.excitation[k] = 12 * std::sin(2 * std::numbers::pi * (3 + 20 * t) * t);
    }
    const Diagnosis d = diagnosed_between(stiff, hidden, stiff, shaken, sine_record(1e-3, 2, 3));
    ASSERT_EQ(d.verdict, "effect_found");
    ASSERT_EQ(d.effects[0].name, "backlash");
    EXPECT_EQ(d.effects[0].parameters["sensor"], "load");
    EXPECT_NEAR(d.effects[0].parameters["gap_m"].get<double>(), 2e-5, 1e-6);
}

TEST(Diagnosis, AnEncoderErrorIsFoundThoughTheLoopTurnsItsPhase) {
    Json stiff = small_axis();
    stiff["rigid_gain_per_kg"] = 0.076;
    stiff["process_noise_rms_N"] = 0.08;
    stiff["controller"] = {
        {"type", "pid"}, {"kp", 115300}, {"ki", 1132000}, {"kd", 1739}, {"derivative_filter_hz", 300}};
    const Json hidden = Json::parse(R"([{"name": "encoder_periodic_error",
        "parameters": {"A": 2.5e-6, "period_m": 0.002, "phase": 5.6, "A2": 4e-7, "phase2": 2.9}}])");
    const Diagnosis d = diagnosed_between(stiff, hidden, stiff, sine_record(0.04, 0.5, 4), sine_record(0.006, 1, 4));
    ASSERT_EQ(d.verdict, "effect_found");
    ASSERT_EQ(d.effects[0].name, "encoder_periodic_error");
    for (const char* name : {"A", "period_m", "A2"}) {
        expect_parameter(d.effects[0], name, hidden[0]["parameters"][name].get<double>());
    }
}

// Gain, friction and modes within their tolerances, and the spring that leads the motion away: on whole records a gain of the thrust
// comes nearest to them.
TEST(Diagnosis, ASpringThatLeadsTheMotionAwayIsFoundOnItsBeginning) {
    const auto machine = [](double friction, double gain, const char* modes) {
        Json one = small_axis();
        one["controller"] = {{"type", "pid"}, {"kp", 10000}, {"ki", 40000}, {"kd", 380}, {"derivative_filter_hz", 300}};
        one["rigid_gain_per_kg"] = gain;
        one["friction"] = {{"viscous", 2.5 * friction}, {"elements", Json::array()}};
        for (const auto& [F, K] : {std::pair{1.3, 1.8e6}, {1.0, 3e5}, {1.0, 4e4}, {1.4, 8e3}, {0.9, 1.6e3}}) {
            one["friction"]["elements"].push_back({{"F", friction * F}, {"K", friction * K}});
        }
        one["modes"] = Json::parse(modes);
        return one;
    };
    const Json real = machine(1, 0.152, R"([{"freq_hz": 82.7, "gain": 0.01, "zeta": 0.0115},
        {"freq_hz": 168.4, "gain": 0.0073, "zeta": 0.042}])");
    Json believed = machine(1.2, 0.14, R"([{"freq_hz": 83.2, "gain": 0.011, "zeta": 0.01},
        {"freq_hz": 165.6, "gain": 0.0072, "zeta": 0.035}])");
    believed["tolerance"] = {{"rigid_gain_per_kg", 0.045}, {"friction.elements", 0.1}, {"friction.viscous", 0.18},
                             {"modes.freq_hz", 0.018},     {"modes.gain", 0.08},       {"modes.zeta", 0.13}};
    const Json hidden = Json::parse(R"([{"name": "spring_force", "parameters": {"k": 240, "y0": 0}}])");
    const Diagnosis d = diagnosed_between(real, hidden, believed, sine_record(1e-3, 2, 6), sine_record(0.02, 1, 6));
    ASSERT_EQ(d.verdict, "effect_found");
    ASSERT_EQ(d.effects[0].name, "spring_force");
    expect_parameter(d.effects[0], "k", 240);
}

TEST(Diagnosis, AHiddenModeIsFoundThoughItsPhaseRunsRoundManyTimes) {
    const MachineModel machine = MachineModel::from_description(small_axis(), "case");
    const Json hidden =
        Json::parse(R"([{"name": "resonant_mode", "parameters": {"gain": 0.004, "freq_hz": 87.3, "zeta": 0.01}}])");
    const auto record = [&](double phase, std::uint64_t seed) {
        DriveRecord drive = sine_record(0.01, 0.5, 4);
        for (std::size_t k = 0; k < drive.t.size(); ++k) {
            for (const double f : {11.0, 29.0, 47.0, 71.0, 86.0, 89.0, 101.0, 131.0}) {
                drive.excitation[k] += 4 * std::sin(2 * std::numbers::pi * f * drive.t[k] + phase * f);
            }
        }
        return measurement_from_table(measured(small_axis(), hidden, drive, seed), machine, "case");
    };
    DiagnosisOptions options;
    options.max_effects = 1;
    RunControl control;
    control.workers = 2;
    const Diagnosis d = diagnose(machine, {record(1, 1)}, record(2, 2), options, control);
    ASSERT_EQ(d.verdict, "effect_found");
    ASSERT_EQ(d.effects[0].name, "resonant_mode");
    for (const char* name : {"gain", "freq_hz", "zeta"}) {
        expect_parameter(d.effects[0], name, hidden[0]["parameters"][name].get<double>());
    }
}

TEST(Diagnosis, ACoarseEncoderShowsInItsValues) {
    const Diagnosis d =
        diagnosed(Json::parse(R"([{"name": "encoder_quantization", "parameters": {"resolution_m": 2e-6}}])"));
    ASSERT_EQ(d.verdict, "effect_found");
    EXPECT_EQ(d.effects[0].name, "encoder_quantization");
    EXPECT_NEAR(d.effects[0].parameters["resolution_m"].get<double>(), 2e-6, 1e-12);
    // Before is the machine as it was handed in: finer steps, which would leave less.
    EXPECT_EQ(d.before.axis().encoder_resolution, 1e-7);
    EXPECT_EQ(d.after.axis().encoder_resolution, 2e-6);
    EXPECT_LT(d.validation.front().described_floor, 0.5 * d.validation.front().gap.floor);
    EXPECT_NEAR(d.validation_gap.after / d.validation_gap.floor, 1, 0.1);
}

TEST(Diagnosis, AMachineWithItsEffectLacksNothing) {
    const Json hidden = Json::parse(R"([{"name": "constant_force", "parameters": {"F": -2.5}}])");
    const Diagnosis first = diagnosed(hidden);
    ASSERT_EQ(first.verdict, "effect_found");
    EXPECT_EQ(diagnosed(hidden, first.after.description()).verdict, "nothing_missing");
}

// A slow record shows little of the drag, a fast one beside it a good deal more.
TEST(Diagnosis, RecordsToFitAreUsedTogether) {
    const MachineModel machine = MachineModel::from_description(small_axis(), "case");
    const Json hidden = Json::parse(R"([{"name": "quadratic_drag", "parameters": {"c": 300}}])");
    const auto record = [&](double amplitude, double frequency, std::uint64_t seed) {
        return measurement_from_table(measured(small_axis(), hidden, sine_record(amplitude, frequency, 2), seed),
                                      machine, "case");
    };
    const DiagnosisOptions options{.max_effects = 1};
    const RunControl control{.workers = 2};
    const Measurement slow = record(0.008, 1, 1), fast = record(0.02, 1.5, 2), validation = record(0.015, 1, 3);
    const Diagnosis alone = diagnose(machine, {slow}, validation, options, control);
    const Diagnosis both = diagnose(machine, {slow, fast}, validation, options, control);
    for (const Diagnosis* d : {&alone, &both}) {
        ASSERT_EQ(d->verdict, "effect_found");
        ASSERT_EQ(d->effects[0].name, "quadratic_drag");
        expect_parameter(d->effects[0], "c", 300);
    }
    EXPECT_LT(both.effects[0].standard_errors["c"].get<double>(),
              0.3 * alone.effects[0].standard_errors["c"].get<double>());
    EXPECT_EQ(both.fitted.size(), 2u);
}

TEST(Diagnosis, AFieldWithinItsToleranceIsNoEffect) {
    Json believed = small_axis();
    believed["friction"]["viscous"] = 4.6; // 15 % off, where 10 % is its standard deviation
    believed["tolerance"] = {{"friction.viscous", 0.1}};
    EXPECT_EQ(diagnosed(Json::array(), believed).verdict, "nothing_missing");
    believed.erase("tolerance");
    EXPECT_NE(diagnosed(Json::array(), believed).verdict, "nothing_missing");
}

TEST(Diagnosis, AFieldFarOutsideItsToleranceIsAnEffect) {
    Json believed = small_axis();
    believed["tolerance"] = {{"friction.viscous", 0.1}, {"rigid_gain_per_kg", 0.01}};
    // Seven standard deviations of viscous friction more: the field alone could take them up without a trace.
    const Diagnosis d =
        diagnosed(Json::parse(R"([{"name": "viscous_friction", "parameters": {"dD": 2.8}}])"), believed);
    ASSERT_EQ(d.verdict, "effect_found");
    EXPECT_EQ(d.effects[0].name, "viscous_friction");
    // What the tolerance leaves open is part of its error.
    EXPECT_NEAR(d.effects[0].standard_errors["dD"].get<double>(), 0.4, 0.1);
    expect_parameter(d.effects[0], "dD", 2.8);
}

// More of them than effects are sought.
TEST(Diagnosis, FieldsOutsideTheirTolerancesAreToldWithTheGapThatTheyLeave) {
    Json believed = small_axis();
    believed["rigid_gain_per_kg"] = 1.06 * believed["rigid_gain_per_kg"].get<double>();
    for (const char* field : {"viscous", "coulomb"})
        believed["friction"][field] = 0.8 * believed["friction"][field].get<double>();
    believed["tolerance"] = {{"friction.viscous", 0.05}, {"friction.coulomb", 0.05}, {"rigid_gain_per_kg", 0.01}};
    const Diagnosis d = diagnosed(Json::array(), believed);
    EXPECT_EQ(d.verdict, "unknown_effect");
    EXPECT_EQ(d.fields_off.size(), 3u);
    EXPECT_GT(d.validation_gap.before, 10 * d.validation_gap.floor);
    EXPECT_LT(d.validation_gap.after, 1.2 * d.validation_gap.floor);
    EXPECT_NEAR(d.after.axis().plant.viscous, 4, 0.1);
}

TEST(Diagnosis, FieldsAreFoundWhereAModeRunsRoundWithinItsTolerance) {
    Json believed = small_axis();
    believed["modes"] = Json::parse(R"([{"gain": 0.006, "freq_hz": 73, "zeta": 0.003}])");
    believed["controller"] =
        Json::parse(R"({"type": "pid", "kp": 11000, "ki": 60000, "kd": 500, "derivative_filter_hz": 400})");
    Json real = believed;
    const auto off = [&](Json& field, const char* name, double deviation, double deviations) {
        field = field.get<double>() * (1 + deviation * deviations);
        believed["tolerance"][name] = deviation;
    };
    off(real["friction"]["coulomb"], "friction.coulomb", 0.09, 0.6);
    off(real["friction"]["viscous"], "friction.viscous", 0.14, -0.3);
    off(real["rigid_gain_per_kg"], "rigid_gain_per_kg", 0.05, 1.5);
    off(real["modes"][0]["gain"], "modes.gain", 0.07, -0.6);
    off(real["modes"][0]["freq_hz"], "modes.freq_hz", 0.03, 1.9);
    off(real["modes"][0]["zeta"], "modes.zeta", 0.15, 1.4);
    const MachineModel machine = MachineModel::from_description(believed, "case");
    // A multisine about the mode, which goes round with a phase of its own after a second.
    const auto record = [&](double phase, std::uint64_t seed) {
        DriveRecord drive = sine_record(0.01, 0.5, 4);
        for (std::size_t k = 0; k < drive.t.size(); ++k) {
            for (const double f : {5.0, 12.0, 23.0, 41.0, 57.0, 69.0, 72.0, 77.0, 83.0, 110.0}) {
                drive.excitation[k] += 3 * std::sin(2 * std::numbers::pi * f * drive.t[k] + phase * f);
            }
        }
        return measurement_from_table(measured(real, Json::array(), drive, seed), machine, "case");
    };
    const Diagnosis d = diagnose(machine, {record(1, 1)}, record(2, 2), {}, {});
    EXPECT_EQ(d.verdict, "nothing_missing");
    EXPECT_NEAR(d.before.modes[0].freq_hz, real["modes"][0]["freq_hz"].get<double>(), 0.05);
}

TEST(Diagnosis, WhatIsNoKnownEffectIsNotNamedWithConfidence) {
    // A force that comes and goes by the clock, as no effect does: blows of 6 N for 4 ms at uneven times.
    const MachineModel machine = MachineModel::from_description(small_axis(), "case");
    const auto record = [&](double frequency, std::uint64_t seed) {
        DriveRecord drive = sine_record(0.012, frequency, 2);
        for (const std::size_t start : {311u, 800u, 1403u, 1577u, 2590u, 3333u}) {
            for (std::size_t k = start; k < start + 8; ++k) drive.excitation[k] = 6;
        }
        Table table = measured(small_axis(), Json::array(), drive, seed);
        // The blows are no part of the recorded u.
        for (std::size_t k = 0; k < drive.t.size(); ++k) table.columns[2].values[k] -= drive.excitation[k];
        return measurement_from_table(table, machine, "case");
    };
    DiagnosisOptions options;
    options.max_effects = 1;
    RunControl control;
    control.workers = 2;
    const Diagnosis d = diagnose(machine, {record(1.5, 1)}, record(1, 2), options, control);
    if (d.verdict == "effect_found") {
        EXPECT_LE(d.effects[0].probability, 0.8);
    } else {
        EXPECT_TRUE(d.verdict == "unknown_effect" || d.verdict == "undecided") << d.verdict;
    }
}

// In open loop no controller tells units and places; the simulation does.
TEST(Diagnosis, AnOpenLoopRecordInOtherUnitsOrPlacesIsRefused) {
    Json believed = small_axis();
    believed.erase("controller");
    believed["closed_loop"] = false;
    const MachineModel machine = MachineModel::from_description(believed, "case");
    DriveRecord record = sine_record(0, 1, 1);
    for (const double t : record.t) record.u.push_back(15 * std::sin(30 * t) + 9 * std::sin(170 * t));
    record.reference.clear();
    record.excitation.clear();
    const Table good = measured(believed, Json::array(), record, 1);
    const auto refusal = [&](const Table& table) {
        try {
            diagnose(machine, {measurement_from_table(table, machine, "case")}, std::nullopt, {.max_effects = 1}, {});
        } catch (const InputError& problem) {
            return std::string(problem.what());
        }
        return std::string();
    };
    EXPECT_EQ(refusal(good), "");
    Table millimetres = good;
    for (double& y : millimetres.columns[3].values) y *= 1e3;
    EXPECT_NE(refusal(millimetres).find("another unit"), std::string::npos) << refusal(millimetres);
    Table exchanged = good;
    std::swap(exchanged.columns[2].values, exchanged.columns[3].values);
    EXPECT_NE(refusal(exchanged).find("the other's place"), std::string::npos) << refusal(exchanged);
}

TEST(DiagnosisFiles, TheMachineInLuaHasEveryField) {
    const std::string text =
        machine_lua(Json::parse(R"({"Ts": 0.0005, "modes": [{"gain": 1}], "odd key": null, "a b": 2})"));
    EXPECT_EQ(
        text,
        "-- A machine description; see docs/machine-description.md.\nreturn {\n  Ts = 5e-04,\n  modes = {\n    {\n"
        "      gain = 1,\n    },\n  },\n  [\"a b\"] = 2,\n}\n");
}

} // namespace
} // namespace tribode
