#include "tribode/script/equation_recorder.hpp"
#include "tribode/base/error.hpp"
#include "tribode/base/random.hpp"
#include "tribode/base/text.hpp"
#include "tribode/script/table_fields.hpp"
#include "tribode/script/trampoline.hpp"
#include "tribode/script/vector_names.hpp"
#include "tribode/system/tape.hpp"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <fmt/format.h>
#include <lua.hpp>
#include <set>

namespace tribode {

std::string line_of(lua_State* lua, int index) {
    lua_Debug info;
    lua_pushvalue(lua, index);
    lua_getinfo(lua, ">S", &info);
    return fmt::format("{}:{}: ", info.short_src, info.linedefined);
}

namespace {

// The table that holds a name, below the one on top, which it replaces; what remains of the name: a field, or the index of
// an element. [-0, +0]
std::pair<std::string, std::size_t> go_to(lua_State* lua, std::string_view name) {
    const auto enter = [&](const std::string& field) {
        luaL_getsubtable(lua, -1, field.c_str());
        lua_remove(lua, -2);
    };
    for (auto dot = name.find('.'); dot != std::string_view::npos; dot = name.find('.')) {
        enter(std::string(name.substr(0, dot)));
        name.remove_prefix(dot + 1);
    }
    if (const auto element = element_of(std::string(name))) {
        enter(element->first);
        return {"", element->second};
    }
    return {std::string(name), 0};
}

// The value on top into the table below it. [-1, +0]
void put(lua_State* lua, const std::pair<std::string, std::size_t>& place) {
    if (place.second > 0) {
        lua_rawseti(lua, -2, static_cast<lua_Integer>(place.second));
    } else {
        lua_setfield(lua, -2, place.first.c_str());
    }
}

void push_all(lua_State* lua, const Scope& scope, const std::function<void(std::size_t)>& push_value) {
    lua_newtable(lua);
    for (std::size_t i = 0; i < scope.names.size(); ++i) {
        lua_pushvalue(lua, -1);
        const auto place = go_to(lua, scope.names[i]);
        push_value(i);
        put(lua, place);
        lua_pop(lua, 1);
    }
}

using Names = std::shared_ptr<const std::vector<std::string>>;

// Instead of a value that is not there.
int refuse_index(lua_State* lua, const Names& names, const std::string& path, lua_Integer size) {
    if (symbol_at(lua, 2)) {
        throw InputError(
            fmt::format("{} is indexed by a symbolic value, which has no number while equations are recorded; "
                        "tb.where takes one of two values, tb.table1 values over an abscissa",
                        path.empty() ? "the table of variables" : path));
    }
    if (size > 0) {
        if (lua_isinteger(lua, 2) && lua_tointeger(lua, 2) == size + 1) return 0; // where ipairs ends
        throw InputError(fmt::format("{}[{}] is not there: {} has the elements 1 to {}", path,
                                     lua_isstring(lua, 2) ? lua_tostring(lua, 2) : luaL_typename(lua, 2), path, size));
    }
    const std::string name = lua_isstring(lua, 2) ? lua_tostring(lua, 2) : luaL_typename(lua, 2);
    throw InputError(fmt::format("{} is not a variable of the system{}", name, suggestion(name, *names)));
}

// Puts a table in the place of the one on top, through which it can be read only, and so for all tables in it. [-0, +0]
void guard(lua_State* lua, const Names& names, const std::string& path) {
    luaL_checkstack(lua, 10, nullptr);
    const int table = lua_gettop(lua);
    const auto size = static_cast<lua_Integer>(lua_rawlen(lua, table));
    lua_pushnil(lua);
    while (size == 0 && lua_next(lua, table)) {
        if (lua_istable(lua, -1)) {
            const std::string name = lua_tostring(lua, -2);
            guard(lua, names, path.empty() ? name : path + "." + name);
            lua_pushvalue(lua, -2);
            lua_insert(lua, -2);
            lua_rawset(lua, table);
        } else {
            lua_pop(lua, 1);
        }
    }
    lua_settop(lua, table);
    lua_createtable(lua, 0, 1);
    lua_pushnil(lua);
    push_function(lua, [names, path, size](lua_State* state) { return refuse_index(state, names, path, size); });
    lua_setfield(lua, -2, "__index");
    lua_setmetatable(lua, table);
    lua_newtable(lua);
    lua_createtable(lua, 0, 3);
    lua_pushvalue(lua, table);
    lua_setfield(lua, -2, "__index");
    lua_pushnil(lua);
    push_function(lua, [](lua_State*) -> int {
        throw InputError("the variables of a system cannot be set here; a function returns a table of new values");
    });
    lua_setfield(lua, -2, "__newindex");
    lua_pushnil(lua);
    push_function(lua, [size](lua_State* state) {
        lua_pushinteger(state, size);
        return 1;
    });
    lua_setfield(lua, -2, "__len");
    lua_setmetatable(lua, -2);
    lua_remove(lua, table);
}

} // namespace

void push_scope(lua_State* lua, const Scope& scope, const std::function<void(std::size_t)>& push_value) {
    push_all(lua, scope, push_value);
    // Of a vector its name alone.
    std::vector<std::string> names;
    for (const auto& name : scope.names) {
        const auto element = element_of(name);
        if (!element || element->second == 1) names.push_back(element ? element->first : name);
    }
    guard(lua, std::make_shared<const std::vector<std::string>>(std::move(names)), "");
}

void push_values(lua_State* lua, const Scope& scope, std::span<const double> values) {
    push_all(lua, scope, [&](std::size_t i) { lua_pushnumber(lua, values[i]); });
}

// Values of the variables of a scope at a point, each made where it is asked for, and which ones have been. So a comparison takes
// no time for variables that the function does not read, however many there are.
class EquationRecorder::Numbers {
  public:
    // All variables drawn at random; one may have a value of its own.
    void draw(std::uint64_t number) { draw_ = number, set_.clear(), all_.reset(), one_.reset(); }
    void set(std::size_t i, double value) { one_.emplace(i, value); }
    void set_all(double value) { all_ = value; }
    void set_all(const std::vector<double>& values) { set_ = values; }

    double value(std::size_t i) const {
        if (one_ && one_->first == i) return one_->second;
        if (all_) return *all_;
        if (!set_.empty()) return set_[i];
        // Of all sizes, mostly near one; half of the points positive.
        const double u = uniform(1, draw_, i);
        return (draw_ % 2 ? 2 * u : 4 * u - 2) * (draw_ % 5 == 4 ? 100 : 1);
    }
    double read(std::size_t i) {
        add(i);
        return value(i);
    }

    // Those that were read, in the order in which they were first.
    const std::vector<std::size_t>& known() const { return known_; }
    void add(std::size_t i) {
        if (is_known_.size() <= i) is_known_.resize(i + 1);
        if (!is_known_[i]) known_.push_back(i);
        is_known_[i] = true;
    }
    void forget() {
        for (const std::size_t i : known_) is_known_[i] = false;
        known_.clear();
    }

  private:
    std::uint64_t draw_ = 0;
    std::vector<double> set_;
    std::optional<double> all_;
    std::optional<std::pair<std::size_t, double>> one_;
    std::vector<std::size_t> known_;
    std::vector<bool> is_known_;
};

EquationRecorder::~EquationRecorder() {
    for (const int table : {symbols_table_, first_table_, numbers_table_}) luaL_unref(lua_, LUA_REGISTRYINDEX, table);
}

void EquationRecorder::add(const std::string& name, Term term, const std::string& unit) {
    place_.emplace(term, scope_.terms.size());
    scope_.add(name, term);
    units_.set(term, unit);
    if (const auto element = element_of(name)) vectors_[element->first] = element->second;
}

// The same table for each function. [-0, +1]
void EquationRecorder::push_symbols() {
    if (argument_ == Argument::value) return push_symbol(lua_, scope_.terms.front());
    if (symbols_table_ == LUA_NOREF) {
        push_scope(lua_, scope_, [&](std::size_t i) { push_symbol(lua_, scope_.terms[i]); });
        symbols_table_ = luaL_ref(lua_, LUA_REGISTRYINDEX);
    }
    lua_rawgeti(lua_, LUA_REGISTRYINDEX, symbols_table_);
}

// Puts a table in the place of the one on top, through which its numbers i are read as value(i), and so for all tables in it.
// [-0, +0]
static void read_through(lua_State* lua, const std::function<double(std::size_t)>& value) {
    luaL_checkstack(lua, 10, nullptr);
    const int table = lua_gettop(lua);
    lua_pushnil(lua);
    while (lua_next(lua, table)) {
        if (lua_istable(lua, -1)) {
            read_through(lua, value);
            lua_pushvalue(lua, -2);
            lua_insert(lua, -2);
            lua_rawset(lua, table);
        } else {
            lua_pop(lua, 1);
        }
    }
    lua_newtable(lua);
    lua_createtable(lua, 0, 2);
    lua_pushvalue(lua, table);
    push_function(lua, [value](lua_State* state) {
        lua_settop(state, 2);
        lua_rawget(state, lua_upvalueindex(2));
        if (!lua_isinteger(state, -1)) return 1;
        const auto i = static_cast<std::size_t>(lua_tointeger(state, -1));
        lua_pushnumber(state, value(i));
        return 1;
    });
    lua_setfield(lua, -2, "__index");
    lua_pushvalue(lua, table);
    push_function(lua, [](lua_State* state) {
        lua_pushinteger(state, static_cast<lua_Integer>(lua_rawlen(state, lua_upvalueindex(2))));
        return 1;
    });
    lua_setfield(lua, -2, "__len");
    lua_setmetatable(lua, -2);
    lua_remove(lua, table);
}

void EquationRecorder::make_numbers() {
    if (numbers_) return;
    numbers_ = std::make_shared<Numbers>();
    if (argument_ == Argument::value) return;
    push_all(lua_, scope_, [&](std::size_t i) { lua_pushinteger(lua_, static_cast<lua_Integer>(i)); });
    read_through(lua_, [numbers = numbers_](std::size_t i) { return numbers->read(i); });
    numbers_table_ = luaL_ref(lua_, LUA_REGISTRYINDEX);
    push_all(lua_, scope_, [&](std::size_t i) { lua_pushnumber(lua_, numbers_->value(i)); });
    first_table_ = luaL_ref(lua_, LUA_REGISTRYINDEX);
}

// The argument with numbers_: the same table for each function. [-0, +1]
void EquationRecorder::push_numbers() {
    if (argument_ == Argument::value) return lua_pushnumber(lua_, numbers_->read(0));
    lua_rawgeti(lua_, LUA_REGISTRYINDEX, numbers_table_);
}

std::vector<Recorded> EquationRecorder::record(const std::string& what, bool single) {
    if (!lua_isfunction(lua_, -1)) {
        throw InputError(
            fmt::format("{} is a {}, must be a function of the system's variables", what, luaL_typename(lua_, -1)));
    }
    const int function = lua_gettop(lua_);
    const std::string line = line_of(lua_, function);
    lua_pushvalue(lua_, function);
    push_symbols();
    {
        const CalledFor here(symbols_, Symbols::State::recording);
        called_.watch([&] {
            call_with_hint(
                lua_, 1, 1, "nil value (field '?')",
                "; a table that is indexed by a symbolic value gives nil, tb.table1 takes values over an abscissa");
        });
    }
    std::vector<Recorded> recorded = returned(what, line, single);
    lua_pop(lua_, 1);
    for (auto& entry : recorded) check_units(entry, line + what);
    const CalledFor here(symbols_, Symbols::State::comparing);
    compare(function, recorded, what, line, single);
    lua_pop(lua_, 1);
    return recorded;
}

Recorded EquationRecorder::named(const std::string& name, const std::string& what) {
    const auto found = std::find(scope_.names.begin(), scope_.names.end(), name);
    if (found == scope_.names.end()) {
        throw InputError(
            fmt::format("{}: {} is not a variable of the system{}", what, name, suggestion(name, scope_.names)));
    }
    Recorded made{"", "", scope_.terms[static_cast<std::size_t>(found - scope_.names.begin())]};
    check_units(made, what);
    return made;
}

void EquationRecorder::check_units(Recorded& entry, const std::string& what) {
    entry.what = entry.name.empty() ? what : fmt::format("{}: {}", what, entry.name);
    try {
        entry.dimension = units_.of(entry.term);
        entry.advice = units_.advice(entry.term);
    } catch (const InputError& problem) {
        throw InputError(fmt::format("{}: {}", entry.what, problem.what()));
    }
    require_unit(entry, dimension_of(entry.unit), "it");
}

void require_unit(const Recorded& entry, const Dimension& wanted, const char* what) {
    if (fit(entry.dimension, wanted)) return;
    throw InputError(fmt::format("{}: {} must be in {}, but is in {}{}", entry.what, what, to_text(wanted),
                                 to_text(entry.dimension), entry.advice));
}

// What stands on top of the stack. [-0, +0]
std::vector<Recorded> EquationRecorder::returned(const std::string& what, const std::string& line, bool single) {
    std::vector<Recorded> list;
    if (single) {
        list.push_back({"", "", result_at(lua_gettop(lua_), line + what)});
        return list;
    }
    const int table = lua_gettop(lua_);
    if (!lua_istable(lua_, table)) {
        throw InputError(fmt::format("{}{} returns a {}, must return a table of named values", line, what,
                                     luaL_typename(lua_, table)));
    }
    for (const auto& name : names_of(lua_, table, line + what)) {
        lua_getfield(lua_, table, name.c_str());
        add_returned(lua_gettop(lua_), name, fmt::format("{}{}: {}", line, what, name), list);
        lua_pop(lua_, 1);
    }
    return list;
}

// A value, { value, unit = "N" }, or the list of a vector, with a unit or without. [-0, +0]
void EquationRecorder::add_returned(int index, const std::string& name, const std::string& place,
                                    std::vector<Recorded>& list) {
    if (!lua_istable(lua_, index)) {
        list.push_back({name, "", result_at(index, place)});
        return;
    }
    // A vector of the scope as it is knows no other fields.
    const bool is_own = luaL_getmetafield(lua_, index, "__len") != LUA_TNIL;
    if (is_own) lua_pop(lua_, 1);
    const std::string unit = !is_own && has_field(lua_, index, "unit") ? text_field(lua_, index, "unit", place) : "";
    const auto count = static_cast<std::size_t>(luaL_len(lua_, index));
    const auto vector = vectors_.find(name);
    if (vector != vectors_.end() && vector->second != count) {
        throw InputError(fmt::format("{} has {} values, must have {}", place, count, vector->second));
    }
    const bool is_vector = vector != vectors_.end() || count > 1;
    for (std::size_t i = 1; i <= std::max<std::size_t>(count, 1); ++i) {
        lua_geti(lua_, index, static_cast<lua_Integer>(i));
        const std::string own = is_vector ? element_name(name, i) : name;
        list.push_back({own, unit, result_at(lua_gettop(lua_), is_vector ? fmt::format("{}[{}]", place, i) : place)});
        lua_pop(lua_, 1);
    }
}

Term EquationRecorder::result_at(int index, const std::string& what) {
    if (lua_isboolean(lua_, index)) return graph_.constant(lua_toboolean(lua_, index));
    return term_at(lua_, index, graph_, what);
}

// The value of an entry of what a call on numbers returned. [-0, +0]
std::optional<double> EquationRecorder::number_returned(int result, const Recorded& entry, bool single) const {
    const int top = lua_gettop(lua_);
    lua_pushvalue(lua_, result);
    if (!single) {
        if (!lua_istable(lua_, -1)) return lua_settop(lua_, top), std::nullopt;
        const auto element = element_of(entry.name);
        if (lua_getfield(lua_, -1, entry.name.c_str()) == LUA_TNIL && element) {
            lua_pop(lua_, 1);
            lua_getfield(lua_, -1, element->first.c_str());
            if (lua_istable(lua_, -1)) lua_geti(lua_, -1, static_cast<lua_Integer>(element->second));
        } else if (lua_istable(lua_, -1)) {
            lua_geti(lua_, -1, 1);
        }
    }
    std::optional<double> value;
    if (lua_isboolean(lua_, -1)) value = lua_toboolean(lua_, -1);
    if (lua_type(lua_, -1) == LUA_TNUMBER) value = lua_tonumber(lua_, -1);
    lua_settop(lua_, top);
    return value;
}

namespace {

// Changes one coordinate so that the expression has exactly the value; false where none was found that can.
bool move_to(const Tape& expression, double value, std::vector<double>& point) {
    double result = 0;
    for (double& x : point) {
        const double before = x;
        const auto miss_at = [&](double at) {
            x = at;
            expression.evaluate({point}, {&result, 1});
            return result - value;
        };
        double from = before, to = before + 1, miss = miss_at(from);
        for (int step = 0; step < 20; ++step) {
            const double next_miss = miss_at(to);
            if (next_miss == 0) return true;
            const double slope = (next_miss - miss) / (to - from);
            from = to;
            miss = next_miss;
            to -= next_miss / slope;
            if (!std::isfinite(to) || to == from) break;
        }
        // Numbers that are compared have few digits, and so has what gives them.
        for (const double digits : {1.0, 8.0, 100.0, 1000.0}) {
            if (std::isfinite(from) && miss_at(std::round(from * digits) / digits) == 0) return true;
        }
        x = before;
    }
    return false;
}

} // namespace

// Whether a rounding in it has a whole number, where Lua's % and the recorded one may be on either side.
bool EquationRecorder::is_at_jump(Term root, const std::vector<Term>& inputs, const std::vector<double>& point) const {
    std::vector<Term> operands;
    for (const Term term : graph_.reachable(std::span(&root, 1))) {
        if (graph_[term].op == Op::floor) operands.push_back(graph_[term].a);
    }
    std::vector<double> values(operands.size());
    Tape(graph_, inputs, operands).evaluate({point}, values);
    return std::any_of(values.begin(), values.end(),
                       [](double x) { return std::abs(x - std::round(x)) <= 1e-9 * (1 + std::abs(x)); });
}

// Calls the function on numbers and compares: at random points, and at points at which one variable, all of them, or an
// expression have a value that a comparison in a function of the script may name. Variables are those that the terms depend on and those
// that the function has read so far: a branch may read further ones.
void EquationRecorder::compare(int function, const std::vector<Recorded>& recorded, const std::string& what,
                               const std::string& line, bool single) {
    std::vector<Term> terms;
    for (const auto& entry : recorded) terms.push_back(entry.term);
    std::vector<Term> inputs = graph_.variables_of(terms);
    std::erase_if(inputs, [&](Term term) { return !place_.contains(term); }); // refused by the tape
    const Tape tape(graph_, inputs, terms);
    std::vector<double> point(inputs.size()), values(terms.size());
    make_numbers();
    Numbers& numbers = *numbers_;
    numbers.forget();
    for (const Term term : inputs) numbers.add(place_.at(term));
    // With the argument that is on top of the stack. [-1, +0]
    const auto check_on_top = [&] {
        for (std::size_t i = 0; i < inputs.size(); ++i) point[i] = numbers.value(place_.at(inputs[i]));
        tape.evaluate({point}, values);
        lua_pushvalue(lua_, function);
        lua_insert(lua_, -2);
        // What fails on numbers, fails for reasons of the point.
        if (lua_pcall(lua_, 1, 1, 0) != LUA_OK) return lua_pop(lua_, 1);
        for (std::size_t i = 0; i < recorded.size(); ++i) {
            const auto direct = number_returned(lua_gettop(lua_), recorded[i], single);
            const bool same =
                direct && (std::abs(*direct - values[i]) <= 1e-6 * (std::abs(*direct) + std::abs(values[i])) ||
                           !std::isfinite(*direct) || !std::isfinite(values[i]));
            // Where large numbers cancel, sums taken in another order differ by more.
            if (same || (direct && std::abs(*direct - values[i]) < 1e-9)) continue;
            if (is_at_jump(recorded[i].term, inputs, point)) continue;
            refuse_branch(what, line);
        }
        lua_pop(lua_, 1);
    };
    const auto check = [&] {
        push_numbers();
        check_on_top();
    };
    // The first point in a table of numbers, which next() and pairs() go through as others do not.
    constexpr std::uint64_t random_points = 20;
    numbers.draw(0);
    if (argument_ == Argument::table) {
        lua_rawgeti(lua_, LUA_REGISTRYINDEX, first_table_);
        check_on_top();
    }
    for (std::uint64_t draw = 0; draw < random_points; ++draw) {
        numbers.draw(draw);
        check();
    }
    // Of many variables some, as many as take no longer than the recording.
    const std::size_t count = std::max<std::size_t>(numbers.known().size(), 1);
    const std::size_t most = std::clamp<std::size_t>(200'000 / count, 10, 500);
    const std::size_t stride = (count + most - 1) / most;
    const auto compared = called_.numbers();
    for (const double value : compared) {
        numbers.draw(0);
        numbers.set_all(value);
        check();
        for (std::size_t i = 0; i < numbers.known().size(); i += stride) {
            numbers.draw(random_points + i);
            numbers.set(numbers.known()[i], value);
            check();
        }
    }
    if (!called_.compare_for_equality()) return;
    std::vector<double> all(scope_.terms.size());
    const auto check_at_all = [&] {
        numbers.draw(0);
        numbers.set_all(all);
        check();
    };
    // Two comparisons may decide together.
    constexpr std::size_t most_pairs = 500, most_compared = 8;
    const auto first = std::span(compared).first(std::min(compared.size(), most_compared));
    const auto known = numbers.known();
    const std::size_t pairs = known.size() * (known.size() - 1) / 2 * first.size() * first.size();
    for (std::size_t i = 0; i < known.size() && pairs <= most_pairs; ++i) {
        for (std::size_t j = 0; j < i; ++j) {
            for (const double a : first) {
                for (const double b : first) {
                    std::ranges::fill(all, 0.5);
                    all[known[i]] = a;
                    all[known[j]] = b;
                    check_at_all();
                }
            }
        }
    }
    // What is compared for equality may be an expression: points at which one of this scope has such a value.
    for (const Term term : expressions_of_scope()) {
        const Tape expression(graph_, scope_.terms, {term});
        for (const double value : compared) {
            for (std::size_t i = 0; i < all.size(); ++i) all[i] = static_cast<double>(i % 7) / 4 - 0.5;
            if (move_to(expression, value, all)) check_at_all();
        }
    }
}

// The newest expressions, not too many, that are made of the variables of the scope alone.
std::vector<Term> EquationRecorder::expressions_of_scope() const {
    constexpr std::size_t most = 100, looked_at = 1000;
    const std::size_t oldest = graph_.size() - std::min(graph_.size(), looked_at);
    const std::set<Term> known(scope_.terms.begin(), scope_.terms.end());
    std::vector<Term> list;
    for (std::size_t i = graph_.size(); i-- > oldest && list.size() < most;) {
        const auto term = static_cast<Term>(i);
        if (operand_count(graph_[term].op) == 0 || is_condition(graph_[term].op)) continue;
        const auto variables = graph_.variables_of(std::span(&term, 1));
        const bool is_own = std::all_of(variables.begin(), variables.end(), [&](Term v) { return known.contains(v); });
        if (is_own && !variables.empty()) list.push_back(term);
    }
    return list;
}

void EquationRecorder::refuse_branch(const std::string& what, const std::string& line) const {
    const std::string place = called_.deciding_line().value_or(line);
    throw InputError(fmt::format("{}{} takes a branch on the value of a variable (==, if, and, or, not), which is not "
                                 "recorded; tb.where(tb.less(a, b), x, y) takes a branch in an equation, a `when` "
                                 "changes it at an event",
                                 place, what));
}

} // namespace tribode
