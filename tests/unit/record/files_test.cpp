#include "tribode/base/commit.hpp"
// HDF5, JSON and the run folder.
#include "tribode/base/text.hpp"
#include "tribode/record/hdf5.hpp"
#include "tribode/record/json_file.hpp"
#include "tribode/record/output_file.hpp"
#include "tribode/record/run_folder.hpp"
#include "unit/script/messages.hpp"
#include "unit/script/temporary_folder.hpp"

#include <cmath>
#include <gtest/gtest.h>

namespace tribode {
namespace {

std::vector<NamedTable> two_tables() {
    NamedTable sweep{"sweep", {}}, loop{"loop", {}};
    sweep.table.add("frequency_hz", "Hz", {10, 20, 30});
    sweep.table.add("gain", "m/N", {1e-7, 0.1, std::nan("")});
    loop.table.add("t", "s", {0, 0.5});
    return {sweep, loop};
}

TEST(Hdf5, ReadsBackWithUnitsAndTheSameDataGivesTheSameBytes) {
    const TemporaryFolder folder;
    const Json attributes{{"amplitude_N", 15.0}, {"machine", "table"}, {"count", 3}};
    write_hdf5(folder / "x.h5", two_tables(), attributes);
    EXPECT_EQ(read_file(folder / "x.h5"), to_hdf5(two_tables(), attributes));
    const auto back = read_hdf5(folder / "x.h5");
    ASSERT_EQ(back.size(), 2u);
    for (const auto& original : two_tables()) {
        const auto it = std::find_if(back.begin(), back.end(), [&](const auto& t) { return t.name == original.name; });
        ASSERT_NE(it, back.end());
        for (const auto& column : original.table.columns) {
            const Column& read = it->table[column.name];
            EXPECT_EQ(read.unit, column.unit);
            ASSERT_EQ(read.values.size(), column.values.size());
            for (std::size_t i = 0; i < read.values.size(); ++i) {
                if (std::isnan(column.values[i])) continue;
                EXPECT_EQ(read.values[i], column.values[i]);
            }
        }
    }
}

TEST(Hdf5, RefusesWhatIsNone) {
    const TemporaryFolder folder;
    const auto file = folder.write("x.h5", "this is no such file");
    EXPECT_TRUE(problem_of([&] { read_hdf5(file); }).starts_with("input: " + file.string()));
    EXPECT_TRUE(problem_of([&] { to_hdf5({{"a/b", {}}}); }).starts_with("input: "));
}

TEST(JsonFile, SaysLineAndColumn) {
    const TemporaryFolder folder;
    const auto problem = [&](std::string_view text) {
        const auto file = folder.write("x.json", text);
        const std::string message = problem_of([&] { read_json(file); });
        return message.substr(std::min(message.size(), ("input: " + file.string()).size()));
    };
    EXPECT_TRUE(problem("{\n  \"a\": 1,\n  \"b\" 2\n}\n").starts_with(":3:"))
        << problem("{\n  \"a\": 1,\n  \"b\" 2\n}\n");
    EXPECT_TRUE(problem("").starts_with(":1:1"));
    EXPECT_NE(problem("{\"a\": 1, \"a\": 2}").find("twice"), std::string::npos);
    EXPECT_NE(problem("{\"a\": 1e999}"), "");
}

TEST(JsonFile, NumbersAreShortAndReadBack) {
    const TemporaryFolder folder;
    write_json(folder / "x.json", {{"a", 0.1}, {"b", 5e-7}, {"n", std::nan("")}});
    EXPECT_EQ(read_file(folder / "x.json"), "{\n  \"a\": 0.1,\n  \"b\": 5e-07,\n  \"n\": null\n}\n");
    EXPECT_EQ(read_json(folder / "x.json")["b"], 5e-7);
}

TEST(RunFolder, KeepsToItself) {
    const TemporaryFolder folder;
    RunFolder run(folder / "run");
    std::filesystem::create_directory_symlink(folder.path(), folder / "run/link");
    for (const char* name : {"../x", "/etc/passwd", "a/../../x", "link/x", "", ".", "manifest.json"}) {
        EXPECT_TRUE(problem_of([&] { run.write(name, "x"); }).starts_with("input: ")) << name;
    }
    run.write("deep/x.csv", "t\n0\n");
    EXPECT_EQ(run.path("deep/x.csv"), folder / "run/deep/x.csv");
    folder.write("file", "x");
    EXPECT_TRUE(problem_of([&] { RunFolder(folder / "file"); }).starts_with("output: "));
}

TEST(RunFolder, TheManifestHoldsTheHashes) {
    const TemporaryFolder folder;
    RunFolder run(folder.path());
    run.write("x.csv", "old");
    run.write("x.csv", "t\n0\n");
    run.write_json("y.json", {{"a", 1}});
    run.write_manifest({{"seed", 3}});
    const Json manifest = read_json(folder / "manifest.json");
    EXPECT_EQ(manifest["seed"], 3);
    EXPECT_EQ(manifest["version"], version());
    EXPECT_EQ(manifest.value("commit", ""), commit());
    EXPECT_TRUE(commit().empty() || commit().find_first_not_of("0123456789abcdef") >= 7) << commit();
    EXPECT_EQ(manifest["files"]["x.csv"], sha256("t\n0\n"));
    EXPECT_EQ(manifest["files"].size(), 2u);
}

TEST(JsonFile, RefusesWhatIsNestedTooDeeply) {
    const TemporaryFolder folder;
    const auto nested = [&](int levels, const std::string& open, const std::string& close) {
        std::string text = "1";
        for (int i = 0; i < levels; ++i) text = open + text + close;
        const auto file = folder.write("x.json", text);
        return problem_of([&] { read_json(file); });
    };
    for (const auto& [open, close] : {std::pair{"[", "]"}, {"{\"a\":", "}"}}) {
        EXPECT_EQ(nested(64, open, close), "none: ");
        EXPECT_TRUE(nested(65, open, close).ends_with("is nested deeper than 64 levels"));
    }
    const auto deep = folder.write("deep.json", std::string(500'000, '['));
    EXPECT_TRUE(problem_of([&] { read_json(deep); }).ends_with("deep.json:1:65: is nested deeper than 64 levels"));
}

TEST(PathInside, IsOneAlsoBehindLinks) {
    const TemporaryFolder folder;
    const std::filesystem::path root = folder / "run";
    std::filesystem::create_directories(root / "real");
    std::filesystem::create_directory(folder / "elsewhere");
    std::filesystem::create_symlink("real", root / "inner");
    std::filesystem::create_symlink(folder / "elsewhere", root / "outer");
    std::filesystem::create_symlink(folder / "none", root / "nowhere");
    std::filesystem::create_symlink("new", root / "real/new-link");
    EXPECT_EQ(path_inside(root, "a/b.csv"), root / "a/b.csv");
    EXPECT_EQ(path_inside(root, "inner/x.csv"), root / "inner/x.csv");
    EXPECT_EQ(path_inside("", "x.csv"), std::filesystem::path("x.csv"));
    using namespace std::string_literals;
    for (const auto& [name, reason] :
         std::vector<std::pair<std::string, std::string>>{{"../x", "leads out of it, "},
                                                          {"a/../../x", "leads out of it, "},
                                                          {"/etc/x", "is an absolute path"},
                                                          {"", "is not a file name"},
                                                          {"a/..", "is not a file name"},
                                                          {"outer/x", "through a link"},
                                                          {"outer", "through a link"},
                                                          {"nowhere", "through a link"},
                                                          {"real/new-link", "through a link"},
                                                          {"a\0b"s, "zero byte"}}) {
        EXPECT_NE(problem_of([&] { path_inside(root, name); }).find(reason), std::string::npos) << name;
    }
}

} // namespace
} // namespace tribode
