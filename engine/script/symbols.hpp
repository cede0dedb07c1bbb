#pragma once
#include "script/lua_state.hpp"
#include "system/expressions.hpp"

#include <memory>
#include <optional>

namespace tribode {

// Symbolic values in Lua: userdata with the arithmetic of numbers, whose results are terms of one graph. The functions
// of `math` and tb.where, tb.less and the like take numbers and symbolic values alike.
//
// What Lua would decide at once is refused: `<` and `==` between symbolic values, `%`, `//`. Lua asks nobody about `==`
// with a number and about `if x`, `and`, `or`, `not`; see the reader of systems.
struct Symbols {
    std::shared_ptr<Expressions> graph = std::make_shared<Expressions>();
    Term time = graph->variable("t");
    lua_State* running = nullptr; // where a run is under way: the thread that its functions are called on
};

// Puts the functions into the module and into `math`.
void add_symbols(LuaState& lua, const std::shared_ptr<Symbols>& symbols);

void push_symbol(lua_State* lua, Term term); // [-0, +1]
std::optional<Term> symbol_at(lua_State* lua, int index);

// The symbolic value or number at `index`; throws InputError, beginning with `what`. [-0, +0]
Term term_at(lua_State* lua, int index, Expressions& graph, const std::string& what);

} // namespace tribode
