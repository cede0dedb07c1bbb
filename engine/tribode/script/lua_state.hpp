#pragma once
#include "tribode/base/json.hpp"
#include "tribode/base/run_control.hpp"
#include "tribode/script/script_access.hpp"

#include <cstdint>
#include <filesystem>
#include <functional>
#include <memory>
#include <span>
#include <string>
#include <string_view>
#include <vector>

struct lua_State;

namespace tribode {

struct ScriptHost;

// What a script has used of its limits, with all that it has started: nested runs, machine files.
struct ScriptUse {
    std::size_t memory_bytes = 0;
    std::uint64_t instructions = 0;
};

struct ScriptLimits {
    std::size_t memory_bytes = std::size_t{1} << 30; // all that Lua holds at one time, and the graph of expressions
    std::uint64_t instructions = 2'000'000'000;      // of Lua, over the life of the state, in steps of 1000
    std::shared_ptr<ScriptUse> used = nullptr;       // of the state that starts another; null: counts begin at zero
};

// One Lua program with the engine's functions in the module `tribode`, sandboxed by default:
//
//  - libraries: base, string, table, math, utf8, coroutine; of os only clock, date, difftime, time; of io
//    only close, lines, open, stderr, stdout, type, write; of debug only traceback. Program text only, no
//    compiled Lua, no C modules, no finalizers (__gc), because Lua runs these where no limit reaches.
//  - files: as ScriptAccess says, also for dofile, loadfile and `require`, which searches the script's own
//    folder and the read folders for name.lua and name/init.lua (a dot in the name is a folder).
//  - math.random begins with the same seed in every run.
//
// With allow_all the whole standard library is open, and a script can get round its limits. Time inside
// functions of the engine is not counted, nor is time inside one call of a library function, such as a slow
// string pattern. A limit that was reached, or a stop request, ends the script even if it catches the error.
//
// Not for use from several threads at one time. A script's functions are values of its own state only.
class LuaState {
  public:
    // Arguments: the one options table, or a list of the plain arguments. The result is what the script gets.
    using Function = std::function<Json(const Json& arguments)>;
    // Reads its arguments from the Lua stack, pushes its results and returns their number: a lua_CFunction.
    using StackFunction = std::function<int(lua_State*)>;

    LuaState(const ScriptLimits& limits, ScriptAccess access, const RunControl& control);
    ~LuaState();
    LuaState(const LuaState&) = delete;
    LuaState& operator=(const LuaState&) = delete;

    // Put a field into the table that `require "tribode"` returns, or into a table in it: "parts.play". An exception of a function becomes a Lua
    // error with the script's name and line in front; uncaught by the script it leaves `run` as the same kind
    // of Error.
    void add_function(const std::string& name, Function function);
    void add_stack_function(const std::string& name, StackFunction function);
    void add_value(const std::string& name, const Json& value);

    // Runs `body` on the state, for what is no field of the module: metatables, functions of Lua's own libraries.
    void set_up(const StackFunction& body);

    // Runs the program with one argument (`...`; none where null) and returns its first result, null without
    // one. Throws InputError for errors of syntax, of the script and of its limits, EndedEarly on a stop
    // request, and what the engine's functions throw; the text begins with the script's name and line.
    Json run_file(const std::filesystem::path& path, const Json& argument = nullptr);
    Json run_text(std::string_view text, const std::string& chunk_name, const Json& argument = nullptr);

    // Runs `body` with the stack of the state, as an outermost call with a count of instructions of its own, which is not
    // added to that of the state. For what calls functions that a script has left behind. Throws what `run` does.
    void enter(const StackFunction& body);
    // A function of numbers: fills the second from the first. Valid as long as this state is.
    using Numbers = std::function<void(std::span<const double>, std::span<double>)>;
    // Of a text that is its body, with these names for its arguments. A call throws InputError where the text does not
    // return a number for each result, or fails, with its line.
    Numbers compile(std::string_view body, const std::vector<std::string>& arguments, const std::string& chunk_name);
    void set_global(const std::string& name, double value);
    // After a limit or a stop request has ended what ran: the state may be used again.
    void go_on();

    // The chain of calls at the last uncaught error; empty where there was none.
    const std::string& traceback() const;

    const ScriptAccess& access() const;
    // For a state that this one starts: what that uses is counted here, too.
    const ScriptLimits& limits() const;

  private:
    struct Closer {
        void operator()(lua_State* lua) const;
    };

    // `load` pushes the chunk.
    Json run(const std::string& name, const Json& argument, const std::function<void(lua_State*)>& load);

    std::unique_ptr<ScriptHost> host_; // before the state, which uses it to its end
    std::unique_ptr<lua_State, Closer> lua_;
};

} // namespace tribode
