#include "tribode/script/lookup_bindings.hpp"
#include "tribode/base/error.hpp"
#include "tribode/base/field_reader.hpp"
#include "tribode/base/text.hpp"
#include "tribode/script/trampoline.hpp"
#include "tribode/script/value.hpp"

#include <fmt/format.h>
#include <lua.hpp>

namespace tribode {

namespace {

using HeldTable = std::shared_ptr<const LookupTable>;

LookupTable::Points read_points(const Json& options, bool two) {
    const char* function = two ? "tb.table2" : "tb.table1";
    FieldReader fields(options, function);
    LookupTable::Points points;
    points.name = fields.text("name", "table");
    const auto list = [&](const char* key) { return fields.numbers(key, "", Allowed::finite, {}); };
    points.x = list("x");
    if (two) {
        points.y = list("y");
        const Json& rows = fields.value("z");
        if (!rows.is_array()) fields.fail("z", "must be a list of rows, one for each x");
        if (rows.size() != points.x.size()) {
            fields.fail("z", fmt::format("has {} rows, must have {}, one for each x", rows.size(), points.x.size()));
        }
        for (std::size_t i = 0; i < rows.size(); ++i) {
            const Json row{{"z", rows[i]}};
            FieldReader one(row, function);
            const auto values = one.numbers("z", "", Allowed::finite, {});
            if (values.size() != points.y.size()) {
                fields.fail(fmt::format("z[{}]", i + 1),
                            fmt::format("has {} values, must have {}, one for each y", values.size(), points.y.size()));
            }
            points.values.insert(points.values.end(), values.begin(), values.end());
        }
        points.y_unit = fields.text("y_unit", "");
        points.unit = fields.text("z_unit", "");
    } else {
        points.values = list("y");
        points.unit = fields.text("y_unit", "");
    }
    points.x_unit = fields.text("x_unit", "");
    using Interpolation = LookupTable::Interpolation;
    const std::string between = fields.choice("interpolation", {"linear", "pchip", "spline", "natural"}, "linear");
    points.interpolation = between == "linear"   ? Interpolation::linear
                           : between == "pchip"  ? Interpolation::pchip
                           : between == "spline" ? Interpolation::spline
                                                 : Interpolation::natural;
    using Extrapolation = LookupTable::Extrapolation;
    const std::string beyond = fields.choice("extrapolation", {"refuse", "hold", "linear"}, "refuse");
    points.extrapolation = beyond == "refuse" ? Extrapolation::refuse
                           : beyond == "hold" ? Extrapolation::hold
                                              : Extrapolation::linear;
    fields.finish();
    return points;
}

Term argument(lua_State* lua, int index, Expressions& graph, const std::string& what) {
    const Term term = term_at(lua, index, graph, what);
    if (!is_condition(graph[term].op)) return term;
    throw InputError(fmt::format("{}: found the condition {}, must be a value", what, graph.text(term)));
}

double number(lua_State* lua, int index, const std::string& what) {
    if (lua_type(lua, index) == LUA_TNUMBER) return lua_tonumber(lua, index);
    throw InputError(fmt::format("{}: found a {}, must be a number or a symbolic value", what,
                                 lua_isnone(lua, index) ? "nil" : luaL_typename(lua, index)));
}

// table(x) or table(x, y).
int look_up(lua_State* lua, Symbols& symbols, const HeldTable& table) {
    const bool two = table->variables() == 2;
    const auto what = [&](int variable) {
        return fmt::format("{}: argument {}", table->name(), two && variable == 1 ? "y" : "x");
    };
    if (symbol_at(lua, 1) || (two && symbol_at(lua, 2))) {
        auto& graph = *symbols.graph;
        const Term x = argument(lua, 1, graph, what(0)), y = two ? argument(lua, 2, graph, what(1)) : x;
        push_symbol(lua, graph.look_up(table, x, y));
        return 1;
    }
    const double x = number(lua, 1, what(0)), y = two ? number(lua, 2, what(1)) : 0;
    for (int variable = 0; variable < table->variables(); ++variable) {
        const double at = variable == 0 ? x : y;
        const auto [low, high] = table->domain(variable);
        // At the points at which an equation is tried out, it has no value there.
        if ((at >= low && at <= high) || symbols.state == Symbols::State::comparing) continue;
        throw InputError(fmt::format("{} = {} lies beyond the abscissas, from {} to {}; extrapolation = \"hold\" or "
                                     "\"linear\" goes on there",
                                     what(variable), to_text(at), to_text(low), to_text(high)));
    }
    lua_pushnumber(lua, table->value(x, y));
    return 1;
}

} // namespace

void add_lookups(LuaState& lua, const std::shared_ptr<Symbols>& symbols) {
    for (const bool two : {false, true}) {
        lua.add_stack_function(two ? "table2" : "table1", [symbols, two](lua_State* state) {
            if (!lua_istable(state, 1)) {
                throw InputError(fmt::format("tb.table{}: found a {}, must be a table of options", two ? 2 : 1,
                                             luaL_typename(state, 1)));
            }
            const Json options = to_json(state, 1, two ? "tb.table2: options" : "tb.table1: options");
            const auto table = std::make_shared<const LookupTable>(read_points(options, two));
            lua_pushnil(state);
            push_function(state, [symbols, table](lua_State* caller) { return look_up(caller, *symbols, table); });
            return 1;
        });
    }
}

} // namespace tribode
