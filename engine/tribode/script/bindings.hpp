#pragma once
#include "tribode/script/lua_state.hpp"
#include "tribode/script/script_run.hpp"

namespace tribode {

// Puts the functions of the module `tribode` into the state; docs/lua-reference.md describes each.
void add_bindings(LuaState& lua, ScriptRun& run);

} // namespace tribode
