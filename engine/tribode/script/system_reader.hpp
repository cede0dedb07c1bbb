#pragma once
#include "tribode/script/symbols.hpp"
#include "tribode/system/equations.hpp"

struct lua_State;

namespace tribode {

// The equations of the options table of tb.system at `index`; docs/systems.md describes the table. Its functions are
// called on symbolic values, which records them, and then on numbers: where the recorded equations say something else
// than the function itself, it has a branch that was not recorded, and is refused. [-0, +0]
// Throws InputError.
Equations read_system(lua_State* lua, int index, const std::shared_ptr<Symbols>& symbols);

// Userdata with equations. [-0, +1]; null where there is none at `index` [-0, +0].
void push_system(lua_State* lua, Equations equations);
const Equations* system_at(lua_State* lua, int index);

// A function of the time alone at `index`, recorded. [-0, +0]
Term record_input(lua_State* lua, int index, const std::shared_ptr<Symbols>& symbols, const std::string& what);

} // namespace tribode
