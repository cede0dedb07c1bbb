#include "tribode/script/ordered_tables.hpp"
#include "tribode/base/error.hpp"
#include "tribode/script/trampoline.hpp"

#include <algorithm>
#include <cstdint>
#include <fmt/format.h>
#include <functional>
#include <limits>
#include <lua.hpp>
#include <numeric>
#include <span>
#include <string_view>
#include <utility>
#include <vector>

namespace tribode {

namespace {

// A key of a table and its place in the order.
struct Key {
    enum Rank { index, number, boolean, text, other };
    Rank rank = other;
    lua_Integer integer = 0; // of an index; where a whole number is below 1 or a boolean, too
    double real = 0;         // of another number
    std::string_view bytes;  // of a text; Lua owns them
    const void* place = nullptr;
    int slot = 0; // where the key stands on the way to its order

    friend bool operator<(const Key& a, const Key& b) {
        if (a.rank != b.rank) return a.rank < b.rank;
        switch (a.rank) {
        case index:
        case boolean: return a.integer < b.integer;
        case number: return a.real != b.real ? a.real < b.real : a.integer < b.integer;
        case text: return a.bytes < b.bytes;
        case other: break;
        }
        return std::less<>()(a.place, b.place);
    }
};

Key key_at(lua_State* lua, int at) {
    Key key;
    switch (lua_type(lua, at)) {
    case LUA_TNUMBER:
        key.rank = Key::number;
        key.real = lua_tonumber(lua, at);
        if (lua_isinteger(lua, at)) {
            key.integer = lua_tointeger(lua, at);
            if (key.integer > 0) key.rank = Key::index;
        }
        break;
    case LUA_TBOOLEAN:
        key.rank = Key::boolean;
        key.integer = lua_toboolean(lua, at);
        break;
    case LUA_TSTRING: {
        std::size_t length = 0;
        const char* bytes = lua_tolstring(lua, at, &length);
        key.rank = Key::text;
        key.bytes = {bytes, length};
        break;
    }
    default: key.place = lua_topointer(lua, at);
    }
    return key;
}

// Pushes the list of the keys of the table at index 1, in order. [-0, +1]
void push_ordered_keys(lua_State* lua) {
    std::vector<Key> keys;
    lua_newtable(lua);
    const int gathered = lua_gettop(lua);
    for (lua_pushnil(lua); lua_next(lua, 1);) {
        lua_pop(lua, 1);
        keys.push_back(key_at(lua, -1));
        keys.back().slot = static_cast<int>(keys.size());
        lua_pushvalue(lua, -1);
        lua_rawseti(lua, gathered, keys.back().slot);
    }
    charge_instructions(lua, keys.size());
    std::sort(keys.begin(), keys.end());
    lua_createtable(lua, static_cast<int>(keys.size()), 0);
    lua_Integer next = 0;
    for (const Key& key : keys) {
        lua_rawgeti(lua, gathered, key.slot);
        lua_rawseti(lua, -2, ++next);
    }
    lua_remove(lua, gathered);
}

// Pushes the first entry of the table at `table` behind place `at` of the list `keys` that is still there, or nil. Returns
// how many values it pushed; `at` becomes the place of the entry.
int push_entry_behind(lua_State* lua, int table, int keys, lua_Integer& at) {
    for (;;) {
        if (lua_rawgeti(lua, keys, ++at) == LUA_TNIL) return 1;
        lua_pushvalue(lua, -1);
        if (lua_rawget(lua, table) != LUA_TNIL) return 2;
        lua_pop(lua, 2);
    }
}

// Whether a table has nothing but the keys 1, 2, 3 ..., of which the order of Lua is the order here, or is empty.
bool is_plain_list(lua_State* lua, int table) {
    lua_Integer expected = 0;
    for (lua_pushnil(lua); lua_next(lua, table);) {
        lua_pop(lua, 1);
        if (lua_isinteger(lua, -1) && lua_tointeger(lua, -1) == ++expected) continue;
        lua_pop(lua, 1);
        return false;
    }
    return true;
}

void require_table(lua_State* lua, const char* function) {
    if (lua_istable(lua, 1)) return;
    throw InputError(fmt::format("bad argument #1 to '{}' (table expected, got {})", function,
                                 lua_isnone(lua, 1) ? "no value" : luaL_typename(lua, 1)));
}

// What `pairs` returns: the upvalues are the table, its keys, and the place.
int step(lua_State* lua) {
    lua_settop(lua, 0);
    lua_pushvalue(lua, lua_upvalueindex(1));
    lua_pushvalue(lua, lua_upvalueindex(2));
    lua_Integer at = lua_tointeger(lua, lua_upvalueindex(3));
    const int results = push_entry_behind(lua, 1, 2, at);
    lua_pushinteger(lua, at);
    lua_replace(lua, lua_upvalueindex(3));
    return results;
}

int ordered_pairs(lua_State* lua) {
    if (luaL_getmetafield(lua, 1, "__pairs") != LUA_TNIL) {
        lua_pop(lua, 1);
        return call_replaced(lua);
    }
    require_table(lua, "pairs");
    lua_settop(lua, 1);
    if (is_plain_list(lua, 1)) return call_replaced(lua);
    lua_pushvalue(lua, 1);
    push_ordered_keys(lua);
    lua_pushinteger(lua, 0);
    lua_pushcclosure(lua, step, 3);
    lua_pushvalue(lua, 1);
    lua_pushnil(lua);
    return 3;
}

// Pushes the registry's table of what `next` keeps: for a table, as long as that is there, the list of keys that the last
// call went through, with its place as entry 0.
void push_kept_orders(lua_State* lua) {
    constexpr const char* kept_orders = "tribode.orders";
    if (luaL_getsubtable(lua, LUA_REGISTRYINDEX, kept_orders)) return;
    lua_createtable(lua, 0, 1);
    lua_pushliteral(lua, "k");
    lua_setfield(lua, -2, "__mode");
    lua_setmetatable(lua, -2);
}

// Pushes the first entry of the table at index 1, or nil: mostly the question is whether it is empty.
int push_first_entry(lua_State* lua) {
    lua_settop(lua, 1);
    lua_pushnil(lua);
    Key first;
    std::uint64_t count = 0;
    for (lua_pushnil(lua); lua_next(lua, 1);) {
        lua_pop(lua, 1);
        const Key key = key_at(lua, -1);
        if (count++ > 0 && !(key < first)) continue;
        first = key;
        lua_pushvalue(lua, -1);
        lua_replace(lua, 2);
        if (key.rank == Key::index && key.integer == 1) {
            lua_settop(lua, 2);
            break;
        }
    }
    charge_instructions(lua, count);
    if (count == 0) return 1;
    lua_pushvalue(lua, 2);
    lua_rawget(lua, 1);
    return 2;
}

int ordered_next(lua_State* lua) {
    require_table(lua, "next");
    lua_settop(lua, 2);
    push_kept_orders(lua); // 3
    if (lua_isnil(lua, 2)) {
        lua_pushvalue(lua, 1);
        lua_pushnil(lua);
        lua_rawset(lua, 3);
        return push_first_entry(lua);
    }
    lua_pushvalue(lua, 1);
    lua_rawget(lua, 3); // 4: the kept list or nil
    lua_Integer at = 0;
    if (!lua_isnil(lua, 4)) {
        lua_rawgeti(lua, 4, 0);
        at = lua_tointeger(lua, -1);
        lua_rawgeti(lua, 4, at);
        if (!lua_rawequal(lua, -1, 2)) at = 0;
        lua_pop(lua, 2);
    }
    if (at == 0) {
        lua_settop(lua, 3);
        push_ordered_keys(lua); // 4
        lua_pushvalue(lua, 1);
        lua_pushvalue(lua, 4);
        lua_rawset(lua, 3);
        // Behind the key, which may be gone by now.
        const Key key = key_at(lua, 2);
        auto high = static_cast<lua_Integer>(lua_rawlen(lua, 4));
        while (at < high) {
            const lua_Integer middle = at + (high - at) / 2 + 1;
            lua_rawgeti(lua, 4, middle);
            const bool is_behind = key < key_at(lua, -1);
            lua_pop(lua, 1);
            if (is_behind) {
                high = middle - 1;
            } else {
                at = middle;
            }
        }
    }
    const int results = push_entry_behind(lua, 1, 4, at);
    lua_pushinteger(lua, at);
    lua_rawseti(lua, 4, 0);
    return results;
}

// Whether entry `a` of the list at index 3 comes before entry `b`, by the function at index 2 where there is one.
bool comes_before(lua_State* lua, lua_Integer a, lua_Integer b) {
    const bool by_function = !lua_isnil(lua, 2);
    if (by_function) lua_pushvalue(lua, 2);
    lua_rawgeti(lua, 3, a);
    lua_rawgeti(lua, 3, b);
    if (by_function) lua_call(lua, 2, 1);
    const bool before = by_function ? lua_toboolean(lua, -1) != 0 : lua_compare(lua, -2, -1, LUA_OPLT) != 0;
    lua_pop(lua, by_function ? 1 : 2);
    return before;
}

// The places of the entries of the list at index 3 in their order, as a part of `room` for twice as many. The sorts of the
// standard library may go astray where the function is no order.
std::span<std::uint32_t> merge_sorted(lua_State* lua, std::span<std::uint32_t> room) {
    const std::size_t n = room.size() / 2;
    std::span<std::uint32_t> order = room.first(n), merged = room.last(n);
    std::iota(order.begin(), order.end(), 1);
    for (std::size_t width = 1; width < n; width *= 2) {
        charge_instructions(lua, n);
        for (std::size_t begin = 0; begin < n; begin += 2 * width) {
            const std::size_t middle = std::min(begin + width, n), end = std::min(begin + 2 * width, n);
            std::size_t left = begin, right = middle;
            for (std::size_t at = begin; at < end; ++at) {
                const bool from_right = left == middle || (right < end && comes_before(lua, order[right], order[left]));
                merged[at] = order[from_right ? right++ : left++];
            }
        }
        std::swap(order, merged);
    }
    return order;
}

int stable_sort(lua_State* lua) {
    require_table(lua, "sort");
    if (!lua_isnoneornil(lua, 2) && !lua_isfunction(lua, 2)) {
        throw InputError(fmt::format("bad argument #2 to 'sort' (function expected, got {})", luaL_typename(lua, 2)));
    }
    lua_settop(lua, 2);
    const lua_Integer count = luaL_len(lua, 1);
    constexpr lua_Integer most = std::numeric_limits<int>::max();
    if (count >= most) throw InputError("bad argument #1 to 'sort' (array too big)");
    if (count < 2) return 0;
    charge_instructions(lua, static_cast<std::uint64_t>(count));
    lua_newtable(lua); // 3: the elements as they were
    const auto n = static_cast<std::size_t>(count);
    // 4: memory of Lua, so that it counts to the limit of the script
    auto* const room = static_cast<std::uint32_t*>(lua_newuserdatauv(lua, 2 * n * sizeof(std::uint32_t), 0));
    for (lua_Integer i = 1; i <= count; ++i) {
        lua_geti(lua, 1, i);
        lua_rawseti(lua, 3, i);
    }
    lua_Integer place = 0;
    for (const std::uint32_t from : merge_sorted(lua, {room, 2 * n})) {
        lua_rawgeti(lua, 3, from);
        lua_seti(lua, 1, ++place);
    }
    return 0;
}

// Field `name` of the table on top becomes `function`, with the old value for call_replaced. [-0, +0]
void replace_function(lua_State* lua, const char* name, lua_CFunction function) {
    lua_getfield(lua, -1, name);
    push_function(lua, function);
    lua_setfield(lua, -2, name);
}

} // namespace

void order_tables(lua_State* lua) {
    lua_pushglobaltable(lua);
    replace_function(lua, "pairs", ordered_pairs);
    replace_function(lua, "next", ordered_next);
    lua_getfield(lua, -1, "table");
    replace_function(lua, "sort", stable_sort);
    lua_pop(lua, 2);
}

} // namespace tribode
