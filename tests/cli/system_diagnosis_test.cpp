#include "cli/program.hpp"
#include "tribode/base/json.hpp"
#include "unit/script/temporary_folder.hpp"

#include <algorithm>
#include <cmath>
#include <fmt/format.h>
#include <fmt/ranges.h>
#include <gtest/gtest.h>
#include <map>
#include <set>

namespace tribode::cli {
namespace {

// A vehicle on a track, driven by a voltage. What the model lacks is written here as Lua, and simulated by Tribode.
class SystemDiagnosis : public ::testing::Test {
  protected:
    SystemDiagnosis() {
        folder.write("model.lua", model("0"));
        folder.write("script.lua", R"(
            local tb = require "tribode"
            local n, step = 300, 0.04
            local option = tb.options { valid_size = { default = 1 }, force_seed = { default = 1 } }
            for k, name in ipairs { "ident", "valid" } do
                local u, f, size, force = {}, {}, k == 2 and option.valid_size or 1, 0
                for i = 1, n do
                    local t = (i - 1) * step
                    u[i] = size * (math.sin(1.3 * t + k) + 0.6 * math.sin(3.1 * t * k) + 0.3 * math.sin(0.5 * t))
                    force = 0.95 * force + 0.000312 * tb.standard_normal(option.force_seed, 10 + k, i)
                    f[i] = force
                end
                local run = tb.run_system { system = require "truth", duration_s = (n - 1) * step, output_step_s = step,
                    inputs = { u = { sample_time_s = step, values = u }, f = { sample_time_s = step, values = f } } }
                local x = {}
                for i = 1, n do x[i] = run.values.x[i] + 1e-3 * tb.standard_normal(7, k, i) end
                tb.write_csv { file = name .. ".csv", columns = { { name = "t", unit = "s", values = run.t },
                    { name = "u", values = u }, { name = "x", values = x } } }
            end)");
    }

    static std::string model(const std::string& hidden, const std::string& more = "") {
        return fmt::format(R"(
            local tb = require "tribode"
            return tb.system {{
                parameters = {{ d = {{ value = 0.4, unit = "1/s" }}, g = {{ value = 2, unit = "m/s2/V" }},
                    h = 0.5, p = {{ value = 3, unit = "s/m" }}, q = {{ value = 2, unit = "1/m" }} }},
                inputs = {{ u = {{ unit = "V" }} }},
                states = {{ x = {{ start = 0, unit = "m" }}, v = {{ start = 0, unit = "m/s" }} }},
                der = function(s) return {{ x = s.v, v = s.g * s.u - s.d * s.v - s.h * ({}) }} end,
                {} }})",
                           hidden, more);
    }

    Ending program(const std::vector<std::string>& arguments) { return run(arguments, {.folder = folder.path()}); }

    // Records ident.csv and valid.csv of the vehicle with this term, in a folder. In it s.f is a random force of 1 mm/s2 that is
    // correlated over 0.8 s. `options`: of the script.
    void measure(const std::string& hidden, const std::string& options = "valid_size=1") {
        std::string truth = model(hidden);
        const std::string inputs = "inputs = { ";
        truth.insert(truth.find(inputs) + inputs.size(), "f = 0, ");
        folder.write("truth.lua", truth);
        const auto ending = program({"run", "script.lua", "-o", "records", "-D", options, "--quiet"});
        ASSERT_EQ(ending.exit_code, 0) << ending.err;
    }

    // The answer must not depend on the clock. What the model does not use cannot be fitted.
    std::vector<std::string> usual = {"--free",   "d",   "--free",        "g", "--free", "x.start", "--free", "v.start",
                                      "--budget", "1e6", "--max-effects", "1", "--quiet"};

    Ending diagnose(const std::vector<std::string>& arguments) {
        std::vector<std::string> all = {"diagnose"};
        all.insert(all.end(), arguments.begin(), arguments.end());
        return program(all);
    }

    Json diagnosis(const std::string& system, const std::string& out) {
        std::vector<std::string> arguments = {"--system",          system, "--data", "records/ident.csv", "--validate",
                                              "records/valid.csv", "-o",   out};
        arguments.insert(arguments.end(), usual.begin(), usual.end());
        const auto ending = diagnose(arguments);
        EXPECT_EQ(ending.exit_code, 0) << ending.err;
        return Json::parse(text_of(folder / (out + "/diagnosis.json")));
    }

    TemporaryFolder folder;
};

TEST_F(SystemDiagnosis, AHiddenDragIsFoundAndAddedToAFileThatRuns) {
    measure("s.v * math.abs(s.v)");
    const Json found = diagnosis("model.lua", "out");
    ASSERT_EQ(found["verdict"], "effect_found");
    ASSERT_EQ(found["effects"].size(), 1u);
    const Json& effect = found["effects"][0];
    EXPECT_EQ(effect["name"], "quadratic_drag");
    EXPECT_EQ(effect["equation"], "der(v)");
    const double error = effect["standard_errors"]["quadratic_drag_a"];
    EXPECT_NEAR(effect["parameters"]["quadratic_drag_a"].get<double>(), -0.5, 3.5 * error);
    EXPECT_LT(error, 0.02);
    EXPECT_EQ(effect["units"]["quadratic_drag_a"], "1/m");
    EXPECT_GT(effect["probability"], 0.8);
    EXPECT_NEAR(found["free"]["d"]["value"].get<double>(), 0.4,
                3.5 * found["free"]["d"]["standard_error"].get<double>());
    // The floor is the noise that was added.
    EXPECT_NEAR(found["gap"]["validate"]["floor"].get<double>(), 1e-3, 2e-4);
    EXPECT_LT(found["gap"]["validate"]["after"], 1.2e-3);
    EXPECT_GT(found["explained"], 0.99);
    EXPECT_EQ(found["gap_unit"], "m");
    // All that was tried is told, with a reason, but for the one that was taken.
    EXPECT_GT(found["hypotheses"].size(), 5u);
    EXPECT_EQ(std::count_if(found["hypotheses"].begin(), found["hypotheses"].end(),
                            [](const Json& one) { return one["lost"].is_null(); }),
              1);
    const auto page = text_of(folder / "out/report.html");
    for (const char* title : {"What is missing", "Where model and measurement disagree", "What was tried"}) {
        EXPECT_NE(page.find(title), std::string::npos) << title;
    }
    EXPECT_TRUE(text_of(folder / "out/validate.csv").starts_with("t,x_measured,x_before,x_after\n"));

    // The file runs, and lacks nothing.
    const auto ending = program({"run", "out/system.lua", "-o", "ran", "--quiet"});
    EXPECT_EQ(ending.exit_code, 0) << ending.err;
    std::vector<std::string> again = {
        "diagnose", "--system", "out/system.lua", "--data",  "records/ident.csv", "--validate", "records/valid.csv",
        "--free",   "x.start",  "--free",         "v.start", "--max-effects",     "1",          "--budget",
        "1e6",      "-o",       "again",          "--quiet"};
    ASSERT_EQ(program(again).exit_code, 0);
    const Json second = Json::parse(text_of(folder / "again/diagnosis.json"));
    EXPECT_EQ(second["verdict"], "nothing_missing");
    EXPECT_NEAR(second["gap"]["validate"]["before"].get<double>(), found["gap"]["validate"]["after"].get<double>(),
                1e-5);
}

// A script and the command line hand in the same model, also where dry friction of its own holds it.
TEST_F(SystemDiagnosis, AModelWithDryFrictionIsTheSameFromAScriptAndAFile) {
    const auto with_friction = [](const std::string& hidden) {
        return model("s.f.force + " + hidden, "parts = { f = tb.parts.coulomb { velocity = 'v', level = 1 } }");
    };
    std::string truth = with_friction("s.v * math.abs(s.v)");
    const std::string inputs = "inputs = { ";
    truth.insert(truth.find(inputs) + inputs.size(), "f_random = 0, ");
    folder.write("truth.lua", truth);
    folder.write("model.lua", with_friction("0"));
    std::string script = text_of(folder / "script.lua");
    const std::string random = "f = { sample_time_s = step, values = f }";
    script.replace(script.find(random), random.size(), "f_random = { sample_time_s = step, values = f }");
    folder.write("script.lua", script);
    ASSERT_EQ(program({"run", "script.lua", "-o", "records", "--quiet"}).exit_code, 0);
    usual = {"--free", "d", "--free", "g", "--free", "h", "--budget", "1e6", "--max-effects", "1", "--quiet"};
    const Json file = diagnosis("model.lua", "out");
    ASSERT_EQ(file["effects"].size(), 1u);
    EXPECT_EQ(file["effects"][0]["name"], "quadratic_drag");
    folder.write("diagnose.lua", R"(
        local tb = require "tribode"
        tb.diagnose_system { system = require "model", data = { "records/ident.csv" },
            validate = { "records/valid.csv" }, free = { "d", "g", "h" }, budget_s = 1e6, max_effects = 1 })");
    const auto ending = program({"run", "diagnose.lua", "-o", "again", "--quiet", "--allow-all"});
    ASSERT_EQ(ending.exit_code, 0) << ending.err;
    const Json from_script = Json::parse(text_of(folder / "again/diagnosis/diagnosis.json"));
    for (const auto* key : {"verdict", "effects", "gap", "free", "hypotheses"})
        EXPECT_EQ(from_script[key], file[key]) << key;
}

TEST_F(SystemDiagnosis, WhatTheRecordsDoNotDetermineIsSaid) {
    measure("s.v * math.abs(s.v)");
    std::string twice = model("0"); // only the product of g and h counts
    twice.replace(twice.find("s.g * s.u"), 9, "s.g * s.h / 0.5 * s.u");
    folder.write("twice.lua", twice);
    usual.insert(usual.end(), {"--free", "h"});
    EXPECT_EQ(diagnosis("twice.lua", "out")["effects"][0]["name"], "quadratic_drag");
    EXPECT_NE(text_of(folder / "out/system.lua").find(" These records do not determine g, h.\n"), std::string::npos);
    EXPECT_NE(text_of(folder / "out/report.html").find("These records do not determine g, h."), std::string::npos);
}

TEST_F(SystemDiagnosis, AModelThatLacksNothingIsLeftAlone) {
    measure("0");
    const Json found = diagnosis("model.lua", "out");
    EXPECT_EQ(found["verdict"], "nothing_missing");
    EXPECT_TRUE(found["effects"].empty());
    EXPECT_NEAR(found["gap"]["validate"]["before"].get<double>(), 1e-3, 2e-4);
}

// One wrong sample is nothing that the model lacks, and the answer says that it was replaced.
TEST_F(SystemDiagnosis, WhatIsDoneToARecordIsSaid) {
    measure("0");
    std::string rows = text_of(folder / "records/ident.csv");
    std::size_t row = 0;
    for (int n = 0; n < 150; ++n) row = rows.find('\n', row) + 1;
    const std::size_t end = rows.find('\n', row), cell = rows.rfind(',', end) + 1;
    const double x = std::stod(rows.substr(cell, end - cell));
    folder.write("records/ident.csv", rows.replace(cell, end - cell, std::to_string(x + 1)));
    const Json found = diagnosis("model.lua", "out");
    EXPECT_EQ(found["verdict"], "nothing_missing");
    ASSERT_EQ(found["remarks"].size(), 1u);
    const std::string remark = found["remarks"][0];
    EXPECT_NE(remark.find("ident.csv: one sample of x stands apart"), std::string::npos) << remark;
    EXPECT_NE(text_of(folder / "out/report.html").find("one sample of x stands apart"), std::string::npos);
}

// No term of the library is this one, so none may be called the answer.
// The fitted values follow what the force did on the fitted record, so that the model is off on the other one. A term that explains
// a quarter of that is none; of one that explains more these records cannot tell.
TEST_F(SystemDiagnosis, ARandomForceIsNoEffect) {
    measure("-2 * s.f", "force_seed=1");
    const Json found = diagnosis("model.lua", "out");
    EXPECT_EQ(found["effects"].size(), 0u);
    EXPECT_EQ(found["verdict"], "unknown_effect");
    EXPECT_GT(found["gap"]["validate"]["before"].get<double>(), 2 * found["gap"]["validate"]["floor"].get<double>());
    measure("-2 * s.f", "force_seed=17");
    const Json unsure = diagnosis("model.lua", "unsure");
    EXPECT_EQ(unsure["verdict"], "undecided");
    ASSERT_EQ(unsure["effects"].size(), 1u);
    EXPECT_LT(unsure["effects"][0]["probability"], 0.3);
    EXPECT_NE(unsure["next_experiment"].get<std::string>().find("nothing"), std::string::npos);
}

TEST_F(SystemDiagnosis, AForceOfNoNameIsNoNamedEffect) {
    measure("math.sin(s.p * s.v) * math.cos(s.q * s.x)");
    const Json found = diagnosis("model.lua", "out");
    EXPECT_TRUE(found["verdict"] == "unknown_effect" || found["verdict"] == "partial" ||
                found["verdict"] == "undecided")
        << found["verdict"];
    EXPECT_GT(found["gap"]["validate"]["after"], 3 * found["gap"]["validate"]["floor"].get<double>());
}

TEST_F(SystemDiagnosis, AForceOfNoNameIsFoundAsAFormula) {
    measure("2 * s.x * tb.tanh(s.p * s.v)");
    const Json found = diagnosis("model.lua", "out");
    EXPECT_EQ(found["verdict"], "effect_found");
    ASSERT_EQ(found["effects"].size(), 1u);
    const Json& effect = found["effects"][0];
    EXPECT_EQ(effect["name"], "term");
    // -0.5 2 x tanh(3 v)
    for (const auto& [parameter, value] : {std::pair{"term_a", -1.0}, {"term_width", 1.0 / 3}}) {
        const double error = effect["standard_errors"][parameter];
        EXPECT_NEAR(effect["parameters"][parameter].get<double>(), value, 3.5 * error) << parameter;
        EXPECT_LT(error, 0.05) << parameter;
    }
    EXPECT_LT(found["gap"]["validate"]["after"], 1.5 * found["gap"]["validate"]["floor"].get<double>());
}

// Of three functions none explains much without the others, and the best two are not among them.
TEST_F(SystemDiagnosis, ASumOfThreeFunctionsIsFoundAsAFormula) {
    measure("-0.5 * s.q * s.x * s.p * s.v + 0.4 * (s.q * s.x)^2 * s.p * s.v + 0.3 * s.q * s.x * (s.p * s.v)^2");
    usual[std::find(usual.begin(), usual.end(), "--max-effects") - usual.begin() + 1] = "3";
    const Json found = diagnosis("model.lua", "out");
    EXPECT_EQ(found["verdict"], "effect_found");
    std::map<std::string, double> amplitudes;
    for (const auto& effect : found["effects"]) {
        amplitudes[effect["expression"]] = effect["parameters"].begin().value();
    }
    ASSERT_EQ(amplitudes.size(), 3u) << found["effects"];
    for (const auto& [expression, value] : amplitudes) {
        // In the truth: -h times the coefficient, p of v and q of x.
        const bool has_two_x = expression.find("x*x") != std::string::npos;
        const bool has_two_v = expression.find("v*v") != std::string::npos;
        const double truth = has_two_x ? -0.5 * 0.4 * 4 * 3 : has_two_v ? -0.5 * 0.3 * 2 * 9 : 0.5 * 0.5 * 2 * 3;
        EXPECT_NEAR(value, truth, 0.05 * std::abs(truth)) << expression;
    }
    EXPECT_LT(found["gap"]["validate"]["after"], 1.2e-3); // 1e-3 is noise
}

// The vehicle stays in the hollows of the force that the model lacks, so that the two part at once.
TEST_F(SystemDiagnosis, ARippleThatLeadsTheModelAwayIsFoundOverSegments) {
    measure("3 * math.sin(s.q * s.x)");
    const Json found = diagnosis("model.lua", "out");
    EXPECT_EQ(found["verdict"], "effect_found");
    ASSERT_EQ(found["effects"].size(), 1u);
    const Json& effect = found["effects"][0];
    EXPECT_EQ(effect["name"], "force_ripple");
    EXPECT_NEAR(effect["parameters"]["force_ripple_period"].get<double>(), 3.14159265,
                4 * effect["standard_errors"]["force_ripple_period"].get<double>());
    EXPECT_GT(found["gap"]["validate"]["before"], 30 * found["gap"]["validate"]["floor"].get<double>());
}

// A body on a spring, which the vehicle carries: only the vehicle is measured.
TEST_F(SystemDiagnosis, AVibrationThatActsBackOnWhatIsDriven) {
    const double ratio = 0.8, w = 6.5; // of the masses; of the body on its spring where the vehicle is held
    folder.write("truth.lua", fmt::format(R"(
        local tb = require "tribode"
        return tb.system {{
            parameters = {{ d = 0.4, g = 2, w = {1}, ratio = {0}, damping = 0.04 }},
            inputs = {{ u = {{ unit = "V" }}, f = 0 }},
            states = {{ x = 0, v = 0, y = 0, z = 0 }},
            der = function(s)
                local lift = s.w ^ 2 * (s.x - s.y) + 2 * s.damping * s.w * (s.v - s.z)
                return {{ x = s.v, v = (1 + s.ratio) * (s.g * s.u - s.d * s.v) - s.ratio * lift, y = s.z, z = lift }}
            end }})",
                                          ratio, w));
    ASSERT_EQ(program({"run", "script.lua", "-o", "records", "--quiet"}).exit_code, 0);
    const Json found = diagnosis("model.lua", "out");
    EXPECT_EQ(found["verdict"], "effect_found");
    ASSERT_EQ(found["effects"].size(), 1u);
    const Json& effect = found["effects"][0];
    EXPECT_EQ(effect["name"], "resonant_mode");
    EXPECT_EQ(effect["equation"], "der(v)");
    const double resonance = w * std::sqrt(1 + ratio);
    for (const auto& [parameter, value] : {std::pair{"resonant_mode_ratio", ratio},
                                           {"resonant_mode_frequency", resonance / (2 * 3.14159265)},
                                           {"resonant_mode_damping", 0.04 * std::sqrt(1 + ratio)}}) {
        const double error = effect["standard_errors"][parameter];
        EXPECT_NEAR(effect["parameters"][parameter].get<double>(), value, 3.5 * error) << parameter;
        EXPECT_LT(error, 0.02) << parameter;
    }
    EXPECT_LT(found["gap"]["validate"]["after"], 1.5 * found["gap"]["validate"]["floor"].get<double>());
}

// Whatever the order in which they were found.
TEST_F(SystemDiagnosis, OfTwoEffectsTheStrongerIsNamedFirst) {
    const auto forces = [](double spring, double drag) {
        return fmt::format("{} * s.x * (s.q / s.p) ^ 2 + {} * s.q * s.v * math.abs(s.v)", spring, drag);
    };
    for (const auto& [hidden, stronger] :
         {std::pair{forces(7, 0.1), "spring_force"}, {forces(0.3, 1), "quadratic_drag"}}) {
        measure(hidden);
        const auto ending =
            diagnose({"--system", "model.lua", "--data", "records/ident.csv", "--validate", "records/valid.csv",
                      "--free", "d", "--free", "g", "--max-effects", "2", "--budget", "1e6", "-o", "out", "--quiet"});
        ASSERT_EQ(ending.exit_code, 0) << ending.err;
        const Json found = Json::parse(text_of(folder / "out/diagnosis.json"));
        ASSERT_EQ(found["effects"].size(), 2u) << hidden;
        std::set<std::string> names;
        for (const auto& effect : found["effects"]) names.insert(effect["name"].get<std::string>());
        EXPECT_EQ(names, (std::set<std::string>{"spring_force", "quadratic_drag"}));
        EXPECT_EQ(found["effects"][0]["name"], stronger);
    }
}

// What no record can decide is no rival.
TEST_F(SystemDiagnosis, AConstantForceIsAnOffsetOfTheInputInOtherWords) {
    measure("0.4");
    const Json found = diagnosis("model.lua", "out");
    EXPECT_EQ(found["verdict"], "effect_found");
    ASSERT_EQ(found["effects"].size(), 1u);
    const Json& effect = found["effects"][0];
    std::set<std::string> names = {effect["name"]};
    for (const auto& same : effect["same_as"]) names.insert(same.get<std::string>());
    EXPECT_TRUE(names.contains("constant_force") || names.contains("constant_force in der(v)")) << effect;
    EXPECT_TRUE(names.contains("offset") || names.contains("offset in input u")) << effect;
    EXPECT_GT(effect["probability"], 0.8);
}

TEST_F(SystemDiagnosis, TheSystemItselfSaysWhatIsFree) {
    measure("0");
    folder.write("free.lua", model("0", R"(free = { "g", "v.start" })"));
    const auto ending = diagnose({"--system", "free.lua", "--data", "records/ident.csv", "--max-effects", "1",
                                  "--budget", "1e6", "-o", "out", "--quiet"});
    ASSERT_EQ(ending.exit_code, 0) << ending.err;
    const Json found = Json::parse(text_of(folder / "out/diagnosis.json"));
    EXPECT_EQ(found["free"].size(), 1u);
    EXPECT_TRUE(found["free"].contains("g"));
    // The validation record is the last third.
    EXPECT_EQ(found["data"].size(), 1u);
    folder.write("wrong.lua", model("0", R"(free = { "gg" })"));
    expect_sentence(diagnose({"--system", "wrong.lua", "--data", "records/ident.csv", "-o", "none"}), 2,
                    {"free[1]", "\"gg\"", "STATE.start"});
}

TEST_F(SystemDiagnosis, WhatIsFoundMayBeFittedAgainToo) {
    measure("s.v * math.abs(s.v)");
    folder.write("free.lua", model("0", R"(free = { "g", "d" })"));
    const auto ending =
        diagnose({"--system", "free.lua", "--data", "records/ident.csv", "--validate", "records/valid.csv",
                  "--max-effects", "1", "--budget", "1e6", "-o", "out", "--quiet"});
    ASSERT_EQ(ending.exit_code, 0) << ending.err;
    const Json found = Json::parse(text_of(folder / "out/diagnosis.json"));
    ASSERT_EQ(found["effects"].size(), 1u);
    const auto text = text_of(folder / "out/system.lua");
    for (const auto& [name, value] : found["effects"][0]["parameters"].items()) {
        EXPECT_NE(text.find(fmt::format("free = {{ \"g\", \"d\", \"{}\"", name)), std::string::npos) << text;
        break;
    }
}

TEST_F(SystemDiagnosis, ARecordThatIsGivenTwiceIsRefused) {
    measure("0");
    expect_sentence(diagnose({"--system", "model.lua", "--data", "records/ident.csv", "--validate", "records/ident.csv",
                              "-o", "out", "--quiet"}),
                    2, {"records/ident.csv", "same content"});
}

TEST_F(SystemDiagnosis, ColumnsOfOtherNamesAndUnits) {
    measure("0");
    auto text = text_of(folder / "records/ident.csv");
    text.replace(0, text.find('\n'), "time_ms,voltage,place_mm");
    folder.write("other.csv", text);
    const auto ending =
        diagnose({"--system",  "model.lua", "--data",        "other.csv", "--columns", "t=time_ms", "--input",
                  "u=voltage", "--output",  "x=place_mm",    "--scale",   "x=1,t=1",   "--free",    "g",
                  "--free",    "v.start",   "--max-effects", "1",         "--budget",  "1e6",       "-j",
                  "1",         "-o",        "out",           "--quiet"});
    ASSERT_EQ(ending.exit_code, 0) << ending.err;
    EXPECT_EQ(Json::parse(text_of(folder / "out/diagnosis.json"))["verdict"], "nothing_missing");
}

TEST_F(SystemDiagnosis, ABudgetEndsTheSearchAndTheAnswerSaysSo) {
    measure("s.v * math.abs(s.v)");
    const auto ending =
        diagnose({"--system", "model.lua", "--data", "records/ident.csv", "--budget", "0.001", "-o", "out", "--quiet"});
    ASSERT_EQ(ending.exit_code, 0) << ending.err;
    const Json found = Json::parse(text_of(folder / "out/diagnosis.json"));
    EXPECT_EQ(found["out_of_time"], true);
    EXPECT_EQ(found["verdict"], "undecided"); // not that the library lacks it, which was hardly tried
    EXPECT_NE(text_of(folder / "out/report.html").find("before the budget of time ended the search"),
              std::string::npos);
}

// The drag does next to nothing where the vehicle hardly moves. No term is tried.
TEST_F(SystemDiagnosis, AValidationRecordThatHardlyShowsWhatIsMissingDoesNotHideIt) {
    measure("s.v * math.abs(s.v)", "valid_size=0.01");
    const auto ending =
        diagnose({"--system", "model.lua", "--data", "records/ident.csv", "--validate", "records/valid.csv", "--free",
                  "v.start", "--free", "x.start", "--budget", "0.001", "-o", "out", "--quiet"});
    ASSERT_EQ(ending.exit_code, 0) << ending.err;
    const Json found = Json::parse(text_of(folder / "out/diagnosis.json"));
    EXPECT_LT(found["gap"]["validate"]["before"].get<double>(), 1.5 * found["gap"]["validate"]["floor"].get<double>());
    EXPECT_EQ(found["verdict"], "undecided");
}

TEST_F(SystemDiagnosis, AnInertiaThatDependsOnThePosition) {
    measure("-0.6 * s.x^2 * (s.g * s.u - s.d * s.v)"); // h = 0.5 of it
    const Json d = diagnosis("model.lua", "out");
    const Json effect = d["effects"][0];
    EXPECT_EQ(effect["name"], "variable_capacity");
    EXPECT_NEAR(effect["parameters"]["variable_capacity_curvature"].get<double>(), 0.3, 0.03);
    EXPECT_NE(text_of(folder / "out/system.lua").find("unit = \"1/m2\" }"), std::string::npos);
}

// What is missing in the derivative of a lag, or in what is measured of it: of records that truth.lua made.
class SystemDiagnosisOfALag : public SystemDiagnosis {
  protected:
    static std::string lag(const std::string& rate) {
        return fmt::format(R"(
            local tb = require "tribode"
            return tb.system {{ parameters = {{ a = {{ value = 0.5, unit = "1/s" }}, b = 1 }}, inputs = {{ u = 0 }},
                states = {{ x = 0.3 }}, der = function(s)
                    local f = s.b * s.u - s.a * s.x
                    return {{ x = {} }} end,
                outputs = function(s) return {{ y = s.x }} end }})",
                           rate);
    }

    // `besides`: what is measured besides the output.
    Json found_in(const std::string& truth, const std::string& input, const std::string& besides = "0") {
        folder.write("lag.lua", given);
        folder.write("truth.lua", truth);
        folder.write("script.lua", fmt::format(R"(
            local tb = require "tribode"
            for k, name in ipairs {{ "ident", "valid" }} do
                local n, step, u, y = {}, {}, {{}}, {{}}
                for i = 1, n do u[i] = {} end
                local run = tb.run_system {{ system = require "truth", duration_s = (n - 1) * step, output_step_s = step,
                    inputs = {{ u = {{ sample_time_s = step, values = u }} }}, {} }}
                for i = 1, n do y[i] = run.values.y[i] + {} + 3e-3 * tb.standard_normal(7, k, i) end
                tb.write_csv {{ file = name .. ".csv", columns = {{ {{ name = "t", unit = "s", values = run.t }},
                    {{ name = "u", values = u }}, {{ name = "y", values = y }} }} }}
            end)",
                                               samples, step, input, run_options, besides));
        EXPECT_EQ(program({"run", "script.lua", "-o", "records", "--quiet"}).exit_code, 0);
        usual = {"--budget", "1e6", "--max-effects", "1", "--quiet"};
        const Json d = diagnosis("lag.lua", "out");
        EXPECT_EQ(d["verdict"], verdict);
        return d["effects"].at(0);
    }

    int samples = 300;
    double step = 0.1;       // [s]
    std::string run_options; // of tb.run_system, by k: 1 for the first record, 2 for the second one
    std::string verdict = "effect_found";
    std::string given = lag("f");

    const std::string positive = "0.4 + 0.35 * math.sin(0.05 * i * k + k) + 0.05 * math.sin(0.17 * i)",
                      both_signs = "math.sin(0.05 * i * k + k) + 0.5 * math.sin(0.17 * i)",
                      levels = "({ 1, -0.8, 0.3, -0.2, 0.6 })[1 + (i + 20 * k) // 25 % 5]";
};

// Above its edge it loses all within a tenth of a sample, so that what the term is called hangs on its rate.
TEST_F(SystemDiagnosisOfALag, ATankThatOverflowsLikeAWall) {
    const Json effect = found_in(lag("f - 100 * math.max(s.x - 0.9, 0)"), positive);
    EXPECT_EQ(effect["name"], "overflow");
    EXPECT_NEAR(effect["parameters"]["overflow_level"].get<double>(), 0.9, 3e-3);
}

TEST_F(SystemDiagnosisOfALag, AnAmplifierThatFollowsOnlySoFast) {
    const Json effect = found_in(lag("math.max(math.min(f, 0.4), -0.4)"), levels);
    EXPECT_EQ(effect["name"], "rate_limit");
    EXPECT_NEAR(effect["parameters"]["rate_limit_limit"].get<double>(), 0.4, 4e-3);
}

TEST_F(SystemDiagnosisOfALag, AValveThatOpensFartherInOneDirection) {
    const Json effect = found_in(lag("f - 0.3 * s.b * math.min(s.u, 0)"), both_signs);
    EXPECT_EQ(effect["name"], "asymmetric_gain");
    EXPECT_NEAR(effect["parameters"]["asymmetric_gain_difference"].get<double>(), -0.3, 0.02);
}

TEST_F(SystemDiagnosisOfALag, AShareOfTheInputThatIsThereAtOnce) {
    const Json effect = found_in(lag("f"), levels, "0.1 * u[i]");
    EXPECT_EQ(effect["name"], "feedthrough");
    EXPECT_NEAR(effect["parameters"]["feedthrough_gain"].get<double>(), 0.1, 0.01);
}

// As of a pump or a valve: neither the dead zone nor the bend shows alone.
TEST_F(SystemDiagnosisOfALag, APowerLawBehindADeadZone) {
    const Json effect = found_in(
        lag("s.b * tb.where(tb.less(s.u, 0), -1, 1) * (math.max(math.abs(s.u) - 0.4, 0) / 1.5)^0.5 - s.a * s.x"),
        both_signs);
    EXPECT_EQ(effect["name"], "power_law");
    EXPECT_NEAR(effect["parameters"]["power_law_width"].get<double>(), 0.4, 0.02);
    EXPECT_NEAR(effect["parameters"]["power_law_exponent"].get<double>(), 0.5, 0.05);
}

// Its shape has no name.
TEST_F(SystemDiagnosisOfALag, AValveWithAKneeAtEachEnd) {
    verdict = "partial";
    const Json effect = found_in(
        lag("f + s.b * (0.6 * math.exp((s.u - 1.4) / 0.12) - 0.8 * math.exp(-(s.u + 1.4) / 0.2))"), both_signs);
    EXPECT_EQ(effect["name"], "curve");
}

// What it shows follows slowly. The second record begins elsewhere, and from there.
TEST_F(SystemDiagnosisOfALag, ASlowSensorIsAtRestWhereEachRecordBegins) {
    run_options = "start = { x = 2 * k - 1.7, y = 2 * k - 1.7 }";
    const Json effect = found_in(R"(
        local tb = require "tribode"
        return tb.system { parameters = { a = { value = 0.5, unit = "1/s" }, b = 1 }, inputs = { u = 0 }, states = { x = 0.3, y = 0.3 },
            der = function(s) return { x = s.b * s.u - s.a * s.x, y = (s.x - s.y) / 0.6 } end })",
                                 levels);
    EXPECT_EQ(effect["name"], "lag");
    EXPECT_EQ(effect["equation"], "output y");
    EXPECT_NEAR(effect["parameters"]["lag_time"].get<double>(), 0.6, 0.02);
}

// A staircase is held, whatever a model that lacks something says: between samples that are joined by lines the delay would be longer by
// half of one.
TEST_F(SystemDiagnosisOfALag, ADelayOfAStaircase) {
    step = 0.2;
    const Json effect = found_in(lag("s.b * tb.delay(s.u, 1.6) - s.a * s.x"), levels);
    EXPECT_EQ(effect["name"], "delay");
    EXPECT_NEAR(effect["parameters"]["delay_time"].get<double>(), 1.6, 0.02);
    EXPECT_EQ(Json::parse(text_of(folder / "out/diagnosis.json"))["inputs"], "held between samples");
}

// A diode before what stores and loses.
TEST_F(SystemDiagnosisOfALag, WhatLetsThroughOneDirectionAlone) {
    given = lag("s.b * (s.u - s.x) - s.a * s.x");
    const Json effect = found_in(lag("s.b * math.max(s.u - s.x - 0.2, 0) - s.a * s.x"), both_signs);
    EXPECT_EQ(effect["name"], "one_way");
    EXPECT_EQ(effect["equation"], "u - x");
    EXPECT_NEAR(effect["parameters"]["one_way_closed_below"].get<double>(), 1, 0.01);
    EXPECT_NEAR(effect["parameters"]["one_way_level"].get<double>(), 0.2, 0.02);
}

TEST_F(SystemDiagnosisOfALag, AMotorThatIsDrivenAndCoasts) {
    const Json effect = found_in(lag("f - 0.6 * math.min(f, 0)"), levels);
    EXPECT_EQ(effect["name"], "one_way");
    EXPECT_EQ(effect["equation"], "der(x)");
    EXPECT_NEAR(effect["parameters"]["one_way_closed_below"].get<double>(), 0.6, 0.02);
    EXPECT_NEAR(effect["parameters"]["one_way_level"].get<double>(), 0, 0.02);
}

TEST_F(SystemDiagnosisOfALag, ASensorThatShowsOnlySoMuchToEitherSide) {
    const Json effect = found_in(lag("f"), levels, "math.max(math.min(run.values.y[i], 0.6), -0.6) - run.values.y[i]");
    EXPECT_EQ(effect["name"], "saturation");
    EXPECT_EQ(effect["equation"], "output y");
    EXPECT_NEAR(effect["parameters"]["saturation_limit"].get<double>(), 0.6, 0.01);
}

// The first model explains nothing of it, as the speed turns as often as not.
TEST_F(SystemDiagnosisOfALag, ASensorThatDoesNotTellTheDirection) {
    const Json effect = found_in(lag("f"), levels, "math.abs(run.values.y[i]) - run.values.y[i]");
    EXPECT_EQ(effect["name"], "magnitude");
    EXPECT_NEAR(effect["parameters"]["magnitude_share"].get<double>(), 1, 0.01);
}

// In few steps a random force may do what a curve of the input does. It is told all the same, but not as sure.
TEST_F(SystemDiagnosisOfALag, WhatARandomForceMayDoIsUndecided) {
    samples = 100;
    step = 0.3;
    verdict = "undecided";
    const Json effect =
        found_in(lag("s.b * s.u^2 - s.a * s.x"), "({ 0.3, 1, 0.6, 0.8 })[1 + (i + 25 * k) // 25 % 4]",
                 "0.12 * (math.sin(0.078 * i + k) + math.sin(0.186 * i + 2 * k) + math.sin(0.42 * i + 3 * k))");
    EXPECT_LT(effect["probability"].get<double>(), 0.3);
}

TEST_F(SystemDiagnosis, AnOutputMayRepeatAStateOfItsName) {
    measure("s.v * math.abs(s.v)");
    folder.write("repeats.lua", model("0", "outputs = function(s) return { x = s.x } end"));
    const Json d = diagnosis("repeats.lua", "out");
    EXPECT_EQ(d["effects"][0]["name"], "quadratic_drag");
    EXPECT_EQ(program({"diagnose", "--system", "out/system.lua", "--data", "records/ident.csv", "--budget", "1", "-o",
                       "again", "--quiet"})
                  .exit_code,
              0);
    folder.write("other.lua", model("0", "outputs = function(s) return { x = 2 * s.x } end"));
    const auto ending = diagnose({"--system", "other.lua", "--data", "records/ident.csv", "-o", "none"});
    EXPECT_NE(ending.err.find("the output x has the name of a state but is another value"), std::string::npos)
        << ending.err;
    folder.write("other.lua", model("0", "outputs = function(s) return { y = s.x, u = s.u } end"));
    EXPECT_NE(diagnose({"--system", "other.lua", "--data", "records/ident.csv", "-o", "none"})
                  .err.find("the output u has the name of an input, must have another name"),
              std::string::npos);
}

TEST_F(SystemDiagnosis, WhatOnlyTheValidationRecordShowsIsSoughtThere) {
    measure("0.002 * s.v * math.abs(s.v) - s.f", "valid_size=20"); // a random force is in both records
    const Json d = diagnosis("model.lua", "out");
    EXPECT_EQ(d["verdict"], "effect_found");
    EXPECT_EQ(d["effects"][0]["name"], "quadratic_drag");
    EXPECT_NE(d["where"].get<std::string>().find("records/valid.csv up to t = "), std::string::npos);
}

// Without damping and with a speed to begin with it drifts as the offset lets it, and the fitted record takes these values. A slow motion
// tells otherwise.
TEST_F(SystemDiagnosis, ValuesFarOffDoNotMakeUpForWhatIsMissing) {
    const auto motor = [](const std::string& drive) {
        return fmt::format(R"(
            local tb = require "tribode"
            return tb.system {{
                parameters = {{ K = {{ value = 0.5, unit = "m/V/s" }}, T = {{ value = 0.1, unit = "s" }},
                    o = {{ value = 0.06, unit = "V" }}, f = {{ value = 0.1, unit = "V" }},
                    w = {{ value = 0.005, unit = "m/s" }} }},
                inputs = {{ u = {{ unit = "V" }} }},
                states = {{ x = {{ start = 0, unit = "m" }}, v = {{ start = 0, unit = "m/s" }} }},
                der = function(s) return {{ x = s.v, v = (s.K * ({}) - s.v) / s.T }} end }})",
                           drive);
    };
    folder.write("motor.lua", motor("s.u"));
    folder.write("truth.lua", motor("s.u - s.o - s.f * tb.tanh(s.v / s.w)"));
    folder.write("script.lua", R"(
        local tb = require "tribode"
        local n, step = 250, 0.04
        for k, name in ipairs { "ident", "valid" } do
            local u, x = {}, {}
            for i = 1, n do
                local sine = math.sin(2 * math.pi * (k == 1 and 0.8 or 0.1) * (i - 1) * step)
                u[i] = k == 1 and math.max(-0.5, math.min(0.5, sine)) or 0.3 * sine
            end
            local run = tb.run_system { system = require "truth", duration_s = (n - 1) * step, output_step_s = step,
                inputs = { u = { sample_time_s = step, values = u } } }
            for i = 1, n do x[i] = run.values.x[i] + 1e-4 * tb.standard_normal(7, k, i) end
            tb.write_csv { file = name .. ".csv", columns = { { name = "t", unit = "s", values = run.t },
                { name = "u", values = u }, { name = "x", values = x } } }
        end)");
    ASSERT_EQ(program({"run", "script.lua", "-o", "records", "--quiet"}).exit_code, 0);
    usual = {"--free",   "K",   "--free",        "T", "--free", "x.start", "--free", "v.start",
             "--budget", "1e6", "--max-effects", "2", "--quiet"};
    const Json d = diagnosis("motor.lua", "out");
    EXPECT_EQ(d["verdict"], "effect_found");
    ASSERT_EQ(d["effects"].size(), 2);
    EXPECT_EQ(d["effects"][0]["name"], "constant_force");
    EXPECT_NEAR(d["effects"][0]["parameters"]["constant_force_a"].get<double>(), -0.06 * 0.5 / 0.1, 0.006);
    EXPECT_EQ(d["effects"][1]["name"], "coulomb_friction");
    EXPECT_NEAR(d["effects"][1]["parameters"]["coulomb_friction_a"].get<double>(), -0.1 * 0.5 / 0.1, 0.01);
    EXPECT_NE(d["where"].get<std::string>().find("far off here: records/valid.csv up to t = "), std::string::npos);
}

// A record of 1 kHz of what moves slowly: the search counts some of its samples, and the answer all of them, with the input held between
// these, which fewer samples do not tell from lines.
TEST_F(SystemDiagnosis, SamplesThatFollowFromOthersAreLeftToTheEnd) {
    const auto axis = [](const std::string& more_states, const std::string& drive, const std::string& more_rates) {
        return fmt::format(R"(
            local tb = require "tribode"
            return tb.system {{
                parameters = {{ g = 3, d = 1.5, k = 8 }}, inputs = {{ u = 0 }}, states = {{ x = 0, v = 0{} }},
                der = function(s) return {{ x = s.v, v = s.g * {} - s.d * s.v - s.k * s.x{} }} end }})",
                           more_states, drive, more_rates);
    };
    folder.write("axis.lua", axis("", "s.u", ""));
    folder.write("truth.lua", axis(", w = 0", "s.w", ", w = (s.u - s.w) / 0.02"));
    folder.write("script.lua", R"(
        local tb = require "tribode"
        local n, step = 10001, 0.001
        for k, name in ipairs { "ident", "valid" } do
            local t, u, x = {}, {}, {}
            for i = 1, n do
                t[i] = (i - 1) * step
                u[i] = math.sin(2 * math.pi * (0.3 * k + 0.1 * t[i]) * t[i]) + (t[i] % 4 < 2 and 0.4 or -0.3)
            end
            local run = tb.run_system { system = require "truth", duration_s = (n - 1) * step, output_step_s = step,
                inputs = { u = { sample_time_s = step, values = u } } }
            for i = 1, n do x[i] = run.values.x[i] + 4e-4 * tb.standard_normal(7, k, i) end
            tb.write_csv { file = name .. ".csv", columns = { { name = "t", unit = "s", values = t },
                { name = "u", values = u }, { name = "x", values = x } } }
        end)");
    ASSERT_EQ(program({"run", "script.lua", "-o", "records", "--quiet"}).exit_code, 0);
    usual = {"--free", "g",       "--free",   "d",   "--free",        "k", "--free", "x.start",
             "--free", "v.start", "--budget", "1e6", "--max-effects", "1", "--quiet"};
    const Json d = diagnosis("axis.lua", "out");
    EXPECT_EQ(d["verdict"], "effect_found");
    ASSERT_EQ(d["effects"].size(), 1);
    EXPECT_EQ(d["effects"][0]["name"], "lag");
    const double seconds = d["effects"][0]["parameters"]["lag_time"].get<double>();
    EXPECT_NEAR(seconds, 0.02, 2e-4) << "half a sample of the input is 0.5 ms";
    EXPECT_EQ(d["inputs"], "held between samples");
    EXPECT_LT(d["gap"]["validate"]["after"].get<double>(), 1.02 * d["gap"]["validate"]["floor"].get<double>());
    ASSERT_EQ(d["remarks"].size(), 1);
    EXPECT_EQ(d["remarks"][0],
              "The search counted one of 4 samples: between these nothing happens that counts beside what is missing. "
              "What it found was fitted to all.");
}

TEST_F(SystemDiagnosis, WhatCannotBeIsOneSentence) {
    measure("0");
    const std::string record = "records/ident.csv";
    folder.write("short.csv", "t,u,x\n0,1,2\n1,1,3\n");
    folder.write("still.csv", [] {
        std::string rows = "t,u,x\n";
        for (int k = 0; k < 50; ++k) rows += fmt::format("{},1,2\n", k);
        return rows;
    }());
    folder.write("no_time.csv", "u,x\n1,2\n");
    folder.write("machine.lua", "return { Ts = 0.001 }");
    for (const auto& [arguments, parts] : std::vector<std::pair<std::vector<std::string>, std::vector<std::string>>>{
             {{"--data", record}, {"one of --machine and --system"}},
             {{"--system", "model.lua", "--machine", "machine.lua", "--data", record},
              {"one of --machine and --system"}},
             {{"--system", "none.lua", "--data", record}, {"none.lua"}},
             {{"--system", "machine.lua", "--data", record}, {"machine.lua", "must return a system"}},
             {{"--system", "model.lua", "--data", "none.csv"}, {"none.csv"}},
             {{"--system", "model.lua", "--data", "short.csv"}, {"short.csv", "2 samples", "20"}},
             {{"--system", "model.lua", "--data", "still.csv"}, {"still.csv", "x does not move"}},
             {{"--system", "model.lua", "--data", "no_time.csv"}, {"no_time.csv", "no column t", "--columns t="}},
             {{"--system", "model.lua", "--data", record, "--input", "w=u"}, {"--input w", "not an input"}},
             {{"--system", "model.lua", "--data", record, "--input", "u=voltage"}, {"voltage"}},
             {{"--system", "model.lua", "--data", record, "--output", "z=x"}, {"--output z", "not an output"}},
             {{"--system", "model.lua", "--data", record, "--output", "v"}, {"records/ident.csv", "v"}},
             {{"--system", "model.lua", "--data", record, "--free", "dd"}, {"--free dd", "STATE.start"}},
             {{"--system", "model.lua", "--data", record, "--scale", "z=2"}, {"--scale z"}},
             {{"--system", "model.lua", "--data", record, "--budget", "-1"}, {"--budget"}},
             {{"--machine", "machine.lua", "--data", record, "--free", "d"}, {"--free", "--system"}},
         }) {
        std::vector<std::string> all = arguments;
        all.insert(all.end(), {"-o", "none", "--quiet"});
        SCOPED_TRACE(fmt::format("{}", fmt::join(arguments, " ")));
        expect_sentence(diagnose(all), 2, parts);
    }
    EXPECT_EQ(files_in(folder / "none"), std::vector<std::string>{});
}

} // namespace
} // namespace tribode::cli
