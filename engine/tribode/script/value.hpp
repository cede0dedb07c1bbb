#pragma once
#include "tribode/base/json.hpp"

#include <string>

struct lua_State;

namespace tribode {

// The Lua value at `index` as plain data. [-0, +0]
// nil, booleans, whole numbers, numbers (NaN and infinities too) and texts stay what they are. A table with
// the keys 1..n is a list; a table with texts as keys has its fields sorted by name, because Lua's own order
// differs from run to run; an empty table is an empty object. Metatables are ignored: no script code runs.
// Throws InputError with the path of the field, which begins with `name`: functions, userdata and threads,
// tables with other or mixed keys, holes in a list, tables that contain themselves, more than 64 levels,
// texts that are not UTF-8, and more than 1 GiB in all (shared tables are copied at each place).
Json to_json(lua_State* lua, int index, const std::string& name = "the value");

// Pushes the value. [-0, +1]
// A null is nil: absent in a table with names, a hole in a list. Unsigned numbers above 2^63 - 1 become the
// nearest double. Throws InputError above 64 levels; raises Lua's memory error. Call both functions below a
// trampoline.
void push(lua_State* lua, const Json& value);

} // namespace tribode
