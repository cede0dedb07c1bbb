#include "messages.hpp"
#include "temporary_folder.hpp"
#include "tribode/base/field_reader.hpp"
#include "tribode/script/lua_state.hpp"
#include "tribode/script/value.hpp"

#include <atomic>
#include <gtest/gtest.h>

namespace tribode {
namespace {

constexpr std::size_t mebibyte = std::size_t{1} << 20;

class LuaStateTest : public ::testing::Test {
  protected:
    // Small, so that the tests of the limits are quick.
    ScriptLimits limits{.memory_bytes = 8 * mebibyte, .instructions = 1'000'000};

    Json run(const std::string& program) { return LuaState(limits, {}, {}).run_text(program, "script.lua"); }
    std::string problem(const std::string& program) {
        return problem_of([&] { run(program); });
    }
    static std::string problem(LuaState& state, const std::string& program) {
        return problem_of([&] { state.run_text("local tb = require 'tribode' " + program, "script.lua"); });
    }
};

// ---- results and errors ------------------------------------------------------------------

TEST_F(LuaStateTest, TheFirstResultComesBack) {
    EXPECT_EQ(run("return {a = 1}, 2"), Json({{"a", 1}}));
    EXPECT_EQ(run("local x = 1"), Json());
}

TEST_F(LuaStateTest, TheArgumentIsPassedOn) {
    LuaState state(limits, {}, {});
    EXPECT_EQ(state.run_text("return (...).points * 2", "t", {{"points", 21}}), Json(42));
    EXPECT_EQ(state.run_text("return select('#', ...)", "t"), Json(0));
}

TEST_F(LuaStateTest, AnErrorNamesScriptAndLine) {
    EXPECT_EQ(problem("local x\n\nx.y = 1"), "input: script.lua:3: attempt to index a nil value (local 'x')");
    EXPECT_EQ(problem("x = = 1"), "input: script.lua:1: unexpected symbol near '='");
    EXPECT_EQ(problem("\nerror('no pulse')"), "input: script.lua:2: no pulse");
}

TEST_F(LuaStateTest, AnErrorThatIsNoTextBecomesASentence) {
    EXPECT_EQ(problem("error({})"), "input: script.lua:1: the script raised a table as its error, must be a text");
    EXPECT_EQ(problem("error()"), "input: script.lua:1: the script raised a nil as its error, must be a text");
    EXPECT_EQ(problem("error(42, 0)"), "input: 42");
    EXPECT_EQ(problem("error(setmetatable({}, {__tostring = function() return 'my error' end}))"), "input: my error");
    // A handler that fails again: whatever Lua makes of it is an InputError, not a crash.
    EXPECT_TRUE(problem("error(setmetatable({}, {__tostring = function() error({}) end}))").starts_with("input: "));
    EXPECT_TRUE(problem("error(setmetatable({}, {__tostring = function() return {} end}))").starts_with("input: "));
}

TEST_F(LuaStateTest, TheTracebackTellsTheCallsOfTheLastError) {
    LuaState state(limits, {}, {});
    EXPECT_EQ(problem(state, "function inner() error('x') end\nfunction outer() inner() end\nouter()"),
              "input: script.lua:1: x");
    EXPECT_NE(state.traceback().find("in function 'inner'"), std::string::npos) << state.traceback();
    EXPECT_NE(state.traceback().find("in function 'outer'"), std::string::npos) << state.traceback();
    state.run_text("return 1", "t");
    EXPECT_EQ(state.traceback(), "");
}

TEST_F(LuaStateTest, EndlessRecursionIsAnError) {
    limits.memory_bytes = 128 * mebibyte; // a million stack slots and their call records fit
    limits.instructions = 10'000'000;
    EXPECT_TRUE(
        problem("local function f() return 1 + f() end f()").starts_with("input: script.lua:1: stack overflow"));
}

// ---- functions of the engine -------------------------------------------------------------

TEST_F(LuaStateTest, AFunctionGetsOneTableOrAListOfArguments) {
    LuaState state(limits, {}, {});
    state.add_function("show", [](const Json& arguments) { return arguments.dump(); });
    EXPECT_EQ(state.run_text("return require('tribode').show{a = {1, 2}}", "t"), Json(R"({"a":[1,2]})"));
    EXPECT_EQ(state.run_text("return require('tribode').show(1, 'b', {c = 2})", "t"), Json(R"([1,"b",{"c":2}])"));
    EXPECT_EQ(state.run_text("return require('tribode').show(7)", "t"), Json("[7]"));
    EXPECT_EQ(state.run_text("return require('tribode').show()", "t"), Json("[]"));
}

TEST_F(LuaStateTest, ValuesStandInTheModule) {
    LuaState state(limits, {}, {});
    state.add_value("solvers", {"exact", "erk"});
    EXPECT_EQ(state.run_text("return require('tribode').solvers[2]", "t"), Json("erk"));
}

TEST_F(LuaStateTest, AnUnknownOptionIsRefusedWithTheNearestName) {
    LuaState state(limits, {}, {});
    state.add_function("sweep", [](const Json& arguments) {
        FieldReader options(arguments, "sweep");
        const double amplitude = options.number("amplitude", "N", Allowed::positive);
        options.finish();
        return amplitude;
    });
    EXPECT_EQ(problem(state, "\ntb.sweep{amplitude = 2, amplitud = 3}"),
              "input: script.lua:2: sweep: amplitud is not a known field (did you mean \"amplitude\"?)");
    EXPECT_EQ(problem(state, "tb.sweep{amplitude = print}"),
              "input: script.lua:1: tribode.sweep: options.amplitude is a function, must be plain data: nil, a "
              "boolean, number, text or table");
}

// The exit code of the program depends on the kind.
TEST_F(LuaStateTest, AnExceptionKeepsItsKindThroughTheScript) {
    LuaState state(limits, {}, {});
    state.add_function("input", [](const Json&) -> Json { throw InputError("wrong"); });
    state.add_function("output", [](const Json&) -> Json { throw OutputError("disk full"); });
    state.add_function("ended", [](const Json&) -> Json { throw EndedEarly("step too small"); });
    state.add_function("other", [](const Json&) -> Json { throw std::runtime_error("odd"); });
    EXPECT_EQ(problem(state, "\n\ntb.input{}"), "input: script.lua:3: wrong");
    EXPECT_EQ(problem(state, "tb.output{}"), "output: script.lua:1: disk full");
    EXPECT_EQ(problem(state, "tb.ended{}"), "ended early: script.lua:1: step too small");
    EXPECT_EQ(problem(state, "tb.other{}"), "other: script.lua:1: odd");
    // Caught and raised again, with or without a line of the script's own, and out of a coroutine.
    EXPECT_EQ(problem(state, "local ok, e = pcall(tb.output) error(e, 0)"), "output: script.lua:1: disk full");
    EXPECT_EQ(problem(state, "local ok, e = pcall(tb.ended)\nerror(e)"),
              "ended early: script.lua:2: script.lua:1: step too small");
    EXPECT_TRUE(problem(state, "coroutine.wrap(tb.output)()").starts_with("output: "));
    // An error of the script after one that it caught is its own.
    EXPECT_EQ(problem(state, "pcall(tb.output) error('mine')"), "input: script.lua:1: mine");
}

TEST_F(LuaStateTest, AScriptCanCatchAnExceptionAsText) {
    LuaState state(limits, {}, {});
    state.add_function("fail", [](const Json&) -> Json { throw InputError("wrong"); });
    EXPECT_EQ(state.run_text("local ok, text = pcall(function() require('tribode').fail{} end) return text", "t"),
              Json("t:1: wrong"));
}

struct Witness {
    explicit Witness(int& alive) : alive_(alive) { ++alive_; }
    ~Witness() { --alive_; }
    Witness(const Witness&) = delete;
    Witness& operator=(const Witness&) = delete;
    int& alive_;
};

TEST_F(LuaStateTest, DestructorsRunWhenAnErrorPassesThroughCpp) {
    LuaState state(limits, {}, {});
    int alive = 0, calls = 0;
    state.add_function("throws", [&](const Json&) -> Json {
        const Witness witness(alive);
        ++calls;
        throw InputError("wrong");
    });
    // Here the error is one of Lua itself: its memory limit.
    state.add_stack_function("overfills", [&](lua_State* lua) {
        const Witness witness(alive);
        ++calls;
        push(lua, Json(std::vector<double>(2'000'000)));
        return 1;
    });
    EXPECT_EQ(problem(state, "tb.throws()"), "input: script.lua:1: wrong");
    EXPECT_EQ(problem(state, "tb.overfills()"), "input: the script used more than its memory limit of 8 MiB");
    EXPECT_EQ(calls, 2);
    EXPECT_EQ(alive, 0);
}

TEST_F(LuaStateTest, CoroutinesWorkAsInLua) {
    EXPECT_EQ(run("local f = coroutine.wrap(function(a) local b = coroutine.yield(a + 1) return b * 2 end) "
                  "return {f(1), f(10)}"),
              Json({2, 20}));
    EXPECT_EQ(run("local f = coroutine.wrap(function() pcall(coroutine.yield, 1) return 2 end) return {f(), f()}"),
              Json({1, 2}));
    EXPECT_EQ(run("local f = coroutine.wrap(function() xpcall(coroutine.yield, print, 1) return 2 end) "
                  "return {f(), f()}"),
              Json({1, 2}));
    EXPECT_EQ(run("local ok, e = pcall(coroutine.wrap(function() error({code = 7}) end)) return e"),
              Json({{"code", 7}}));
    EXPECT_EQ(run("closed = 0 local t = setmetatable({}, {__close = function() closed = closed + 1 end}) "
                  "pcall(coroutine.wrap(function() local x <close> = t error('x') end)) return closed"),
              Json(1));
    EXPECT_EQ(problem("local f = coroutine.wrap(function() end) f() f()"), "input: cannot resume dead coroutine");
    EXPECT_EQ(problem("\ncoroutine.wrap(1)"), "input: script.lua:2: coroutine.create: argument 1 must be a function");
    EXPECT_EQ(run("return select(2, xpcall(error, function(e) return e .. '!' end, 'x'))"), Json("x!"));
    EXPECT_EQ(problem("\nxpcall(print)"), "input: script.lua:2: xpcall: argument 2 must be a function");
}

// ---- limits ------------------------------------------------------------------------------

const std::string instruction_message =
    "the script ran more than 1000000 instructions (an endless loop?); --max-instructions raises the limit";

TEST_F(LuaStateTest, AnEndlessLoopEnds) {
    EXPECT_EQ(problem("local x = 0\nwhile true do x = x + 1 end"), "input: script.lua:2: " + instruction_message);
}

TEST_F(LuaStateTest, AnEndlessLoopThatCatchesItsEndEnds) {
    EXPECT_EQ(problem("while true do pcall(function() while true do end end) end"),
              "input: script.lua:1: " + instruction_message);
    EXPECT_EQ(problem("while true do xpcall(function() while true do end end, function() while true do end end) end"),
              "input: script.lua:1: " + instruction_message);
    EXPECT_EQ(problem("pcall(function() while true do end end)"), "input: script.lua:1: " + instruction_message);
    // Here the main program itself runs too little to be looked at again.
    EXPECT_EQ(problem("coroutine.resume(coroutine.create(function() while true do end end)) return 1"),
              "input: script.lua:1: " + instruction_message);
}

TEST_F(LuaStateTest, AnEndlessLoopInACoroutineEnds) {
    const std::string program = R"(
        local function loop() while true do pcall(function() while true do end end) end end
        while true do
            pcall(function() coroutine.wrap(loop)() end)
            coroutine.resume(coroutine.create(loop))
        end)";
    EXPECT_EQ(problem(program), "input: script.lua:2: " + instruction_message);
}

// Lua switches the hook off in these places when the error came from the hook.
TEST_F(LuaStateTest, NoHandlerRunsOnAfterTheLimit) {
    const std::string closing = R"(
        local endless = setmetatable({}, {__close = function() while true do end end})
        local function loop() local x <close> = endless while true do end end
        )";
    for (const char* call :
         {"pcall(loop)", "xpcall(loop, loop)", "coroutine.wrap(loop)()", "pcall(coroutine.wrap(loop))",
          "coroutine.close(coroutine.create(loop))  loop()",
          "local co = coroutine.create(loop) coroutine.resume(co) coroutine.close(co)",
          "coroutine.wrap(function() pcall(loop) end)()", "coroutine.wrap(function() xpcall(loop, loop) end)()"}) {
        EXPECT_NE(problem(closing + call).find(instruction_message), std::string::npos) << call;
    }
    EXPECT_EQ(run("return getmetatable(io.stdout)"), Json(false));
}

// Each of them runs far less than the 1000 instructions between two looks at the count.
TEST_F(LuaStateTest, ManyShortCoroutinesEnd) {
    const std::string program = R"(
        local function swarm(depth)
            if depth == 0 then return end
            for i = 1, 20 do coroutine.wrap(swarm)(depth - 1) end
        end
        coroutine.wrap(swarm)(30))";
    EXPECT_NE(problem(program).find(instruction_message), std::string::npos);
}

TEST_F(LuaStateTest, NothingRunsAfterTheLimit) {
    LuaState state(limits, {}, {});
    int calls = 0;
    state.add_function("call", [&](const Json&) { return Json(++calls); });
    EXPECT_NE(problem(state, "pcall(function() while true do end end) tb.call()").find(instruction_message),
              std::string::npos);
    EXPECT_NE(problem(state, "tb.call()").find(instruction_message), std::string::npos);
    EXPECT_EQ(calls, 0);
}

// Lua runs a finalizer with the hook switched off.
TEST_F(LuaStateTest, FinalizersAreRefused) {
    EXPECT_EQ(problem("setmetatable({}, {__gc = function() while true do end end})"),
              "input: script.lua:1: setmetatable: __gc is not available to scripts; use --allow-all");
    EXPECT_EQ(run("return setmetatable({}, {__index = {a = 1}}).a"), Json(1));
    EXPECT_EQ(problem("setmetatable(setmetatable({}, {__metatable = 1}), {})"),
              "input: script.lua:1: setmetatable: the metatable is protected");
}

TEST_F(LuaStateTest, AMemoryBombIsRefused) {
    const std::string text = "the script used more than its memory limit of 8 MiB";
    const std::string message = "input: " + text, with_line = "input: script.lua:1: " + text;
    EXPECT_EQ(problem("local s = string.rep('x', 1000000000)"), with_line);
    EXPECT_EQ(problem("local t = {} for i = 1, 1e9 do t[i] = i end"), message);
    EXPECT_EQ(problem("local s = 'x' while true do s = s .. s end"), message);
    EXPECT_EQ(problem("coroutine.wrap(function() local s = string.rep('x', 1 << 30) end)()"), with_line);
}

TEST_F(LuaStateTest, MemoryThatIsFreeAgainMayBeUsedAgain) {
    EXPECT_EQ(run("pcall(string.rep, 'x', 1 << 30) return #string.rep('x', 4000000)"), Json(4000000));
    EXPECT_EQ(run("local k = string.rep('x', 1000) for i = 1, 100 do local s = string.rep(k, 3000) end return 1"),
              Json(1));
}

TEST_F(LuaStateTest, ResultsOfTheEngineCountAsMemory) {
    LuaState state(limits, {}, {});
    state.add_function("trace", [](const Json&) { return Json(std::vector<double>(2'000'000)); });
    EXPECT_EQ(problem(state, "local t = tb.trace{}"), "input: the script used more than its memory limit of 8 MiB");
}

// Wherever the memory ends: at the first allocation, in the middle of a library, in an error message.
TEST_F(LuaStateTest, AMemoryLimitTooSmallForLuaIsAnInputError) {
    std::size_t bytes = 0;
    for (bool opened = false; !opened; bytes += 509) {
        const std::string text = problem_of([&] { LuaState({.memory_bytes = bytes}, {}, {}); });
        opened = text == "none: ";
        EXPECT_TRUE(opened || text.starts_with("input: ")) << bytes << ": " << text;
    }
    EXPECT_GT(bytes, 10'000u); // the libraries do need memory
}

TEST_F(LuaStateTest, AStopRequestEndsTheScript) {
    std::atomic<bool> stop = false;
    RunControl control;
    control.stop = &stop;
    const auto state_that_stops = [&] {
        stop = false;
        auto state = std::make_unique<LuaState>(limits, ScriptAccess{}, control);
        state->add_function("stop", [&](const Json&) { return Json((stop = true, 1)); });
        return state;
    };
    EXPECT_EQ(problem(*state_that_stops(), "tb.stop()\nwhile true do end"), "ended early: script.lua:2: interrupted");
    EXPECT_EQ(problem(*state_that_stops(), "tb.stop()\nwhile true do pcall(function() while true do end end) end"),
              "ended early: script.lua:2: interrupted");
    // Also where the script does little between two calls of the engine.
    EXPECT_EQ(problem(*state_that_stops(), "tb.stop()\ntb.stop()"), "ended early: script.lua:2: interrupted");
}

// ---- libraries ---------------------------------------------------------------------------

TEST_F(LuaStateTest, OnlySafeFunctionsAreThere) {
    for (const char* name : {"os.execute",
                             "os.remove",
                             "os.rename",
                             "os.exit",
                             "os.getenv",
                             "os.tmpname",
                             "os.setlocale",
                             "io.popen",
                             "io.input",
                             "io.output",
                             "io.read",
                             "io.stdin",
                             "io.tmpfile",
                             "debug.sethook",
                             "debug.getregistry",
                             "debug.getupvalue",
                             "debug.setmetatable",
                             "string.dump",
                             "package",
                             "require('os').execute",
                             "require('io').popen",
                             "require('debug').sethook",
                             "require('_G').package"}) {
        EXPECT_EQ(run(std::string("return ") + name), Json()) << name;
    }
    for (const char* name :
         {"os.time", "os.clock", "os.date", "os.difftime", "io.write", "io.open", "io.stderr.write", "debug.traceback",
          "math.sin", "table.concat", "utf8.char", "string.format", "coroutine.wrap", "print", "pcall", "require"}) {
        EXPECT_EQ(run(std::string("return ") + name + " ~= nil"), Json(true)) << name;
    }
}

TEST_F(LuaStateTest, CompiledLuaIsRefused) {
    const std::string message = "attempt to load a binary chunk (mode is 't')";
    EXPECT_EQ(run("return select(2, load('\\27Lua'))"), Json(message));
    EXPECT_EQ(run("return select(2, load('\\27Lua', 'name', 'b'))"), Json(message));
    EXPECT_EQ(run("local done return select(2, load(function() if done then return end done = 1 return "
                  "'\\27Lua' end, "
                  "'name', 'bt', {}))"),
              Json(message));
    const TemporaryFolder folder;
    const auto file = folder.write("compiled.lua", "\x1bLua");
    EXPECT_EQ(problem_of([&] { LuaState(limits, {}, {}).run_file(file); }),
              "input: " + file.string() + ": is compiled Lua, must be program text");
}

TEST_F(LuaStateTest, LoadTakesTextAndEnvironment) {
    EXPECT_EQ(run("return load('return 1 + 1')()"), Json(2));
    EXPECT_EQ(run("return load('return x', 'name', 't', {x = 5})()"), Json(5));
    EXPECT_EQ(run("x = 6 return load('return x', nil, nil)()"), Json(6));
    EXPECT_EQ(run("return select(2, load('x = = 1', '@part.lua'))"), Json("part.lua:1: unexpected symbol near '='"));
}

TEST_F(LuaStateTest, RandomNumbersAreTheSameInEachRun) {
    const std::string program = "return {math.random(), math.random(1000000), math.random()}";
    EXPECT_EQ(run(program), run(program));
}

TEST_F(LuaStateTest, AllowAllOpensTheWholeLibrary) {
    const TemporaryFolder folder;
    const auto file = folder.write("data.txt", "hello");
    folder.write("modules/part.lua", "return {value = 3}");
    ScriptAccess access;
    access.allow_all = true;
    access.read_folders = {folder / "modules"};
    LuaState state(limits, access, {});
    EXPECT_EQ(state.run_text("return os.getenv ~= nil and package ~= nil and debug.sethook ~= nil", "t"), Json(true));
    EXPECT_EQ(state.run_text("return load(string.dump(function() return 4 end))()", "t"), Json(4));
    EXPECT_EQ(state.run_text("return io.open((...).name):read('a')", "t", {{"name", file.string()}}), Json("hello"));
    EXPECT_EQ(state.run_text("return require('part').value", "t"), Json(3));
    EXPECT_EQ(state.run_text("return type(require('tribode'))", "t"), Json("table"));
    EXPECT_NE(problem(state, "while true do end").find(instruction_message), std::string::npos);
}

// ---- files -------------------------------------------------------------------------------

class ScriptFilesTest : public LuaStateTest {
  protected:
    ScriptFilesTest() {
        std::filesystem::create_directory(root / "run");
        root.write("secret.txt", "secret");
        access.run_folder = root / "run";
        access.read_folders = {root / "scripts"};
    }

    Json run_here(const std::string& program) {
        const Json names = {{"root", root.path().string()}};
        return LuaState(limits, access, {}).run_text("local root = (...).root\n" + program, "script.lua", names);
    }
    std::string problem_here(const std::string& program) {
        return problem_of([&] { run_here(program); });
    }

    TemporaryFolder root;
    ScriptAccess access;
};

TEST_F(ScriptFilesTest, AScriptWritesAndReadsInItsRunFolder) {
    EXPECT_EQ(run_here(R"(
        local file <close> = assert(io.open(root .. '/run/notes.txt', 'w'))
        file:write('first\nsecond\n')
        file:close()
        local lines = {}
        for line in io.lines(root .. '/run/notes.txt') do lines[#lines + 1] = line end
        return lines)"),
              Json({"first", "second"}));
}

TEST_F(ScriptFilesTest, EveryRoadOutIsRefusedWithItsLine) {
    const std::string outside = "is outside the run folder; name it with -D, --machine, --data or --input, or use "
                                "--allow-all";
    EXPECT_EQ(problem_here("\nio.open('/etc/passwd')"), "input: script.lua:3: \"/etc/passwd\" " + outside);
    EXPECT_EQ(problem_here("for line in io.lines('/etc/passwd') do end"),
              "input: script.lua:2: \"/etc/passwd\" " + outside);
    EXPECT_EQ(problem_here("dofile('/etc/passwd')"), "input: script.lua:2: \"/etc/passwd\" " + outside);
    EXPECT_EQ(problem_here("loadfile('/etc/passwd')"), "input: script.lua:2: \"/etc/passwd\" " + outside);
    EXPECT_NE(problem_here("io.open(root .. '/run/../secret.txt')").find(outside), std::string::npos);
    for (const std::string mode : {"w", "a", "r+", "w+", "a+", "wb", "rw"}) {
        EXPECT_NE(problem_here("io.open(root .. '/secret.txt', '" + mode + "')").find("a script writes only there"),
                  std::string::npos)
            << mode;
    }
    EXPECT_NE(problem_here("require 'secret'").find("the module \"secret\" was not found"), std::string::npos);
    EXPECT_NE(problem_here("require(root .. '/secret')").find("is not relative"), std::string::npos);
    EXPECT_NE(problem_here("io.lines()").find("argument 1 is missing, must be a text"), std::string::npos);
}

TEST_F(ScriptFilesTest, ASymbolicLinkOutOfTheRunFolderIsRefused) {
    std::filesystem::create_symlink(root / "secret.txt", root / "run/link");
    EXPECT_NE(problem_here("io.open(root .. '/run/link')").find("is outside the run folder"), std::string::npos);
    EXPECT_NE(problem_here("io.open(root .. '/run/link', 'w')").find("is outside the run folder"), std::string::npos);
}

TEST_F(ScriptFilesTest, AMissingFileIsReportedAsLuaDoes) {
    EXPECT_NE(run_here("return select(2, io.open(root .. '/run/none'))").get<std::string>().find("No such file"),
              std::string::npos);
    EXPECT_TRUE(problem_here("io.lines(root .. '/run/none')").starts_with("input: script.lua:2: "));
    EXPECT_TRUE(problem_here("dofile(root .. '/run/none')").starts_with("input: script.lua:2: "));
}

TEST_F(ScriptFilesTest, DofileAndLoadfileRunTextOnly) {
    root.write("run/part.lua", "return x or 8");
    root.write("run/compiled.lua", "\x1bLua");
    EXPECT_EQ(run_here("return dofile(root .. '/run/part.lua')"), Json(8));
    EXPECT_EQ(run_here("return loadfile(root .. '/run/part.lua', 'bt', {x = 9})()"), Json(9));
    EXPECT_NE(problem_here("dofile(root .. '/run/compiled.lua')").find("is compiled Lua"), std::string::npos);
    EXPECT_EQ(run_here("return select(2, loadfile(root .. '/run/compiled.lua', 'b'))"),
              Json("attempt to load a binary chunk (mode is 't')"));
}

TEST_F(ScriptFilesTest, RequireFindsModulesInTheReadFoldersOnce) {
    root.write("scripts/part.lua", "count = (count or 0) + 1 return {name = ...}");
    root.write("scripts/lib/init.lua", "return 'a folder'");
    root.write("scripts/lib/deep.lua", "local x = nil + 1");
    EXPECT_EQ(run_here("local a, b = require 'part', require 'part' return {a == b, a.name, count}"),
              Json({true, "part", 1}));
    EXPECT_EQ(run_here("return require 'lib'"), Json("a folder"));
    EXPECT_NE(problem_here("require 'lib.deep'").find("deep.lua:1: attempt to perform arithmetic on a nil value"),
              std::string::npos);
}

TEST_F(ScriptFilesTest, RequireSearchesTheFolderOfTheScriptFirst) {
    root.write("scripts/part.lua", "return 'read folder'");
    root.write("run/part.lua", "return 'own folder'");
    const auto allowed = root.write("run/main.lua", "return require 'part'");
    const auto outside = root.write("elsewhere/main.lua", "return require 'part'");
    EXPECT_EQ(LuaState(limits, access, {}).run_file(allowed), Json("own folder"));
    EXPECT_EQ(LuaState(limits, access, {}).run_file(outside), Json("read folder"));
    root.write("elsewhere/part.lua", "return 'beside the script'");
    EXPECT_EQ(LuaState(limits, access, {}).run_file(outside), Json("beside the script"));
}

TEST_F(ScriptFilesTest, OnlyModulesMayBeReadBesideAScriptAndNoLinkLeadsFurther) {
    root.write("elsewhere/part.lua", "return 1");
    root.write("far/part.lua", "return 2");
    const auto reads =
        root.write("elsewhere/reads.lua", "io.open(... or '" + (root / "elsewhere/part.lua").string() + "')");
    const auto linked = root.write("elsewhere/linked.lua", "return require 'link'");
    std::filesystem::create_symlink(root / "far/part.lua", root / "elsewhere/link.lua");
    for (const auto& script : {reads, linked}) {
        const auto problem = problem_of([&] { LuaState(limits, access, {}).run_file(script); });
        EXPECT_NE(problem.find("is outside the run folder"), std::string::npos) << problem;
    }
}

TEST_F(ScriptFilesTest, ErrorsOfAScriptFileNameTheFile) {
    // A text of Lua shows the last 59 characters of a long path.
    const auto broken = root.write("broken.lua", "x = 1\nx = = 2\n");
    EXPECT_NE(problem_of([&] { LuaState(limits, access, {}).run_file(broken); }).find("broken.lua:2: unexpected"),
              std::string::npos);
    EXPECT_NE(problem_of([&] { LuaState(limits, access, {}).run_file(root / "none.lua"); }).find("none.lua"),
              std::string::npos);
    EXPECT_THROW(LuaState(limits, access, {}).run_file(root.path()), InputError);
}

} // namespace
} // namespace tribode
