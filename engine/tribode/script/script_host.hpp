#pragma once
#include "tribode/script/lua_state.hpp"

#include <array>
#include <deque>
#include <optional>
#include <set>

namespace tribode {

// An error on its way through Lua, which knows texts only.
struct Failure {
    enum class Kind { input, output, ended_early, other };
    Kind kind = Kind::other;
    std::string text;

    [[noreturn]] void throw_again() const;
};

// What belongs to one Lua state besides Lua itself. Every coroutine reaches it: see host_of.
struct ScriptHost {
    ScriptLimits limits; // with what is used of them
    ScriptAccess access;
    RunControl control;
    std::filesystem::path script_folder;           // of the running file; searched first by `require`
    std::set<std::string> loaded_files;            // names of the files that functions are from
    std::size_t graph_bytes = 0;                   // of the expressions, in the memory that the script has used
    std::deque<LuaState::StackFunction> functions; // a deque, because Lua keeps their addresses
    std::optional<Failure> ended;                  // a limit or a stop request: nothing runs after it
    std::array<std::string, 4> last_text;          // by kind: the last failure that was given to the script
    std::string traceback;
};

ScriptHost& host_of(lua_State* lua);
void set_host(lua_State* lua, ScriptHost& host);

} // namespace tribode
