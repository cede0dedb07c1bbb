#include "tribode/script/symbols.hpp"
#include "tribode/base/error.hpp"
#include "tribode/base/text.hpp"
#include "tribode/script/trampoline.hpp"

#include <algorithm>
#include <cmath>
#include <fmt/format.h>
#include <lua.hpp>

namespace tribode {

namespace {

constexpr const char* symbol_type = "tribode.symbol";

using Graph = std::shared_ptr<Symbols>;

// A function with no replaced one behind it, as field `name` of the table on top. [-0, +0]
void set_function(lua_State* lua, const char* name, LuaState::StackFunction function) {
    lua_pushnil(lua);
    push_function(lua, std::move(function));
    lua_setfield(lua, -2, name);
}

bool any_symbol(lua_State* lua) {
    for (int i = 1; i <= lua_gettop(lua); ++i) {
        if (symbol_at(lua, i)) return true;
    }
    return false;
}

// Operand `index` of a call without symbolic values: such a call leaves no trace in the graph.
double number_at(lua_State* lua, int index, const char* what) {
    if (lua_type(lua, index) == LUA_TNUMBER) return lua_tonumber(lua, index);
    throw InputError(fmt::format("{}: operand {} is a {}, must be a number or a symbolic value", what, index,
                                 luaL_typename(lua, index)));
}

const char* kind_at(lua_State* lua, int index) {
    if (symbol_at(lua, index)) return "symbolic value";
    return lua_isnoneornil(lua, index) ? "nil" : luaL_typename(lua, index);
}

// Operand `index` of an arithmetic operation: a value, not a condition.
// A condition below no_event is one, too.
bool is_condition_term(const Expressions& graph, Term term) {
    while (graph[term].op == Op::no_event) term = graph[term].a;
    return is_condition(graph[term].op);
}

Term value_at(lua_State* lua, int index, Expressions& graph, const char* what) {
    const Term term = term_at(lua, index, graph, what);
    if (is_condition_term(graph, term)) {
        throw InputError(fmt::format("{}: operand {} is the condition {}, must be a value; tb.where makes one of it",
                                     what, index, graph.text(term)));
    }
    return term;
}

// Every result of a symbolic operation goes through here.
void charge(lua_State* lua, const Expressions& graph) {
    constexpr std::size_t bytes_per_term = 128; // about, with its place in the table of terms
    charge_graph(lua, graph.size() * bytes_per_term);
}

void push_boolean_or_symbol(lua_State* lua, const Expressions& graph, Term condition) {
    charge(lua, graph);
    if (graph[condition].op == Op::constant) {
        lua_pushboolean(lua, graph[condition].value != 0);
    } else {
        push_symbol(lua, condition);
    }
}

void push_number_or_symbol(lua_State* lua, const Expressions& graph, Term value) {
    charge(lua, graph);
    if (graph[value].op == Op::constant) {
        lua_pushnumber(lua, graph[value].value);
    } else {
        push_symbol(lua, value);
    }
}

LuaState::StackFunction arithmetic(const Graph& symbols, Op op, const char* what) {
    return [symbols, op, what](lua_State* lua) {
        auto& graph = *symbols->graph;
        if (!any_symbol(lua)) {
            const double b = operand_count(op) > 1 ? number_at(lua, 2, what) : 0;
            lua_pushnumber(lua, apply(op, number_at(lua, 1, what), b, 0));
            return 1;
        }
        const Term a = value_at(lua, 1, graph, what);
        const Term b = operand_count(op) > 1 ? value_at(lua, 2, graph, what) : 0;
        push_number_or_symbol(lua, graph, graph.make(op, a, b));
        return 1;
    };
}

LuaState::StackFunction refused(const char* text) {
    return [text](lua_State*) -> int { throw InputError(text); };
}

// ---- conditions --------------------------------------------------------------------------------------------------

Term condition_at(lua_State* lua, int index, Expressions& graph, const char* what) {
    if (lua_isboolean(lua, index)) return graph.constant(lua_toboolean(lua, index));
    if (const auto term = symbol_at(lua, index); term && is_condition_term(graph, *term)) return *term;
    throw InputError(fmt::format("{}: argument {} is a {}, must be a condition, such as tb.less(x, 0)", what, index,
                                 kind_at(lua, index)));
}

LuaState::StackFunction relation(const Graph& symbols, Op op, bool turned, const char* what) {
    return [symbols, op, turned, what](lua_State* lua) {
        auto& graph = *symbols->graph;
        if (!any_symbol(lua)) {
            const double a = number_at(lua, 1, what), b = number_at(lua, 2, what);
            lua_pushboolean(lua, apply(op, turned ? b : a, turned ? a : b, 0) != 0);
            return 1;
        }
        Term a = value_at(lua, 1, graph, what), b = value_at(lua, 2, graph, what);
        if (turned) std::swap(a, b);
        push_boolean_or_symbol(lua, graph, graph.make(op, a, b));
        return 1;
    };
}

// Any number of conditions.
LuaState::StackFunction connective(const Graph& symbols, Op op, const char* what) {
    return [symbols, op, what](lua_State* lua) {
        auto& graph = *symbols->graph;
        Term result = graph.constant(op == Op::all);
        for (int i = 1; i <= lua_gettop(lua); ++i) {
            result = graph.make(op, result, condition_at(lua, i, graph, what));
        }
        push_boolean_or_symbol(lua, graph, result);
        return 1;
    };
}

int choose(const Graph& symbols, lua_State* lua) {
    auto& graph = *symbols->graph;
    if (lua_isboolean(lua, 1)) {
        lua_pushvalue(lua, lua_toboolean(lua, 1) ? 2 : 3);
        return 1;
    }
    const Term condition = condition_at(lua, 1, graph, "tb.where");
    const Term a = value_at(lua, 2, graph, "tb.where"), b = value_at(lua, 3, graph, "tb.where");
    push_number_or_symbol(lua, graph, graph.make(Op::select, condition, a, b));
    return 1;
}

int without_event(const Graph& symbols, lua_State* lua) {
    auto& graph = *symbols->graph;
    if (!any_symbol(lua)) {
        lua_pushnumber(lua, number_at(lua, 1, "tb.no_event"));
        return 1;
    }
    const auto condition = symbol_at(lua, 1);
    const bool is_one = condition && is_condition_term(graph, *condition);
    push_symbol(lua, graph.make(Op::no_event, is_one ? *condition : value_at(lua, 1, graph, "tb.no_event")));
    return 1;
}

// tb.before(x): what x was when the instant of an event began.
int at_beginning(const Graph& symbols, lua_State* lua) {
    auto& graph = *symbols->graph;
    push_number_or_symbol(lua, graph, graph.make(Op::before, value_at(lua, 1, graph, "tb.before")));
    return 1;
}

// tb.delay(x, seconds): while equations are tried out on numbers, x.
int delayed(const Graph& symbols, lua_State* lua) {
    auto& graph = *symbols->graph;
    if (symbols->state == Symbols::State::none) {
        throw InputError(
            "tb.delay belongs into an equation, where it is recorded; a function that is called with numbers "
            "keeps earlier ones in discrete variables");
    }
    const Term value = value_at(lua, 1, graph, "tb.delay"), seconds = value_at(lua, 2, graph, "tb.delay");
    if (graph[seconds].op == Op::constant && !(graph[seconds].value >= 0 && std::isfinite(graph[seconds].value))) {
        throw InputError(
            fmt::format("tb.delay: the delay is {} s, must be finite and not negative", to_text(graph[seconds].value)));
    }
    push_number_or_symbol(lua, graph, graph.make(Op::delay, value, seconds));
    return 1;
}

// ---- functions of `math` -----------------------------------------------------------------------------------------

// Field `name` of the table on top takes symbolic values too. [-0, +0]
void extend(lua_State* lua, const char* name, LuaState::StackFunction symbolic) {
    lua_getfield(lua, -1, name);
    push_function(lua, [symbolic = std::move(symbolic)](lua_State* state) {
        return any_symbol(state) ? symbolic(state) : call_replaced(state);
    });
    lua_setfield(lua, -2, name);
}

LuaState::StackFunction function_of_one(const Graph& symbols, Op op, const char* name) {
    return arithmetic(symbols, op, name);
}

// math.atan(y [, x]).
int arc_tangent(const Graph& symbols, lua_State* lua) {
    auto& graph = *symbols->graph;
    const Term y = value_at(lua, 1, graph, "math.atan");
    const bool two = !lua_isnoneornil(lua, 2);
    push_number_or_symbol(
        lua, graph, two ? graph.make(Op::atan2, y, value_at(lua, 2, graph, "math.atan")) : graph.make(Op::atan, y));
    return 1;
}

// math.log(x [, base]).
int logarithm(const Graph& symbols, lua_State* lua) {
    auto& graph = *symbols->graph;
    Term result = graph.make(Op::log, value_at(lua, 1, graph, "math.log"));
    if (!lua_isnoneornil(lua, 2)) {
        result = graph.make(Op::divide, result, graph.make(Op::log, value_at(lua, 2, graph, "math.log")));
    }
    push_number_or_symbol(lua, graph, result);
    return 1;
}

int absolute(const Graph& symbols, lua_State* lua) {
    auto& graph = *symbols->graph;
    const Term x = value_at(lua, 1, graph, "math.abs");
    push_number_or_symbol(
        lua, graph, graph.make(Op::select, graph.make(Op::less, x, graph.constant(0)), graph.make(Op::negate, x), x));
    return 1;
}

LuaState::StackFunction extreme(const Graph& symbols, bool least, const char* name) {
    return [symbols, least, name](lua_State* lua) {
        auto& graph = *symbols->graph;
        std::vector<Term> left;
        for (int i = 1; i <= std::max(lua_gettop(lua), 1); ++i) left.push_back(value_at(lua, i, graph, name));
        // In pairs, so that no long chain waits for one another.
        while (left.size() > 1) {
            std::vector<Term> next;
            for (std::size_t i = 0; i + 1 < left.size(); i += 2) {
                const Term a = left[i], b = left[i + 1];
                const Term nearer = least ? graph.make(Op::less, b, a) : graph.make(Op::less, a, b);
                next.push_back(graph.make(Op::select, nearer, b, a));
            }
            if (left.size() % 2 == 1) next.push_back(left.back());
            left = std::move(next);
        }
        push_number_or_symbol(lua, graph, left.front());
        return 1;
    };
}

constexpr const char* no_comparison =
    "a symbolic value cannot be compared while equations are recorded; tb.where(tb.less(a, b), x, y) takes a branch in "
    "an equation, a `when` changes it at an event";
constexpr const char* no_equality = "symbolic values cannot be compared with == while equations are recorded; an event "
                                    "is a `when` with tb.less and the "
                                    "like, a branch tb.where";
constexpr const char* no_remainder =
    "math.fmod, math.modf and math.tointeger of a symbolic value cannot be recorded; %, //, "
    "math.floor and math.ceil can";

// a // b, and a % b as its remainder.
LuaState::StackFunction quotient(const Graph& symbols, bool remainder, const char* what) {
    return [symbols, remainder, what](lua_State* lua) {
        auto& graph = *symbols->graph;
        const Term a = value_at(lua, 1, graph, what), b = value_at(lua, 2, graph, what);
        const Term whole = graph.make(Op::floor, graph.make(Op::divide, a, b));
        push_number_or_symbol(lua, graph,
                              remainder ? graph.make(Op::subtract, a, graph.make(Op::multiply, whole, b)) : whole);
        return 1;
    };
}

int round_up(const Graph& symbols, lua_State* lua) {
    auto& graph = *symbols->graph;
    const Term x = value_at(lua, 1, graph, "math.ceil");
    push_number_or_symbol(lua, graph, graph.make(Op::negate, graph.make(Op::floor, graph.make(Op::negate, x))));
    return 1;
}

void make_metatable(lua_State* lua, const Graph& symbols) {
    luaL_newmetatable(lua, symbol_type);
    set_function(lua, "__add", arithmetic(symbols, Op::add, "+"));
    set_function(lua, "__sub", arithmetic(symbols, Op::subtract, "-"));
    set_function(lua, "__mul", arithmetic(symbols, Op::multiply, "*"));
    set_function(lua, "__div", arithmetic(symbols, Op::divide, "/"));
    set_function(lua, "__pow", arithmetic(symbols, Op::power, "^"));
    set_function(lua, "__unm", arithmetic(symbols, Op::negate, "-"));
    set_function(lua, "__lt", refused(no_comparison));
    set_function(lua, "__le", refused(no_comparison));
    set_function(lua, "__eq", refused(no_equality));
    set_function(lua, "__mod", quotient(symbols, true, "%"));
    set_function(lua, "__idiv", quotient(symbols, false, "//"));
    set_function(lua, "__tostring", [symbols](lua_State* state) {
        lua_pushstring(state, symbols->graph->text(symbol_at(state, 1).value()).c_str());
        return 1;
    });
    lua_pushliteral(lua, "symbolic value");
    lua_setfield(lua, -2, "__name");
    lua_pushboolean(lua, false);
    lua_setfield(lua, -2, "__metatable");
    lua_pop(lua, 1);
}

// Refuses a function that gives another value at each call where equations are recorded: they would keep the first one. The
// table of the library is on top. [-0, +0]
void keep_out(lua_State* lua, const Graph& symbols, const char* name, const char* text) {
    if (lua_getfield(lua, -1, name) == LUA_TNIL) return lua_pop(lua, 1);
    push_function(lua, [symbols, text](lua_State* state) {
        if (symbols->state == Symbols::State::recording) throw InputError(text);
        return call_replaced(state);
    });
    lua_setfield(lua, -2, name);
}

constexpr const char* no_random = "math.random would give one number for the whole run, as an equation is recorded "
                                  "once; noise is a sample clock with "
                                  "tb.standard_normal in `call`";
constexpr const char* no_clock =
    "os.clock and os.time would give one number for the whole run, as an equation is recorded once; the time of the "
    "simulation is s.t";

void extend_math(lua_State* lua, const Graph& symbols) {
    lua_getglobal(lua, "math");
    const std::initializer_list<std::pair<const char*, Op>> functions = {
        {"sin", Op::sin},   {"cos", Op::cos}, {"tan", Op::tan},   {"asin", Op::asin},
        {"acos", Op::acos}, {"exp", Op::exp}, {"sqrt", Op::sqrt}, {"floor", Op::floor}};
    for (const auto& [name, op] : functions) extend(lua, name, function_of_one(symbols, op, name));
    extend(lua, "atan", [symbols](lua_State* state) { return arc_tangent(symbols, state); });
    extend(lua, "log", [symbols](lua_State* state) { return logarithm(symbols, state); });
    extend(lua, "abs", [symbols](lua_State* state) { return absolute(symbols, state); });
    extend(lua, "max", extreme(symbols, false, "math.max"));
    extend(lua, "min", extreme(symbols, true, "math.min"));
    extend(lua, "ceil", [symbols](lua_State* state) { return round_up(symbols, state); });
    keep_out(lua, symbols, "random", no_random);
    for (const char* name : {"fmod", "modf", "tointeger"}) extend(lua, name, refused(no_remainder));
    lua_pop(lua, 1);
    lua_getglobal(lua, "os");
    for (const char* name : {"clock", "time"}) keep_out(lua, symbols, name, no_clock);
    lua_pop(lua, 1);
}

} // namespace

void push_symbol(lua_State* lua, Term term) {
    *static_cast<Term*>(lua_newuserdatauv(lua, sizeof term, 0)) = term;
    luaL_setmetatable(lua, symbol_type);
}

std::optional<Term> symbol_at(lua_State* lua, int index) {
    const void* value = luaL_testudata(lua, index, symbol_type);
    if (!value) return std::nullopt;
    return *static_cast<const Term*>(value);
}

Term term_at(lua_State* lua, int index, Expressions& graph, const std::string& what) {
    if (const auto term = symbol_at(lua, index)) return *term;
    if (lua_type(lua, index) == LUA_TNUMBER) return graph.constant(lua_tonumber(lua, index));
    throw InputError(fmt::format("{}: found a {}, must be a number or a symbolic value", what, kind_at(lua, index)));
}

void add_symbols(LuaState& lua, const std::shared_ptr<Symbols>& symbols) {
    lua.set_up([&](lua_State* state) {
        make_metatable(state, symbols);
        extend_math(state, symbols);
        return 0;
    });
    lua.add_stack_function("less", relation(symbols, Op::less, false, "tb.less"));
    lua.add_stack_function("less_equal", relation(symbols, Op::less_equal, false, "tb.less_equal"));
    lua.add_stack_function("greater", relation(symbols, Op::less, true, "tb.greater"));
    lua.add_stack_function("greater_equal", relation(symbols, Op::less_equal, true, "tb.greater_equal"));
    lua.add_stack_function("all", connective(symbols, Op::all, "tb.all"));
    lua.add_stack_function("any", connective(symbols, Op::any, "tb.any"));
    lua.add_stack_function("negation", [symbols](lua_State* state) {
        auto& graph = *symbols->graph;
        push_boolean_or_symbol(state, graph, graph.make(Op::logical_not, condition_at(state, 1, graph, "tb.negation")));
        return 1;
    });
    lua.add_stack_function("where", [symbols](lua_State* state) { return choose(symbols, state); });
    lua.add_stack_function("no_event", [symbols](lua_State* state) { return without_event(symbols, state); });
    lua.add_stack_function("before", [symbols](lua_State* state) { return at_beginning(symbols, state); });
    lua.add_stack_function("delay", [symbols](lua_State* state) { return delayed(symbols, state); });
    lua.add_stack_function("tanh", arithmetic(symbols, Op::tanh, "tb.tanh"));
}

} // namespace tribode
