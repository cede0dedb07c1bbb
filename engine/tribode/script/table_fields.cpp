#include "tribode/script/table_fields.hpp"
#include "tribode/base/error.hpp"
#include "tribode/base/field_reader.hpp"
#include "tribode/base/text.hpp"

#include <algorithm>
#include <cmath>
#include <fmt/format.h>
#include <lua.hpp>

namespace tribode {

bool has_field(lua_State* lua, int table, const char* key) {
    const bool there = lua_getfield(lua, table, key) != LUA_TNIL;
    lua_pop(lua, 1);
    return there;
}

void check_keys(lua_State* lua, int table, const std::vector<std::string>& known, const std::string& where) {
    if (!lua_istable(lua, table)) {
        throw InputError(fmt::format("{}: found a {}, must be a table", where, luaL_typename(lua, table)));
    }
    lua_pushnil(lua);
    while (lua_next(lua, table)) {
        lua_pop(lua, 1);
        const std::string key = lua_type(lua, -1) == LUA_TSTRING
                                    ? lua_tostring(lua, -1)
                                    : fmt::format("an entry with a {} as key", luaL_typename(lua, -1));
        if (std::find(known.begin(), known.end(), key) != known.end() || FieldReader::is_note(key)) continue;
        throw InputError(fmt::format("{}: {} is not a known field{}", where, key, suggestion(key, known)));
    }
}

std::string text_field(lua_State* lua, int table, const char* key, const std::string& where) {
    lua_getfield(lua, table, key);
    if (lua_type(lua, -1) != LUA_TSTRING) {
        throw InputError(fmt::format("{}: {} is {}, must be a text", where, key,
                                     lua_isnil(lua, -1) ? "missing" : fmt::format("a {}", luaL_typename(lua, -1))));
    }
    std::string text = lua_tostring(lua, -1);
    lua_pop(lua, 1);
    return text;
}

double number_field(lua_State* lua, int table, const char* key, const std::string& where,
                    std::optional<double> fallback) {
    const int type = lua_getfield(lua, table, key);
    if (type == LUA_TNIL && fallback) {
        lua_pop(lua, 1);
        return *fallback;
    }
    if (type != LUA_TNUMBER || !std::isfinite(lua_tonumber(lua, -1))) {
        throw InputError(fmt::format("{}: {} is {}, must be a finite number", where, key,
                                     type == LUA_TNIL ? "missing" : "a " + std::string(luaL_typename(lua, -1))));
    }
    const double number = lua_tonumber(lua, -1);
    lua_pop(lua, 1);
    return number;
}

bool flag_field(lua_State* lua, int table, const char* key, const std::string& where) {
    const int type = lua_getfield(lua, table, key);
    if (type != LUA_TNIL && type != LUA_TBOOLEAN) {
        throw InputError(fmt::format("{}: {} is a {}, must be true or false", where, key, luaL_typename(lua, -1)));
    }
    const bool flag = lua_toboolean(lua, -1);
    lua_pop(lua, 1);
    return flag;
}

std::vector<std::string> names_of(lua_State* lua, int table, const std::string& where) {
    std::vector<std::string> names;
    lua_pushnil(lua);
    while (lua_next(lua, table)) {
        lua_pop(lua, 1);
        if (lua_type(lua, -1) != LUA_TSTRING) {
            throw InputError(fmt::format("{}: has a {} as key, must have names", where, luaL_typename(lua, -1)));
        }
        names.emplace_back(lua_tostring(lua, -1));
    }
    std::sort(names.begin(), names.end());
    return names;
}

bool has_entries(lua_State* lua, int table) {
    lua_pushnil(lua);
    if (!lua_next(lua, table)) return false;
    lua_pop(lua, 2);
    return true;
}

} // namespace tribode
