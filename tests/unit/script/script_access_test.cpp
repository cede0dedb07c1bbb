#include "messages.hpp"
#include "temporary_folder.hpp"
#include "tribode/record/output_file.hpp"
#include "tribode/script/lua_state.hpp"
#include "tribode/script/script_access.hpp"

#include <fstream>
#include <gtest/gtest.h>
#include <unistd.h>

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

// Another process may do so between the check and the opening.
TEST_F(ScriptAccessTest, NoLinkTakesThePlaceOfAFileThatWasChecked) {
    root.write("run/place", "own");
    const fs::path place = root / "run/place";
    const int to_read = access.open_to_read(place), to_write = access.open_to_write(place, false);
    fs::remove(place);
    fs::create_symlink(root / "secret.txt", place);
    const auto name_of = [](int file) { return "/proc/self/fd/" + std::to_string(file); };
    EXPECT_EQ(read_file(name_of(to_read)), "own");
    std::ofstream(name_of(to_write)) << "new";
    EXPECT_EQ(read_file(root / "secret.txt"), "secret");
    EXPECT_EQ(read_file(name_of(to_read)), "new");
    ::close(to_read);
    ::close(to_write);
}

TEST_F(ScriptAccessTest, FilesAreOpenedAsLuaDoes) {
    const std::string folder = (root / "run/").string();
    EXPECT_EQ(LuaState({}, access, {})
                  .run_text("local d = ...\n"
                            "local f = assert(io.open(d .. 'a', 'w')) f:write 'one' f:close()\n"
                            "f = assert(io.open(d .. 'a', 'a+b')) f:write '\\ntwo' f:seek 'set'\n"
                            "assert(f:read 'a' == 'one\\ntwo') f:close()\n"
                            "f = assert(io.open(d .. 'a', 'r+')) f:write 'O' f:close()\n"
                            "local n = 0 for _ in io.lines(d .. 'a') do n = n + 1 end\n"
                            "assert(n == 2 and io.open(d .. 'a'):read 'l' == 'One')\n"
                            "f = assert(io.open(d .. 'a', 'w+')) assert(f:read 'a' == '') f:close()\n"
                            "for _, mode in ipairs {'r', 'r+'} do\n"
                            "  local none, why, number = io.open(d .. 'b', mode)\n"
                            "  assert(none == nil and why == d .. 'b: No such file or directory' and number == 2)\n"
                            "end\n"
                            "local _, why = pcall(io.lines, d .. 'b') assert(why:find 'b: No such file', why)\n"
                            "_, why = pcall(io.open, d .. 'b', 'wx') assert(why:find 'invalid mode', why)\n"
                            "return io.open(d .. 'b') == nil",
                            "t", folder),
              Json(true));
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
    access.files_read = std::make_shared<FilesRead>();
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
