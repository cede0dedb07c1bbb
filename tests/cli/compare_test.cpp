#include "cli/program.hpp"
#include "problems/golden_runs.hpp"
#include "tribode/base/json.hpp"
#include "tribode/base/text.hpp"
#include "unit/script/temporary_folder.hpp"

#include <algorithm>
#include <csignal>
#include <gtest/gtest.h>
#include <sstream>

namespace tribode::cli {
namespace {

namespace fs = std::filesystem;

const std::vector<std::string> results = {"comparison.csv",   "cost.csv",           "differences.png",
                                          "differences.svg",  "findings.txt",       "hysteresis.png",
                                          "hysteresis.svg",   "manifest.json",      "trajectories.png",
                                          "trajectories.svg", "work_precision.png", "work_precision.svg"};

std::string table() { return (fs::path(TRIBODE_SOURCE_DIR) / "models/linear_motor_table.lua").string(); }

class Compare : public ::testing::Test {
  protected:
    void write_record(const std::string& header, const std::vector<std::vector<double>>& columns) {
        std::string text = header + "\n";
        for (std::size_t k = 0; k < columns.front().size(); ++k) {
            text += to_text(static_cast<double>(k) * 5e-4);
            for (const auto& column : columns) text.append(",").append(to_text(column[k]));
            text += '\n';
        }
        folder.write("in.csv", text);
    }

    Ending compare(const std::string& machine, const std::vector<std::string>& more = {"-o", "out"}) {
        std::vector<std::string> arguments = {"compare", "--machine", machine, "--input", "in.csv"};
        arguments.insert(arguments.end(), more.begin(), more.end());
        return run(arguments, {.folder = folder.path()});
    }

    TemporaryFolder folder;
    const std::vector<double> drive = problems::sampled_sine(15, 10, 5e-4, 301);
};

TEST_F(Compare, WritesTableCostFindingsPlotsAndAManifest) {
    write_record("t,u", {drive});
    const auto ending = compare(table());
    EXPECT_EQ(ending.exit_code, 0) << ending.err;
    EXPECT_EQ(ending.err, "");
    EXPECT_EQ(files_in(folder / "out"), results);
    const auto manifest = Json::parse(text_of(folder / "out/manifest.json"));
    EXPECT_EQ(manifest.at("program"), "tribode compare");
    EXPECT_EQ(manifest.at("files").size() + 1, results.size());
    EXPECT_EQ(manifest.at("input").at("sha256"), sha256(text_of(folder / "in.csv")));
    EXPECT_TRUE(text_of(folder / "out/comparison.csv").starts_with("method,tolerance,step_s,completed,"));
    EXPECT_TRUE(text_of(folder / "out/findings.txt").starts_with("Reference: exact. 301 samples"));
    // Every method in the table on standard output, with the reference in front.
    EXPECT_TRUE(ending.out.starts_with("method "));
    EXPECT_NE(ending.out.find("\nexact "), std::string::npos);
    std::istringstream lines(text_of(folder / "out/comparison.csv"));
    std::string line;
    std::getline(lines, line);
    std::size_t methods = 0;
    for (; std::getline(lines, line); ++methods) {
        const std::string name = line.substr(0, line.find(','));
        EXPECT_NE(ending.out.find(std::string("\n").append(name).append(" ")), std::string::npos) << line;
    }
    EXPECT_EQ(methods,
              1u + 3 * 4 + 4 * 7); // the reference, variable steps times tolerances, fixed steps times divisions
}

TEST_F(Compare, RunsClosedLoopAndMapsColumns) {
    // The phases are those of the second half, which has to hold a period.
    write_record("time,ref,force", {std::vector<double>(501, 0.0), problems::sampled_sine(30, 10, 5e-4, 501)});
    const auto ending = compare(table(), {"-o", "out", "--columns", "t=time,r=ref,exc=force", "--scale", "exc=0.5"});
    EXPECT_EQ(ending.exit_code, 0) << ending.err;
    EXPECT_NE(text_of(folder / "out/findings.txt").find("the position at 10 Hz"), std::string::npos);
}

// But for the processor times, which differ from run to run.
TEST_F(Compare, LeavesTheSameBytesInTwoRuns) {
    write_record("t,u", {drive});
    EXPECT_EQ(compare(table(), {"-o", "first"}).exit_code, 0);
    EXPECT_EQ(compare(table(), {"-o", "second"}).exit_code, 0);
    for (const auto& name : results) {
        if (name == "cost.csv" || name == "manifest.json" || name.starts_with("work_precision")) continue;
        EXPECT_TRUE(text_of(folder / ("first/" + name)) == text_of(folder / ("second/" + name))) << name;
    }
}

TEST_F(Compare, WithoutAFolderWritesToResultsCompare) {
    write_record("t,u", {std::vector<double>(20, 1.0)});
    EXPECT_EQ(compare(table(), {}).exit_code, 0);
    EXPECT_EQ(files_in(folder / "results/compare"), results);
}

TEST_F(Compare, TellsWhyTheReferenceIsNotExact) {
    folder.write("machine.json", R"({"rigid_gain_per_kg": 0.1, "friction":
        {"coulomb": 2, "stribeck": {"static": 3, "velocity": 0.01}}})");
    write_record("t,u", {drive});
    EXPECT_EQ(compare("machine.json").exit_code, 0);
    const auto findings = text_of(folder / "out/findings.txt");
    EXPECT_TRUE(findings.starts_with("Reference: erk at 1e-12, because the Stribeck level")) << findings;
}

TEST_F(Compare, RefusesWrongInputInOneSentenceAndMakesNoFolder) {
    write_record("t,u", {drive});
    expect_sentence(compare("missing.lua"), 2, {"missing.lua", "No such file"});
    expect_sentence(compare(table(), {"-o", "out", "--seed", "many"}), 2, {"--seed", "many"});
    expect_sentence(compare(table(), {"-o", "out", "--columsn", "t=t"}), 2,
                    {"--columsn", "did you mean \"--columns\"?"});
    expect_sentence(compare(table(), {"-o", "out", "--scale", "w=2"}), 2, {"in.csv", "no column w"});
    folder.write("machine.json", R"({"rigid_gain_per_kg": -1})");
    expect_sentence(compare("machine.json"), 2, {"machine.json", "rigid_gain_per_kg = -1"});
    folder.write("machine.json", R"({"rigid_gain_per_kg": 0.1})");
    write_record("t,r", {drive});
    expect_sentence(compare("machine.json"), 2, {"in.csv", "controller"});
    write_record("t,uu", {drive});
    expect_sentence(compare("machine.json"), 2, {"in.csv", "uu", "did you mean \"u\"?"});
    EXPECT_FALSE(fs::exists(folder / "out"));
    expect_sentence(run({"compare", "--input", "in.csv"}, {.folder = folder.path()}), 2, {"--machine"});
}

TEST_F(Compare, AnUnstableLoopEndsEarly) {
    folder.write("machine.json", R"({"rigid_gain_per_kg": 0.1, "controller": {"type": "pid", "kp": -1e9}})");
    write_record("t,r", {std::vector<double>(2000, 1e-3)});
    expect_sentence(compare("machine.json"), 3, {"the reference ended early", "diverges"});
}

// A hundred seconds through forty methods take a minute. The progress of the first ones tells that it has begun.
TEST_F(Compare, CtrlCEndsItEarly) {
    folder.write("machine.json", R"({"rigid_gain_per_kg": 0.1})");
    write_record("t,u", {std::vector<double>(200000, 1.0)});
    Program program({"compare", "--machine", "machine.json", "--input", "in.csv", "-o", "out"},
                    {.folder = folder.path(), .errors_to_terminal = true});
    ASSERT_TRUE(program.wait_until([&] { return !program.err().empty(); }));
    program.send(SIGINT);
    const auto ending = program.finish();
    EXPECT_EQ(ending.exit_code, 3);
    EXPECT_EQ(ending.out, "");
    EXPECT_NE(ending.err.find("tribode: interrupted"), std::string::npos) << ending.err;
    EXPECT_TRUE(files_in(folder / "out").empty());
}

TEST_F(Compare, HelpNamesItsOptionsAndTheVersionIsTheProgrammes) {
    const auto help = run({"compare", "--help"}, {.folder = folder.path()});
    EXPECT_EQ(help.exit_code, 0);
    for (const auto* option : {"--machine", "--input", "--out", "--columns", "--scale", "--seed", "--quiet"}) {
        EXPECT_NE(help.out.find(option), std::string::npos) << option;
    }
    EXPECT_EQ(run({"compare", "--version"}, {.folder = folder.path()}).out,
              run({"--version"}, {.folder = folder.path()}).out);
}

} // namespace
} // namespace tribode::cli
