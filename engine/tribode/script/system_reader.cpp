#include "tribode/script/system_reader.hpp"
#include "tribode/base/error.hpp"
#include "tribode/base/text.hpp"
#include "tribode/script/equation_recorder.hpp"
#include "tribode/script/ready_parts.hpp"
#include "tribode/script/table_fields.hpp"
#include "tribode/script/vector_names.hpp"
#include "tribode/system/algebraic_equations.hpp"
#include "tribode/system/contacts.hpp"
#include "tribode/system/input_delays.hpp"

#include <algorithm>
#include <cmath>
#include <fmt/format.h>
#include <lua.hpp>
#include <map>
#include <set>

namespace tribode {

namespace {

constexpr const char* system_type = "tribode.system";

using Held = std::shared_ptr<const Equations>;

int free_system(lua_State* lua) {
    static_cast<Held*>(lua_touserdata(lua, 1))->~Held();
    return 0;
}

bool is_name(const std::string& text) {
    const auto good = [](unsigned char c) { return std::isalnum(c) || c == '_'; };
    return !text.empty() && !std::isdigit(static_cast<unsigned char>(text[0])) &&
           std::all_of(text.begin(), text.end(), good);
}

class Reader {
  public:
    Reader(lua_State* lua, int index, const std::shared_ptr<Symbols>& symbols)
        : lua_(lua),
          index_(lua_absindex(lua, index)),
          symbols_(symbols),
          graph_(*symbols->graph),
          recorder_(lua, *symbols),
          ready_(lua, graph_) {
        made_.graph = symbols->graph;
        made_.time = symbols->time;
    }

    Equations read() {
        const std::vector<std::string> known = {
            "name",    "parameters", "inputs",    "states",    "discrete", "modes", "start_mode", "parts",
            "connect", "der",        "algebraic", "equations", "outputs",  "when",  "sample",     "free"};
        check_keys(lua_, index_, known, "tb.system");
        made_.name = has_field(lua_, index_, "name") ? text_field(lua_, index_, "name", "tb.system") : "system";
        read_parts();
        read_variables();
        read_modes();
        make_scope();
        const std::size_t own = own_states_;
        rates_.assign(own, std::nullopt);
        read_rates();
        read_when_list(index_, "tb.system: when", std::nullopt);
        read_mode_equations();
        ready_.record(recorder_);
        for (std::size_t i = 0; i < own; ++i) {
            auto& state = made_.states[part_states_ + i];
            if (!rates_[i]) {
                throw InputError(fmt::format("tb.system: der has no equation for the state {}; {} states need {} "
                                             "equations, and what is nil is none, such as a list at a symbolic value",
                                             state.name, own, own));
            }
            state.rate = *rates_[i];
        }
        read_algebraic_equations();
        read_outputs();
        read_samples();
        wire();
        read_free();
        assign_equations(made_);
        Equations tried = made_; // refuses what cannot be
        close_contacts(tried);
        take_out_delays(tried);
        return std::move(made_);
    }

  private:
    // { "k", "x.start" }
    void read_free() {
        if (!has_field(lua_, index_, "free")) return;
        std::vector<std::string> known;
        for (const auto& parameter : made_.parameters) known.push_back(parameter.name);
        for (const auto& state : made_.states) known.push_back(state.name + ".start");
        lua_getfield(lua_, index_, "free");
        const int list = lua_gettop(lua_);
        if (!lua_istable(lua_, list)) {
            throw InputError(
                fmt::format("tb.system: free is a {}, must be a list of names", luaL_typename(lua_, list)));
        }
        for (lua_Integer i = 1; i <= static_cast<lua_Integer>(lua_rawlen(lua_, list)); ++i) {
            lua_rawgeti(lua_, list, i);
            const std::string name = lua_type(lua_, -1) == LUA_TSTRING ? lua_tostring(lua_, -1) : "";
            lua_pop(lua_, 1);
            if (std::find(known.begin(), known.end(), name) == known.end()) {
                throw InputError(fmt::format("tb.system: free[{}] = \"{}\", must be a parameter or STATE.start{}", i,
                                             name, suggestion(name, known)));
            }
            made_.free.push_back(name);
        }
        lua_pop(lua_, 1);
    }

    struct Quantity {
        std::string name, unit;
        double value = 0, nominal = 1;
    };

    // { x = 1, v = { start = 0, unit = "m/s" } }
    std::vector<Quantity> quantities(const char* key, const char* value_key, bool with_nominal) {
        std::vector<Quantity> list;
        if (!has_field(lua_, index_, key)) return list;
        lua_getfield(lua_, index_, key);
        const int table = lua_gettop(lua_);
        const std::string where = fmt::format("tb.system: {}", key);
        if (!lua_istable(lua_, table)) {
            throw InputError(fmt::format("{} is a {}, must be a table of names", where, luaL_typename(lua_, table)));
        }
        for (const auto& name : names_of(lua_, table, where)) {
            if (!is_name(name) || name == "t") {
                throw InputError(fmt::format("{}: \"{}\" cannot be a name: letters, digits and _ make one, and t is "
                                             "the time",
                                             where, name));
            }
            Quantity made{name, "", 0, 1};
            const std::string place = fmt::format("{}.{}", where, name);
            if (lua_getfield(lua_, table, name.c_str()) != LUA_TTABLE) {
                lua_pop(lua_, 1);
                made.value = number_field(lua_, table, name.c_str(), where, std::nullopt);
                list.push_back(std::move(made));
                continue;
            }
            std::vector<std::string> known = {value_key, "unit", "size"};
            if (with_nominal) known.emplace_back("nominal");
            const int entry = lua_gettop(lua_);
            check_keys(lua_, entry, known, place);
            if (has_field(lua_, entry, "unit")) made.unit = text_field(lua_, entry, "unit", place);
            made.nominal = number_field(lua_, entry, "nominal", place, 1.0);
            if (!(made.nominal > 0)) {
                throw InputError(fmt::format("{}: nominal = {}, must be positive", place, to_text(made.nominal)));
            }
            const auto fallback = std::string(key) == "parameters" ? std::nullopt : std::optional<double>(0);
            if (has_field(lua_, entry, "size")) {
                add_vector(entry, value_key, place, fallback, made, list);
            } else {
                made.value = number_field(lua_, entry, value_key, place, fallback);
                list.push_back(std::move(made));
            }
            lua_pop(lua_, 1);
        }
        lua_pop(lua_, 1);
        return list;
    }

    // { size = 3, start = 0 }, or a list of numbers, or a function of the index.
    void add_vector(int entry, const char* value_key, const std::string& place, std::optional<double> fallback,
                    const Quantity& common, std::vector<Quantity>& list) {
        constexpr double most = 1e6;
        const double size = number_field(lua_, entry, "size", place, std::nullopt);
        if (!(size >= 1 && size <= most) || size != std::floor(size)) {
            throw InputError(
                fmt::format("{}: size = {}, must be a whole number from 1 to {}", place, to_text(size), most));
        }
        const int type = lua_getfield(lua_, entry, value_key);
        const int values = lua_gettop(lua_);
        const auto count = static_cast<lua_Integer>(size);
        if (type == LUA_TTABLE && static_cast<lua_Integer>(lua_rawlen(lua_, values)) != count) {
            throw InputError(
                fmt::format("{}: {} has {} values, must have {}", place, value_key, lua_rawlen(lua_, values), count));
        }
        for (lua_Integer i = 1; i <= count; ++i) {
            Quantity made = common;
            made.name = element_name(common.name, static_cast<std::size_t>(i));
            if (type == LUA_TTABLE) {
                lua_rawgeti(lua_, values, i);
            } else if (type == LUA_TFUNCTION) {
                lua_pushvalue(lua_, values);
                lua_pushinteger(lua_, i);
                lua_call(lua_, 1, 1);
            } else {
                lua_pushvalue(lua_, values);
            }
            if (lua_isnil(lua_, -1) && fallback) {
                made.value = *fallback;
            } else if (lua_type(lua_, -1) == LUA_TNUMBER && std::isfinite(lua_tonumber(lua_, -1))) {
                made.value = lua_tonumber(lua_, -1);
            } else {
                throw InputError(
                    fmt::format("{}: {} of element {} is {}, must be a finite number", place, value_key, i,
                                lua_isnil(lua_, -1) ? "missing" : fmt::format("a {}", luaL_typename(lua_, -1))));
            }
            lua_pop(lua_, 1);
            list.push_back(std::move(made));
        }
        lua_pop(lua_, 1);
    }

    // ---- variables ---------------------------------------------------------------------------------------------

    void read_variables() {
        for (const auto& q : quantities("parameters", "value", false)) {
            made_.parameters.push_back({q.name, q.unit, q.value, graph_.variable(q.name)});
        }
        for (const auto& q : quantities("inputs", "value", false)) {
            made_.inputs.push_back({q.name, q.unit, q.value, graph_.variable(q.name)});
        }
        for (const auto& q : quantities("states", "start", true)) {
            made_.states.push_back({q.name, q.unit, q.value, q.nominal, graph_.variable(q.name), 0});
        }
        own_states_ = made_.states.size() - part_states_;
        for (const auto& q : quantities("algebraic", "start", true)) {
            made_.states.push_back({q.name, q.unit, q.value, q.nominal, graph_.variable(q.name), 0});
        }
        for (const auto& q : quantities("discrete", "start", false)) {
            made_.discrete.push_back({q.name, q.unit, q.value, graph_.variable(q.name), {}});
        }
    }

    void read_modes() {
        if (!has_field(lua_, index_, "modes")) {
            if (has_field(lua_, index_, "start_mode"))
                throw InputError("tb.system: there is a start_mode, but no modes");
            return;
        }
        lua_getfield(lua_, index_, "modes");
        if (!lua_istable(lua_, -1)) throw InputError("tb.system: modes must be a table of named modes");
        modes_ = names_of(lua_, lua_gettop(lua_), "tb.system: modes");
        lua_pop(lua_, 1);
        const std::string start = text_field(lua_, index_, "start_mode", "tb.system");
        const double first = mode_number(start, "tb.system: start_mode");
        mode_ = graph_.variable("mode");
        made_.discrete.push_back({"mode", "", first, mode_, modes_});
    }

    double mode_number(const std::string& name, const std::string& where) const {
        const auto found = std::find(modes_.begin(), modes_.end(), name);
        if (found == modes_.end()) {
            throw InputError(fmt::format("{}: \"{}\" is not a mode{}", where, name, suggestion(name, modes_)));
        }
        return static_cast<double>(found - modes_.begin());
    }

    void make_scope() {
        recorder_.add("t", made_.time, "");
        std::set<std::string> names;
        const auto add = [&](const auto& list) {
            for (const auto& variable : list) {
                recorder_.add(variable.name, variable.symbol, variable.unit);
                if (names.insert(variable.name).second) continue;
                throw InputError(
                    fmt::format("{}: the name {} stands twice, each must stand once", made_.name, variable.name));
            }
        };
        add(made_.parameters);
        add(made_.inputs);
        add(made_.states);
        add(made_.discrete);
        for (const auto& [name, stand_in] : part_outputs_) recorder_.add(name, stand_in, unit_of(stand_in));
    }

    // ---- equations ---------------------------------------------------------------------------------------------

    // der of the table on top of the stack, as [state] -> rate. [-0, +0]
    std::map<std::size_t, Term> rates_at(int table, const std::string& what) {
        std::map<std::size_t, Term> rates;
        lua_getfield(lua_, table, "der");
        std::string line = lua_isfunction(lua_, -1) ? line_of(lua_, lua_gettop(lua_)) : "";
        if (line.ends_with(": ")) line.resize(line.size() - 2);
        std::map<std::string, std::size_t> places;
        for (std::size_t i = 0; i < own_states_; ++i) places[made_.states[part_states_ + i].name] = i;
        for (const auto& entry : recorder_.record(what, false)) {
            const auto place = places.find(entry.name);
            if (place == places.end()) {
                std::vector<std::string> known;
                for (const auto& [name, number] : places) known.push_back(name);
                throw InputError(
                    fmt::format("{}: {} is not a state{}", what, entry.name, suggestion(entry.name, known)));
            }
            rates[place->second] = entry.term;
            const std::string& unit = made_.states[part_states_ + place->second].unit;
            require_unit(entry, dimension_of(unit.empty() ? "" : fmt::format("({})/s", unit)), "the derivative");
            made_.states[part_states_ + place->second].where = line;
        }
        return rates;
    }

    void read_rates() {
        if (!has_field(lua_, index_, "der")) return;
        for (const auto& [state, rate] : rates_at(index_, "tb.system: der")) rates_[state] = rate;
    }

    void read_mode_equations() {
        if (modes_.empty()) return;
        lua_getfield(lua_, index_, "modes");
        const int modes = lua_gettop(lua_);
        std::vector<std::vector<std::optional<Term>>> by_mode;
        for (std::size_t m = 0; m < modes_.size(); ++m) {
            const std::string where = fmt::format("tb.system: modes.{}", modes_[m]);
            lua_getfield(lua_, modes, modes_[m].c_str());
            const int table = lua_gettop(lua_);
            check_keys(lua_, table, {"der", "equations", "outputs", "when"}, where);
            by_mode.push_back(rates_);
            if (has_field(lua_, table, "der")) {
                for (const auto& [state, rate] : rates_at(table, where + ".der")) by_mode.back()[state] = rate;
            }
            read_when_list(table, where + ".when", m);
            for (std::size_t i = 0; i < rates_.size(); ++i) {
                if (by_mode.back()[i]) continue;
                throw InputError(fmt::format("{}: there is no equation for the state {}, neither here nor in der",
                                             where, made_.states[part_states_ + i].name));
            }
            lua_pop(lua_, 1);
        }
        lua_pop(lua_, 1);
        for (std::size_t i = 0; i < rates_.size(); ++i) {
            Term rate = *by_mode.back()[i];
            for (std::size_t m = modes_.size() - 1; m-- > 0;) {
                rate = graph_.make(Op::select, in_mode(m), *by_mode[m][i], rate);
            }
            rates_[i] = rate;
        }
    }

    Term in_mode(std::size_t mode) { return graph_.make(Op::equal, mode_, graph_.constant(static_cast<double>(mode))); }

    Equations::Assignments assignments_at(int table, const std::string& what) {
        Equations::Assignments set;
        if (has_field(lua_, table, "set")) {
            lua_getfield(lua_, table, "set");
            for (const auto& entry : recorder_.record(what + ".set", false)) {
                set.emplace_back(target(entry.name, what), entry.term);
                require_unit(entry, dimension_of(unit_of(set.back().first)), "the new value");
            }
        }
        if (has_field(lua_, table, "mode")) {
            const double number = mode_number(text_field(lua_, table, "mode", what), what + ".mode");
            set.emplace_back(mode_, graph_.constant(number));
        }
        return set;
    }

    // ---- algebraic equations -----------------------------------------------------------------------------------

    struct Residual {
        Term term = 0;
        std::string where;
    };

    // The term of that name in the mode the system is in; `always` in a system without modes.
    template <class Entry>
    Term chosen_by_mode(const std::vector<std::map<std::string, Entry, ElementOrder>>& by_mode, const std::string& name,
                        Term Entry::*term, const char* kind, Term always) {
        for (std::size_t m = by_mode.size(); m-- > 0;) {
            const auto own = by_mode[m].find(name);
            if (own == by_mode[m].end()) {
                throw InputError(fmt::format("tb.system: modes.{}: there is no {} {}, neither here nor in {}s",
                                             modes_[m], kind, name, kind));
            }
            const Term value = own->second.*term;
            always = m + 1 == by_mode.size() ? value : graph_.make(Op::select, in_mode(m), value, always);
        }
        return always;
    }

    // Of the function on top of the stack, by name. [-1, +0]
    void add_residuals(const std::string& what, std::map<std::string, Residual, ElementOrder>& residuals) {
        std::string line = lua_isfunction(lua_, -1) ? line_of(lua_, lua_gettop(lua_)) : "";
        if (line.ends_with(": ")) line.resize(line.size() - 2);
        for (const auto& entry : recorder_.record(what, false)) residuals[entry.name] = {entry.term, line};
    }

    // `equations`, and in their place those of the same names of a mode: as many as there are algebraic variables.
    void read_algebraic_equations() {
        std::map<std::string, Residual, ElementOrder> always;
        if (has_field(lua_, index_, "equations")) {
            lua_getfield(lua_, index_, "equations");
            add_residuals("tb.system: equations", always);
        }
        auto all = always;
        std::vector<std::map<std::string, Residual, ElementOrder>> by_mode;
        for (const auto& mode : modes_) {
            auto& own = by_mode.emplace_back(always);
            lua_getfield(lua_, index_, "modes");
            lua_getfield(lua_, -1, mode.c_str());
            if (has_field(lua_, lua_gettop(lua_), "equations")) {
                lua_getfield(lua_, -1, "equations");
                add_residuals(fmt::format("tb.system: modes.{}.equations", mode), own);
            }
            lua_pop(lua_, 2);
            all.insert(own.begin(), own.end());
        }
        const std::size_t first = part_states_ + own_states_, count = made_.states.size() - first;
        if (all.size() != count) {
            std::vector<std::string> names, variables;
            for (const auto& [name, residual] : all) names.push_back(name);
            for (std::size_t i = first; i < made_.states.size(); ++i) variables.push_back(made_.states[i].name);
            const auto listed = [](const std::vector<std::string>& list) {
                return list.empty() ? std::string() : fmt::format(" ({})", fmt::join(list, ", "));
            };
            throw InputError(
                fmt::format("tb.system: there are {} equations{} for {} algebraic variables{}, must be as many",
                            all.size(), listed(names), count, listed(variables)));
        }
        std::size_t place = first;
        for (auto& [name, residual] : all) {
            residual.term = chosen_by_mode(by_mode, name, &Residual::term, "equation", residual.term);
            auto& variable = made_.states[place++];
            variable.rate = residual.term;
            variable.equation = name;
            variable.where = residual.where;
        }
    }

    // A state or discrete variable, of this system or a part.
    Term target(const std::string& name, const std::string& what) const {
        std::vector<std::string> known;
        for (std::size_t i = 0; i < made_.states.size(); ++i) {
            const auto& state = made_.states[i];
            // Those of this system have no equation as yet.
            const bool algebraic = state.is_algebraic() || i >= part_states_ + own_states_;
            if (!algebraic) known.push_back(state.name);
            if (state.name != name) continue;
            if (!algebraic) return state.symbol;
            throw InputError(
                fmt::format("{}: {} is an algebraic variable, whose value follows from the equations; set a "
                            "state or a discrete variable that they depend on",
                            what, name));
        }
        for (const auto& discrete : made_.discrete) {
            if (discrete.name == name) return discrete.symbol;
        }
        for (const auto& discrete : made_.discrete) known.push_back(discrete.name);
        throw InputError(
            fmt::format("{}: {} is neither a state nor a discrete variable{}", what, name, suggestion(name, known)));
    }

    // The list `when` of a table; in a mode, it holds there only.
    void read_when_list(int table, const std::string& where, std::optional<std::size_t> mode) {
        if (!has_field(lua_, table, "when")) return;
        lua_getfield(lua_, table, "when");
        const int list = lua_gettop(lua_);
        if (!lua_istable(lua_, list)) throw InputError(fmt::format("{} must be a list of tables", where));
        const auto count = static_cast<lua_Integer>(lua_rawlen(lua_, list));
        if (count == 0 && has_entries(lua_, list)) throw InputError(fmt::format("{} must be a list of tables", where));
        for (lua_Integer i = 1; i <= count; ++i) {
            lua_rawgeti(lua_, list, i);
            read_when(lua_gettop(lua_), fmt::format("{}[{}]", where, i), mode);
            lua_pop(lua_, 1);
        }
        lua_pop(lua_, 1);
    }

    void read_when(int table, const std::string& what, std::optional<std::size_t> mode) {
        check_keys(lua_, table, {"name", "condition", "crossing", "direction", "set", "mode", "at_start", "stop"},
                   what);
        Equations::When when;
        when.name = has_field(lua_, table, "name") ? text_field(lua_, table, "name", what)
                                                   : fmt::format("when[{}]", made_.whens.size() + 1);
        const bool crossing = has_field(lua_, table, "crossing");
        if (crossing == has_field(lua_, table, "condition")) {
            throw InputError(fmt::format("{}: must have either a condition or a crossing", what));
        }
        lua_getfield(lua_, table, crossing ? "crossing" : "condition");
        Term watched = recorder_.record(what + (crossing ? ".crossing" : ".condition"), true)[0].term;
        when.set = assignments_at(table, what);
        when.at_start = flag_field(lua_, table, "at_start", what);
        when.stop = flag_field(lua_, table, "stop", what);
        const auto add = [&](Term condition) {
            when.condition = mode ? graph_.make(Op::all, in_mode(*mode), condition) : condition;
            made_.whens.push_back(when);
        };
        const auto& node = graph_[watched];
        if (!crossing) {
            if (has_field(lua_, table, "direction"))
                throw InputError(fmt::format("{}: direction belongs to a crossing", what));
            if (!is_condition(node.op) && node.op != Op::constant) {
                throw InputError(fmt::format("{}.condition returns the value {}, must return a condition, such as "
                                             "tb.less(s.x, 0)",
                                             what, graph_.text(watched)));
            }
            return add(watched);
        }
        const std::string direction =
            has_field(lua_, table, "direction") ? text_field(lua_, table, "direction", what) : "falling";
        const Term zero = graph_.constant(0);
        if (direction != "falling" && direction != "rising" && direction != "both") {
            throw InputError(
                fmt::format("{}: direction = \"{}\", must be one of falling, rising, both", what, direction));
        }
        if (direction != "rising") add(graph_.make(Op::less, watched, zero));
        if (direction != "falling") add(graph_.make(Op::less, zero, watched));
    }

    void read_outputs() {
        std::map<std::string, Equations::Output, ElementOrder> always;
        if (has_field(lua_, index_, "outputs")) {
            lua_getfield(lua_, index_, "outputs");
            for (const auto& entry : recorder_.record("tb.system: outputs", false)) {
                always[entry.name] = {entry.name, unit_of(entry), entry.term};
            }
        }
        auto outputs = always;
        std::vector<std::map<std::string, Equations::Output, ElementOrder>> by_mode;
        for (const auto& mode : modes_) {
            auto& own = by_mode.emplace_back(always);
            lua_getfield(lua_, index_, "modes");
            lua_getfield(lua_, -1, mode.c_str());
            if (lua_getfield(lua_, -1, "outputs") == LUA_TNIL) {
                lua_pop(lua_, 3);
                continue;
            }
            for (const auto& entry : recorder_.record(fmt::format("tb.system: modes.{}.outputs", mode), false)) {
                own[entry.name] = {entry.name, unit_of(entry), entry.term};
                outputs.try_emplace(entry.name, own[entry.name]);
            }
            lua_pop(lua_, 2);
        }
        for (auto& [name, output] : outputs) {
            output.value = chosen_by_mode(by_mode, name, &Equations::Output::value, "output", output.value);
            made_.outputs.push_back(output);
        }
    }

    // ---- sample clocks -----------------------------------------------------------------------------------------

    void read_samples() {
        if (!has_field(lua_, index_, "sample")) return;
        lua_getfield(lua_, index_, "sample");
        const int list = lua_gettop(lua_);
        if (!lua_istable(lua_, list)) throw InputError("tb.system: sample must be a list of tables");
        const auto count = static_cast<lua_Integer>(lua_rawlen(lua_, list));
        if (count == 0 && has_entries(lua_, list)) throw InputError("tb.system: sample must be a list of tables");
        for (lua_Integer i = 1; i <= count; ++i) {
            lua_rawgeti(lua_, list, i);
            read_sample(lua_gettop(lua_), fmt::format("tb.system: sample[{}]", i));
            lua_pop(lua_, 1);
        }
        lua_pop(lua_, 1);
    }

    void read_sample(int table, const std::string& what) {
        check_keys(lua_, table, {"name", "period_s", "offset_s", "set", "mode", "call"}, what);
        Equations::Clock clock;
        clock.name = has_field(lua_, table, "name") ? text_field(lua_, table, "name", what)
                                                    : fmt::format("sample[{}]", made_.clocks.size() + 1);
        clock.period = number_field(lua_, table, "period_s", what, std::nullopt);
        clock.offset = number_field(lua_, table, "offset_s", what, 0.0);
        if (!(clock.period > 0) || !(clock.offset >= 0)) {
            throw InputError(fmt::format("{}: period_s = {} s and offset_s = {} s, must be positive and not negative",
                                         what, to_text(clock.period), to_text(clock.offset)));
        }
        clock.set = assignments_at(table, what);
        if (has_field(lua_, table, "call")) clock.function = called(table, what + ".call");
        made_.clocks.push_back(std::move(clock));
    }

    // A Lua function that is called at each sample, on numbers. It is called once here, at the start values, to see
    // what it sets.
    Equations::Function called(int table, const std::string& what) {
        lua_getfield(lua_, table, "call");
        if (!lua_isfunction(lua_, -1)) {
            throw InputError(fmt::format("{} is a {}, must be a function", what, luaL_typename(lua_, -1)));
        }
        const std::string line = line_of(lua_, lua_gettop(lua_));
        const Scope& scope = recorder_.scope();
        lua_pushvalue(lua_, -1);
        const int reference = luaL_ref(lua_, LUA_REGISTRYINDEX); // kept as long as the state
        push_scope(lua_, scope, [&](std::size_t i) { lua_pushnumber(lua_, start_of(scope.terms[i])); });
        lua_pushinteger(lua_, 0);
        lua_call(lua_, 2, 1);
        if (!lua_istable(lua_, -1)) {
            throw InputError(fmt::format("{}{} returns a {}, must return a table of named values", line, what,
                                         luaL_typename(lua_, -1)));
        }
        std::vector<std::string> names;
        for (const auto& name : names_of(lua_, lua_gettop(lua_), line + what)) {
            if (lua_getfield(lua_, -1, name.c_str()) == LUA_TTABLE) {
                const auto count = static_cast<std::size_t>(lua_rawlen(lua_, -1));
                for (std::size_t i = 1; i <= count; ++i) names.push_back(element_name(name, i));
            } else {
                names.push_back(name);
            }
            lua_pop(lua_, 1);
        }
        lua_pop(lua_, 1);
        Equations::Function function;
        function.reads = scope.terms;
        for (const auto& name : names) function.writes.push_back(target(name, line + what));
        function.call = [symbols = symbols_, scope, names, reference,
                         where = line + what](long k, std::span<const double> read, std::span<double> written) {
            lua_State* lua = symbols->running;
            const int top = lua_gettop(lua);
            lua_rawgeti(lua, LUA_REGISTRYINDEX, reference);
            push_values(lua, scope, read);
            lua_pushinteger(lua, k);
            lua_call(lua, 2, 1);
            for (std::size_t i = 0; i < names.size(); ++i) {
                const int returned = lua_gettop(lua);
                const auto element = element_of(names[i]);
                if (lua_istable(lua, returned) && lua_getfield(lua, returned, names[i].c_str()) == LUA_TNIL &&
                    element) {
                    lua_getfield(lua, returned, element->first.c_str());
                    if (lua_istable(lua, -1)) lua_rawgeti(lua, -1, static_cast<lua_Integer>(element->second));
                }
                if (lua_type(lua, -1) != LUA_TNUMBER || !std::isfinite(lua_tonumber(lua, -1))) {
                    throw InputError(fmt::format("{}: at sample {} {} is no finite number", where, k, names[i]));
                }
                written[i] = lua_tonumber(lua, -1);
                lua_settop(lua, returned);
            }
            lua_settop(lua, top);
        };
        return function;
    }

    double start_of(Term symbol) const {
        for (const auto& p : made_.parameters) {
            if (p.symbol == symbol) return p.value;
        }
        for (const auto& i : made_.inputs) {
            if (i.symbol == symbol) return i.value;
        }
        for (const auto& s : made_.states) {
            if (s.symbol == symbol) return s.start;
        }
        for (const auto& d : made_.discrete) {
            if (d.symbol == symbol) return d.start;
        }
        return 0;
    }

    // ---- parts -------------------------------------------------------------------------------------------------

    void read_parts() {
        if (!has_field(lua_, index_, "parts")) return;
        lua_getfield(lua_, index_, "parts");
        const int parts = lua_gettop(lua_);
        if (!lua_istable(lua_, parts)) throw InputError("tb.system: parts must be a table of named systems");
        for (const auto& name : names_of(lua_, parts, "tb.system: parts")) {
            if (!is_name(name) || name == "t")
                throw InputError(fmt::format("tb.system: parts: \"{}\" cannot be a name", name));
            lua_getfield(lua_, parts, name.c_str());
            if (!ready_.declare(name, lua_gettop(lua_), made_)) add_part(name, lua_gettop(lua_));
            lua_pop(lua_, 1);
        }
        lua_pop(lua_, 1);
        for (const auto& output : ready_.outputs()) part_outputs_.push_back(output);
        part_states_ = made_.states.size();
        part_clocks_ = static_cast<std::ptrdiff_t>(made_.clocks.size());
    }

    // The system at `place`, with variables of its own: a system may be part twice.
    void add_part(const std::string& name, int place) {
        const Equations* system = system_at(lua_, place);
        if (!system) {
            throw InputError(fmt::format("tb.system: parts.{} is a {}, must be a system (see tb.system) or one of "
                                         "tb.parts",
                                         name, luaL_typename(lua_, place)));
        }
        Equations part = *system;
        Expressions::Replacement own;
        const auto rename = [&](auto& list) {
            for (auto& variable : list) {
                variable.name = name + "." + variable.name;
                const Term other = graph_.variable(variable.name);
                own[variable.symbol] = other;
                variable.symbol = other;
            }
        };
        rename(part.states);
        for (auto& state : part.states) {
            if (state.is_algebraic()) state.equation = name + "." + state.equation;
        }
        rename(part.discrete);
        rename(part.parameters);
        rename(part.inputs);
        for (auto& contact : part.contacts) {
            contact.name = name + "." + contact.name;
            own[contact.force] = graph_.variable(name + "." + graph_.name(contact.force));
        }
        part.replace(own);
        const auto renamed = [&](Term& term) { term = own.at(term); };
        const auto append = [](auto& to, auto& from) {
            to.insert(to.end(), std::make_move_iterator(from.begin()), std::make_move_iterator(from.end()));
        };
        for (auto& when : part.whens) {
            when.name = name + "." + when.name;
            for (auto& [target, value] : when.set) renamed(target);
        }
        for (auto& clock : part.clocks) {
            clock.name = name + "." + clock.name;
            for (auto& [target, value] : clock.set) renamed(target);
            if (!clock.function) continue;
            for (auto& write : clock.function->writes) renamed(write);
        }
        for (auto& contact : part.contacts) {
            renamed(contact.force);
            renamed(contact.mode);
        }
        for (auto& output : part.outputs) {
            output.name = name + "." + output.name;
            const Term stand_in = graph_.variable(output.name);
            part_outputs_.emplace_back(output.name, stand_in);
            definition_[stand_in] = output.value;
        }
        append(made_.states, part.states);
        append(made_.discrete, part.discrete);
        append(made_.parameters, part.parameters);
        append(made_.inputs, part.inputs);
        append(made_.outputs, part.outputs);
        append(made_.whens, part.whens);
        append(made_.clocks, part.clocks);
        append(made_.contacts, part.contacts);
    }

    // Puts what is connected to the inputs of the parts in their place, in an order in which each is known before it
    // is needed.
    void wire() {
        if (has_field(lua_, index_, "connect")) {
            lua_getfield(lua_, index_, "connect");
            for (const auto& entry : recorder_.record("tb.system: connect", false)) connect(entry);
        }
        ready_.define(definition_);
        Expressions::Replacement known;
        std::vector<Term> chain;
        for (const auto& [variable, term] : std::map<Term, Term>(definition_.begin(), definition_.end())) {
            resolve(variable, known, chain);
        }
        made_.replace(known);
        std::erase_if(made_.inputs, [&](const auto& input) { return known.contains(input.symbol); });
        ready_.close(made_, known);
        order_clocks();
    }

    // The clocks of parts, so that those that meet set what others read before it is read. Where they need each other,
    // and within one part, the order stays.
    void order_clocks() {
        const auto reads = [&](const Equations::Clock& clock) {
            std::vector<Term> terms;
            for (const auto& [target, value] : clock.set) terms.push_back(value);
            if (clock.function) terms.insert(terms.end(), clock.function->reads.begin(), clock.function->reads.end());
            return graph_.variables_of(terms);
        };
        const auto part_of = [](const std::string& name) { return name.substr(0, name.find('.')); };
        const auto sets_for = [&](const Equations::Clock& giver, const std::vector<Term>& read) {
            const auto is_read = [&](Term target) { return std::binary_search(read.begin(), read.end(), target); };
            return std::any_of(giver.set.begin(), giver.set.end(), [&](const auto& s) { return is_read(s.first); }) ||
                   (giver.function &&
                    std::any_of(giver.function->writes.begin(), giver.function->writes.end(), is_read));
        };
        std::vector<Equations::Clock> open, ordered;
        std::move(made_.clocks.begin(), made_.clocks.begin() + part_clocks_, std::back_inserter(open));
        while (!open.empty()) {
            const auto is_ready = [&](const Equations::Clock& clock) {
                const auto read = reads(clock);
                return std::none_of(open.begin(), open.end(), [&](const Equations::Clock& other) {
                    const bool same_part = part_of(other.name) == part_of(clock.name);
                    return same_part ? &other < &clock : sets_for(other, read);
                });
            };
            auto next = std::find_if(open.begin(), open.end(), is_ready);
            if (next == open.end()) next = open.begin();
            ordered.push_back(std::move(*next));
            open.erase(next);
        }
        std::move(ordered.begin(), ordered.end(), made_.clocks.begin());
    }

    void connect(const Recorded& entry) {
        std::vector<std::string> inputs;
        for (const auto& input : made_.inputs) {
            if (input.name.find('.') == std::string::npos) continue;
            inputs.push_back(input.name);
            if (input.name != entry.name) continue;
            if (!fit(entry.dimension, dimension_of(input.unit))) {
                const std::string unit = unit_of(entry.term);
                throw InputError(fmt::format("tb.system: connect: {} is in {}, {} in {}, must be in the same unit",
                                             entry.name, input.unit, graph_.text(entry.term),
                                             unit.empty() ? to_text(entry.dimension) : unit));
            }
            definition_[input.symbol] = entry.term;
            return;
        }
        throw InputError(fmt::format("tb.system: connect: {} is not an input of a part{}", entry.name,
                                     suggestion(entry.name, inputs)));
    }

    // Of an output, for which none needs to be written: that of the variable that it is, or what its terms are in where that
    // is no SI unit, such as mm.
    std::string unit_of(const Recorded& output) const {
        if (!output.unit.empty()) return output.unit;
        if (auto unit = unit_of(output.term); !unit.empty()) return unit;
        return is_si(output.dimension) ? "" : to_text(output.dimension);
    }

    // Of a term that is a variable by itself; empty where it is not, or has none.
    std::string unit_of(Term term) const {
        const auto among = [&](const auto& list) {
            const auto found = std::find_if(list.begin(), list.end(), [&](const auto& v) { return v.symbol == term; });
            return found == list.end() ? std::string() : found->unit;
        };
        for (const auto& [name, stand_in] : part_outputs_) {
            if (stand_in != term) continue;
            for (const auto& output : made_.outputs) {
                if (output.name == name) return output.unit;
            }
        }
        return among(made_.states) + among(made_.discrete) + among(made_.inputs) + among(made_.parameters);
    }

    void resolve(Term variable, Expressions::Replacement& known, std::vector<Term>& chain) {
        if (known.contains(variable)) return;
        if (const auto before = std::find(chain.begin(), chain.end(), variable); before != chain.end()) {
            std::vector<std::string> members;
            for (auto member = before; member != chain.end(); ++member) members.push_back(graph_.name(*member));
            members.push_back(graph_.name(variable));
            throw InputError(fmt::format("tb.system: the connections are an algebraic loop: {}; a state or a sample in "
                                         "one of them opens it",
                                         fmt::join(members, " needs ")));
        }
        chain.push_back(variable);
        Term term = definition_.at(variable);
        for (const Term used : graph_.variables_of(std::span(&term, 1))) {
            if (definition_.contains(used)) resolve(used, known, chain);
        }
        chain.pop_back();
        known[variable] = graph_.substitute(std::span(&term, 1), known)[0];
    }

    lua_State* lua_;
    int index_;
    std::shared_ptr<Symbols> symbols_;
    Expressions& graph_;
    EquationRecorder recorder_;
    ReadyParts ready_;
    Equations made_;
    std::vector<std::string> modes_;
    Term mode_ = 0;
    std::size_t part_states_ = 0;    // the states of parts come first, with their algebraic variables
    std::size_t own_states_ = 0;     // then those of this system, and then its algebraic variables
    std::ptrdiff_t part_clocks_ = 0; // and their clocks
    std::vector<std::pair<std::string, Term>> part_outputs_;
    std::unordered_map<Term, Term> definition_; // of inputs and outputs of parts
    std::vector<std::optional<Term>> rates_;    // of the own states
};

} // namespace

Equations read_system(lua_State* lua, int index, const std::shared_ptr<Symbols>& symbols) {
    if (!lua_istable(lua, index)) {
        throw InputError(fmt::format("tb.system: found a {}, must be a table", luaL_typename(lua, index)));
    }
    return Reader(lua, index, symbols).read();
}

void push_system(lua_State* lua, Equations equations) {
    auto* place = lua_newuserdatauv(lua, sizeof(Held), 0);
    new (place) Held(std::make_shared<const Equations>(std::move(equations)));
    if (luaL_newmetatable(lua, system_type)) {
        lua_pushcfunction(lua, free_system);
        lua_setfield(lua, -2, "__gc");
        lua_pushboolean(lua, false);
        lua_setfield(lua, -2, "__metatable");
        lua_pushliteral(lua, "system");
        lua_setfield(lua, -2, "__name");
    }
    lua_setmetatable(lua, -2);
}

const Equations* system_at(lua_State* lua, int index) {
    const auto* held = static_cast<const Held*>(luaL_testudata(lua, index, system_type));
    return held ? held->get() : nullptr;
}

Term record_input(lua_State* lua, int index, const std::shared_ptr<Symbols>& symbols, const std::string& what) {
    EquationRecorder recorder(lua, *symbols, EquationRecorder::Argument::value);
    recorder.add("t", symbols->time, "");
    lua_pushvalue(lua, index);
    return recorder.record(what, true).front().term;
}

} // namespace tribode
