#include "tribode/script/value.hpp"
#include "tribode/base/error.hpp"
#include "tribode/script/script_host.hpp"

#include <algorithm>
#include <cassert>
#include <fmt/format.h>
#include <limits>
#include <lua.hpp>

namespace tribode {

namespace {

constexpr int max_levels = 64;
constexpr std::size_t bytes_per_value = 16; // as in a Lua list

// Where the reader is: a chain of these lies on the C++ stack, so that a path is written for messages only.
struct Place {
    const Place* parent = nullptr;
    const void* table = nullptr; // identity of the table that is being read here
    const char* key = nullptr;   // name of the entry being read, or
    lua_Integer index = 0;       // its number in a list; 0: none yet
    int level = 1;
};

void append_path(std::string& path, const Place* place) {
    if (!place) return;
    append_path(path, place->parent);
    if (place->key) path.append(".").append(place->key);
    if (place->index) path.append(fmt::format("[{}]", place->index));
}

bool is_utf8(const std::string& text) {
    const auto is_ascii = [](unsigned char c) { return c < 0x80; };
    if (std::all_of(text.begin(), text.end(), is_ascii)) return true;
    try {
        Json(text).dump();
        return true;
    } catch (const Json::type_error&) {
        return false;
    }
}

class ValueReader {
  public:
    ValueReader(lua_State* lua, const std::string& name)
        : lua_(lua),
          name_(name),
          max_bytes_(host_of(lua).limits.memory_bytes),
          control_(host_of(lua).control) {}

    Json value(int index, const Place* place) {
        // As a line of a file, a value has two blanks for each level.
        spend(bytes_per_value + (place ? 2 * static_cast<std::size_t>(place->level) : 0), place);
        // A large table takes seconds, in which no instruction of Lua runs.
        if (++values_ % 65536 == 0 && control_.stop_requested()) throw EndedEarly("interrupted");
        switch (lua_type(lua_, index)) {
        case LUA_TNIL: return nullptr;
        case LUA_TBOOLEAN: return lua_toboolean(lua_, index) != 0;
        case LUA_TNUMBER:
            if (lua_isinteger(lua_, index)) return static_cast<std::int64_t>(lua_tointeger(lua_, index));
            return lua_tonumber(lua_, index);
        case LUA_TSTRING: return text(index, place);
        case LUA_TTABLE: return table(index, place);
        default:
            fail(place, fmt::format("is a {}, must be plain data: nil, a boolean, number, text or table",
                                    luaL_typename(lua_, index)));
        }
    }

  private:
    [[noreturn]] void fail(const Place* place, const std::string& problem) const {
        std::string path = name_;
        append_path(path, place);
        throw InputError(fmt::format("{} {}", path, problem));
    }

    // A table that is shared many times costs nothing in Lua and its full size here.
    void spend(std::size_t bytes, const Place* place) {
        bytes_ += bytes;
        if (bytes_ > max_bytes_) fail(place, "is part of a value larger than the memory limit of the script");
    }

    std::string text(int index, const Place* place) {
        std::size_t length = 0;
        const char* bytes = lua_tolstring(lua_, index, &length);
        spend(length, place);
        std::string text(bytes, length);
        if (!is_utf8(text)) fail(place, "is a text that is not UTF-8");
        return text;
    }

    Json table(int index, const Place* parent) {
        Place place{parent, lua_topointer(lua_, index), nullptr, 0, parent ? parent->level + 1 : 1};
        for (const Place* above = parent; above; above = above->parent) {
            if (above->table == place.table) fail(parent, "is a table that contains itself");
        }
        if (place.level > max_levels || !lua_checkstack(lua_, 3)) {
            fail(parent, fmt::format("is nested deeper than {} levels", max_levels));
        }
        const int at = lua_absindex(lua_, index);
        const auto [numbered, named] = count_keys(at, parent);
        if (numbered && named) fail(parent, "has both numbered entries and named fields, must have one kind");
        return numbered ? list(at, numbered, place) : fields(at, named, place);
    }

    struct KeyCount {
        std::size_t numbered = 0, named = 0;
    };

    KeyCount count_keys(int index, const Place* place) const {
        KeyCount count;
        lua_pushnil(lua_);
        while (lua_next(lua_, index)) {
            lua_pop(lua_, 1);
            if (lua_isinteger(lua_, -1)) {
                ++count.numbered;
            } else if (lua_type(lua_, -1) == LUA_TSTRING) {
                ++count.named;
            } else {
                fail(place,
                     fmt::format("has a key that is a {}, must be a text or a whole number", luaL_typename(lua_, -1)));
            }
        }
        return count;
    }

    // n numbered keys are 1..n exactly when none of these is missing.
    Json list(int index, std::size_t count, Place& place) {
        Json::array_t list;
        list.reserve(count);
        for (std::size_t i = 1; i <= count; ++i) {
            place.index = static_cast<lua_Integer>(i);
            if (lua_rawgeti(lua_, index, place.index) == LUA_TNIL) {
                fail(&place, "is missing: a list has the entries 1 to n without a hole");
            }
            list.push_back(value(-1, &place));
            lua_pop(lua_, 1);
        }
        return list;
    }

    Json fields(int index, std::size_t count, Place& place) {
        std::vector<std::pair<std::string, Json>> found;
        found.reserve(count);
        lua_pushnil(lua_);
        while (lua_next(lua_, index)) {
            place.key = lua_tostring(lua_, -2);
            std::string key = text(-2, &place);
            spend(sizeof(std::pair<std::string, Json>), &place);
            found.emplace_back(std::move(key), value(-1, &place));
            lua_pop(lua_, 1);
        }
        std::sort(found.begin(), found.end(), [](const auto& a, const auto& b) { return a.first < b.first; });
        Json::object_t object;
        object.reserve(count);
        for (auto& [key, field] : found) object.emplace_back(std::move(key), std::move(field));
        return object;
    }

    lua_State* lua_;
    const std::string& name_;
    std::size_t max_bytes_;
    const RunControl& control_;
    std::size_t bytes_ = 0, values_ = 0;
};

void push_text(lua_State* lua, const std::string& text) { lua_pushlstring(lua, text.data(), text.size()); }

void push_unsigned(lua_State* lua, std::uint64_t number) {
    constexpr auto most = static_cast<std::uint64_t>(std::numeric_limits<lua_Integer>::max());
    if (number <= most) {
        lua_pushinteger(lua, static_cast<lua_Integer>(number));
    } else {
        lua_pushnumber(lua, static_cast<double>(number));
    }
}

void push_value(lua_State* lua, const Json& value, int level);

void push_list(lua_State* lua, const Json& list, int level) {
    lua_createtable(lua, static_cast<int>(list.size()), 0);
    lua_Integer index = 0;
    for (const auto& entry : list) {
        push_value(lua, entry, level);
        lua_rawseti(lua, -2, ++index);
    }
}

void push_fields(lua_State* lua, const Json& object, int level) {
    lua_createtable(lua, 0, static_cast<int>(object.size()));
    for (const auto& [key, field] : object.items()) {
        push_text(lua, key);
        push_value(lua, field, level);
        lua_rawset(lua, -3);
    }
}

void push_value(lua_State* lua, const Json& value, int level) {
    if (level > max_levels || !lua_checkstack(lua, 3)) {
        throw InputError(fmt::format("the value is nested deeper than {} levels", max_levels));
    }
    switch (value.type()) {
    case Json::value_t::null: lua_pushnil(lua); break;
    case Json::value_t::boolean: lua_pushboolean(lua, value.get<bool>()); break;
    case Json::value_t::number_integer: lua_pushinteger(lua, value.get<lua_Integer>()); break;
    case Json::value_t::number_unsigned: push_unsigned(lua, value.get<std::uint64_t>()); break;
    case Json::value_t::number_float: lua_pushnumber(lua, value.get<double>()); break;
    case Json::value_t::string: push_text(lua, value.get_ref<const std::string&>()); break;
    case Json::value_t::array: push_list(lua, value, level + 1); break;
    case Json::value_t::object: push_fields(lua, value, level + 1); break;
    case Json::value_t::binary:
    case Json::value_t::discarded: assert(false && "not plain data"); lua_pushnil(lua);
    }
}

} // namespace

Json to_json(lua_State* lua, int index, const std::string& name) {
    if (!lua_checkstack(lua, 3)) throw InputError(fmt::format("{} is nested too deeply", name));
    return ValueReader(lua, name).value(index, nullptr);
}

void push(lua_State* lua, const Json& value) { push_value(lua, value, 0); }

} // namespace tribode
