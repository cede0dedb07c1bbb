#include "cli/program.hpp"
#include "tribode/base/json.hpp"
#include "unit/script/temporary_folder.hpp"

#include <cmath>
#include <csignal>
#include <fmt/format.h>
#include <gtest/gtest.h>
#include <numbers>

namespace tribode::cli {
namespace {

// Small cases: a machine with an effect that its description does not have, measured by `tribode simulate`.
class Diagnosis : public ::testing::Test {
  protected:
    Diagnosis() {
        reference("slow.csv", 0.012, 1.5);
        reference("fast.csv", 0.02, 1);
        folder.write("nominal.json", axis.dump());
    }

    void reference(const std::string& name, double amplitude, double frequency, int samples = 4000) {
        std::string rows = "t,r\n";
        for (int k = 0; k < samples; ++k) {
            const double t = k * 5e-4;
            rows += fmt::format("{},{}\n", t, amplitude * (1 - std::cos(2 * std::numbers::pi * frequency * t)) / 2);
        }
        folder.write(name, rows);
    }

    Ending program(const std::vector<std::string>& arguments) { return run(arguments, {.folder = folder.path()}); }

    // The two records of the axis with these effects.
    void measure(const Json& effects) {
        Json real = axis;
        real["effects"] = effects;
        folder.write("real.json", real.dump());
        for (const auto& [input, output, seed] :
             {std::tuple{"slow.csv", "ident.csv", "1"}, {"fast.csv", "valid.csv", "2"}}) {
            const auto ending = program(
                {"simulate", "--machine", "real.json", "--input", input, "--seed", seed, "-o", output, "--quiet"});
            ASSERT_EQ(ending.exit_code, 0) << ending.err;
        }
    }

    Json diagnosis(const std::string& machine, const std::string& out) {
        const auto ending = program({"diagnose", "--machine", machine, "--data", "ident.csv", "--validate", "valid.csv",
                                     "--max-effects", "1", "-o", out, "--quiet"});
        EXPECT_EQ(ending.exit_code, 0) << ending.err;
        return Json::parse(text_of(folder / (out + "/diagnosis.json")));
    }

    const Json axis = Json::parse(R"({"Ts": 0.0005, "rigid_gain_per_kg": 0.1, "friction": {"coulomb": 5, "viscous": 4},
        "input_delay_s": 0.0005, "current_loop_hz": 900, "encoder_resolution_m": 1e-7, "noise_rms_m": 1e-7,
        "controller": {"type": "pid", "kp": 40000, "ki": 500000, "kd": 800, "derivative_filter_hz": 300}})");
    TemporaryFolder folder;
};

TEST_F(Diagnosis, AMachineWithTheEffectThatWasFoundLacksNothing) {
    measure(Json::parse(R"([{"name": "quadratic_drag", "parameters": {"c": 300}}])"));
    const Json first = diagnosis("nominal.json", "out");
    ASSERT_EQ(first["verdict"], "effect_found");
    EXPECT_EQ(first["effects"][0]["name"], "quadratic_drag");
    const double error = first["effects"][0]["standard_errors"]["c"].get<double>();
    EXPECT_NEAR(first["effects"][0]["parameters"]["c"].get<double>(), 300, 3.5 * error);
    EXPECT_LT(error, 15);

    const auto page = text_of(folder / "out/report.html");
    for (const char* title : {"The gap", "Where they disagree", "The name", "Before and after",
                              "What these records cannot show", "How it was found"}) {
        EXPECT_NE(page.find(title), std::string::npos) << title;
    }
    for (const char* file : {"residual_force.png", "residual_maps.png", "residual_force.csv", "response.png",
                             "loop.png", "spectrum.png", "machine.lua"}) {
        EXPECT_TRUE(std::filesystem::exists(folder / (std::string("out/") + file))) << file;
    }

    const Json second = diagnosis("out/machine.json", "again");
    EXPECT_EQ(second["verdict"], "nothing_missing");
    EXPECT_EQ(second["gap"]["validate"]["before"], first["gap"]["validate"]["after"]);
}

TEST_F(Diagnosis, ACoarserEncoderIsReadFromItsValues) {
    measure(Json::parse(R"([{"name": "encoder_quantization", "parameters": {"resolution_m": 2e-6}}])"));
    const Json found = diagnosis("nominal.json", "out");
    ASSERT_EQ(found["verdict"], "effect_found");
    EXPECT_EQ(found["effects"][0]["name"], "encoder_quantization");
    EXPECT_NEAR(found["effects"][0]["parameters"]["resolution_m"].get<double>(), 2e-6, 1e-12);
}

TEST_F(Diagnosis, ABudgetThatEndsTheSearchBeforeItBeginsDoesNotMakeTheMachineRight) {
    measure(Json::parse(R"([{"name": "quadratic_drag", "parameters": {"c": 300}}])"));
    const auto ending = program({"diagnose", "--machine", "nominal.json", "--data", "ident.csv", "--validate",
                                 "valid.csv", "--budget", "1e-4", "-o", "out", "--quiet"});
    ASSERT_EQ(ending.exit_code, 0) << ending.err;
    const Json found = Json::parse(text_of(folder / "out/diagnosis.json"));
    EXPECT_EQ(found["out_of_time"], true);
    EXPECT_EQ(found["verdict"], "undecided");
    EXPECT_NE(text_of(folder / "out/report.html").find("ended the search before it was found; measured and simulated"),
              std::string::npos);
}

// A long record keeps the search busy; the signal comes while effects are tried.
TEST_F(Diagnosis, CtrlCSaysWhatIsKnownAndWritesNothing) {
    reference("slow.csv", 0.012, 1.5, 30000);
    measure(Json::parse(R"([{"name": "quadratic_drag", "parameters": {"c": 300}}])"));
    Program program({"diagnose", "--machine", "nominal.json", "--data", "ident.csv", "-o", "out"},
                    {.folder = folder.path(), .errors_to_terminal = true});
    ASSERT_TRUE(program.wait_until([&] { return program.err().find("screening") != std::string::npos; }));
    program.send(SIGINT);
    const auto ending = program.finish();
    EXPECT_EQ(ending.exit_code, 3);
    EXPECT_NE(ending.err.find("\ntribode: interrupted, nothing is written; so far without an effect "),
              std::string::npos)
        << ending.err;
    EXPECT_EQ(files_in(folder / "out"), std::vector<std::string>{});
}

// ---- scoring
// -----------------------------------------------------------------------------------------------------------------

// Cases as scripts/diagnosis_score.lua takes them; their answers are known, those of the truth may be wrong on purpose.
TEST_F(Diagnosis, AScoreCountsWhatIsRightAndWhatIsNot) {
    for (const auto& [name, effects, truth] :
         {std::tuple{"001", "[]", R"({"effects": [{"name": "none"}], "accept": ["none"]})"},
          {"002", R"([{"name": "encoder_quantization", "parameters": {"resolution_m": 2e-6}}])",
           R"({"effects": [{"name": "encoder_quantization", "params": {"resolution_m": 2e-6}}],
               "accept": ["encoder_quantization"]})"},
          {"003", R"([{"name": "encoder_quantization", "parameters": {"resolution_m": 2e-6}}])",
           R"({"effects": [{"name": "none"}], "accept": ["none"]})"}}) {
        measure(Json::parse(effects));
        const std::string where = std::string("cases/") + name + "/";
        folder.write(where + "nominal.json", axis.dump());
        folder.write(where + "truth.json", truth);
        for (const std::string record : {"ident", "valid"}) {
            folder.write(where + record + ".csv.gz", text_of(folder / (record + ".csv"))); // told apart by the content
        }
    }
    const auto script = (std::filesystem::path(TRIBODE_SOURCE_DIR) / "scripts/diagnosis_score.lua").string();
    const auto ending = program({"run", script, "-D", "cases=cases", "-o", "score", "--quiet"});
    ASSERT_EQ(ending.exit_code, 0) << ending.err;
    const Json score = Json::parse(text_of(folder / "score/score.json"));
    EXPECT_EQ(score["cases"], 3);
    EXPECT_EQ(score["right"]["count"], 1);
    EXPECT_EQ(score["right"]["of"], 1);
    EXPECT_EQ(score["nothing_missing"]["count"], 1); // 003 is a false alarm
    EXPECT_EQ(score["nothing_missing"]["of"], 2);
    EXPECT_EQ(score["confident_wrong"]["count"], 1);
    const auto table = text_of(folder / "score/cases.csv");
    EXPECT_NE(table.find("\n003,none,effect_found,encoder_quantization,"), std::string::npos) << table;
    // Only some of them, by name.
    const auto one = program({"run", script, "-D", "cases=cases", "-D", "only=001", "-o", "one", "--quiet"});
    ASSERT_EQ(one.exit_code, 0) << one.err;
    EXPECT_EQ(Json::parse(text_of(folder / "one/score.json"))["cases"], 1);
    expect_sentence(program({"run", script, "-D", "cases=score", "-o", "none", "--quiet"}), 2,
                    {"score", "holds no case"});
}

} // namespace
} // namespace tribode::cli
