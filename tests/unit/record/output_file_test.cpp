#include "tribode/record/output_file.hpp"
#include "unit/script/messages.hpp"
#include "unit/script/temporary_folder.hpp"

#include <gtest/gtest.h>
#include <sys/resource.h>
#include <sys/wait.h>
#include <unistd.h>

namespace tribode {
namespace {

std::size_t files_in(const std::filesystem::path& folder) {
    return static_cast<std::size_t>(
        std::distance(std::filesystem::directory_iterator(folder), std::filesystem::directory_iterator()));
}

TEST(OutputFile, WritesAllBytesUnderTheFinalNameAndNothingElse) {
    const TemporaryFolder folder;
    const std::string bytes("a\0b\n", 4);
    write_file(folder / "deep/er/x.bin", bytes);
    EXPECT_EQ(read_file(folder / "deep/er/x.bin"), bytes);
    EXPECT_EQ(files_in(folder / "deep/er"), 1u);
    write_file(folder / "deep/er/x.bin", "new");
    EXPECT_EQ(read_file(folder / "deep/er/x.bin"), "new");
}

TEST(OutputFile, AFullDiskIsOneSentence) {
    const std::string problem = problem_of([] { write_file("/dev/full", "x"); });
    EXPECT_EQ(problem, "output: /dev/full: cannot be written (No space left on device)");
}

TEST(OutputFile, AFileThatDoesNotFitLeavesTheOldOneAndNoPart) {
    const TemporaryFolder folder;
    write_file(folder / "x.csv", "old");
    // A limit of the process, so it is set in a child.
    const pid_t child = fork();
    if (child == 0) {
        const rlimit limit{1000, 1000};
        setrlimit(RLIMIT_FSIZE, &limit);
        const std::string problem = problem_of([&] { write_file(folder / "x.csv", std::string(5000, 'y')); });
        _exit(problem.starts_with("output: ") && problem.find("File too large") != std::string::npos ? 0 : 1);
    }
    int status = 0;
    waitpid(child, &status, 0);
    EXPECT_EQ(status, 0);
    EXPECT_EQ(read_file(folder / "x.csv"), "old");
    EXPECT_EQ(files_in(folder.path()), 1u);
}

TEST(OutputFile, WhatIsNoFileIsRefused) {
    const TemporaryFolder folder;
    folder.write("file", "x");
    EXPECT_TRUE(problem_of([&] { write_file(folder.path(), "x"); }).starts_with("output: " + folder.path().string()));
    EXPECT_TRUE(problem_of([&] { write_file(folder / "file/below", "x"); }).starts_with("output: "));
    EXPECT_TRUE(
        problem_of([&] { read_file(folder / "none"); }).ends_with("cannot be read (No such file or directory)"));
    EXPECT_TRUE(problem_of([&] { read_file(folder.path()); }).starts_with("input: "));
}

} // namespace
} // namespace tribode
