#include "cli/program.hpp"
#include "unit/script/temporary_folder.hpp"

#include <cstdlib>
#include <fstream>
#include <gtest/gtest.h>
#include <optional>
#include <sched.h>
#include <sys/mount.h>
#include <sys/wait.h>
#include <unistd.h>

namespace tribode::cli {
namespace {

namespace fs = std::filesystem;

// Results that cannot be written: one sentence, exit code 1, and neither a result nor a part of one.
class Output : public ::testing::Test {
  protected:
    Output() {
        folder.write("mass.json", R"({"rigid_gain_per_kg": 0.1})");
        std::string rows = "t,u\n";
        for (int k = 0; k < 1000; ++k) rows += std::to_string(k * 5e-4) + ",1\n";
        folder.write("in.csv", rows);
        folder.write("s.lua", "local tb = require 'tribode'\n"
                              "tb.write_json { file = 'large.json', value = ('x'):rep(200000) }\n");
    }

    static std::vector<std::string> simulate(const std::string& output) {
        return {"simulate", "--machine", "mass.json", "--input", "in.csv", "-o", output};
    }

    TemporaryFolder folder;
};

constexpr std::size_t small_file = 10000; // bytes; the results have more, the manifest has less

TEST_F(Output, AFileAboveTheSizeLimitIsToldAndNotLeft) {
    const auto before = files_in(folder.path());
    expect_sentence(run(simulate("out.csv"), {.folder = folder.path(), .largest_file = small_file}), 1,
                    {"out.csv: cannot be written", "File too large"});
    EXPECT_EQ(files_in(folder.path()), before);
}

TEST_F(Output, AFileAboveTheSizeLimitEndsAScript) {
    expect_sentence(run({"run", "s.lua", "-o", "out"}, {.folder = folder.path(), .largest_file = small_file}), 1,
                    {"s.lua:2:", "out/large.json: cannot be written", "File too large"});
    EXPECT_EQ(files_in(folder / "out"), std::vector<std::string>{"manifest.json"});
}

TEST_F(Output, AScriptThatWritesItselfSeesTheSizeLimit) {
    folder.write("own.lua", "local file <close> = io.open('out/own.txt', 'w')\n"
                            "file:setvbuf('no')\n"
                            "local _, problem = file:write(('x'):rep(20000))\n"
                            "print(problem)\n");
    const auto ending = run({"run", "own.lua", "-o", "out"}, {.folder = folder.path(), .largest_file = small_file});
    EXPECT_EQ(ending.exit_code, 0) << ending.err;
    EXPECT_EQ(ending.out, "File too large\n");
}

TEST_F(Output, AnOldResultOutlivesAFullDisk) {
    folder.write("out.csv", "old\n");
    expect_sentence(run(simulate("out.csv"), {.folder = folder.path(), .largest_file = small_file}), 1, {"out.csv"});
    EXPECT_EQ(text_of(folder / "out.csv"), "old\n");
    EXPECT_FALSE(fs::exists(folder / "out.csv.part"));
}

TEST_F(Output, ADeviceThatIsFullIsTold) {
    expect_sentence(run(simulate("/dev/full"), {.folder = folder.path()}), 1,
                    {"/dev/full: cannot be written", "No space left on device"});
}

// What is printed waits in a buffer, so that the device is seen to be full at the end alone.
TEST_F(Output, StandardOutputThatIsFullIsTold) {
    for (const std::vector<std::string>& words :
         {std::vector<std::string>{"--version"}, {"--help"}, simulate("out.csv"), {"run", "s.lua", "-o", "out"}}) {
        folder.write("s.lua", "print 'hello'\n");
        expect_sentence(run(words, {.folder = folder.path(), .output = "/dev/full"}), 1,
                        {"standard output: cannot be written"});
    }
}

// ---- a disk of 64 KiB, in a mount namespace of its own
// --------------------------------------------------------------

bool write_line(const char* file, const std::string& text) {
    std::ofstream stream(file);
    stream << text;
    stream.close();
    return static_cast<bool>(stream);
}

bool mount_small_disk(const fs::path& folder) {
    const std::string user = std::to_string(geteuid()), group = std::to_string(getegid());
    return unshare(CLONE_NEWUSER | CLONE_NEWNS) == 0 && write_line("/proc/self/uid_map", "0 " + user + " 1") &&
           write_line("/proc/self/setgroups", "deny") && write_line("/proc/self/gid_map", "0 " + group + " 1") &&
           mount("none", "/", nullptr, MS_REC | MS_PRIVATE, nullptr) == 0 &&
           mount("tmpfs", folder.c_str(), "tmpfs", 0, "size=64k") == 0;
}

constexpr int no_small_disk = 99;

// Runs the program with disk/ below the folder on the small disk, in a child process, for only that one sees
// the disk; nothing where the system does not allow it. What stands on the disk then goes to the file
// `listing`.
std::optional<Ending> run_beside_small_disk(const std::vector<std::string>& arguments, const TemporaryFolder& folder) {
    fs::create_directory(folder / "disk");
    const pid_t child = fork();
    if (child == 0) {
        if (!mount_small_disk(folder / "disk")) _exit(no_small_disk);
        const Ending ending = run(arguments, {.folder = folder.path()});
        std::string listing;
        for (const auto& name : files_in(folder / "disk")) listing += name + "\n";
        folder.write("listing", listing);
        folder.write("err", ending.err);
        _exit(ending.exit_code);
    }
    int status = 0;
    waitpid(child, &status, 0);
    if (!WIFEXITED(status)) return Ending{};
    if (WEXITSTATUS(status) == no_small_disk) return std::nullopt;
    return Ending{WEXITSTATUS(status), 0, "", text_of(folder / "err")};
}

TEST_F(Output, AFullDiskIsToldAndKeepsNoPart) {
    folder.write("s.lua", "local tb = require 'tribode'\n"
                          "tb.write_json { file = 'small.json', value = 1 }\n"
                          "tb.write_json { file = 'large.json', value = ('x'):rep(200000) }\n");
    const auto ending = run_beside_small_disk({"run", "s.lua", "-o", "disk/out"}, folder);
    if (!ending) GTEST_SKIP() << "no small disk can be mounted here";
    expect_sentence(*ending, 1, {"s.lua:3:", "disk/out/large.json: cannot be written", "No space left on device"});
    EXPECT_EQ(text_of(folder / "listing"), "out/manifest.json\nout/small.json\n");
}

TEST_F(Output, AFullDiskLeavesNoSimulation) {
    folder.write("s.lua", "");
    std::string rows = "t,u\n";
    for (int k = 0; k < 4000; ++k) rows += std::to_string(k * 5e-4) + ",1\n";
    folder.write("in.csv", rows);
    const auto ending = run_beside_small_disk(simulate("disk/out.csv"), folder);
    if (!ending) GTEST_SKIP() << "no small disk can be mounted here";
    expect_sentence(*ending, 1, {"disk/out.csv: cannot be written", "No space left on device"});
    EXPECT_EQ(text_of(folder / "listing"), "");
}

// ---- folders
// ---------------------------------------------------------------------------------------------------------

TEST_F(Output, AReadOnlyFolderIsTold) {
    fs::create_directory(folder / "locked");
    fs::permissions(folder / "locked",
                    fs::perms::owner_read | fs::perms::owner_exec | fs::perms::others_read | fs::perms::others_exec);
    const Surroundings without_rights{.folder = folder.path(), .as_nobody = true};
    const auto simulation = run(simulate("locked/out.csv"), without_rights);
    if (simulation.exit_code == Program::cannot_start) GTEST_SKIP() << "others may not run the program here";
    expect_sentence(simulation, 1, {"locked/out.csv: cannot be written", "Permission denied"});
    expect_sentence(run({"run", "s.lua", "-o", "locked"}, without_rights), 1,
                    {"locked/large.json", "Permission denied"});
    expect_sentence(run({"run", "s.lua", "-o", "locked/out"}, without_rights), 1,
                    {"locked/out: the folder cannot be made", "Permission denied"});
    EXPECT_EQ(files_in(folder / "locked"), std::vector<std::string>{});
}

TEST_F(Output, AFileWhereAFolderMustBeIsTold) {
    folder.write("taken", "old\n");
    expect_sentence(run(simulate("taken/out.csv"), {.folder = folder.path()}), 1, {"taken/out.csv", "Not a directory"});
    expect_sentence(run({"run", "s.lua", "-o", "taken"}, {.folder = folder.path()}), 1,
                    {"taken: the folder cannot be made"});
    EXPECT_EQ(text_of(folder / "taken"), "old\n");
}

TEST_F(Output, AFolderWhereAFileMustBeIsTold) {
    fs::create_directory(folder / "out.csv");
    expect_sentence(run(simulate("out.csv"), {.folder = folder.path()}), 1, {"out.csv", "it is a folder"});
}

TEST_F(Output, MissingFoldersAreMade) {
    EXPECT_EQ(run(simulate("new/deep/out.csv"), {.folder = folder.path()}).exit_code, 0);
    EXPECT_TRUE(fs::is_regular_file(folder / "new/deep/out.csv"));
}

} // namespace
} // namespace tribode::cli
