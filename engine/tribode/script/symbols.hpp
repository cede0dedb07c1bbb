#pragma once
#include "tribode/script/lua_state.hpp"
#include "tribode/system/expressions.hpp"

#include <memory>
#include <optional>

namespace tribode {

// Symbolic values in Lua: userdata with the arithmetic of numbers, whose results are terms of one graph. The functions
// of `math` and tb.where, tb.less and the like take numbers and symbolic values alike.
//
// What Lua would decide at once is refused: `<` and `==` between symbolic values. Lua asks nobody about `==`
// with a number and about `if x`, `and`, `or`, `not`; see the reader of systems.
struct Symbols {
    std::shared_ptr<Expressions> graph = std::make_shared<Expressions>();
    Term time = graph->variable("t");
    lua_State* running = nullptr; // where a run is under way: the thread that its functions are called on
    // What functions of equations are being called for.
    enum class State { none, recording, comparing };
    State state = State::none;
};

// What functions are called for, while it lasts; an error of Lua ends it too.
class CalledFor {
  public:
    CalledFor(Symbols& symbols, Symbols::State state) : symbols_(symbols), before_(symbols.state) {
        symbols.state = state;
    }
    ~CalledFor() { symbols_.state = before_; }
    CalledFor(const CalledFor&) = delete;
    CalledFor& operator=(const CalledFor&) = delete;

  private:
    Symbols& symbols_;
    Symbols::State before_;
};

// Puts the functions into the module and into `math`.
void add_symbols(LuaState& lua, const std::shared_ptr<Symbols>& symbols);

void push_symbol(lua_State* lua, Term term); // [-0, +1]
std::optional<Term> symbol_at(lua_State* lua, int index);

// The symbolic value or number at `index`; throws InputError, beginning with `what`. [-0, +0]
Term term_at(lua_State* lua, int index, Expressions& graph, const std::string& what);

} // namespace tribode
