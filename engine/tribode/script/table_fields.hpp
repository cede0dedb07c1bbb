#pragma once
#include <optional>
#include <string>
#include <vector>

struct lua_State;

namespace tribode {

// Fields of a Lua table at an absolute index, for what cannot become plain data since it holds functions. All leave the
// stack as it is. Those that take `where`, how messages begin, throw InputError.

bool has_field(lua_State* lua, int table, const char* key);
bool has_entries(lua_State* lua, int table);

// Refuses what is no table, and fields other than these; a note, "_...", is allowed.
void check_keys(lua_State* lua, int table, const std::vector<std::string>& known, const std::string& where);

std::string text_field(lua_State* lua, int table, const char* key, const std::string& where);

// A finite number; `fallback` where there is none.
double number_field(lua_State* lua, int table, const char* key, const std::string& where,
                    std::optional<double> fallback);

bool flag_field(lua_State* lua, int table, const char* key, const std::string& where); // false where there is none

// The names of a table's fields, sorted: Lua's own order differs from run to run.
std::vector<std::string> names_of(lua_State* lua, int table, const std::string& where);

} // namespace tribode
