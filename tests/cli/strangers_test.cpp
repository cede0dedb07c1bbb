// Scripts, batch folders and files of strangers: what they try, and the sentence that refuses it.
#include "cli/program.hpp"
#include "tribode/base/json.hpp"
#include "tribode/base/text.hpp"
#include "unit/script/temporary_folder.hpp"

#include <cstdlib>
#include <fmt/format.h>
#include <gtest/gtest.h>
#include <sys/resource.h>
#include <sys/stat.h>

namespace tribode::cli {
namespace {

namespace fs = std::filesystem;

class Strangers : public ::testing::Test {
  protected:
    Strangers() {
        folder.write("secret.txt", "424242\nif s.x == 31337 then end\n");
        folder.write("m.json", R"({"Ts": 0.0005, "rigid_gain_per_kg": 0.1})");
        folder.write("u.csv", "t,u\n0,0\n0.0005,1\n0.001,1\n");
    }

    Ending tribode(const std::vector<std::string>& words) const { return run(words, {.folder = folder.path()}); }
    Ending script(const std::string& text, const std::vector<std::string>& more = {}) const {
        folder.write("s.lua", "local tb = require 'tribode'\n" + text);
        std::vector<std::string> words = {"run", "s.lua", "-o", "out", "--quiet"};
        words.insert(words.end(), more.begin(), more.end());
        return tribode(words);
    }

    TemporaryFolder folder;
};

// ---- scripts -----------------------------------------------------------------------------------------------------

// The reader of equations looks into the file of a function; a name given to `load` is none.
TEST_F(Strangers, AChunkNamedLikeAFileTellsNothingOfIt) {
    for (const std::string name : {"@secret.txt", "@./secret.txt", "@/dev/zero"}) {
        const auto ending =
            script("local seen = {}\n"
                   "local f = load('local seen = ... return function(s) if type(s.x) == \"number\" then '\n"
                   "  .. 'seen[s.x] = true end return { x = -s.x } end', '" +
                   name +
                   "')\n"
                   "tb.system { name = 's', states = { x = { start = 0 } }, der = f(seen) }\n"
                   "print(seen[31337], seen[-31337])\n"
                   "print(select(2, pcall(load('error \"x\"', '" +
                   name + "'))))\n");
        EXPECT_EQ(ending.exit_code, 0) << ending.err;
        EXPECT_EQ(ending.out, "nil\tnil\n" + name.substr(1) + ":1: x\n");
    }
}

// A unit is machine code; in the sandbox it runs where the user has named it.
TEST_F(Strangers, AFunctionalMockUpUnitRunsOnlyWhereItIsNamed) {
    folder.write("lag.lua",
                 "local tb = require 'tribode'\n"
                 "return tb.system { name = 'lag', inputs = { u = 1 }, states = { x = 0 },\n"
                 "  der = function(s) return { x = s.u - s.x } end, outputs = function(s) return { y = s.x } end }\n");
    ASSERT_EQ(tribode({"export-fmu", "lag.lua", "-o", "lag.fmu", "--quiet"}).exit_code, 0);
    const std::string use = "local lag = tb.fmu { file = 'lag.fmu', period_s = 0.1 }\n"
                            "local whole = tb.system { parts = { lag = lag }, states = { z = 0 },\n"
                            "  der = function(s) return { z = s.lag.y } end }\n"
                            "local run = tb.run_system { system = whole, duration_s = 1 }\n"
                            "print(string.format('%.9f', run.final['lag.y']))\n"
                            "print(select(2, pcall(tb.linearize, { system = whole })))\n";
    const auto refused = script(use);
    EXPECT_EQ(refused.exit_code, 2);
    EXPECT_NE(refused.err.find("machine code, which runs only where it is named: tribode run --fmu lag.fmu"),
              std::string::npos)
        << refused.err;
    for (const std::vector<std::string>& allowed : {std::vector<std::string>{"--fmu", "lag.fmu"}, {"--allow-all"}}) {
        const auto ending = script(use, allowed);
        EXPECT_EQ(ending.exit_code, 0) << ending.err;
        EXPECT_TRUE(ending.out.starts_with("0.632120559\n")) << ending.out; // 1 - exp(-1)
        EXPECT_NE(ending.out.find("cannot be linearized"), std::string::npos) << ending.out;
    }
    EXPECT_EQ(script(use, {"--fmu", "secret.txt"}).exit_code, 2);
    EXPECT_EQ(script(use, {"--fmu", "missing.fmu"}).exit_code, 2);
}

TEST_F(Strangers, LinksInTheRunFolderLeadNowhere) {
    fs::create_directory(folder / "out");
    for (const char* name : {"a.png", "r.html", "r_1.png", "c.csv", "f.png", "f.plot.json"}) {
        fs::create_symlink("../secret.txt", folder / "out" / name);
    }
    fs::create_hard_link(folder / "secret.txt", folder / "out/hard.txt");
    const std::string figure = "panels = { { series = { { x = { 1, 2 }, y = { 1, 2 } } } } }";
    for (const auto& text :
         {"tb.plot { file = 'a', " + figure + " }", std::string("tb.report { file = 'r.html', title = 't' }"),
          "tb.report { file = 'q.html', title = 't', sections = { { title = 's', content = { { plot = "
          "{ file = 'f', " +
              figure + " } } } } } }",
          std::string("tb.report { file = 'q.html', title = 't', sections = { { title = 's', content = "
                      "{ { plot = 'f' } } } } }"),
          std::string("tb.write_csv { file = 'c.csv', columns = { { name = 'x', values = { 1 } } } }")}) {
        expect_sentence(script(text), 2, {"s.lua:2:", "leads out of it through a link"});
    }
    for (const char* mode : {"r", "w", "a", "r+"}) {
        expect_sentence(script(std::string("io.open('out/hard.txt', '") + mode + "')"), 2,
                        {"s.lua:2:", "is a hard link"});
    }
    expect_sentence(script("tb.read_json { file = 'hard.txt' }"), 2, {"is a hard link"});
    expect_sentence(script("tb.write_text { file = 'x\\0y', text = '' }"), 2, {"\"x\" goes on behind a zero byte"});
    EXPECT_EQ(text_of(folder / "secret.txt"), "424242\nif s.x == 31337 then end\n");
    // By a function of the engine the name gets a new file.
    EXPECT_EQ(script("tb.write_text { file = 'hard.txt', text = 'new' }").exit_code, 0);
    EXPECT_EQ(text_of(folder / "secret.txt").substr(0, 6), "424242");
}

// A manifest that the script has written itself names the file and a hash: whether the run is repeated would tell if
// it is right.
TEST_F(Strangers, ANestedManifestTellsNoHash) {
    const std::string guess = sha256(text_of(folder / "secret.txt"));
    const auto ending =
        script("local f = io.open('out/i.lua', 'w') f:write '' f:close()\n"
               "tb.run { script = 'i.lua', folder = 'p' }\n"
               "local m = tb.read_json { file = 'p/manifest.json' }\n"
               "for _, hash in ipairs { '" +
               guess +
               "', ('0'):rep(64) } do\n"
               "  m.read = { ['secret.txt'] = hash } m.given = nil m.files = nil\n"
               "  f = io.open('out/p/manifest.json', 'w')\n"
               "  f:write(('{\"outcome\":\"done\",\"version\":\"%s\",\"quick\":false,\"given\":{},\"script\":"
               "{\"file\":\"%s\",\"sha256\":\"%s\"},\"read\":{\"secret.txt\":\"%s\"},\"files\":{}}'):format(\n"
               "    tb.version, m.script.file, m.script.sha256, hash)) f:close()\n"
               "  print(tb.run { script = 'i.lua', folder = 'p' }.repeated)\n"
               "end\n");
    EXPECT_EQ(ending.exit_code, 0) << ending.err;
    EXPECT_EQ(ending.out, "true\ntrue\n");
}

TEST_F(Strangers, LimitsHoldForAllThatAScriptStarts) {
    const std::string endless = "tb.write_text { file = 'n.lua', text = 'while true do end' }\n";
    const std::string refusal = "the script ran more than 10000000 instructions";
    const auto nested =
        script(endless + "for n = 1, 1000 do print(n) pcall(tb.run, { script = 'n.lua', folder = 'n' .. n }) end\n",
               {"--max-instructions", "10000000"});
    EXPECT_EQ(nested.exit_code, 2);
    EXPECT_NE(nested.err.find(refusal), std::string::npos) << nested.err;
    EXPECT_LE(nested.out.size(), 4u) << nested.out; // it ends within a thousand instructions
    const auto machines = script(endless + "for n = 1, 1000 do print(n) pcall(tb.machine, 'n.lua') end\n",
                                 {"--max-instructions", "10000000"});
    EXPECT_NE(machines.err.find(refusal), std::string::npos) << machines.err;
    EXPECT_LE(machines.out.size(), 4u) << machines.out;
    // Memory that a nested run holds is the script's, too, and is given back at its end.
    const std::string greedy = "tb.write_text { file = 'n.lua', text = 'local s = (\"x\"):rep(12 << 20)' }\n"
                               "for n = 1, 3 do tb.run { script = 'n.lua', folder = 'n' .. n } end\n";
    EXPECT_EQ(script(greedy, {"--max-memory", "40"}).exit_code, 0);
    expect_sentence(script("local held = ('y'):rep(20 << 20)\n" + greedy + "print(#held)", {"--max-memory", "40"}), 2,
                    {"memory limit of 40 MiB"});
}

TEST_F(Strangers, TheMemoryOfExpressionsIsLimited) {
    expect_sentence(
        script("tb.system { name = 's', states = { x = { start = 0 } }, der = function(s)\n"
               "  local e = s.x for i = 1, 1e9 do pcall(function() e = e * 1.0001 + i end) end return { x = e }\n"
               "end }\n",
               {"--max-memory", "16"}),
        2, {"memory limit of 16 MiB"});
    expect_sentence(
        script("local t = {} for i = 1, 30 do t = { a = t, b = t } end tb.write_json { file = 'x.json', value = t }",
               {"--max-memory", "16"}),
        2, {"larger than the memory limit of the script"});
}

TEST_F(Strangers, TheTimeOfTheProcessorIsLimited) {
    expect_sentence(script("while true do end", {"--max-cpu", "1", "--max-instructions", "1000000000000"}), 3,
                    {"interrupted"});
}

// The sum depends on the order of its parts.
const char* const order_dependent =
    "tb.batch { count = 14, points = function(i) return { a = i } end, run = function(p)\n"
    "  local t = { alpha = 1e16, beta = 2.5, gamma = -1e16, delta = 4.25, epsilon = 5.125, zeta = 6 }\n"
    "  for i = 1, p.a do t['k' .. i] = 1 / i end\n"
    "  local sum, by_next, names = 0, 0, {}\n"
    "  for k, v in pairs(t) do sum = sum + v names[#names + 1] = #k + v end\n"
    "  for _, v in next, t do by_next = by_next + v end\n"
    "  return { sum = sum, by_next = by_next, names = names }\n"
    "end }\n";

TEST_F(Strangers, ScriptsWithPairsGiveTheSameBytesForAnyNumberOfWorkers) {
    std::string first;
    for (const char* workers : {"1", "2", "7"}) {
        const std::string out = std::string("w") + workers;
        folder.write("s.lua", std::string("local tb = require 'tribode'\n") + order_dependent);
        ASSERT_EQ(tribode({"batch", "plan", "s.lua", "-o", out, "--shards", "7"}).exit_code, 0);
        ASSERT_EQ(tribode({"batch", "run", out, "-j", workers}).exit_code, 0);
        ASSERT_EQ(tribode({"batch", "merge", out, "-o", out + ".csv"}).exit_code, 0);
        ASSERT_EQ(tribode({"run", "s.lua", "-o", out + "r", "-j", workers, "--quiet"}).exit_code, 0);
        const std::string bytes = text_of(folder / (out + ".csv")) + text_of(folder / (out + "r/batch.h5"));
        if (first.empty()) first = bytes;
        EXPECT_EQ(bytes, first) << workers;
    }
}

// ---- batch folders -----------------------------------------------------------------------------------------------

class BatchOfAStranger : public Strangers {
  protected:
    void plan(const std::vector<std::string>& more = {}) const {
        folder.write("b.lua",
                     "local tb = require 'tribode'\n"
                     "local o = tb.options { data = 'none' }\n"
                     "tb.batch { name = 'b', count = 2, points = function(i) return { a = i } end, run = function(p)\n"
                     "  local f = io.open(o.data .. (p.a == 2 and io.open(o.data .. '/2') and '/2' or ''))\n"
                     "  return { first = f and tonumber(f:read 'l') or 0 } end }\n");
        std::vector<std::string> words = {"batch", "plan", "b.lua", "-o", "b", "--shards", "1", "--quiet"};
        words.insert(words.end(), more.begin(), more.end());
        const Ending ending = tribode(words);
        ASSERT_EQ(ending.exit_code, 0) << ending.err;
    }

    // The manifest with other fields, and an identity that fits them.
    void forge(const std::function<void(Json&)>& change) const {
        Json manifest = Json::parse(text_of(folder / "b/manifest.json"));
        change(manifest);
        Json content;
        for (const char* key : {"schema", "version", "name", "seed", "points", "parameters", "units", "files",
                                "defines", "quick", "points_sha256"}) {
            content[key] = manifest[key];
        }
        manifest["identity"] = sha256(content.dump());
        folder.write("b/manifest.json", manifest.dump());
    }
};

TEST_F(BatchOfAStranger, NamesNoFileThatItsScriptMayRead) {
    plan();
    const std::string secret = (folder / "secret.txt").string();
    fs::create_symlink("../secret.txt", folder / "b/inside.txt");
    for (const std::string& name : {secret, std::string("secret.txt"), std::string("b/../secret.txt"), std::string("."),
                                    std::string("b/inside.txt")}) {
        forge([&](Json& manifest) { manifest["defines"]["data"] = name; });
        const std::vector<std::string> parts = {"the option data of the batch names \"" + name + "\"",
                                                "outside its folder", "give -D data=" + name + " again"};
        expect_sentence(tribode({"batch", "run", "b"}), 2, parts);
        expect_sentence(tribode({"batch", "resume", "b"}), 2, parts);
        expect_sentence(tribode({"batch", "shard", "b", "1"}), 2, parts);
        expect_sentence(tribode({"batch", "slurm", "b", "--dry-run"}), 2, parts);
    }
    forge([&](Json& manifest) { manifest["defines"]["data"] = "secret.txt"; });
    expect_sentence(tribode({"batch", "run", "b", "-D", "data=other.txt"}), 2,
                    {"the batch was planned with data=secret.txt; its options do not change"});
    expect_sentence(tribode({"batch", "run", "b", "-D", "more=1"}), 2, {"planned without this option"});
    EXPECT_FALSE(fs::exists(folder / "b/shards"));
    // Who gives it again, allows it.
    EXPECT_EQ(tribode({"batch", "run", "b", "-D", "data=secret.txt"}).exit_code, 0);
    EXPECT_EQ(tribode({"batch", "merge", "b", "-o", "b.csv"}).exit_code, 0);
    EXPECT_NE(text_of(folder / "b.csv").find("424242"), std::string::npos);
}

TEST_F(BatchOfAStranger, AFileOfOnesOwnNeedsNoSecondNaming) {
    folder.write("mine.txt", "7\n");
    plan({"-D", "data=mine.txt"});
    EXPECT_EQ(tribode({"batch", "run", "b"}).exit_code, 0);
    EXPECT_EQ(tribode({"batch", "merge", "b", "-o", "b.csv"}).exit_code, 0);
    EXPECT_NE(text_of(folder / "b.csv").find("1,0,1,7,"), std::string::npos) << text_of(folder / "b.csv");
    folder.write("mine.txt", "8\n");
    expect_sentence(tribode({"batch", "run", "b"}), 2, {"mine.txt: has changed since"});
}

TEST_F(BatchOfAStranger, AFolderIsNamedAgain) {
    folder.write("mine/2", "9\n");
    plan({"-D", "data=mine"});
    expect_sentence(tribode({"batch", "run", "b"}), 2, {"give -D data=mine again"});
    const auto slurm = tribode({"batch", "slurm", "b", "--dry-run", "-D", "data=mine"});
    EXPECT_NE(slurm.out.find("SLURM_ARRAY_TASK_ID)) -D 'data=mine' --quiet"), std::string::npos) << slurm.err;
    EXPECT_EQ(tribode({"batch", "run", "b", "-D", "data=mine"}).exit_code, 0);
    EXPECT_EQ(tribode({"batch", "merge", "b", "-o", "b.csv"}).exit_code, 0);
    EXPECT_NE(text_of(folder / "b.csv").find("2,0,2,9,"), std::string::npos) << text_of(folder / "b.csv");
}

TEST_F(BatchOfAStranger, KeepsNothingBusyForEver) {
    plan();
    forge([](Json& manifest) { manifest["shards"] = manifest["points"] = std::uint64_t{1} << 62; });
    expect_sentence(tribode({"batch", "status", "b"}), 2, {"has 4611686018427387904 points", "must be at most"});
    for (const char* device : {"/dev/zero", "/dev/random", "."}) {
        fs::remove_all(folder / "b");
        plan();
        forge([&](Json& manifest) { manifest["files"].push_back({{"file", device}, {"sha256", "0"}}); });
        expect_sentence(tribode({"batch", "run", "b"}), 2,
                        {std::string(device) + ": is among the files", "and is none"});
    }
    for (const char* name : {"a,b", "index", "a\nb", ""}) {
        fs::remove_all(folder / "b");
        plan();
        forge([&](Json& manifest) { manifest["parameters"][0] = name; });
        expect_sentence(tribode({"batch", "status", "b"}), 2, {"is not the manifest of a batch"});
    }
}

TEST_F(BatchOfAStranger, AFolderWithALineBreakHasNoSlurmScript) {
    fs::create_directory(folder / "x\nid #");
    plan();
    fs::rename(folder / "b", folder / "x\nid #/b");
    fs::copy_file(folder / "b.lua", folder / "x\nid #/b.lua");
    expect_sentence(tribode({"batch", "slurm", "x\nid #/b", "--dry-run"}), 2, {"x\\x0aid #", "has a line break"});
}

// ---- files -------------------------------------------------------------------------------------------------------

TEST_F(Strangers, AMessageDoesNothingToATerminal) {
    folder.write("v.csv", "t,\x1b]0;title\x07\n0,0\n");
    const auto ending = tribode({"simulate", "--machine", "m.json", "--input", "v.csv", "-o", "y.csv"});
    EXPECT_EQ(ending.exit_code, 2);
    EXPECT_EQ(ending.err.find_first_of("\x1b\x07"), std::string::npos);
    EXPECT_NE(ending.err.find("\\x1b]0;title\\x07"), std::string::npos) << ending.err;
}

TEST_F(Strangers, ADeviceHasNoEnd) {
    expect_sentence(tribode({"simulate", "--machine", "m.json", "--input", "/dev/zero", "-o", "y.csv"}), 2,
                    {"/dev/zero: cannot be read (it is no file and has no end)"});
}

// Threads of a library would wait for memory for ever.
TEST_F(Strangers, ASmallAddressSpaceHangsNothing) {
#if defined(__SANITIZE_ADDRESS__) || defined(__SANITIZE_THREAD__)
    GTEST_SKIP() << "a sanitizer needs a large address space";
#endif
    rlimit before{};
    getrlimit(RLIMIT_AS, &before);
    for (const rlim_t mebibytes : {150, 200, 400, 1000}) {
        const rlimit small{mebibytes << 20, before.rlim_max};
        setrlimit(RLIMIT_AS, &small);
        const auto ending = tribode({"simulate", "--machine", "m.json", "--input", "u.csv", "-o", "y.csv", "--quiet"});
        setrlimit(RLIMIT_AS, &before);
        EXPECT_EQ(ending.exit_code, 0) << mebibytes << " MiB: " << ending.err;
    }
}

// ---- the kernel's part -------------------------------------------------------------------------------------------

// In place of gnuplot, a program that does what it likes: as if a plot had become a command after all.
TEST_F(Strangers, WhatTheProgramStartsIsConfined) {
    const TemporaryFolder elsewhere;
    elsewhere.write("secret.txt", "424242");
    folder.write("bin/gnuplot", "#!/bin/sh\necho owned > " + (elsewhere / "owned").string() + "\ncat " +
                                    (elsewhere / "secret.txt").string() + "\necho drawn\n");
    ::chmod((folder / "bin/gnuplot").c_str(), 0755);
    const std::string path = std::getenv("PATH");
    ::setenv("PATH", ((folder / "bin").string() + ":" + path).c_str(), 1);
    const std::string plot = "tb.plot { file = 'p', panels = { { series = { { x = { 1, 2 }, y = { 1, 2 } } } } } }";
    const auto open = script(plot, {"--allow-all"});
    EXPECT_EQ(open.exit_code, 0) << open.err;
    EXPECT_EQ(text_of(folder / "out/p.png"), "424242drawn\n");
    EXPECT_TRUE(fs::remove(elsewhere / "owned"));
    const auto confined = script(plot);
    ::setenv("PATH", path.c_str(), 1);
    EXPECT_EQ(confined.exit_code, 0) << confined.err;
    if (fs::exists(elsewhere / "owned")) GTEST_SKIP() << "this kernel has no Landlock";
    EXPECT_EQ(text_of(folder / "out/p.png"), "drawn\n");
}

} // namespace
} // namespace tribode::cli
