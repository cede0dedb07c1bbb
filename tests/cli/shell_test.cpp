#include "cli/program.hpp"
#include "tribode/base/json.hpp"
#include "unit/script/temporary_folder.hpp"

#include <csignal>
#include <cstdlib>
#include <gtest/gtest.h>

namespace tribode::cli {
namespace {

namespace fs = std::filesystem;

// How the program is used from a shell: programs without a file, results in a pipe, reports as JSON.
class Shell : public ::testing::Test {
  protected:
    Ending tribode(const std::vector<std::string>& arguments, const std::string& input = "") {
        return run(arguments, {.folder = folder.path(), .input = input});
    }

    Json manifest(const std::string& run_folder) { return Json::parse(text_of(folder / run_folder / "manifest.json")); }

    TemporaryFolder folder;
};

TEST_F(Shell, CodeOfTheCommandLineRunsWithTheModuleAtHand) {
    const auto ending = tribode({"run", "-e", "x = tb.linspace(0, 1, 3)[2]", "-e", "print(x, ...)"});
    EXPECT_EQ(ending.exit_code, 0) << ending.err;
    EXPECT_EQ(ending.out, "0.5\n");
    EXPECT_EQ(manifest("results/command_line").at("script").at("text"), "x = tb.linspace(0, 1, 3)[2]\nprint(x, ...)");
    expect_sentence(tribode({"run", "-e", "x = {}", "-e", "x.y.z = 1"}), 2, {"command_line:2:", "field 'y'"});
    expect_sentence(tribode({"run", "-e", "x = ="}), 2, {"command_line:1:", "'='"});
    expect_sentence(tribode({"run", "-e", "tb.batch{}"}), 2, {"tb.batch"});
}

TEST_F(Shell, AScriptComesThroughAPipe) {
    const std::string text = "#!/usr/bin/env tribode\nlocal tb = require 'tribode'\n"
                             "tb.write_text { file = 'a.txt', text = tb.options { x = 1 }.x .. '' }\nprint 'done'\n";
    for (const char* name : {"-", "/dev/stdin"}) {
        const auto ending = tribode({"run", name, "-o", "out", "-D", "x=5"}, text);
        EXPECT_EQ(ending.exit_code, 0) << ending.err;
        EXPECT_EQ(ending.out, "done\n");
        EXPECT_EQ(text_of(folder / "out/a.txt"), "5");
        EXPECT_EQ(manifest("out").at("script").at("text"), text);
    }
    EXPECT_EQ(tribode({"run", "-"}, "print(1)\n").out, "1\n");
    EXPECT_TRUE(fs::exists(folder / "results/stdin/manifest.json"));
    expect_sentence(tribode({"run", "-"}, "print(1)\nerror 'no'\n"), 2, {"stdin:2: no"});
    expect_sentence(tribode({"run", "-"}, "\x1bLua"), 2, {"stdin", "compiled Lua"});
    expect_sentence(tribode({"run", "-"}, "io.open('/etc/passwd')"), 2, {"stdin:1:", "outside the run folder"});
    EXPECT_EQ(tribode({"run", "-"}, "").exit_code, 0);
}

TEST_F(Shell, AProgramIsGivenOnce) {
    folder.write("s.lua", "print(1)\n");
    expect_sentence(tribode({"run"}), 2, {"wants a script", "-e CODE"});
    expect_sentence(tribode({"run", "s.lua", "-e", "print(1)"}), 2, {"wants a script", "-e CODE"});
}

TEST_F(Shell, AnErrorHasTheCallsThatLedToIt) {
    const auto error_of = [&](const std::string& text) {
        folder.write("s.lua", text);
        return tribode({"run", "s.lua"}).err;
    };
    EXPECT_EQ(
        error_of("local function inner(x)\n  return x.y.z\nend\nlocal function outer() inner({}) end\n\nouter()\n"),
        "tribode: s.lua:2: attempt to index a nil value (field 'y'); called from s.lua:4 (local 'outer'), "
        "s.lua:6 (main chunk)\n");
    EXPECT_EQ(error_of("local function check() error('bad', 2) end\ncheck()\n"),
              "tribode: s.lua:2: bad; raised at s.lua:1 (local 'check'), called from s.lua:2 (main chunk)\n");
    EXPECT_EQ(error_of("error 'bad'\n"), "tribode: s.lua:1: bad\n");
    // Also of an error of the engine, in a module, and of a recursion without end.
    folder.write("part.lua", "return function() require 'tribode'.machine { file = 3 } end\n");
    EXPECT_NE(error_of("local call = require 'part'\n\ncall()\n").find("; called from s.lua:3 (main chunk)"),
              std::string::npos);
    const std::string deep = error_of("local function f() return 1 + f() end\nf()\n");
    EXPECT_NE(deep.find("stack overflow"), std::string::npos) << deep;
    EXPECT_LT(deep.size(), 1000u) << deep;
}

// What the engine reads, not what Lua itself would open: see Script.FilesOutsideAreNotRead.
TEST_F(Shell, DataFilesBesideTheScriptAreRead) {
    folder.write("work/axis.json", R"({"Ts": 0.0005, "rigid_gain_per_kg": 0.1})");
    folder.write("work/log.csv", "t,u\n0,1\n0.0005,2\n");
    folder.write("work/.hidden.json", "[1]");
    folder.write("work/deeper/log.csv", "t,u\n0,1\n0.0005,2\n");
    folder.write("elsewhere.csv", "t,u\n0,1\n0.0005,2\n");
    fs::create_symlink(folder / "elsewhere.csv", folder / "work/link.csv");
    const auto with = [&](const std::string& text) {
        folder.write("work/s.lua", "local tb = require 'tribode'\n" + text);
        return tribode({"run", "work/s.lua", "-o", "out"});
    };
    const auto ending = with("local m = tb.machine 'axis.json'\n"
                             "local r = tb.read_record { file = 'log.csv' }\n"
                             "print(m.Ts, r.data.u[2], #tb.simulate { machine = m, input = 'log.csv' }.y)\n");
    EXPECT_EQ(ending.out, "0.0005\t2.0\t2\n") << ending.err;
    EXPECT_EQ(with("tb.read_record { file = 'work/log.csv' }").exit_code, 0);
    for (const std::string name : {"work/deeper/log.csv", "elsewhere.csv", "work/link.csv", "link.csv"}) {
        expect_sentence(with("tb.read_record { file = '" + name + "' }"), 2, {"s.lua:2:", "outside the run folder"});
    }
    expect_sentence(with("tb.read_json { file = '.hidden.json' }"), 2, {"s.lua:2:", "outside the run folder"});
}

constexpr const char* mass = R"({"Ts": 0.0005, "rigid_gain_per_kg": 0.1})";

TEST_F(Shell, ASimulationGoesIntoAPipe) {
    folder.write("m.json", mass);
    folder.write("u.csv", "t,u\n0,1\n0.0005,2\n0.001,0\n");
    const std::vector<std::string> command = {"simulate", "--machine", "m.json", "--input", "u.csv"};
    const auto with = [&](std::vector<std::string> more) {
        more.insert(more.begin(), command.begin(), command.end());
        return tribode(more);
    };
    ASSERT_EQ(with({"-o", "out.csv"}).exit_code, 0);
    const auto piped = with({"-o", "-"});
    EXPECT_EQ(piped.exit_code, 0) << piped.err;
    EXPECT_EQ(piped.out, text_of(folder / "out.csv")) << "the file and nothing else";
    const auto report = Json::parse(with({"-o", "out.csv", "--json", "--quiet"}).out);
    EXPECT_EQ(report.at("samples"), 3);
    EXPECT_EQ(report.at("file"), "out.csv");
    EXPECT_EQ(report.at("solver"), "exact");
    EXPECT_GE(report.at("statistics").at("steps"), 1);
    expect_sentence(with({"-o", "-", "--json"}), 2, {"standard output"});
    expect_sentence(with({"-o", "-", "--events", "-"}), 2, {"standard output"});
    EXPECT_EQ(with({"-o", "out.csv", "--events", "-"}).out, "t,element,kind\n");
    EXPECT_FALSE(fs::exists(folder / "-"));
}

TEST_F(Shell, ABatchGoesIntoAPipe) {
    folder.write("s.lua", "local tb = require 'tribode'\n"
                          "tb.batch { name = 'b', points = { { x = 1 }, { x = 2 }, { x = 3 } },\n"
                          "  run = function(p) return { y = 2 * p.x } end }\n");
    const auto planned = tribode({"batch", "plan", "s.lua", "-o", "b", "--json"});
    ASSERT_EQ(planned.exit_code, 0) << planned.err;
    EXPECT_EQ(Json::parse(planned.out).at("points"), 3);
    EXPECT_EQ(Json::parse(tribode({"batch", "run", "b", "--json"}).out).at("done"), 3);
    EXPECT_EQ(Json::parse(tribode({"batch", "status", "b", "--json"}).out).at("complete"), true);
    const auto merged = Json::parse(tribode({"batch", "merge", "b", "-o", "b.csv", "--json"}).out);
    EXPECT_EQ(merged.at("points"), 3);
    EXPECT_EQ(tribode({"batch", "merge", "b", "-o", "-"}).out, text_of(folder / "b.csv"));
    expect_sentence(tribode({"batch", "merge", "b", "-o", "-", "--json"}), 2, {"standard output"});
    expect_sentence(tribode({"batch", "plan", "-", "-o", "c"}, "print(1)"), 2, {"-"});
}

TEST_F(Shell, TheReportOfARunIsItsManifest) {
    const auto ending = tribode({"run", "-e", "print 'aside' tb.write_text { file = 'a', text = 'b' }", "--json"});
    ASSERT_EQ(ending.exit_code, 0) << ending.err;
    EXPECT_EQ(ending.out, text_of(folder / "results/command_line/manifest.json"));
    EXPECT_EQ(ending.err, "aside\n");
}

TEST_F(Shell, ComparisonsAreReportedAsJson) {
    folder.write("m.json", mass);
    folder.write("u.csv", "t,u\n0,1\n0.0005,2\n0.001,0\n0.0015,0\n");
    const auto ending = tribode({"compare", "--machine", "m.json", "--input", "u.csv", "-o", "c", "--json"});
    ASSERT_EQ(ending.exit_code, 0) << ending.err;
    const Json report = Json::parse(ending.out);
    EXPECT_EQ(report.at("reference"), "exact");
    EXPECT_GT(report.at("methods").size(), 10u);
}

TEST_F(Shell, TheEffectsAndSolversAreListed) {
    const auto list = tribode({"effects"});
    EXPECT_EQ(list.exit_code, 0);
    const Json effects = Json::parse(tribode({"effects", "--json"}).out);
    EXPECT_GE(effects.size(), 23u);
    for (const auto& effect : effects) {
        const std::string name = effect.at("name");
        EXPECT_NE(list.out.find(name + " "), std::string::npos);
        const auto one = tribode({"effects", name});
        for (const auto& parameter : effect.at("parameters")) {
            EXPECT_NE(one.out.find(parameter.at("name").get<std::string>()), std::string::npos) << name;
        }
        EXPECT_EQ(Json::parse(tribode({"effects", name, "--json"}).out), effect);
    }
    expect_sentence(tribode({"effects", "force_riple"}), 2, {"force_riple", "did you mean \"force_ripple\"?"});

    const auto solvers = tribode({"solvers"});
    const Json methods = Json::parse(tribode({"solvers", "--json"}).out);
    EXPECT_EQ(methods.at(0).at("name"), "auto");
    for (const auto& method : methods) {
        EXPECT_NE(solvers.out.find("\n" + method.at("name").get<std::string>() + " "),
                  method.at("name") == "auto" ? 0 : std::string::npos);
    }
}

TEST_F(Shell, HelpOfACommandIsThatOfItsOption) {
    for (const std::vector<std::string>& words :
         {std::vector<std::string>{}, {"simulate"}, {"batch"}, {"batch", "plan"}}) {
        auto option = words, command = words;
        option.push_back("--help");
        command.insert(command.begin(), "help");
        const auto help = tribode(command);
        EXPECT_EQ(help.exit_code, 0);
        EXPECT_EQ(help.out, tribode(option).out);
    }
    expect_sentence(tribode({"help", "simulat"}), 2, {"did you mean \"simulate\"?"});
    expect_sentence(tribode({"help", "batch", "plna"}), 2, {"\"plna\"", "of tribode batch", "did you mean \"plan\"?"});
    expect_sentence(tribode({"help", "simulate", "x"}), 2, {"simulate has no commands of its own"});
}

// What a shell makes of the text: the program itself is not asked.
class Completion : public Shell {
  protected:
    // The words that the bash script offers for the last one.
    std::string offered(const std::string& words) {
        folder.write("tribode.bash", tribode({"completion", "bash"}).out);
        folder.write("ask.bash", "source ./tribode.bash\nCOMP_WORDS=(" + words +
                                     ")\nCOMP_CWORD=$((${#COMP_WORDS[@]} - 1))\n_tribode\n"
                                     "echo \"${COMPREPLY[*]}\" > answer\n");
        EXPECT_EQ(std::system(("cd '" + folder.path().string() + "' && bash --norc ask.bash").c_str()), 0);
        std::string answer = text_of(folder / "answer");
        answer.pop_back();
        return answer;
    }
};

TEST_F(Completion, BashKnowsCommandsOptionsAndChoices) {
    EXPECT_EQ(offered("tribode sim"), "simulate");
    EXPECT_EQ(offered("tribode batch p"), "plan");
    EXPECT_EQ(offered("tribode batch plan --shard"), "--shards --shard-seconds");
    EXPECT_EQ(offered("tribode simulate --solver ex"), "exact");
    EXPECT_EQ(offered("tribode effects force_r"), "force_ripple");
    EXPECT_EQ(offered("tribode help ba"), "batch");
    EXPECT_EQ(offered("tribode completion z"), "zsh");
    EXPECT_EQ(offered("tribode simulate --rtol ''"), "");
    folder.write("my.lua", "");
    EXPECT_EQ(offered("tribode run my"), "my.lua");
    EXPECT_EQ(offered("tribode simulate --quiet --machine my"), "my.lua");
}

// Every option of every command is in each of the texts, which come from one list.
TEST_F(Completion, EveryShellAndTheManualHaveEveryOption) {
    const std::string zsh = tribode({"completion", "zsh"}).out, fish = tribode({"completion", "fish"}).out;
    const std::string manual = tribode({"help", "--man"}).out;
    EXPECT_TRUE(zsh.starts_with("#compdef tribode\n"));
    for (const std::string option : {"machine", "max-running", "shard-seconds", "methods", "compile", "json"}) {
        EXPECT_NE(zsh.find("*--" + option + "["), std::string::npos) << option;
        EXPECT_NE(fish.find(" -l " + option + " "), std::string::npos) << option;
        std::string troff = "\\-\\-" + option;
        for (auto at = troff.find('-', 4); at != std::string::npos; at = troff.find('-', at + 2))
            troff.insert(at, "\\");
        EXPECT_NE(manual.find(troff), std::string::npos) << troff;
    }
    EXPECT_TRUE(manual.find(".TH TRIBODE 1") != std::string::npos &&
                manual.find(".SH EXIT STATUS") != std::string::npos);
    folder.write("c.zsh", zsh);
    folder.write("c.fish", fish);
    for (const std::string shell : {"zsh", "fish"}) {
        const std::string in_folder = "cd '" + folder.path().string() + "' && ";
        if (std::system(("command -v " + shell + " > /dev/null").c_str()) != 0) continue;
        EXPECT_EQ(std::system((in_folder + shell + " -n c." + shell).c_str()), 0) << shell;
    }
    expect_sentence(tribode({"completion", "tcsh"}), 2, {"bash"});
    expect_sentence(tribode({"completion"}), 2, {"shell"});
}

TEST_F(Completion, TheStubForEditorsHasEveryFunctionOfTheModule) {
    folder.write("stub.lua", tribode({"completion", "lua"}).out);
    folder.write("check.lua", "local tb, stub = require 'tribode', require 'stub'\n"
                              "local function compare(real, copy, path)\n"
                              "  for name, value in pairs(real) do\n"
                              "    if type(value) == 'table' then compare(value, copy[name], path .. name .. '.')\n"
                              "    elseif type(value) == 'function' and type(copy[name]) ~= 'function' then\n"
                              "      error(path .. name .. ' is missing') end\n"
                              "  end\n"
                              "end\n"
                              "compare(tb, stub, 'tb.')\ncompare(stub, tb, 'stub.')\nprint 'same'\n");
    const auto ending = tribode({"run", "check.lua"});
    EXPECT_EQ(ending.out, "same\n") << ending.err;
    const std::string stub = text_of(folder / "stub.lua");
    EXPECT_TRUE(stub.starts_with("---@meta tribode\n"));
    EXPECT_NE(stub.find("---@field quick? boolean\n"), std::string::npos);
    EXPECT_NE(stub.find("\nfunction tb.linspace(from, to, count, ...) end\n"), std::string::npos);
    EXPECT_NE(stub.find("---@field solver? \"auto\"|\"exact\"|"), std::string::npos);
    EXPECT_NE(stub.find("---@field relative_tolerance? number"), std::string::npos);
    EXPECT_EQ(stub.find("---@return any"), std::string::npos);
}

// Calls whose results are tables, beside the fields and types that the stub gives them.
TEST_F(Completion, TheStubForEditorsHasTheFieldsOfResults) {
    folder.write("stub.txt", tribode({"completion", "lua"}).out);
    folder.write("check.lua", R"lua(
local tb = require "tribode"
local file = assert(io.open "stub.txt")
local stub = file:read "a"
file:close()

-- The fields of a type: name = type, with "?" behind the name of one that may be missing; and whether there may be others.
local function fields_of(type)
  local fields, open = {}, false
  if type:sub(1, 1) == "{" then
    local depth, from = 0, 2
    for i = 2, #type do
      local c = type:sub(i, i)
      if c:find "[<{]" then depth = depth + 1 end
      if (c == "," or c == "}") and depth == 0 then
        local name, kind = type:sub(from, i - 1):match "^%s*([%w_?]+): (.-)%s*$"
        fields[name] = kind
        from = i + 1
        if c == "}" then break end
      end
      if c:find "[>}]" then depth = depth - 1 end
    end
    return fields, open
  end
  local base, body = stub:match("%-%-%-@class " .. type:gsub("%.", "%%.") .. "(:? ?[%w_.]*)[^\n]*\n(.-)\n\n")
  if base:find ": " then fields, open = fields_of(base:sub(3)) end
  for name, kind in body:gmatch "@field ([%w_?]+) ([^\n]+)" do fields[name] = kind end
  return fields, open or body:find("[string]", 1, true) ~= nil
end

local function is(value, kind)
  if kind:find "^any" then return true end
  if kind:find "^[%w_.]+%[%]" or kind:find "^table" or kind:find "^tribode" or kind:find "^{" then
    return type(value) == "table"
  end
  local wanted = kind:match "^%a+"
  return type(value) == wanted or math.type(value) == wanted
end

local machine = tb.machine "models/linear_motor_table.lua"
local values, slow = {}, {}
for i = 1, 1024 do
  values[i], slow[i] = math.sin(i * i), math.sin(0.1 * i)
end
local factors = { { name = "a", low = 0, high = 1 } }
local system = tb.system {
  states = { x = 1, v = 0 }, inputs = { u = 0 }, parameters = { k = 2 },
  der = function(s) return { x = s.v, v = s.u - s.k * s.x - s.v } end,
  outputs = function(s) return { y = s.x } end,
}
local sweep = tb.sweep { machine = machine, frequency_hz = { 20, 40, 80, 160 } }
local fit = tb.fit_modal { response = sweep.responses.Proposed, modes = 1 }
local feedforward = tb.feedforward { model = fit }
local results = {
  binary_sequence = tb.binary_sequence {},
  chirp = tb.chirp {},
  estimate_delay = tb.estimate_delay {
    fra1 = sweep.responses["FRA-1"], fra2 = sweep.responses["FRA-2"], f_min_hz = 10, f_max_hz = 200 },
  feedforward = feedforward,
  fit_friction = tb.fit_friction { position = slow, force = values, elements = 2 },
  fit_modal = fit,
  frf = tb.frf { input = values, output = slow, sample_time_s = 1, window_samples = 64 },
  histogram = tb.histogram { values = values },
  least_squares = tb.least_squares { columns = { values }, values = slow },
  linearize = tb.linearize { system = system, frequency_hz = { 0.1 } },
  loop_gain = tb.loop_gain { machine = machine, frequency_hz = { 20 } },
  monte_carlo = tb.monte_carlo { factors = factors, count = 4 },
  multisine = tb.multisine {},
  positioning = tb.positioning { machine = machine, feedforward = feedforward },
  regression_sensitivity = tb.regression_sensitivity { factors = { { name = "a", values = slow } }, values = values },
  run_system = tb.run_system { system = system, duration_s = 1 },
  simulate = tb.simulate { machine = machine, exc = values },
  single_frequency = tb.single_frequency { machine = machine, excitation_hz = 40 },
  sobol_indices = tb.sobol_indices { values = values, factors = { "a", "b" } },
  statistics = tb.statistics { values = values },
  steady_state = tb.steady_state { system = system },
  sweep = sweep,
  system_variables = tb.system_variables { system = system },
  tornado = tb.tornado { factors = { { name = "a", values = slow } }, values = values }[1],
  worst_cases = tb.worst_cases { values = values }[1],
}
local count = 0
for name, result in pairs(results) do
  local type = stub:match("@return ([^\n]+)\nfunction tb%." .. name .. "%("):gsub("%[%]$", "")
  local fields, open = fields_of(type)
  for key, value in pairs(result) do
    local kind = fields[key] or fields[key .. "?"]
    assert(kind or open, name .. " gives " .. key)
    assert(not kind or is(value, kind), name .. "." .. key .. " is no " .. tostring(kind))
  end
  for key in pairs(fields) do
    assert(key:sub(-1) == "?" or result[key] ~= nil, name .. " does not give " .. key)
    count = count + 1
  end
end
print(count)
)lua");
    const auto ending = tribode({"run", "check.lua", "--allow-all"});
    EXPECT_EQ(ending.exit_code, 0) << ending.err;
    EXPECT_GT(std::atoi(ending.out.c_str()), 120);
}

TEST_F(Shell, ADialogueReadsLinesFromAPipe) {
    const auto ending = tribode({"repl", "-o", "out"}, "x = 41\nx + 1, 'text'\n{ 1, { a = 'b' }, n = 2 }\n"
                                                       "for i = 1, 2 do\n  print(i)\nend\ntb.linspace(0, 1, 3)\nnil\n");
    EXPECT_EQ(ending.exit_code, 0) << ending.err;
    EXPECT_EQ(ending.out, "42\ttext\n{ 1, { a = \"b\" }, n = 2 }\n1\n2\n{ 0.0, 0.5, 1.0 }\nnil\n");
    EXPECT_EQ(manifest("out").at("script").at("file"), "repl");
    // A line that fails is not the end.
    const auto failing = tribode({"repl"}, "x.y.z = 1\nx = = 2\nio.open('/etc/passwd')\nerror({})\n1 + 1\nfor\n");
    EXPECT_EQ(failing.exit_code, 2);
    EXPECT_EQ(failing.out, "2\n");
    for (const char* part : {"repl:1: attempt to index", "near '='", "outside the run folder", "raised a table",
                             "the last statement has no end"}) {
        EXPECT_NE(failing.err.find(part), std::string::npos) << failing.err;
    }
    const auto endless =
        tribode({"repl", "--max-instructions", "100000"}, "while true do end\n1 + 1\nwhile true do end\n2\n");
    EXPECT_EQ(endless.out, "2\n2\n") << "each line has its own limit";
    EXPECT_EQ(tribode({"repl"}, "").exit_code, 0);
}

TEST_F(Shell, AnInterruptEndsTheCallAndNotTheDialogue) {
    Program dialogue({"repl"},
                     {.folder = folder.path(), .input = "io.stderr:write('begins') while true do end\n1 + 1\n"});
    ASSERT_TRUE(dialogue.wait_until([&] { return dialogue.err().find("begins") != std::string::npos; }));
    dialogue.send(SIGINT);
    const auto ending = dialogue.finish();
    EXPECT_EQ(ending.err, "beginsrepl:1: interrupted\n");
    EXPECT_EQ(ending.out, "2\n");
    EXPECT_EQ(ending.signal, 0);
}

} // namespace
} // namespace tribode::cli
