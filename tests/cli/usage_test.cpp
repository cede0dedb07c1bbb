#include "cli/program.hpp"
#include "unit/script/temporary_folder.hpp"

#include <gtest/gtest.h>

namespace tribode::cli {
namespace {

class Usage : public ::testing::Test {
  protected:
    void expect_refused(const std::vector<std::string>& arguments, const std::vector<std::string>& parts) {
        const auto before = files_in(folder.path());
        expect_sentence(run(arguments, {.folder = folder.path()}), 2, parts);
        EXPECT_EQ(files_in(folder.path()), before);
    }

    TemporaryFolder folder;
};

TEST_F(Usage, HelpIsGivenForTheProgramAndEachCommand) {
    const auto program = run({"--help"}, {.folder = folder.path()});
    EXPECT_EQ(program.exit_code, 0);
    for (const auto* command : {"simulate", "run"}) {
        EXPECT_NE(program.out.find(command), std::string::npos);
        const auto help = run({command, "--help"}, {.folder = folder.path()});
        EXPECT_EQ(help.exit_code, 0);
        EXPECT_NE(help.out.find("--quiet"), std::string::npos);
        EXPECT_EQ(help.err, "");
    }
}

TEST_F(Usage, HelpOfSimulateNamesEveryOption) {
    const auto help = run({"simulate", "--help"}, {.folder = folder.path()}).out;
    for (const auto* option : {"--machine", "--input", "--out", "--events", "--solver", "--rtol", "--atol", "--step",
                               "--seed", "--columns", "--scale"}) {
        EXPECT_NE(help.find(option), std::string::npos) << option;
    }
}

// Limits, defaults and meanings are those of the options that Lua has, without the marks of Markdown.
TEST_F(Usage, HelpOfFlagsIsThatOfTheOptions) {
    std::string help = run({"fra", "--help"}, {.folder = folder.path()}).out;
    for (const auto* text : {"--methods", "fra1", "--fit-min", "fit_min_hz", "0.01 of the sampling rate", "--periods",
                             "--keep-transients", "whole, 0 to 20"}) {
        EXPECT_NE(help.find(text), std::string::npos) << text << "\n" << help;
    }
    EXPECT_EQ(help.find('`'), std::string::npos);
    expect_refused({"fra", "--machine", "m.lua", "--data", "d.csv", "--methods", "fra1,fra9"},
                   {"--methods", "\"fra9\"", "improved"});
    expect_refused({"fra", "--machine", "m.lua", "--data", "d.csv", "--fit", "21"}, {"--fit", "21", "0 to 20"});
    expect_refused({"fra", "--machine", "m.lua", "--data", "d.csv", "--delay", "-1"}, {"--delay", "-1"});
}

TEST_F(Usage, TheVersionIsGivenForTheProgramAndEachCommand) {
    const auto version = run({"--version"}, {.folder = folder.path()});
    EXPECT_EQ(version.exit_code, 0);
    EXPECT_TRUE(version.out.starts_with("tribode ")) << version.out;
    for (const auto* command : {"simulate", "run"}) {
        const auto same = run({command, "--version"}, {.folder = folder.path()});
        EXPECT_EQ(same.exit_code, 0);
        EXPECT_EQ(same.out, version.out);
    }
}

TEST_F(Usage, WithoutACommandTheCommandsAreNamed) { expect_refused({}, {"command is missing", "simulate", "run"}); }

TEST_F(Usage, AnUnknownCommandIsRefused) {
    expect_refused({"bogus"}, {"\"bogus\"", "simulate", "run"});
    expect_refused({"simulat", "--machine", "m.lua"}, {"\"simulat\"", "did you mean \"simulate\"?"});
}

// Also where it is the reason that a needed option is missing.
TEST_F(Usage, AMisspeltOptionIsRefusedWithTheNearestOne) {
    expect_refused({"simulate", "--machine", "m.lua", "--inptu", "i.csv", "-o", "o.csv"},
                   {"--inptu", "did you mean \"--input\"?"});
    expect_refused({"run", "s.lua", "--quik"}, {"--quik", "did you mean \"--quick\"?"});
    expect_refused({"run", "s.lua", "--max-instruction=7"},
                   {"--max-instruction ", "did you mean \"--max-instructions\"?"});
}

TEST_F(Usage, AMissingOptionIsNamed) {
    expect_refused({"simulate", "--input", "i.csv", "-o", "o.csv"}, {"--machine"});
    expect_refused({"simulate", "--machine", "m.lua", "-o", "o.csv"}, {"--input"});
    expect_refused({"simulate", "--machine", "m.lua", "--input", "i.csv"}, {"--out"});
    expect_refused({"run"}, {"script"});
}

TEST_F(Usage, OneScriptAtATime) { expect_refused({"run", "a.lua", "b.lua"}, {"\"b.lua\""}); }

TEST_F(Usage, TextWhereAnOptionNeedsANumberIsRefused) {
    for (const auto* option : {"--rtol", "--atol", "--step", "--seed"}) {
        expect_refused({"simulate", "--machine", "m.lua", "--input", "i.csv", "-o", "o.csv", option, "abc"},
                       {option, "abc"});
    }
    expect_refused({"run", "s.lua", "-j", "many"}, {"--workers", "many", "1 to 4096"});
    expect_refused({"run", "s.lua", "-j", "0"}, {"--workers", "0", "1 to 4096"});
}

// A size that wraps round, or is cut off, would be another limit than the one that was given.
TEST_F(Usage, LimitsAreNumbersThatFit) {
    for (const auto* option : {"--max-memory", "--max-instructions", "--max-cpu"}) {
        for (const auto* value : {"-1", "-5", "0", "1.5", "99999999999999999999", "17592186044416000000"}) {
            expect_refused({"run", "s.lua", option, value}, {option, value, "is not a whole number from 1 to"});
        }
    }
    expect_refused({"run", "s.lua", "--max-memory", "17592186044417"}, {"--max-memory", "from 1 to 1073741824"});
    expect_refused({"batch", "plan", "s.lua", "-o", "b", "--shard-seconds", "0"}, {"0 is not a positive number"});
}

TEST_F(Usage, AnOutputHasAName) {
    expect_refused({"simulate", "--machine", "m.lua", "--input", "i.csv", "-o", ""}, {"--out: names nothing"});
    expect_refused({"compare", "--machine", "m.lua", "--input", "i.csv", "-o", ""}, {"--out: names nothing"});
    expect_refused({"batch", "merge", "b", "-o", ""}, {"--out: names nothing"});
    expect_refused({"run", "s.lua", "-o", ""}, {"--out: names nothing"});
}

class Quiet : public ::testing::Test {
  protected:
    Quiet() {
        folder.write("s.lua", "local tb = require 'tribode'\n"
                              "tb.sweep { machine = tb.machine 'models/bare_mass.lua', frequency_hz = { 50, 60 } }\n");
        folder.write("machine.json", R"({"rigid_gain_per_kg": 0.1})");
        folder.write("in.csv", "t,u\n0,1\n0.0005,1\n0.001,1\n");
    }

    // On a terminal the progress shows at once.
    Ending on_terminal(std::vector<std::string> arguments, bool quiet) {
        if (quiet) arguments.emplace_back("--quiet");
        return run(arguments, {.folder = folder.path(), .errors_to_terminal = true});
    }

    const std::vector<std::string> simulate = {"simulate", "--machine", "machine.json", "--input",
                                               "in.csv",   "-o",        "out.csv"};
    TemporaryFolder folder;
};

TEST_F(Quiet, ProgressShowsOnATerminal) {
    EXPECT_NE(on_terminal({"run", "s.lua"}, false).err.find("2/2"), std::string::npos);
    EXPECT_NE(on_terminal(simulate, false).err.find("2/2"), std::string::npos);
}

TEST_F(Quiet, NothingStandsOnStandardError) {
    for (const auto& arguments : {std::vector<std::string>{"run", "s.lua"}, simulate}) {
        const auto ending = on_terminal(arguments, true);
        EXPECT_EQ(ending.exit_code, 0);
        EXPECT_EQ(ending.err, "");
    }
}

TEST_F(Quiet, AnErrorIsStillTold) {
    expect_sentence(run({"run", "missing.lua", "--quiet"}, {.folder = folder.path()}), 2, {"missing.lua"});
}

} // namespace
} // namespace tribode::cli
