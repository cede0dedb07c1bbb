#pragma once
#include "tribode/script/lua_state.hpp"

namespace tribode {

// The functions of the module `tribode` for designs of experiments and what is made of their results; as add_bindings.
void add_sampling_bindings(LuaState& lua);

} // namespace tribode
