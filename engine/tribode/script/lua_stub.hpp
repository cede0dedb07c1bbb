#pragma once
#include <string>

namespace tribode {

// The module `tribode` as a stub with annotations of LuaCATS (---@meta), from which editors with lua-language-server know the
// functions, their options and documentation. Made from the tables of LuaFunction, as docs/lua-reference.md.
std::string lua_stub();

} // namespace tribode
