#include "tribode/script/dialogue.hpp"
#include "tribode/base/error.hpp"

#include <algorithm>
#include <cctype>
#include <lua.hpp>

namespace tribode {

namespace {

constexpr const char* print_name = "tribode.dialogue.print"; // in the registry
constexpr const char* chunk_name = "=repl";

// Prints values as one would write them; of long and deep tables the beginning.
constexpr std::string_view print_values = R"lua(
    local type, tostring, pairs, format, concat, print = type, tostring, pairs, string.format, table.concat, print
    local most, deepest = 20, 3

    local function show(value, depth)
        if type(value) == "string" then return depth == 0 and value or format("%q", value) end
        if type(value) ~= "table" then return tostring(value) end
        if depth == deepest then return "{…}" end
        local parts, count, length = {}, 0, #value
        for key, entry in pairs(value) do
            count = count + 1
            if count <= most then
                local text = show(entry, depth + 1)
                if not (math.type(key) == "integer" and key >= 1 and key <= length) then
                    local plain = type(key) == "string" and key:find("^[%a_][%w_]*$")
                    text = (plain and key or "[" .. show(key, deepest) .. "]") .. " = " .. text
                end
                parts[count] = text
            end
        end
        if count == 0 then return "{}" end
        if count > most then parts[most + 1] = format("… (%d in all)", count) end
        return "{ " .. concat(parts, ", ") .. " }"
    end

    return function(...)
        local texts = {}
        for i = 1, select("#", ...) do texts[i] = show((select(i, ...)), 0) end
        print(concat(texts, "\t"))
    end
)lua";

bool is_name(char c) { return std::isalnum(static_cast<unsigned char>(c)) || c == '_'; }

} // namespace

Dialogue::Dialogue(ScriptRun& run) : run_(run), lua_(run.lua()) {
    lua_.run_text("tb = require 'tribode'", "tribode");
    lua_.set_up([](lua_State* lua) {
        if (luaL_loadbufferx(lua, print_values.data(), print_values.size(), chunk_name, "t") != LUA_OK) {
            throw Error(lua_tostring(lua, -1));
        }
        lua_call(lua, 0, 1);
        lua_setfield(lua, LUA_REGISTRYINDEX, print_name);
        return 0;
    });
}

bool Dialogue::evaluate(const std::string& text) {
    bool complete = true;
    lua_.go_on();
    lua_.enter([&](lua_State* lua) {
        const std::string expression = "return " + text;
        if (luaL_loadbufferx(lua, expression.data(), expression.size(), chunk_name, "t") != LUA_OK) {
            lua_pop(lua, 1);
            if (luaL_loadbufferx(lua, text.data(), text.size(), chunk_name, "t") != LUA_OK) {
                const std::string problem = lua_tostring(lua, -1);
                complete = !problem.ends_with("<eof>");
                if (complete) throw InputError(problem);
                return 0;
            }
        }
        run_.add_text(text);
        lua_call(lua, 0, LUA_MULTRET);
        const int values = lua_gettop(lua);
        if (values == 0) return 0;
        luaL_checkstack(lua, 2, nullptr);
        lua_getfield(lua, LUA_REGISTRYINDEX, print_name);
        lua_insert(lua, 1);
        lua_call(lua, values, 0);
        return 0;
    });
    return complete;
}

std::vector<std::string> Dialogue::completions(std::string_view text) {
    std::size_t begin = text.size();
    while (begin > 0 && (is_name(text[begin - 1]) || text[begin - 1] == '.' || text[begin - 1] == ':')) --begin;
    const std::string_view whole = text.substr(begin);
    const auto last = whole.find_last_of(".:");
    const std::string_view path = last == std::string_view::npos ? "" : whole.substr(0, last + 1);
    const std::string_view part = whole.substr(path.size());
    std::vector<std::string> names;
    lua_.go_on();
    lua_.set_up([&](lua_State* lua) {
        lua_pushglobaltable(lua);
        for (std::size_t from = 0; from < path.size();) {
            const std::size_t end = path.find_first_of(".:", from);
            lua_pushlstring(lua, path.data() + from, end - from);
            if (lua_rawget(lua, -2) != LUA_TTABLE) return 0;
            from = end + 1;
        }
        for (lua_pushnil(lua); lua_next(lua, -2); lua_pop(lua, 1)) {
            if (lua_type(lua, -2) != LUA_TSTRING) continue;
            const std::string name = lua_tostring(lua, -2);
            if (!name.starts_with(part) || !std::all_of(name.begin(), name.end(), is_name)) continue;
            names.push_back(std::string(path) + name);
        }
        return 0;
    });
    std::sort(names.begin(), names.end());
    return names;
}

} // namespace tribode
