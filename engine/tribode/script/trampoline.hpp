#pragma once
#include "tribode/script/script_host.hpp"

// The border between C++ exceptions and Lua errors; no other file raises a Lua error. Lua is its C++ build:
// its errors unwind C++ frames, so destructors run. They are no std::exception and must never be caught by
// `catch (...)`.
namespace tribode {

// Runs `body` under lua_pcall, as the outermost call. An uncaught error leaves as the Error it was. [-0, +0]
void protected_call(lua_State* lua, const LuaState::StackFunction& body);

// Pushes a Lua function that calls `function`; its exceptions become Lua errors. The value on top of the
// stack, a function that is replaced or nil, goes with it for call_replaced. [-1, +1]
void push_function(lua_State* lua, LuaState::StackFunction function);

// Inside such a function: calls the replaced one with all that is on the stack; returns the number of
// results.
// [-n, +results]
int call_replaced(lua_State* lua);

// As lua_call; to an error with `part` in its text the hint is added. [-(arguments + 1), +results]
void call_with_hint(lua_State* lua, int arguments, int results, const char* part, const char* hint);

// Counts instructions from now on and ends the script at its limit or on a stop request. Coroutines inherit
// it.
void watch_instructions(lua_State* lua);

// Adds to the count what the hook does not see. Raises as the hook does.
void charge_instructions(lua_State* lua, std::uint64_t count);

// Counts so many bytes of expressions, all there are, to the memory of the script, and ends it above its limit.
void charge_graph(lua_State* lua, std::size_t bytes);

// The chunk name of Lua code that is our own; messages do not point there.
inline constexpr const char* own_chunk = "=tribode";

// `script.lua:7: ` for the innermost line of the script that is running; empty where none is. [-0, +0]
std::string where(lua_State* lua);

} // namespace tribode
