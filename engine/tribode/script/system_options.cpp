#include "tribode/script/system_options.hpp"
#include "tribode/base/error.hpp"
#include "tribode/script/system_reader.hpp"
#include "tribode/script/value.hpp"
#include "tribode/system/contacts.hpp"

#include <algorithm>
#include <fmt/format.h>
#include <lua.hpp>

namespace tribode {

Equations given_system(lua_State* lua, const char* function) {
    if (!lua_istable(lua, 1)) {
        throw InputError(fmt::format("{}: found a {}, must be a table of options", function, luaL_typename(lua, 1)));
    }
    lua_getfield(lua, 1, "system");
    const Equations* system = system_at(lua, -1);
    if (!system) {
        throw InputError(fmt::format("{}: system is {}, must be a system (see tb.system)", function,
                                     lua_isnil(lua, -1) ? "missing" : fmt::format("a {}", luaL_typename(lua, -1))));
    }
    Equations copy = *system;
    lua_pop(lua, 1);
    return copy;
}

Equations system_of(lua_State* lua, const char* function) {
    Equations system = given_system(lua, function);
    close_contacts(system);
    return system;
}

Json plain_options(lua_State* lua, std::initializer_list<std::string_view> special, const char* function) {
    lua_newtable(lua);
    lua_pushnil(lua);
    while (lua_next(lua, 1)) {
        const bool skipped = lua_type(lua, -2) == LUA_TSTRING &&
                             std::find(special.begin(), special.end(), lua_tostring(lua, -2)) != special.end();
        if (skipped) {
            lua_pop(lua, 1);
            continue;
        }
        lua_pushvalue(lua, -2);
        lua_insert(lua, -2);
        lua_rawset(lua, -4);
    }
    Json json = to_json(lua, -1, function);
    lua_pop(lua, 1);
    return json.is_null() ? Json::object() : json;
}

std::vector<std::string> names_of_values(const Equations& equations) {
    std::vector<std::string> names;
    for (const auto& state : equations.states) names.push_back(state.name);
    for (const auto& discrete : equations.discrete) names.push_back(discrete.name);
    return names;
}

double discrete_value(FieldReader& values, const Equations::Discrete& discrete) {
    const auto& names = discrete.modes;
    if (names.empty()) return values.number(discrete.name, discrete.unit, Allowed::finite, discrete.start);
    const auto mode = values.choice(discrete.name, names, names[static_cast<std::size_t>(discrete.start)]);
    return static_cast<double>(std::find(names.begin(), names.end(), mode) - names.begin());
}

} // namespace tribode
