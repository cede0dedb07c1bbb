#pragma once
#include "tribode/script/lua_function.hpp"

namespace tribode {

// The part of system_functions() about linear systems and steady states.
std::vector<LuaFunction> system_analysis_functions();

} // namespace tribode
