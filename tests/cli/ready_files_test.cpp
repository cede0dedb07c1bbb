#include "cli/program.hpp"
#include "tribode/base/json.hpp"
#include "unit/record/browser.hpp"
#include "unit/script/temporary_folder.hpp"

#include <algorithm>
#include <cmath>
#include <gtest/gtest.h>
#include <map>
#include <set>

namespace tribode::cli {
namespace {

namespace fs = std::filesystem;

std::vector<std::string> ready_files(const std::string& folder) {
    std::vector<std::string> files;
    for (const auto& entry : fs::directory_iterator(fs::path(TRIBODE_SOURCE_DIR) / folder)) {
        if (entry.path().extension() == ".lua") files.push_back(entry.path().string());
    }
    std::sort(files.begin(), files.end());
    return files;
}

// A name that a test may have.
std::string stem_of(const ::testing::TestParamInfo<std::string>& file) { return fs::path(file.param).stem().string(); }

// ---- scripts and samples
// ---------------------------------------------------------------------------------------------

// What the header of each says it leaves.
const std::map<std::string, std::vector<std::string>> results = {
    {"fra_comparison",
     {"bode.png", "bode.svg", "error.png", "error.svg", "identified.json", "manifest.json", "responses.csv",
      "responses.h5", "signals.csv", "signals.png", "signals.svg"}},
    {"method_comparison",
     {"comparison.csv", "cost.csv", "differences.png", "differences.svg", "findings.txt", "hysteresis.png",
      "hysteresis.svg", "manifest.json", "methods.json", "trajectories.png", "trajectories.svg", "work_precision.png",
      "work_precision.svg"}},
    {"friction_identification",
     {"branches.png", "branches.svg", "elements.csv", "error.csv", "error.png", "error.svg", "friction.json",
      "held_out.csv", "held_out.png", "held_out.svg", "loop.csv", "loop.png", "loop.svg", "manifest.json"}},
    {"delay_identification",
     {"delay.json", "dispersion.csv", "dispersion.png", "dispersion.svg", "manifest.json", "pade.csv", "pade.png",
      "pade.svg", "readings.csv", "readings.png", "readings.svg"}},
    {"amplitude_family",
     {"amplitudes.png", "amplitudes.svg", "analyses.png", "analyses.svg", "manifest.json", "proposed.png",
      "proposed.svg", "responses.csv", "summary.json", "wrong_delay.csv", "wrong_delay.png", "wrong_delay.svg"}},
    {"positioning",
     {"design_deadbeat.csv",
      "design_deadbeat_hold_once.csv",
      "design_s_curve.csv",
      "design_zero_phase.csv",
      "design_zv.csv",
      "design_zvd.csv",
      "designs.json",
      "designs.png",
      "designs.svg",
      "detected.json",
      "detected.png",
      "detected.svg",
      "detected_FRA-1.csv",
      "detected_FRA-2.csv",
      "detected_Proposed.csv",
      "feedforward_gain.png",
      "feedforward_gain.svg",
      "identified.json",
      "identified.png",
      "identified.svg",
      "identified_FRA-1.csv",
      "identified_FRA-2.csv",
      "identified_Proposed.csv",
      "manifest.json",
      "paper_FRA-1.csv",
      "paper_FRA-2.csv",
      "paper_Proposed.csv",
      "positions.png",
      "positions.svg",
      "reading.png",
      "reading.svg",
      "spectrum.png",
      "spectrum.svg",
      "summary.json"}},
    {"open_question",
     {"amplitudes.csv", "amplitudes.png", "amplitudes.svg", "causes.csv", "causes.png", "causes.svg", "manifest.json",
      "open_question.json", "parameters.png", "parameters.svg", "steps.png", "steps.svg"}},
    {"open_question_ranges", {"manifest.json", "ranges.csv", "ranges.json", "ranges.png", "ranges.svg", "ranges.txt"}},
    {"friction_compensation",
     {"bode.png",
      "bode.svg",
      "delay.png",
      "delay.svg",
      "limit_cycle.csv",
      "limit_cycle.png",
      "limit_cycle.svg",
      "loop_gain.csv",
      "loop_gain_large.png",
      "loop_gain_large.svg",
      "loop_gain_small.png",
      "loop_gain_small.svg",
      "manifest.json",
      "margins.csv",
      "margins.png",
      "margins.svg",
      "responses.csv",
      "results.json",
      "time.csv",
      "time.png",
      "time.svg"}},
    {"batch_robustness",
     {"batch.h5", "manifest.json", "parameters.png", "parameters.svg", "points.csv", "positioning.png",
      "positioning.svg", "scatter.png", "scatter.svg", "sensitivity.json", "statistics.json", "tornado.png",
      "tornado.svg", "worst.png", "worst.svg", "worst_1.csv", "worst_cases.json"}},
    {"describing_function_map",
     {"batch.h5", "frequency.png", "frequency.svg", "laws.png", "laws.svg", "manifest.json", "map.csv", "map.json",
      "map.png", "map.svg", "sampled.png", "sampled.svg"}},
    {"element_count",
     {"accuracy.png", "accuracy.svg", "batch.h5", "cost.csv", "cost.png", "cost.svg", "curve.png", "curve.svg",
      "elements.csv", "elements.json", "manifest.json"}},
    {"sensitivity", {"batch.h5", "manifest.json", "tornado.png", "tornado.svg"}},
    {"systems",
     {"bouncing_ball.csv",
      "bouncing_ball.png",
      "bouncing_ball.svg",
      "dc_motor.csv",
      "dc_motor.png",
      "dc_motor.svg",
      "inverted_pendulum.csv",
      "inverted_pendulum.png",
      "inverted_pendulum.svg",
      "manifest.json",
      "paper_table.csv",
      "paper_table.png",
      "paper_table.svg",
      "robertson.csv",
      "robertson.png",
      "robertson.svg",
      "stick_slip.csv",
      "stick_slip.png",
      "stick_slip.svg",
      "summary.json",
      "tank.csv",
      "tank.png",
      "tank.svg",
      "thermostat.csv",
      "thermostat.png",
      "thermostat.svg",
      "two_guides.csv",
      "two_guides.png",
      "two_guides.svg",
      "two_mass_drive.csv",
      "two_mass_drive.png",
      "two_mass_drive.svg",
      "van_der_pol.csv",
      "van_der_pol.png",
      "van_der_pol.svg"}},
    {"bouncing_ball", {"ball.csv", "manifest.json"}},
    {"half_friction", {"manifest.json"}},
    {"my_axis", {"manifest.json"}},
    {"own_part", {"manifest.json"}},
    {"two_tanks", {"manifest.json"}},
    {"first_script", {"hysteresis.csv", "hysteresis.png", "hysteresis.svg", "manifest.json"}},
};

// Scripts that need measurements which are not part of the project; see RealData.
const std::set<std::string> needs_data = {"emps", "silverbox", "cascaded_tanks", "pendulum", "cogging", "seal"};

std::vector<std::string> scripts_without_data() {
    auto files = ready_files("scripts");
    std::erase_if(files, [](const std::string& file) { return needs_data.contains(fs::path(file).stem()); });
    return files;
}

class ReadyScript : public ::testing::TestWithParam<std::string> {};

TEST_P(ReadyScript, RunsQuicklyAndLeavesItsResults) {
    const TemporaryFolder folder;
    const auto ending = run({"run", GetParam(), "--quick", "-o", "out"}, {.folder = folder.path()});
    EXPECT_EQ(ending.exit_code, 0) << ending.err;
    auto files = files_in(folder / "out");
    // The folder of a batch keeps a manifest of its own.
    std::erase_if(files, [](const std::string& name) { return name.starts_with("batch/"); });
    const auto wanted = results.find(fs::path(GetParam()).stem().string());
    if (wanted != results.end()) {
        EXPECT_EQ(files, wanted->second);
    } else {
        EXPECT_GT(files.size(), 1u) << "there is a manifest and no result";
    }
    const auto manifest = Json::parse(text_of(folder / "out/manifest.json"));
    EXPECT_EQ(manifest.at("outcome"), "done");
    EXPECT_TRUE(manifest.at("quick"));
    EXPECT_EQ(manifest.at("files").size() + 1, files.size()) << "the manifest lists what there is";
    for (const auto& name : files) EXPECT_GT(fs::file_size(folder / "out" / name), 0u) << name;
    if (fs::exists(folder / "out/report.html") && has_browser()) {
        const auto result = visit(folder, text_of(folder / "out/report.html"), R"js(
            const painted = (c) => {
                const p = c.getContext('2d').getImageData(0, 0, c.width, c.height).data;
                return p.some((value, i) => i % 4 === 3 && value > 200);
            };
            const canvases = [...document.querySelectorAll('canvas')];
            seen.canvases = canvases.length;
            seen.empty = canvases.filter((c) => !painted(c)).length;
            seen.tables = document.querySelectorAll('table').length;
        )js");
        expect_quiet(result);
        // That on the paper has 41 panels.
        EXPECT_GE(result.seen.at("canvases"), fs::path(GetParam()).stem() == "paper" ? 41 : 1);
        EXPECT_EQ(result.seen.at("empty"), 0);
        EXPECT_GE(result.seen.at("tables"), 1);
    }
}

INSTANTIATE_TEST_SUITE_P(Scripts, ReadyScript, ::testing::ValuesIn(scripts_without_data()), stem_of);
INSTANTIATE_TEST_SUITE_P(Samples, ReadyScript, ::testing::ValuesIn(ready_files("docs/samples")), stem_of);

// ---- models
// ----------------------------------------------------------------------------------------------------------

class ReadyModel : public ::testing::TestWithParam<std::string> {};

TEST_P(ReadyModel, FollowsASmallStepOfItsReference) {
    const TemporaryFolder folder;
    // All that is needed to know is the sample time; the program tells it where the record has another.
    const auto step = [&](double sample_time) {
        std::string rows = "t,r\n";
        for (int k = 0; k * sample_time < 2; ++k) {
            char row[64];
            std::snprintf(row, sizeof row, "%.4f,0.001\n", k * sample_time);
            rows += row;
        }
        folder.write("in.csv", rows);
        return run({"simulate", "--machine", GetParam(), "--input", "in.csv", "-o", "out.csv"},
                   {.folder = folder.path()});
    };
    auto ending = step(5e-4);
    if (ending.err.find("sample time 0.001 s") != std::string::npos) ending = step(1e-3);
    ASSERT_EQ(ending.exit_code, 0) << ending.err;
    const auto text = text_of(folder / "out.csv");
    const auto last_row = text.substr(text.rfind('\n', text.size() - 2) + 1);
    double t = 0, r = 0, u = 0, y = 0;
    ASSERT_EQ(std::sscanf(last_row.c_str(), "%lf,%lf,%lf,%lf", &t, &r, &u, &y), 4) << last_row;
    // Friction without an integrator leaves 20.4 N/(kp kv) = 1.5e-5 m in the cascade; after 2 s the loops
    // with one have less.
    EXPECT_NEAR(y, 1e-3, 2e-5);
}

INSTANTIATE_TEST_SUITE_P(Models, ReadyModel, ::testing::ValuesIn(ready_files("models")), stem_of);

// ---- tests written in Lua
// --------------------------------------------------------------------------------------------

class LuaTest : public ::testing::TestWithParam<std::string> {};

TEST_P(LuaTest, Holds) {
    const TemporaryFolder folder;
    const auto ending = run({"run", GetParam(), "-o", "out"}, {.folder = folder.path()});
    EXPECT_EQ(ending.exit_code, 0) << ending.err << ending.out;
    EXPECT_EQ(ending.err, "");
}

INSTANTIATE_TEST_SUITE_P(Scripts, LuaTest, ::testing::ValuesIn(ready_files("tests/scripts")), stem_of);

// Problems of the literature; what takes long is left out.
class ProblemTest : public ::testing::TestWithParam<std::string> {};

TEST_P(ProblemTest, Holds) {
    const TemporaryFolder folder;
    const auto ending = run({"run", GetParam(), "--quick", "-o", "out"}, {.folder = folder.path()});
    EXPECT_EQ(ending.exit_code, 0) << ending.err << ending.out;
    EXPECT_EQ(ending.err, "");
}

INSTANTIATE_TEST_SUITE_P(Problems, ProblemTest, ::testing::ValuesIn(ready_files("tests/problems")), stem_of);

TEST(LuaTests, AFailedAssertionFails) {
    const TemporaryFolder folder;
    folder.write("s.lua", "assert(1 + 1 == 3, 'sums')\n");
    expect_sentence(run({"run", "s.lua", "-o", "out"}, {.folder = folder.path()}), 2, {"sums"});
}

// ---- the claim of the comparison
// --------------------------------------------------------------------------------------

// At 15 N: the proposed analysis comes to the truth, FRA-1 sees the friction as inertia, stiffness and
// damping of the plant, FRA-2 loses gain to the delay.
TEST(FraComparison, OnlyTheProposedAnalysisComesToTheTruth) {
    const TemporaryFolder folder;
    const auto script = fs::path(TRIBODE_SOURCE_DIR) / "scripts/fra_comparison.lua";
    const auto ending =
        run({"run", script.string(), "-D", "frequencies=100", "-o", "out", "--quiet"}, {.folder = folder.path()});
    ASSERT_EQ(ending.exit_code, 0) << ending.err;
    EXPECT_EQ(ending.err, "");
    const auto identified = Json::parse(text_of(folder / "out/identified.json"));
    const auto ratio = [&](const char* analysis, const char* name) {
        return identified.at(analysis).at(name).get<double>() / identified.at("truth").at(name).get<double>();
    };
    // The claim: 3 %; 8 % for the small damping of the second mode, on which few frequencies lie.
    for (const auto* name : {"k0", "k1", "f1_hz", "zeta1", "k2", "f2_hz"})
        EXPECT_NEAR(ratio("Proposed", name), 1, 0.03);
    EXPECT_NEAR(ratio("Proposed", "zeta2"), 1, 0.08);
    for (const auto* name : {"k0", "k1", "f1_hz", "zeta1", "zeta2"}) EXPECT_GT(ratio("FRA-1", name), 1) << name;
    for (const auto* name : {"k0", "k1", "k2"}) EXPECT_LT(ratio("FRA-2", name), 1) << name;
    for (const auto* name : {"zeta1", "zeta2"}) EXPECT_GT(ratio("FRA-2", name), 1) << name;
    // The description's own numbers stand beside them.
    EXPECT_EQ(identified.at("truth").at("k0"), 94.28e-3);
    for (const auto* analysis : {"FRA-1", "FRA-2", "Proposed"}) {
        EXPECT_GT(identified.at(analysis).at("standard_errors").at("k0").get<double>(), 0) << analysis;
    }
}

} // namespace
} // namespace tribode::cli
