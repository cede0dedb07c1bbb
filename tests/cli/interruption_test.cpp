#include "cli/program.hpp"
#include "tribode/base/json.hpp"
#include "tribode/base/text.hpp"
#include "unit/script/temporary_folder.hpp"

#include <algorithm>
#include <csignal>
#include <gtest/gtest.h>
#include <map>

namespace tribode::cli {
namespace {

namespace fs = std::filesystem;

// File name -> bytes, of all that a run leaves but its manifest, which has date and times in it.
std::map<std::string, std::string> results_in(const fs::path& folder) {
    std::map<std::string, std::string> results;
    for (const auto& name : files_in(folder)) {
        if (name != "manifest.json") results[name] = text_of(folder / name);
    }
    return results;
}

void expect_same_results(const fs::path& folder, const fs::path& undisturbed) {
    const auto found = results_in(folder), wanted = results_in(undisturbed);
    EXPECT_FALSE(wanted.empty());
    EXPECT_EQ(files_in(folder), files_in(undisturbed));
    for (const auto& [name, bytes] : wanted) {
        EXPECT_TRUE(found.contains(name) && found.at(name) == bytes) << name << " differs";
    }
}

class Interruption : public ::testing::Test {
  protected:
    // Long enough to be interrupted once its first frequency is done and kept.
    Interruption() {
        folder.write("s.lua", "local tb = require 'tribode'\n"
                              "local sweep = tb.sweep {\n"
                              "  machine = tb.machine 'models/linear_motor_table.lua',\n"
                              "  frequency_hz = tb.linspace(20, 180, 40),\n"
                              "}\n"
                              "tb.write_csv { file = 'sweep.csv', columns = sweep.columns }\n"
                              "tb.write_json { file = 'responses.json', value = sweep.responses }\n");
    }

    std::vector<std::string> command(const std::string& out) const { return {"run", "s.lua", "-o", out, "-j", "2"}; }

    // Sends the signal while the sweep runs and has kept something: it says so to a terminal that is stopped, and
    // waits.
    Ending interrupted(int signal) {
        Program program(command("out"), {.folder = folder.path(), .terminal_is_stopped = true});
        EXPECT_TRUE(program.wait_until([&] { return fs::exists(checkpoint); })) << program.err();
        program.send(signal);
        Ending ending = program.finish();
        ending.err.erase(0, ending.err.find("tribode: ")); // the progress
        return ending;
    }

    void expect_second_run_finishes_as_an_undisturbed_one() {
        const auto second = run(command("out"), {.folder = folder.path()});
        EXPECT_EQ(second.exit_code, 0) << second.err;
        EXPECT_FALSE(fs::exists(checkpoint));
        EXPECT_EQ(run(command("undisturbed"), {.folder = folder.path()}).exit_code, 0);
        expect_same_results(folder / "out", folder / "undisturbed");
    }

    TemporaryFolder folder;
    const fs::path checkpoint = folder / "out/sweep.resume.json";
};

TEST_F(Interruption, CtrlCInASweepKeepsWhatIsDone) {
    const auto ending = interrupted(SIGINT);
    expect_sentence(ending, 3, {"s.lua:2:", "interrupted", "of 40 frequencies", "goes on from there"});
    EXPECT_EQ(files_in(folder / "out"), (std::vector<std::string>{"manifest.json", "sweep.resume.json"}));
    expect_second_run_finishes_as_an_undisturbed_one();
}

TEST_F(Interruption, TerminationIsAsCtrlC) {
    expect_sentence(interrupted(SIGTERM), 3, {"interrupted", "of 40 frequencies"});
    EXPECT_TRUE(fs::exists(checkpoint));
}

TEST_F(Interruption, AKilledSweepGoesOnFromWhatWasKept) {
    EXPECT_EQ(interrupted(SIGKILL).signal, SIGKILL);
    EXPECT_TRUE(fs::exists(checkpoint));
    EXPECT_FALSE(fs::exists(folder / "out/sweep.csv"));
    expect_second_run_finishes_as_an_undisturbed_one();
}

// What was kept is used, not computed anew: a settling time that no run would give shows in the result.
TEST_F(Interruption, TheSecondRunTakesTheKeptFrequencies) {
    interrupted(SIGINT);
    auto kept = Json::parse(text_of(checkpoint));
    kept["points"].begin()->at("settling_time") = 123.5;
    kept["sha256"] = sha256(kept["points"].dump());
    folder.write("out/sweep.resume.json", kept.dump());
    EXPECT_EQ(run(command("out"), {.folder = folder.path()}).exit_code, 0);
    EXPECT_NE(text_of(folder / "out/sweep.csv").find(",123.5,"), std::string::npos);
}

// Any digit of a kept number, or a number that none can be.
TEST_F(Interruption, DamagedKeptFrequenciesAreRefused) {
    interrupted(SIGINT);
    const std::string good = text_of(checkpoint);
    const auto expect_refused = [&](const std::string& text) {
        folder.write("out/sweep.resume.json", text);
        expect_sentence(run(command("out"), {.folder = folder.path()}), 2,
                        {"s.lua:2:", "sweep.resume.json: is damaged; remove it, and the sweep begins anew"});
    };
    const auto digits = good.find("\"response\"");
    ASSERT_NE(digits, std::string::npos);
    for (const std::size_t from : {digits, good.size() / 2, good.size() * 3 / 4}) {
        std::string text = good;
        const auto place = text.find_first_of("12345678", from);
        ASSERT_NE(place, std::string::npos);
        ++text[place];
        expect_refused(text);
    }
    expect_refused(good.substr(0, good.size() / 2));
    for (const auto& [field, value] : {std::pair{"outcome", Json::array({99, 0.0, ""})},
                                       {"outcome", Json::array({-1, 0.0, ""})},
                                       {"counts", {{"steps", 1e300}}}}) {
        auto kept = Json::parse(good);
        kept["points"].begin()->at(field) = value;
        kept["sha256"] = sha256(kept["points"].dump());
        expect_refused(kept.dump());
    }
    fs::remove(checkpoint);
    expect_second_run_finishes_as_an_undisturbed_one();
}

TEST_F(Interruption, AnotherSweepDoesNotTakeThem) {
    interrupted(SIGINT);
    auto text = text_of(folder / "s.lua");
    text.replace(text.find("frequency_hz"), 0, "amplitude_N = 14, ");
    folder.write("s.lua", text);
    expect_second_run_finishes_as_an_undisturbed_one();
}

// A call that looks at no stop request: only the second Ctrl-C ends it.
TEST_F(Interruption, TheSecondCtrlCEndsAtOnce) {
    folder.write("s.lua", "print('begun')\nlocal a = ('a'):rep(40)\na:find(('a*'):rep(40) .. 'b')\n");
    Program program(command("out"), {.folder = folder.path()});
    ASSERT_TRUE(program.wait_until([&] { return program.out() == "begun\n"; }));
    program.send(SIGINT);
    ASSERT_TRUE(program.wait_until([&] { return !program.listens_to(SIGINT); }));
    EXPECT_FALSE(program.has_ended());
    program.send(SIGINT);
    const auto ending = program.finish();
    EXPECT_EQ(ending.signal, SIGINT);
    EXPECT_EQ(files_in(folder / "out"), std::vector<std::string>{});
}

// Where no instruction of Lua runs for seconds, either.
TEST_F(Interruption, CtrlCEndsTheReadingOfALargeTable) {
    folder.write("s.lua", "local tb = require 'tribode'\n"
                          "local list = tb.linspace(0, 1, 100000)\n"
                          "print('begun')\n"
                          "while true do pcall(tb.fit_modal, { response = list }) end\n");
    Program program(command("out"), {.folder = folder.path()});
    ASSERT_TRUE(program.wait_until([&] { return program.out() == "begun\n"; }));
    program.send(SIGINT);
    expect_sentence(program.finish(), 3, {"s.lua:4:", "interrupted"});
}

TEST_F(Interruption, ASweepOfTooManyFrequenciesIsRefused) {
    folder.write("s.lua", "local tb = require 'tribode'\n"
                          "tb.sweep { machine = tb.machine 'models/bare_mass.lua',\n"
                          "  frequency_hz = tb.linspace(1, 2, 1000001) }\n");
    expect_sentence(run(command("out"), {.folder = folder.path()}), 2,
                    {"s.lua:2:", "frequency_hz has 1000001 entries, must have 1000000 at most"});
}

TEST_F(Interruption, CtrlCEndsAnEndlessScript) {
    folder.write("s.lua", "print('begun')\nwhile true do pcall(function() while true do end end) end\n");
    Program program(command("out"), {.folder = folder.path()});
    ASSERT_TRUE(program.wait_until([&] { return program.out() == "begun\n"; }));
    program.send(SIGINT);
    expect_sentence(program.finish(), 3, {"s.lua:2:", "interrupted"});
}

TEST_F(Interruption, CtrlCEndsAnEndlessMachineFile) {
    folder.write("m.lua", "print('begun')\nwhile true do end\n");
    folder.write("in.csv", "t,u\n0,0\n0.0005,0\n");
    folder.write("s.lua", "require 'tribode'.machine 'm.lua'\n");
    for (const std::vector<std::string>& words :
         {std::vector<std::string>{"simulate", "--machine", "m.lua", "--input", "in.csv", "-o", "out.csv"},
          {"run", "s.lua", "-o", "out", "-D", "machine=m.lua"}}) {
        Program program(words, {.folder = folder.path()});
        ASSERT_TRUE(program.wait_until([&] { return program.out() == "begun\n"; })) << program.err();
        program.send(SIGINT);
        expect_sentence(program.finish(), 3, {"m.lua:2: interrupted"});
    }
}

// A step of a nanosecond: the run would take minutes. Its progress tells that it has begun.
TEST_F(Interruption, CtrlCInASimulationKeepsWhatWasReachedUnderAnotherName) {
    folder.write("mass.json", R"({"rigid_gain_per_kg": 0.1})");
    std::string rows = "t,u\n";
    for (int k = 0; k < 2000; ++k) rows += std::to_string(k * 5e-4) + ",1\n";
    folder.write("in.csv", rows);
    Program program({"simulate", "--machine", "mass.json", "--input", "in.csv", "-o", "out.csv", "--solver", "fixed",
                     "--step", "1e-9"},
                    {.folder = folder.path(), .errors_to_terminal = true});
    ASSERT_TRUE(program.wait_until([&] { return !program.err().empty(); }));
    program.send(SIGINT);
    const auto ending = program.finish();
    EXPECT_EQ(ending.exit_code, 3);
    EXPECT_NE(ending.err.find("tribode: interrupted"), std::string::npos) << ending.err;
    EXPECT_NE(ending.err.find("out.csv.partial.csv"), std::string::npos) << ending.err;
    EXPECT_EQ(files_in(folder.path()),
              (std::vector<std::string>{"in.csv", "mass.json", "out.csv.partial.csv", "s.lua"}));
}

// Tables, plots and HDF5 alike.
TEST_F(Interruption, ResultsAreTheSameBytesForAnyNumberOfWorkers) {
    const auto script = fs::path(TRIBODE_SOURCE_DIR) / "scripts/fra_comparison.lua";
    for (const std::string workers : {"1", "2", "7"}) {
        const auto ending = run({"run", script.string(), "-D", "frequencies=12", "-o", "out" + workers, "-j", workers},
                                {.folder = folder.path()});
        EXPECT_EQ(ending.exit_code, 0) << ending.err;
    }
    EXPECT_EQ(results_in(folder / "out1").size(), 10u);
    expect_same_results(folder / "out2", folder / "out1");
    expect_same_results(folder / "out7", folder / "out1");
}

} // namespace
} // namespace tribode::cli
