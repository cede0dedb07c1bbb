#include "cli/program.hpp"
#include "unit/script/temporary_folder.hpp"

#include <csignal>
#include <fmt/format.h>
#include <fstream>
#include <gtest/gtest.h>
#include <random>
#include <regex>
#include <thread>

namespace tribode::cli {
namespace {

namespace fs = std::filesystem;

// Every kind of thing that is kept, points that fail, chance that belongs to the point. Where the option `hold` names a
// file that is there, a worker stands still behind some points of its shard, longer than results are gathered.
const std::string all_kinds = "local tb = require 'tribode'\n"
                              "local work = 'WORK' == 'none' and 0 or tonumber 'WORK'\n"
                              "local hold, done = tb.options { hold = '' }.hold, 0\n"
                              "local function wait()\n"
                              "  done = done + 1\n"
                              "  local begin = os.clock()\n"
                              "  repeat until os.clock() - begin > 0.01\n"
                              "  while done > 20 do\n"
                              "    local file = io.open(hold)\n"
                              "    if not file then return end\n"
                              "    file:close()\n"
                              "  end\n"
                              "end\n"
                              "tb.batch {\n"
                              "  seed = 7, count = COUNT, units = { x = 'm', square = 'm2' },\n"
                              "  points = function(i) return { x = i / 10, big = i > 5 } end,\n"
                              "  run = function(point, seed, index)\n"
                              "    if index % 50 == 3 then error('bad luck, \"again\"') end\n"
                              "    if hold ~= '' then wait() end\n"
                              "    for _ = 1, work do end\n"
                              "    local list = {}\n"
                              "    for i = 1, index % 4 do list[i] = point.x * i end\n"
                              "    return { square = point.x ^ 2, list = list, chance = math.random(),\n"
                              "             trace = { t = { 0, 1 }, y = { seed % 100, index } } }\n"
                              "  end,\n"
                              "}\n";

std::string replaced(std::string text, const std::string& word, const std::string& by) {
    return std::regex_replace(text, std::regex(word), by);
}

// The processes that a process has started.
std::vector<pid_t> children_of(pid_t parent) {
    const std::string number = std::to_string(parent);
    std::ifstream file("/proc/" + number + "/task/" + number + "/children");
    std::vector<pid_t> children;
    for (pid_t child; file >> child;) children.push_back(child);
    return children;
}

class BatchCommands : public ::testing::Test {
  protected:
    Ending tribode(std::vector<std::string> words, Surroundings surroundings = {}) const {
        surroundings.folder = folder.path();
        words.insert(words.begin(), "batch");
        return run(words, surroundings);
    }

    void expect_done(const std::vector<std::string>& words) const {
        const Ending ending = tribode(words);
        EXPECT_EQ(ending.exit_code, 0) << words.front() << ": " << ending.err;
    }

    // A script of `count` points, each with `work` turns of a loop (a million is about 5 ms), in `b` with `shards`.
    void plan(int count, const std::string& work, int shards, const std::string& out = "b",
              const std::string& hold = "") const {
        folder.write("s.lua", replaced(replaced(all_kinds, "COUNT", std::to_string(count)), "WORK", work));
        expect_done({"plan", "s.lua", "-o", out, "--shards", std::to_string(shards), "-D", "hold=" + hold});
    }

    std::string merged(const std::string& batch) const {
        expect_done({"merge", batch, "-o", batch + ".h5"});
        return text_of(folder / (batch + ".h5"));
    }

    std::unique_ptr<Program> begin(const std::vector<std::string>& words) const {
        return std::make_unique<Program>(words, Surroundings{.folder = folder.path()});
    }

    // A command on `b` that has done some of its points and does not end by itself.
    std::unique_ptr<Program> begin_and_hold(const std::vector<std::string>& words, int shards) const {
        plan(400, "none", shards, "b", "b/hold");
        folder.write("b/hold", "");
        auto program = begin(words);
        EXPECT_TRUE(program->wait_until([&] { return points_done() > 0; }));
        return program;
    }
    std::unique_ptr<Program> begin_long_run() const {
        return begin_and_hold({"batch", "run", "b", "-j", "2", "--quiet"}, 4);
    }

    int points_done() const {
        const auto ending = tribode({"status", "b", "--json"});
        const std::string key = "\"done\": ";
        return std::stoi(ending.out.substr(ending.out.find(key) + key.size()));
    }

    TemporaryFolder folder;
};

TEST_F(BatchCommands, EveryPointIsARowInTheOrderOfTheIndex) {
    folder.write("s.lua", "local tb = require 'tribode'\n"
                          "tb.batch { points = { { a = 2 }, { a = 3, name = 'text' }, { a = 5 } },\n"
                          "  run = function(p)\n"
                          "    if p.a == 3 then error('three, \"of all\"') end\n"
                          "    return { twice = 2 * p.a, list = { p.a, 1 } }\n"
                          "  end }\n");
    expect_done({"plan", "s.lua", "-o", "b", "--shards", "2"});
    EXPECT_EQ(text_of(folder / "b/points.csv"), "index,a\n1,2\n2,3\n3,5\n");
    const auto early = tribode({"merge", "b", "-o", "m.csv"});
    expect_sentence(early, 2, {"b: 3 of 3 points are missing (1-3; 2 of 2 shards)", "tribode batch resume"});
    EXPECT_FALSE(fs::exists(folder / "m.csv"));
    expect_done({"shard", "b", "2"});
    expect_sentence(tribode({"merge", "b", "-o", "m.csv"}), 2, {"b: 1 of 3 points are missing (1-1; 1 of 2 shards)"});
    expect_done({"run", "b"});
    expect_done({"merge", "b", "-o", "m.csv"});
    EXPECT_EQ(text_of(folder / "m.csv"), "index,failed,a,list_1,list_2,twice,reason\n"
                                         "1,0,2,2,1,4,\n"
                                         "2,1,3,nan,nan,nan,s.lua:4: three; 'of all'\n"
                                         "3,0,5,5,1,10,\n");
    expect_done({"merge", "b", "-o", "m.mat"});
    EXPECT_EQ(text_of(folder / "m.mat").substr(0, 6), "MATLAB");
    EXPECT_NE(tribode({"status", "b"}).out.find("3 of 3 points done, 1 failed; 2 of 2 shards complete"),
              std::string::npos);
}

TEST_F(BatchCommands, WorkersShareWhatWasCompiledAndGiveTheSameBytes) {
    folder.write("s.lua", "local tb = require 'tribode'\n"
                          "tb.batch { count = 40, points = function(i) return { k = 1 + i } end,\n"
                          "  run = function(point)\n"
                          "    local s = tb.system { parameters = { k = point.k }, states = { x = 1 },\n"
                          "      der = function(s) return { x = -s.k * s.x ^ 3 } end }\n"
                          "    return { x = tb.run_system { system = s, duration_s = 1 }.final.x }\n"
                          "  end }\n");
    ::setenv("XDG_CACHE_HOME", (folder / "cache").c_str(), 1);
    for (const std::string name : {"plain", "compiled"}) {
        expect_done({"plan", "s.lua", "-o", name, "--shards", "4"});
        expect_done(name == "plain" ? std::vector<std::string>{"run", name, "-j", "2"}
                                    : std::vector<std::string>{"run", name, "-j", "2", "--compile"});
        expect_done({"merge", name, "-o", name + ".csv"});
        EXPECT_EQ(fs::exists(folder / "cache"), name == "compiled");
    }
    ::unsetenv("XDG_CACHE_HOME");
    EXPECT_EQ(text_of(folder / "compiled.csv"), text_of(folder / "plain.csv"));
    EXPECT_EQ(files_in(folder / "cache/tribode").size(), 1u); // the number k is not in the text
}

TEST_F(BatchCommands, TheMergedBytesAreTheSameForAnyNumberOfWorkersAndShards) {
    plan(120, "1000", 1, "one");
    expect_done({"run", "one", "-j", "1"});
    const std::string wanted = merged("one");
    for (const auto& [workers, shards] : {std::pair{2, 7}, {7, 40}}) {
        const std::string name = fmt::format("b{}", shards);
        plan(120, "1000", shards, name);
        expect_done({"run", name, "-j", std::to_string(workers)});
        EXPECT_EQ(merged(name), wanted) << workers << " workers, " << shards << " shards";
    }
}

// Workers and the one that started them are killed at random moments; the same command goes on each time. A machine so
// fast that it ends the batch before the last kill gets another one.
TEST_F(BatchCommands, TwoHundredKillsChangeNoByte) {
    plan(400, "300000", 1, "undisturbed");
    expect_done({"run", "undisturbed", "-j", "2"});
    const std::string wanted = merged("undisturbed");
    std::mt19937 random(20);
    int kills = 0, parents = 0;
    for (int batch = 1; kills < 200; ++batch) {
        const std::string name = fmt::format("b{}", batch);
        plan(400, "300000", 13, name);
        for (bool complete = false; !complete;) {
            const auto program = begin({"batch", "resume", name, "-j", "2", "--quiet"});
            while (!program->has_ended() && kills < 200) {
                std::this_thread::sleep_for(std::chrono::microseconds(random() % 20000));
                const auto workers = children_of(program->number());
                const bool parent = workers.empty() || random() % 3 == 0;
                parents += parent;
                kills += ::kill(parent ? program->number() : workers[random() % workers.size()], SIGKILL) == 0;
            }
            const Ending ending = program->finish();
            complete = ending.exit_code == 0;
            ASSERT_TRUE(complete || ending.signal == SIGKILL) << ending.err;
        }
        EXPECT_EQ(merged(name), wanted) << "after " << kills << " kills";
        EXPECT_TRUE(fs::is_empty(folder / name / "parts"));
    }
    EXPECT_GT(parents, 20);
}

TEST_F(BatchCommands, CtrlCKeepsWhatIsDoneAndResumeGoesOn) {
    const auto program = begin_long_run();
    program->send(SIGINT);
    const auto ending = program->finish();
    expect_sentence(ending, 3, {"interrupted after", "of 400 points", "tribode batch resume b goes on"});
    const int kept = points_done();
    EXPECT_GT(kept, 0);
    EXPECT_LT(kept, 400);
}

TEST_F(BatchCommands, StatusAndMergeCountTheSamePointsAsMissing) {
    const auto program = begin_long_run();
    program->send(SIGINT);
    program->finish();
    const auto status = tribode({"status", "b", "--json"});
    const std::string key = "\"missing\": ";
    const int missing = std::stoi(status.out.substr(status.out.find(key) + key.size()));
    EXPECT_EQ(missing, 400 - points_done());
    EXPECT_NE(status.out.find("\"active\": 0"), std::string::npos) << status.out;
    expect_sentence(tribode({"merge", "b", "-o", "m.h5"}), 2,
                    {fmt::format("b: {} of 400 points are missing (", missing), "of 4 shards)"});
}

TEST_F(BatchCommands, AShardThatIsTerminatedEndsWith75AtAPoint) {
    const auto program = begin_and_hold({"batch", "shard", "b", "1", "--quiet"}, 1);
    program->send(SIGTERM);
    EXPECT_EQ(program->finish().exit_code, 75);
    EXPECT_GT(points_done(), 0);
    EXPECT_EQ(files_in(folder / "b/shards"), std::vector<std::string>{});
}

TEST_F(BatchCommands, TwoAtOnceOnOneFolderAreRefused) {
    const auto program = begin_long_run();
    expect_sentence(tribode({"resume", "b"}), 2, {"b: another process (" + std::to_string(program->number()) + ")"});
    EXPECT_FALSE(program->has_ended());
}

TEST_F(BatchCommands, WhatChangedAfterPlanningIsRefused) {
    folder.write("machine.lua", "return { Ts = 5e-4, rigid_gain_per_kg = require 'part' }\n");
    folder.write("part.lua", "return 3\n");
    folder.write("s.lua",
                 "local tb = require 'tribode'\n"
                 "local machine = tb.machine(tb.options { machine = '' }.machine)\n"
                 "tb.batch { points = { { a = 1 } }, run = function() return { k0 = machine.rigid_gain_per_kg }"
                 " end }\n");
    expect_done({"plan", "s.lua", "-o", "b", "-D", "machine=machine.lua"});
    for (const char* file : {"s.lua", "part.lua", "machine.lua"}) {
        const std::string before = text_of(folder / file);
        folder.write(file, before + "\n");
        for (const char* command : {"run", "resume"}) {
            expect_sentence(tribode({command, "b"}), 2, {std::string(file) + ": has changed since the batch in"});
        }
        expect_sentence(tribode({"shard", "b", "1"}), 2, {std::string(file) + ": has changed since"});
        folder.write(file, before);
    }
    fs::rename(folder / "part.lua", folder / "elsewhere.lua");
    expect_sentence(tribode({"run", "b"}), 2, {"part.lua: cannot be read"});
    fs::rename(folder / "elsewhere.lua", folder / "part.lua");
    expect_done({"run", "b"});
    for (const char* file : {"s.lua", "part.lua", "machine.lua"}) {
        const std::string before = text_of(folder / file);
        folder.write(file, before + "\n");
        expect_sentence(tribode({"merge", "b", "-o", "m.h5"}), 2, {std::string(file) + ": has changed since"});
        folder.write(file, before);
    }
    EXPECT_FALSE(fs::exists(folder / "m.h5"));
    expect_done({"merge", "b", "-o", "m.h5"});
}

TEST_F(BatchCommands, AManifestOfAnotherVersionIsRefused) {
    plan(10, "none", 2);
    expect_done({"run", "b"});
    const std::string manifest = text_of(folder / "b/manifest.json");
    folder.write("b/manifest.json", replaced(manifest, "\"schema\": 1", "\"schema\": 2"));
    for (const char* command : {"run", "status"}) {
        expect_sentence(tribode({command, "b"}), 2, {"manifest.json: is of schema 2", "knows schema 1"});
    }
    folder.write("b/manifest.json", replaced(manifest, "\"version\": \"[^\"]*\"", "\"version\": \"0.0.1\""));
    expect_sentence(tribode({"run", "b"}), 2, {"manifest.json", "version 0.0.1"});
    expect_sentence(tribode({"merge", "b", "-o", "m.h5"}), 2, {"manifest.json", "version 0.0.1"});
    // Not part of the identity, and yet not to be believed.
    folder.write("b/manifest.json", replaced(replaced(manifest, "\"shards\": 2", "\"shards\": 4611686018427387904"),
                                             "\"points\": 10,", "\"points\": 4611686018427387905,"));
    expect_sentence(tribode({"status", "b"}), 2, {"manifest.json: has", "must be at most", "1000000 shards"});
    folder.write("b/manifest.json", manifest.substr(0, manifest.size() / 2));
    expect_sentence(tribode({"run", "b"}), 2, {"manifest.json"});
    folder.write("b/manifest.json", manifest);
    expect_done({"merge", "b", "-o", "m.h5"});
}

TEST_F(BatchCommands, ResultsOfAnotherBatchAreNotMerged) {
    plan(10, "1", 2, "other");
    expect_done({"run", "other"});
    plan(10, "none", 2);
    expect_done({"run", "b"});
    fs::copy_file(folder / "other/shards/00002.rows", folder / "b/shards/00002.rows",
                  fs::copy_options::overwrite_existing);
    expect_sentence(tribode({"merge", "b", "-o", "m.h5"}), 2, {"00002.rows: belongs to another batch"});
    EXPECT_FALSE(fs::exists(folder / "m.h5"));
}

TEST_F(BatchCommands, TheMergedFileReplacesNothingOfTheBatch) {
    plan(10, "none", 2);
    expect_done({"run", "b"});
    for (const auto* file : {"b/manifest.json", "b/points.csv", "b/shards/00001.rows", "b/shards/new.csv", "s.lua"}) {
        expect_sentence(tribode({"merge", "b", "-o", file}), 2, {file, "choose another output"});
    }
    expect_done({"merge", "b", "-o", "b/merged.csv"});
    expect_done({"merge", "b", "-o", "b/merged.csv"});
}

TEST_F(BatchCommands, ADamagedResultIsNamed) {
    plan(10, "none", 2);
    expect_done({"run", "b"});
    std::string bytes = text_of(folder / "b/shards/00002.rows");
    bytes[bytes.size() - 3] ^= 1;
    folder.write("b/shards/00002.rows", bytes);
    expect_sentence(tribode({"merge", "b", "-o", "m.h5"}), 2, {"00002.rows: is damaged after 4 of 5 points"});
    const auto status = tribode({"status", "b"});
    EXPECT_NE(status.out.find("9 of 10 points done"), std::string::npos) << status.out;
    EXPECT_NE(status.out.find("00002.rows is damaged"), std::string::npos) << status.out;
    expect_done({"resume", "b"});
    EXPECT_EQ(points_done(), 10);
    expect_done({"merge", "b", "-o", "m.h5"});
}

TEST_F(BatchCommands, AFullDiskLosesNothing) {
    plan(200, "none", 2, "undisturbed");
    expect_done({"run", "undisturbed"});
    plan(200, "none", 2);
    // Enough for some points of a shard of a hundred.
    const auto ending = tribode({"run", "b", "-j", "2", "--quiet"}, {.largest_file = 10000});
    expect_sentence(ending, 1, {"b/parts/", "cannot be written", "what is done is kept"});
    expect_done({"resume", "b"});
    EXPECT_EQ(merged("b"), merged("undisturbed"));
    for (const char* output : {"full.h5", "full.csv"}) {
        expect_sentence(tribode({"merge", "b", "-o", output}, {.largest_file = 10000}), 1,
                        {output, "cannot be written"});
        EXPECT_FALSE(fs::exists(folder / output));
        EXPECT_FALSE(fs::exists(folder / (std::string(output) + ".part")));
    }
}

TEST_F(BatchCommands, AReadOnlyFolderIsSaid) {
    plan(10, "none", 2);
    fs::permissions(folder.path(), fs::perms::owner_all | fs::perms::others_read | fs::perms::others_exec);
    for (const char* command : {"run", "resume"}) {
        expect_sentence(tribode({command, "b"}, {.as_nobody = true}), 1, {"cannot be written", "Permission denied"});
    }
    expect_done({"run", "b"});
    const auto status = tribode({"status", "b"}, {.as_nobody = true});
    EXPECT_EQ(status.exit_code, 0) << status.err;
}

// What is there and cannot be read is not run once more.
TEST_F(BatchCommands, AResultThatMayNotBeReadIsSaid) {
    plan(10, "none", 2);
    expect_done({"run", "b"});
    for (const char* place : {"b/shards/00001.rows", "b/shards"}) {
        const auto before = fs::status(folder / place).permissions();
        fs::permissions(folder / place, fs::perms::none);
        for (const std::vector<std::string>& words :
             {std::vector<std::string>{"status", "b"}, {"merge", "b", "-o", "m.h5"}}) {
            expect_sentence(tribode(words, {.as_nobody = true}), 2, {place, "cannot be read (Permission denied)"});
        }
        fs::permissions(folder / place, before);
    }
}

TEST_F(BatchCommands, WhatIsNoBatchIsSaid) {
    expect_sentence(tribode({"run", "nowhere"}), 2, {"nowhere: holds no planned batch"});
    folder.write("plain.lua", "print 'hello'\n");
    expect_sentence(tribode({"plan", "plain.lua", "-o", "p"}), 2, {"plain.lua: describes no batch"});
    plan(10, "none", 2);
    expect_sentence(tribode({"plan", "s.lua", "-o", "b"}), 2, {"b: holds a planned batch already"});
    expect_sentence(tribode({"shard", "b", "3"}), 2, {"b: there is no shard 3", "1 to 2"});
    expect_sentence(tribode({"merge", "b", "-o", "m.txt"}), 2, {"m.txt: a merged batch is a .h5"});
    expect_sentence(tribode({"rnu", "b"}), 2, {"\"rnu\" is not a command of tribode batch (known: plan, run,"});
    expect_sentence(tribode({}), 2, {"tribode batch: a command is missing"});
}

TEST_F(BatchCommands, AWrongDescriptionIsRefusedWithItsField) {
    const auto expect_refused = [&](const std::string& text, const std::string& sentence) {
        folder.write("s.lua", "require 'tribode'.batch " + text + "\n");
        expect_sentence(tribode({"plan", "s.lua", "-o", "b"}), 2, {"s.lua:1: ", sentence});
        EXPECT_FALSE(fs::exists(folder / "b/manifest.json"));
    };
    expect_refused("{ points = { { a = 1 } } }", "tb.batch: run is missing, must be a function");
    expect_refused("{ points = {}, run = print }", "points is an empty list");
    expect_refused("{ run = print }",
                   "points must be a list of tables, a design such as tb.sobol gives, or a function");
    expect_refused("{ points = print, run = print }", "count must be a whole number from 1 on");
    expect_refused("{ points = { 3 }, run = print }", "point 1 must be a table of named fields");
    expect_refused("{ points = { { a = 1 } }, run = print, sed = 3 }", "sed is not known (did you mean \"seed\"?)");
    folder.write("s.lua", "require 'tribode'.batch { points = { { a = 1 }, { b = 1 } }, run = print }\n");
    expect_sentence(tribode({"plan", "s.lua", "-o", "b"}), 2, {"point 2 has the numbers (b), point 1 has (a)"});
}

TEST_F(BatchCommands, APointThatDependsOnTheOnesBeforeIsNoticed) {
    folder.write("s.lua", "local n = 0\n"
                          "require 'tribode'.batch { points = function(i) return { i = i } end, count = 9,\n"
                          "  run = function() n = n + 1; return { n = n } end }\n");
    const auto ending = tribode({"plan", "s.lua", "-o", "b"});
    EXPECT_EQ(ending.exit_code, 0);
    EXPECT_NE(ending.err.find("a point that was run twice gave two results"), std::string::npos) << ending.err;
}

TEST_F(BatchCommands, TheFolderCanMoveWithItsScript) {
    plan(10, "none", 2);
    fs::create_directory(folder / "moved");
    for (const char* name : {"s.lua", "b"}) fs::rename(folder / name, folder / "moved" / name);
    expect_done({"run", "moved/b"});
}

TEST_F(BatchCommands, ArraysOfSlurmKeepToTheLargestIndexAndToWhatIsMissing) {
    plan(2500, "none", 2500);
    expect_done({"shard", "b", "7"});
    expect_done({"shard", "b", "2042"});
    // Slurm's default, 1000 tasks in an array, where no Slurm can be asked.
    const std::string path = ::getenv("PATH");
    ::setenv("PATH", "/nonexistent", 1);
    const auto ending = tribode({"slurm", "b", "--dry-run", "--max-running", "50", "--sbatch=--partition=short"});
    ::setenv("PATH", path.c_str(), 1);
    EXPECT_EQ(ending.exit_code, 0) << ending.err;
    for (const char* line :
         {"#SBATCH --array=1-6,8-1000%50\n", "#SBATCH --array=1-1000%50\n", "#SBATCH --array=1-41,43-500%50\n",
          "#SBATCH --partition=short\n", "$((2000 + SLURM_ARRAY_TASK_ID))"}) {
        EXPECT_NE(ending.out.find(line), std::string::npos) << line << " is not in " << ending.out;
    }
    EXPECT_FALSE(fs::exists(folder / "b/slurm"));
}

TEST_F(BatchCommands, AScriptRunAsAWholeHandsTheMergedBatchToFinish) {
    folder.write("s.lua", "local tb = require 'tribode'\n"
                          "tb.batch { points = { { a = 2 }, { a = 3 }, { a = 5 } }, seed = 1,\n"
                          "  run = function(p, seed) assert(p.a ~= 3); return { twice = 2 * p.a, seed = seed } end,\n"
                          "  finish = function(b)\n"
                          "    assert(b.count == 3 and b.index[3] == 3 and b.parameters.a[3] == 5)\n"
                          "    assert(b.results.twice[3] == 10 and b.results.twice[2] ~= b.results.twice[2])\n"
                          "    assert(b.results.seed[3] == b.seeds[3] and b.failures[1].index == 2)\n"
                          "    tb.write_json { file = 'sum.json', value = b.results.twice[1] + b.results.twice[3] }\n"
                          "  end }\n");
    const auto ending = run({"run", "s.lua", "-o", "r"}, {.folder = folder.path()});
    EXPECT_EQ(ending.exit_code, 0) << ending.err;
    EXPECT_EQ(text_of(folder / "r/sum.json"), "14.0\n");
    EXPECT_TRUE(fs::exists(folder / "r/batch.h5"));
}

// Its points would be of two files. The one that reads it is none of those that are timed when the batch is planned.
TEST_F(BatchCommands, AScriptRunAsAWholeRefusesANamedFileThatHasChanged) {
    folder.write("s.lua", "local tb = require 'tribode'\n"
                          "local file = tb.options { data = '' }.data\n"
                          "tb.batch { count = 1000, points = function(i) return { a = i } end, run = function(p)\n"
                          "    if p.a < 1000 then return { g = 0 } end\n"
                          "    local f = io.open(file) local g = f:read 'n' f:close() return { g = g }\n"
                          "  end, finish = function(b) print(b.results.g[1000]) end }\n");
    folder.write("data.txt", "1");
    const std::vector<std::string> command = {"run", "s.lua", "-o", "r", "-D", "data=data.txt", "--quiet"};
    EXPECT_EQ(run(command, {.folder = folder.path()}).out, "1.0\n");
    folder.write("data.txt", "5");
    expect_sentence(run(command, {.folder = folder.path()}), 2, {"data.txt: has changed since the batch"});
}

} // namespace
} // namespace tribode::cli
