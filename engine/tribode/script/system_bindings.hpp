#pragma once
#include "tribode/script/lua_state.hpp"
#include "tribode/script/script_run.hpp"

namespace tribode {

// tb.system, tb.run_system and the functions that equations are written with; docs/systems.md describes them.
void add_system_bindings(LuaState& lua, ScriptRun& run);

} // namespace tribode
