#include "cli/program.hpp"
#include "unit/script/temporary_folder.hpp"

#include <gtest/gtest.h>
#include <nlohmann/json.hpp>

namespace tribode::cli {
namespace {

namespace fs = std::filesystem;

// What `tribode run` does with scripts that go wrong. They lie beside the run folder, out of a script's
// reach.
class Script : public ::testing::Test {
  protected:
    Script() { folder.write("secret.txt", "secret\n"); }

    Ending run_script(const std::string& text, const std::vector<std::string>& more = {}) {
        folder.write("s.lua", text);
        std::vector<std::string> arguments = {"run", "s.lua", "-o", "out"};
        arguments.insert(arguments.end(), more.begin(), more.end());
        return run(arguments, {.folder = folder.path()});
    }

    // One sentence, exit code 2; of the run only the manifest is left, which tells the same.
    void expect_refused(const std::string& text, const std::vector<std::string>& parts,
                        const std::vector<std::string>& more = {}) {
        const auto ending = run_script(text, more);
        expect_sentence(ending, 2, parts);
        ASSERT_EQ(files_in(folder / "out"), std::vector<std::string>{"manifest.json"});
        const auto manifest = nlohmann::json::parse(text_of(folder / "out/manifest.json"));
        EXPECT_EQ("tribode: " + manifest.at("outcome").get<std::string>() + "\n", ending.err);
    }

    TemporaryFolder folder;
};

TEST_F(Script, AMissingScriptIsNamedAndNoFolderMade) {
    expect_sentence(run({"run", "missing.lua"}, {.folder = folder.path()}), 2, {"missing.lua", "No such file"});
    EXPECT_FALSE(fs::exists(folder / "results"));
}

TEST_F(Script, AnErrorOfSyntaxIsToldWithItsLine) {
    expect_refused("local tb = require 'tribode'\nlocal x = = 3\n", {"s.lua:2:", "'='"});
    expect_refused("if true then\nprint(1)\n", {"s.lua:", "'end'"});
}

TEST_F(Script, AnErrorAtRunTimeIsToldWithItsLine) {
    expect_refused("local t\nlocal function read()\n  return t.x\nend\nread()\n", {"s.lua:3:", "'t'"});
    expect_refused("\nerror('too hot')\n", {"s.lua:2: too hot"});
    expect_refused("error({ code = 7 })\n", {"table"});
}

TEST_F(Script, AMisspeltKeyOfAnOptionsTableIsToldWithTheNearestOne) {
    expect_refused("local tb = require 'tribode'\n"
                   "tb.sweep { machine = tb.machine 'models/bare_mass.lua', frequncy_hz = { 10 } }\n",
                   {"s.lua:2:", "tb.sweep", "frequncy_hz", "did you mean \"frequency_hz\"?"});
}

TEST_F(Script, AMisspeltFieldOfAChangedMachineIsToldWithTheNearestOne) {
    expect_refused("local tb = require 'tribode'\n"
                   "local m = tb.machine 'models/bare_mass.lua'\n"
                   "m.frictoin = { viscous = 1 }\n"
                   "tb.simulate { machine = m, u = { 0, 1 } }\n",
                   {"s.lua:4:", "tb.simulate: machine", "frictoin", "did you mean \"friction\"?"});
}

TEST_F(Script, AMissingMachineIsNamed) {
    expect_refused("local tb = require 'tribode'\ntb.machine 'models/bare_mas.lua'\n",
                   {"s.lua:2:", "models/bare_mas.lua", "No such file"});
}

TEST_F(Script, OptionsOfTheUserAreChecked) {
    const std::string text = "local tb = require 'tribode'\n"
                             "tb.options { amplitude = 3, loud = false, list = { 1, 2 },\n"
                             "  way = { default = 'up', choices = { 'up', 'down' } } }\n";
    expect_refused(text, {"-D amplitde=3", "did you mean \"amplitude\"?"}, {"-D", "amplitde=3"});
    expect_refused(text, {"-D amplitude=three", "must be a number"}, {"-D", "amplitude=three"});
    expect_refused(text, {"-D loud=yes", "must be true or false"}, {"-D", "loud=yes"});
    expect_refused(text, {"-D list=1,b", "list of numbers"}, {"-D", "list=1,b"});
    expect_refused(text, {"way", "\"left\"", "up, down"}, {"-D", "way=left"});
    expect_refused("print(1)\n", {"-D amplitude", "takes no options"}, {"-D", "amplitude=3"});
    expect_sentence(run_script(text, {"-D", "amplitude"}), 2, {"-D amplitude", "name=value"});
}

TEST_F(Script, AnEndlessLoopEnds) {
    expect_refused("while true do end\n", {"s.lua:1:", "100000 instructions", "--max-instructions"},
                   {"--max-instructions", "100000"});
    expect_refused("while true do pcall(function() while true do end end) end\n", {"100000 instructions"},
                   {"--max-instructions", "100000"});
}

TEST_F(Script, AMemoryBombEnds) {
    expect_refused("local t = {}\nfor i = 1, 1e9 do t[i] = ('x'):rep(1000) .. i end\n", {"memory limit", "16 MiB"},
                   {"--max-memory", "16"});
    expect_refused("local s = ('x'):rep(1 << 26)\n", {"memory limit", "16 MiB"}, {"--max-memory", "16"});
}

// No count of instructions reaches into a call of Lua's library.
TEST_F(Script, ASlowPatternEndsAtTheLimitOfTheProcessor) {
    expect_sentence(run_script("print(1); (('a'):rep(1 << 14)):find(('.-'):rep(12) .. 'b')\n", {"--max-cpu", "1"}), 3,
                    {"limit of the processor's time"});
}

TEST_F(Script, NothingIsRepeatedAtOnce) {
    const auto ending =
        run_script("print(#(''):rep(1 << 62), #string.rep('', '4611686018427387904', ''), (''):rep(3, 1))\n"
                   "print(('ab'):rep(2), ('ab'):rep(2, '-'), (''):rep(0), string.rep(7, 2))\n",
                   {"--max-cpu", "5"});
    EXPECT_EQ(ending.exit_code, 0) << ending.err;
    EXPECT_EQ(ending.out, "0\t0\t11\nabab\tab-ab\t\t77\n");
}

TEST_F(Script, FilesOutsideAreNotRead) {
    fs::create_directory(folder / "out");
    fs::create_symlink(folder / "secret.txt", folder / "out/link");
    for (const std::string name : {"/etc/passwd", "secret.txt", "out/../secret.txt", "out/link"}) {
        for (const std::string reading : {"io.open('", "io.lines('", "dofile('", "loadfile('"}) {
            const auto ending = run_script("print(1)\n" + reading + name + "')\n");
            expect_sentence(ending, 2, {"s.lua:2:", "\"" + name + "\"", "outside the run folder", "--allow-all"});
        }
    }
}

TEST_F(Script, FilesOutsideAreNotWritten) {
    fs::create_directory(folder / "out");
    fs::create_directory_symlink(folder.path(), folder / "out/link");
    for (const std::string name : {"secret.txt", "new.txt", "out/../new.txt", "out/link/new.txt"}) {
        for (const std::string mode : {"w", "a", "r+"}) {
            const auto ending = run_script("io.open('" + name + "', '" + mode + "')\n");
            expect_sentence(ending, 2, {"s.lua:1:", "\"" + name + "\"", "outside the run folder"});
        }
    }
    EXPECT_EQ(text_of(folder / "secret.txt"), "secret\n");
    EXPECT_FALSE(fs::exists(folder / "new.txt"));
}

TEST_F(Script, ResultsStayInTheRunFolder) {
    fs::create_directory(folder / "out");
    fs::create_directory_symlink(folder.path(), folder / "out/link");
    for (const std::string name : {"../new.json", "/etc/../new.json", "link/new.json", "manifest.json"}) {
        const auto ending =
            run_script("local tb = require 'tribode'\ntb.write_json { file = '" + name + "', value = 1 }\n");
        expect_sentence(ending, 2, {"s.lua:2:", "\"" + name + "\""});
    }
    EXPECT_FALSE(fs::exists(folder / "new.json"));
    EXPECT_FALSE(fs::exists("/new.json"));
}

TEST_F(Script, TheSystemIsOutOfReach) {
    expect_refused("os.execute('true')\n", {"s.lua:1:", "'execute'"});
    expect_refused("io.popen('true')\n", {"s.lua:1:", "'popen'"});
    expect_refused("os.remove('secret.txt')\n", {"s.lua:1:", "'remove'"});
    EXPECT_EQ(text_of(folder / "secret.txt"), "secret\n");
}

TEST_F(Script, AllowAllLiftsTheFence) {
    const auto ending = run_script("local file = io.open('secret.txt')\n"
                                   "io.write(file:read('a'))\n"
                                   "local copy = assert(io.open('new.txt', 'w'))\n"
                                   "copy:write('written')\n"
                                   "copy:close()\n"
                                   "print(os.getenv ~= nil)\n",
                                   {"--allow-all"});
    EXPECT_EQ(ending.exit_code, 0) << ending.err;
    EXPECT_EQ(ending.out, "secret\ntrue\n");
    EXPECT_EQ(text_of(folder / "new.txt"), "written");
}

TEST_F(Script, AFileNamedByTheUserIsRead) {
    const auto ending = run_script("local tb = require 'tribode'\n"
                                   "local option = tb.options { data = '' }\n"
                                   "io.write(io.open(option.data):read('a'))\n",
                                   {"--data", "secret.txt"});
    EXPECT_EQ(ending.exit_code, 0) << ending.err;
    EXPECT_EQ(ending.out, "secret\n");
}

TEST_F(Script, TheDefaultRunFolderBearsTheNameOfTheScript) {
    folder.write("s.lua", "print('hello')\n");
    const auto ending = run({"run", "s.lua"}, {.folder = folder.path()});
    EXPECT_EQ(ending.exit_code, 0) << ending.err;
    EXPECT_EQ(ending.out, "hello\n");
    EXPECT_EQ(files_in(folder / "results"), std::vector<std::string>{"s/manifest.json"});
}

// Equations through a C compiler: the same numbers to the bit, and without a compiler too. A script cannot ask for it.
TEST_F(Script, CompiledEquationsGiveTheSameNumbers) {
    const std::string text =
        "local tb = require 'tribode'\n"
        "local s = tb.system { states = { x = 0.5, v = 0 }, discrete = { n = 0 },\n"
        "  der = function(s) return { x = s.v, v = -math.sin(3 * s.x) - 0.1 * s.v * s.v * s.x } end,\n"
        "  when = { { crossing = function(s) return s.x end, set = function(s)\n"
        "    return { n = s.n + 1, v = 0.9 * s.v } end } } }\n"
        "local run = tb.run_system { system = s, duration_s = 20 }\n"
        "tb.write_csv { file = 'run.csv', columns = run.columns }\n";
    const std::string path = ::getenv("PATH");
    ::setenv("XDG_CACHE_HOME", (folder / "cache").c_str(), 1);
    const Ending plain = run_script(text);
    const std::string wanted = text_of(folder / "out/run.csv");
    EXPECT_FALSE(fs::exists(folder / "cache"));
    const Ending compiled = run_script(text, {"--compile"});
    EXPECT_EQ(compiled.exit_code, 0);
    EXPECT_EQ(compiled.err, plain.err);
    EXPECT_EQ(text_of(folder / "out/run.csv"), wanted);
    EXPECT_EQ(files_in(folder / "cache").size(), 1u);

    fs::remove_all(folder / "cache");
    ::setenv("PATH", folder.path().c_str(), 1);
    const Ending without = run_script(text, {"--compile"});
    ::setenv("PATH", path.c_str(), 1);
    ::unsetenv("XDG_CACHE_HOME");
    EXPECT_EQ(without.exit_code, 0);
    EXPECT_NE(
        without.err.find("tribode: equations are not compiled, but evaluated as tapes: there is no C compiler cc"),
        std::string::npos)
        << without.err;
    EXPECT_EQ(text_of(folder / "out/run.csv"), wanted);
}

} // namespace
} // namespace tribode::cli
