#include "messages.hpp"
#include "script/script_access.hpp"
#include "temporary_folder.hpp"

#include <gtest/gtest.h>

namespace tribode {
namespace {

namespace fs = std::filesystem;

class ScriptAccessTest : public ::testing::Test {
  protected:
    ScriptAccessTest() {
        fs::create_directory(root / "run");
        root.write("secret.txt", "secret");
        root.write("models/table.lua", "return {}");
        root.write("data.csv", "t,u,y\n");
        access.run_folder = root / "run";
        access.read_folders = {root / "models"};
        access.named = {root / "data.csv"};
    }

    bool may_read(const fs::path& name) const {
        return problem_of([&] { access.check_read(name); }) == "none: ";
    }
    bool may_write(const fs::path& name) const {
        return problem_of([&] { access.check_write(name); }) == "none: ";
    }

    TemporaryFolder root;
    ScriptAccess access;
};

TEST_F(ScriptAccessTest, TheRunFolderMayBeReadAndWritten) {
    EXPECT_TRUE(may_read(root / "run/result.csv"));
    EXPECT_TRUE(may_write(root / "run/result.csv"));
    EXPECT_TRUE(may_write(root / "run/plots/../new/result.csv"));
}

TEST_F(ScriptAccessTest, WhatTheUserNamedMayBeReadOnly) {
    EXPECT_TRUE(may_read(root / "models/table.lua"));
    EXPECT_TRUE(may_read(root / "data.csv"));
    EXPECT_FALSE(may_write(root / "models/table.lua"));
    EXPECT_FALSE(may_write(root / "data.csv"));
}

TEST_F(ScriptAccessTest, AFolderThatTheUserNamedIsReadWithAllThatLiesInIt) {
    root.write("cases/001/nominal.json", "{}");
    EXPECT_FALSE(may_read(root / "cases/001/nominal.json"));
    access.named.push_back(root / "cases/");
    EXPECT_TRUE(may_read(root / "cases"));
    EXPECT_TRUE(may_read(root / "cases/001/nominal.json"));
    EXPECT_FALSE(may_read(root / "cases/../secret.txt"));
    EXPECT_FALSE(may_read(root / "casesbook.txt"));
    EXPECT_FALSE(may_write(root / "cases/001/nominal.json"));
    // The list of what was read holds files only: each of them has a hash.
    access.files_read = std::make_shared<std::set<fs::path>>();
    EXPECT_TRUE(may_read(root / "cases"));
    EXPECT_TRUE(may_read(root / "cases/001/nominal.json"));
    EXPECT_EQ(access.files_read->size(), 1u);
    // An option whose text is a slash opens nothing.
    access.named.push_back("/");
    EXPECT_FALSE(may_read(root / "secret.txt"));
}

TEST_F(ScriptAccessTest, AFileOutsideIsRefusedWithAdvice) {
    EXPECT_EQ(problem_of([&] { access.check_read("/etc/passwd"); }),
              "input: \"/etc/passwd\" is outside the run folder; name it with -D, --machine, --data or --input, or "
              "use --allow-all");
    EXPECT_EQ(problem_of([&] { access.check_write("/etc/passwd"); }),
              "input: \"/etc/passwd\" is outside the run folder " + access.run_folder.string() +
                  ", and a script writes only there; choose the folder with -o, or use --allow-all");
}

TEST_F(ScriptAccessTest, DotsDoNotLeadOutside) {
    EXPECT_FALSE(may_read(root / "run/../secret.txt"));
    EXPECT_FALSE(may_write(root / "run/../secret.txt"));
    EXPECT_FALSE(may_write(root / "run/missing/../../secret.txt"));
    EXPECT_FALSE(may_read(root / "models/./../secret.txt"));
}

TEST_F(ScriptAccessTest, SymbolicLinksDoNotLeadOutside) {
    fs::create_symlink(root / "secret.txt", root / "run/file_link");
    fs::create_directory_symlink(root.path(), root / "run/folder_link");
    EXPECT_FALSE(may_read(root / "run/file_link"));
    EXPECT_FALSE(may_write(root / "run/file_link"));
    EXPECT_FALSE(may_read(root / "run/folder_link/secret.txt"));
    EXPECT_FALSE(may_write(root / "run/folder_link/new.txt"));
}

// Writing through it would create its target.
TEST_F(ScriptAccessTest, ALinkWithoutTargetIsRefused) {
    fs::create_symlink(root / "not_there.txt", root / "run/link");
    EXPECT_FALSE(may_write(root / "run/link"));
    EXPECT_FALSE(may_read(root / "run/link"));
}

TEST_F(ScriptAccessTest, ALinkThatStaysInsideIsAllowed) {
    root.write("run/result.csv", "");
    fs::create_symlink(root / "run/result.csv", root / "run/latest.csv");
    EXPECT_TRUE(may_write(root / "run/latest.csv"));
}

TEST_F(ScriptAccessTest, ARunFolderBehindALinkIsTheSameFolder) {
    fs::create_directory_symlink(root / "run", root / "alias");
    access.run_folder = root / "alias/";
    EXPECT_TRUE(may_write(root / "run/result.csv"));
    EXPECT_TRUE(may_write(root / "alias/result.csv"));
}

TEST_F(ScriptAccessTest, AFolderWhoseNameBeginsAlikeIsOutside) {
    fs::create_directory(root / "run2");
    EXPECT_FALSE(may_read(root / "run2/result.csv"));
}

TEST_F(ScriptAccessTest, AZeroByteInANameIsRefused) {
    const std::string name = "/etc/passwd" + std::string(1, '\0') + "/../.." + (root / "run/x").string();
    EXPECT_EQ(problem_of([&] { access.check_read(name); }),
              "input: the file name \"/etc/passwd\" contains a zero byte");
}

TEST_F(ScriptAccessTest, NothingIsAllowedWithoutFolders) {
    access = ScriptAccess{};
    EXPECT_FALSE(may_read("x.txt"));
    EXPECT_FALSE(may_write("x.txt"));
    EXPECT_FALSE(may_read(""));
}

TEST_F(ScriptAccessTest, AllowAllAllowsAll) {
    access.allow_all = true;
    EXPECT_TRUE(may_read("/etc/passwd"));
    EXPECT_TRUE(may_write(root / "secret.txt"));
}

} // namespace
} // namespace tribode
