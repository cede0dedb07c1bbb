#include "cli/program.hpp"
#include "unit/script/temporary_folder.hpp"

#include <csignal>
#include <gtest/gtest.h>
#include <nlohmann/json.hpp>

namespace tribode::cli {
namespace {

namespace fs = std::filesystem;

// A script that runs others, which lie beside the run folder: --allow-all lets it name them.
class NestedRun : public ::testing::Test {
  protected:
    Ending outer(const std::string& text, const std::vector<std::string>& more = {}) {
        folder.write("outer.lua", "local tb = require 'tribode'\n" + text);
        std::vector<std::string> words = {"run", "outer.lua", "-o", "out", "--allow-all"};
        words.insert(words.end(), more.begin(), more.end());
        return run(words, {.folder = folder.path()});
    }

    nlohmann::json json_of(const std::string& file) { return nlohmann::json::parse(text_of(folder / file)); }

    TemporaryFolder folder;
};

TEST_F(NestedRun, HasItsOptionsItsFolderAndItsManifest) {
    folder.write("inner.lua",
                 "local tb = require 'tribode'\n"
                 "local o = tb.options { x = 1, name = 'a', yes = false, list = { 1, 2 }, rest = 7 }\n"
                 "o.quick = tb.quick\n"
                 "tb.write_json { file = 'o.json', value = o }\n"
                 "tb.plot { file = 'p', panels = { { series = { { x = { 1, 2, 3 }, y = { 1, 0/0, 2 } } } } } }\n");
    const auto ending = outer("local r = tb.run { script = 'inner.lua', folder = 'a/b', quick = true,\n"
                              "  options = { x = 0.1, name = 'b,c', yes = true, list = { 3, 4.5 } } }\n"
                              "assert(r.folder == 'out/a/b' and r.repeated == true)\n"
                              "local o = tb.read_json { file = r.folder .. '/o.json' }\n"
                              "assert(o.x == 0.1 and o.name == 'b,c' and o.yes and o.list[2] == 4.5 and o.rest == 7)\n"
                              "assert(o.quick and not tb.quick)\n"
                              // The plot that the inner run kept, with its break.
                              "tb.report { file = 'r.html', title = 't',\n"
                              "  sections = { { title = 's', content = { { plot = 'a/b/p' } } } } }\n");
    ASSERT_EQ(ending.exit_code, 0) << ending.err;
    EXPECT_EQ(files_in(folder / "out"),
              (std::vector<std::string>{"a/b/manifest.json", "a/b/o.json", "a/b/p.plot.json", "a/b/p.png", "a/b/p.svg",
                                        "manifest.json", "r.html"}));
    const auto manifest = json_of("out/manifest.json");
    EXPECT_EQ(manifest.at("files").size(), 6u) << "all but itself";
    EXPECT_EQ(manifest.at("work")[0].at("script"), "inner.lua");
    EXPECT_EQ(json_of("out/a/b/manifest.json").at("given").at("list"), "3,4.5");
    EXPECT_NE(text_of(folder / "out/r.html").find("href=\"./a/b/p.png\""), std::string::npos);
}

// The inner script counts its runs in a file that only --allow-all lets it reach.
constexpr const char* counting = "local tb = require 'tribode'\n"
                                 "tb.options { x = 1 }\n"
                                 "local file = io.open('count', 'a') file:write('x') file:close()\n"
                                 "tb.write_json { file = 'done.json', value = { 1 } }\n";

TEST_F(NestedRun, IsNotRepeatedAfterAnInterruption) {
    folder.write("inner.lua", counting);
    const std::string first = "tb.run { script = 'inner.lua', folder = 'inner' }\n";
    const auto runs = [&] { return text_of(folder / "count").size(); };
    EXPECT_EQ(outer(first + "error('stopped')\n").exit_code, 2);
    EXPECT_EQ(runs(), 1u);
    // The outer script may change: it is the inner run that is kept.
    ASSERT_EQ(outer(first + "error('stopped again')\n").exit_code, 2);
    EXPECT_EQ(runs(), 1u);
    // Other options, another result file, another script: run again.
    outer("tb.run { script = 'inner.lua', folder = 'inner', options = { x = 2 } } error('x')\n");
    EXPECT_EQ(runs(), 2u);
    folder.write("out/inner/done.json", "[2]");
    outer("tb.run { script = 'inner.lua', folder = 'inner', options = { x = 2 } } error('x')\n");
    EXPECT_EQ(runs(), 3u);
    folder.write("inner.lua", std::string(counting) + "-- changed\n");
    outer("tb.run { script = 'inner.lua', folder = 'inner', options = { x = 2 } } error('x')\n");
    EXPECT_EQ(runs(), 4u);
    // Then the whole comes to its end, and from there the same command begins anew.
    const std::string same = "tb.run { script = 'inner.lua', folder = 'inner', options = { x = 2 } }\n";
    EXPECT_EQ(outer(same).exit_code, 0);
    EXPECT_EQ(runs(), 4u);
    EXPECT_EQ(outer(same).exit_code, 0);
    EXPECT_EQ(runs(), 5u);
}

// Whatever way the files were read, the results follow what they hold now.
TEST_F(NestedRun, IsRepeatedAfterAFileItReadHasChanged) {
    folder.write("module.lua", "return 1\n");
    folder.write("deeper.lua",
                 "local tb = require 'tribode'\n"
                 "local f = io.open(tb.options { file = '' }.file) print('deeper', f:read 'a') f:close()\n");
    struct Way {
        std::string text, before = "1", after = "22"; // of the file
    };
    const std::vector<Way> ways = {{"local f = io.open(file) print(f:read 'a') f:close()"},
                                   {"for line in io.lines(file) do print(line) end"},
                                   {"print(dofile(file))", "return 1", "return 22"},
                                   {"print(loadfile(file)())", "return 1", "return 22"},
                                   {"print(require 'module')"},
                                   {"print(tb.read_json { file = file }[1])", "[1]", "[22]"},
                                   {"tb.run { script = 'deeper.lua', folder = 'deeper', options = { file = file } }"},
                                   {"print(#tb.list_folder { folder = file:match '(.*)/' })"}};
    for (const auto& [way, before, after] : ways) {
        folder.write("inner.lua", "local tb = require 'tribode'\n"
                                  "local file = tb.options { file = '' }.file\n" +
                                      way + "\n");
        folder.write("outer.lua", "local tb = require 'tribode'\n"
                                  "local o = tb.options { file = '', inner = '', more = '', folder = '' }\n"
                                  "local r = tb.run { script = o.inner, folder = 'in', options = { file = o.file } }\n"
                                  "print('repeated', r.repeated) error('stopped')\n");
        for (const bool all : {false, true}) {
            fs::remove_all(folder / "out");
            fs::remove_all(folder / "data");
            folder.write("data/d.txt", before);
            folder.write("module.lua", "return 1");
            std::vector<std::string> words = {"run", "outer.lua",       "-o", "out",
                                              "-D",  "file=data/d.txt", "-D", "inner=inner.lua",
                                              "-D",  "more=deeper.lua", "-D", "folder=data"};
            if (all) words.push_back("--allow-all");
            const auto out = [&] { return run(words, {.folder = folder.path()}).out; };
            const std::string first = out();
            EXPECT_TRUE(first.ends_with("repeated\ttrue\n")) << way << first;
            EXPECT_EQ(out(), "repeated\tfalse\n") << way;
            folder.write("data/d.txt", after);
            folder.write("data/e.txt", "");
            folder.write("module.lua", "return 22");
            const std::string second = out();
            EXPECT_TRUE(second.ends_with("repeated\ttrue\n")) << way << second;
            EXPECT_NE(first, second) << way;
        }
    }
}

TEST_F(NestedRun, GoesOnWhereItWasInterrupted) {
    folder.write("inner.lua", "local tb = require 'tribode'\n"
                              "local sweep = tb.sweep {\n"
                              "  machine = tb.machine 'models/linear_motor_table.lua',\n"
                              "  frequency_hz = tb.linspace(20, 180, 40),\n"
                              "}\n"
                              "tb.write_csv { file = 'sweep.csv', columns = sweep.columns }\n");
    folder.write("outer.lua", "local tb = require 'tribode'\n"
                              "tb.run { script = 'inner.lua', folder = 'inner' }\n");
    const auto checkpoint = folder / "out/inner/sweep.resume.json";
    const std::vector<std::string> command = {"run", "outer.lua", "-o", "out", "--allow-all", "-j", "2"};
    {
        // It waits at its first progress, as the terminal is stopped.
        Program program(command, {.folder = folder.path(), .terminal_is_stopped = true});
        EXPECT_TRUE(program.wait_until([&] { return fs::exists(checkpoint); })) << program.err();
        program.send(SIGINT);
        Ending ending = program.finish();
        ending.err.erase(0, ending.err.find("tribode: "));
        expect_sentence(ending, 3, {"inner.lua:2:", "interrupted", "of 40 frequencies"});
    }
    EXPECT_TRUE(fs::exists(checkpoint));
    EXPECT_NE(json_of("out/inner/manifest.json").at("outcome"), "done");
    const auto second = run(command, {.folder = folder.path()});
    EXPECT_EQ(second.exit_code, 0) << second.err;
    EXPECT_FALSE(fs::exists(checkpoint));
    EXPECT_EQ(run({"run", "inner.lua", "-o", "alone"}, {.folder = folder.path()}).exit_code, 0);
    EXPECT_EQ(text_of(folder / "out/inner/sweep.csv"), text_of(folder / "alone/sweep.csv"));
}

TEST_F(NestedRun, HasNoMoreRightsThanTheScriptThatStartsIt) {
    folder.write("secret.json", "[1]");
    folder.write("inner.lua", "return 1\n");
    const auto shut_in = [&](const std::string& text, const std::vector<std::string>& more = {}) {
        folder.write("outer.lua", "local tb = require 'tribode'\n" + text);
        std::vector<std::string> words = {"run", "outer.lua", "-o", "out", "--quick"};
        words.insert(words.end(), more.begin(), more.end());
        return run(words, {.folder = folder.path()});
    };
    expect_sentence(shut_in("tb.run { script = 'inner.lua', folder = 'x' }"), 2,
                    {"outer.lua:2:", "\"inner.lua\" is outside the run folder"});
    // A script it has written itself is its own, but may not read what it may not.
    expect_sentence(
        shut_in("local f = io.open('out/i.lua', 'w')\n"
                "f:write(\"local tb = require 'tribode' tb.options { identified = '' }\"\n"
                "  .. \" tb.read_json { file = 'secret.json' }\") f:close()\n"
                "tb.run { script = 'out/i.lua', folder = 'x', options = { identified = 'secret.json' } }\n"),
        2, {"\"secret.json\" is outside the run folder"});
    for (const char* elsewhere : {"../x", ".", "/tmp/x"}) {
        expect_sentence(
            shut_in(std::string("tb.run { script = 'scripts/fra_comparison.lua', folder = '") + elsewhere + "' }\n"), 2,
            {"run folder"});
    }
    expect_sentence(shut_in("tb.report { file = 'r.html', title = 't',\n"
                            "  sections = { { title = 's', content = { { plot = '../secret' } } } } }\n"),
                    2, {"must lie beside the page"});
}

TEST_F(NestedRun, SaysWhatIsWrong) {
    folder.write("inner.lua", "local tb = require 'tribode'\ntb.options { x = 1 }\n");
    expect_sentence(outer("tb.run { script = 'inner.lua', folder = 'a', options = { y = 2 } }"), 2,
                    {"outer.lua:2:", "inner.lua:2:", "has no option \"y\""});
    expect_sentence(outer("tb.run { script = 'inner.lua', folder = 'a', options = { x = { y = 2 } } }"), 2,
                    {"outer.lua:2:", "options.x must be a number, a text, a boolean or a list of numbers"});
    expect_sentence(outer("tb.run { script = 'nowhere.lua', folder = 'a' }"), 2, {"nowhere.lua: cannot be read"});
    expect_sentence(outer("tb.run { scipt = 'inner.lua', folder = 'a' }"), 2, {"tb.run", "script"});
    folder.write("self.lua", "require 'tribode'.run { script = 'self.lua', folder = 'deeper' }\n");
    expect_sentence(outer("tb.run { script = 'self.lua', folder = 'a' }"), 2, {"must be at most 4"});
}

} // namespace
} // namespace tribode::cli
