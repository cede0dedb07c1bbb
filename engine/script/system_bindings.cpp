#include "script/system_bindings.hpp"
#include "base/error.hpp"
#include "base/field_reader.hpp"
#include "base/text.hpp"
#include "experiment/system_run.hpp"
#include "script/system_reader.hpp"
#include "script/value.hpp"

#include <cmath>
#include <fmt/format.h>
#include <lua.hpp>

namespace tribode {

namespace {

using Graph = std::shared_ptr<Symbols>;

// The system of an options table at index 1. [-0, +0]
Equations system_of(lua_State* lua, const char* function) {
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

// All other options as plain data, without those of `special`. [-0, +0]
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

// { name = number } into the variables of a list. [-0, +0]
template <class Variables, class Member>
void read_values(const Json& options, const char* key, Variables& variables, Member member, const char* function) {
    if (!options.contains(key)) return;
    FieldReader values(options[key], fmt::format("{}: {}", function, key));
    for (auto& variable : variables) {
        variable.*member = values.number(variable.name, variable.unit, Allowed::finite, variable.*member);
    }
    values.finish();
}

// A list of samples holds its first value from the start; its clock comes before all others.
void add_samples(Equations& equations, Equations::Input& input, double period, std::vector<double> values) {
    Equations::Clock clock;
    clock.name = "input " + input.name;
    clock.period = period;
    Equations::Function function;
    function.writes = {equations.graph->variable(input.name)};
    const Term held = function.writes[0];
    const double first = values.front();
    function.call = [values = std::move(values)](long k, std::span<const double>, std::span<double> written) {
        written[0] = values[std::min(static_cast<std::size_t>(k), values.size() - 1)];
    };
    clock.function = std::move(function);
    equations.clocks.insert(equations.clocks.begin(), std::move(clock));
    equations.discrete.push_back({input.name, input.unit, first, held, {}});
    equations.replace({{input.symbol, held}});
}

// inputs = { u = 3, v = function(t) return … end, w = { sample_time_s =, values = {…} } } [-0, +0]
void read_inputs(lua_State* lua, Equations& equations, const Graph& symbols, const char* function) {
    if (lua_getfield(lua, 1, "inputs") == LUA_TNIL) return lua_pop(lua, 1);
    if (!lua_istable(lua, -1)) throw InputError(fmt::format("{}: inputs must be a table of named inputs", function));
    std::vector<std::string> known;
    for (const auto& input : equations.inputs) known.push_back(input.name);
    lua_pushnil(lua);
    while (lua_next(lua, -2)) {
        const std::string name = lua_type(lua, -2) == LUA_TSTRING ? lua_tostring(lua, -2) : luaL_typename(lua, -2);
        const auto input = std::find_if(equations.inputs.begin(), equations.inputs.end(),
                                        [&](const auto& i) { return i.name == name; });
        const std::string what = fmt::format("{}: inputs.{}", function, name);
        if (input == equations.inputs.end()) {
            throw InputError(
                fmt::format("{}: inputs: {} is not an input of the system{}", function, name, suggestion(name, known)));
        }
        if (lua_isfunction(lua, -1)) {
            equations.replace({{input->symbol, record_input(lua, -1, symbols, what)}});
            equations.inputs.erase(input);
        } else if (lua_istable(lua, -1)) {
            const Json samples = to_json(lua, -1, what);
            FieldReader fields(samples, what);
            const double period = fields.number("sample_time_s", "s", Allowed::positive);
            auto values = fields.numbers("values", input->unit, Allowed::finite, {});
            fields.finish();
            if (values.empty()) throw InputError(fmt::format("{}.values is empty, must have a value", what));
            add_samples(equations, *input, period, std::move(values));
            equations.inputs.erase(input);
        } else {
            const Json number = to_json(lua, -1, what);
            if (!number.is_number() || !std::isfinite(number.get<double>())) {
                throw InputError(fmt::format("{} must be a finite number, a function of the time, or "
                                             "{{sample_time_s =, values =}}",
                                             what));
            }
            input->value = number.get<double>();
        }
        lua_pop(lua, 1);
    }
    lua_pop(lua, 1);
}

SystemRunOptions run_options(FieldReader& fields) {
    SystemRunOptions options;
    options.duration = fields.number("duration_s", "s", Allowed::positive);
    options.output_step = fields.number("output_step_s", "s", Allowed::non_negative, 0);
    auto& solver = options.solver;
    solver.method = method_named(fields.choice("solver", SolverOptions::method_names(), name_of(solver.method)));
    solver.relative_tolerance = fields.number("relative_tolerance", "", Allowed::positive, solver.relative_tolerance);
    solver.absolute_tolerance = fields.number("absolute_tolerance", "", Allowed::positive, solver.absolute_tolerance);
    solver.fixed_step = fields.number("fixed_step_s", "s", Allowed::positive, solver.fixed_step);
    return options;
}

Json statistics_of(const RunStatistics& s) {
    return {{"steps", s.steps},
            {"rejected_steps", s.rejected_steps},
            {"derivative_evaluations", s.derivative_evaluations},
            {"jacobian_evaluations", s.jacobian_evaluations},
            {"guard_evaluations", s.guard_evaluations},
            {"events", s.events},
            {"samples", s.samples},
            {"restarts", s.restarts}};
}

Json to_json(const SystemRun& run, const Equations& equations) {
    Json json{{"t", run.table["t"].values}, {"values", Json::object()}, {"columns", Json::array()}};
    for (const auto& column : run.table.columns) {
        if (column.name != "t") json["values"][column.name] = column.values;
        json["columns"].push_back({{"name", column.name}, {"unit", column.unit}, {"values", column.values}});
    }
    json["final"] = Json::object();
    for (std::size_t i = 0; i < equations.states.size(); ++i) {
        json["final"][equations.states[i].name] = run.final_states[i];
    }
    for (std::size_t i = 0; i < equations.discrete.size(); ++i) {
        const auto& discrete = equations.discrete[i];
        const double value = run.final_discrete[i];
        if (discrete.modes.empty()) {
            json["final"][discrete.name] = value;
        } else {
            json["final"][discrete.name] = discrete.modes[static_cast<std::size_t>(value)];
        }
    }
    json["events"] = Json::array();
    for (const auto& event : run.events) {
        json["events"].push_back(
            {{"t", event.t}, {"name", equations.whens[static_cast<std::size_t>(event.subject)].name}});
    }
    json["solver"] = name_of(run.method);
    json["ok"] = run.outcome.ok();
    json["message"] = run.outcome.message;
    json["t_end"] = run.outcome.t;
    json["statistics"] = statistics_of(run.statistics);
    return json;
}

// Where the functions of a system are called while it runs.
class RunningOn {
  public:
    RunningOn(Symbols& symbols, lua_State* lua) : symbols_(symbols), before_(symbols.running) { symbols.running = lua; }
    ~RunningOn() { symbols_.running = before_; }
    RunningOn(const RunningOn&) = delete;
    RunningOn& operator=(const RunningOn&) = delete;

  private:
    Symbols& symbols_;
    lua_State* before_;
};

int run_in_script(lua_State* lua, ScriptRun& run, const Graph& symbols) {
    Equations equations = system_of(lua, "tb.run");
    const Json options = plain_options(lua, {"system", "inputs"}, "tb.run: options");
    FieldReader fields(options, "tb.run");
    SystemRunOptions run_with = run_options(fields);
    for (const char* key : {"parameters", "start"}) fields.value(key);
    fields.finish();
    read_values(options, "parameters", equations.parameters, &Equations::Parameter::value, "tb.run");
    read_values(options, "start", equations.states, &Equations::State::start, "tb.run");
    read_inputs(lua, equations, symbols, "tb.run");

    const EquationSystem system(std::move(equations));
    const RunningOn here(*symbols, lua);
    const SystemRun result = run_system(system, run_with, run.control());
    if (result.outcome.end == RunEnd::interrupted) throw EndedEarly(result.outcome.message);
    run.note_work({{"function", "run"},
                   {"system", system.equations().name},
                   {"solver", name_of(result.method)},
                   {"outcome", result.outcome.message},
                   {"statistics", statistics_of(result.statistics)}});
    push(lua, to_json(result, system.equations()));
    return 1;
}

} // namespace

void add_system_bindings(LuaState& lua, ScriptRun& run) {
    const auto symbols = std::make_shared<Symbols>();
    add_symbols(lua, symbols);
    lua.add_stack_function("system", [symbols](lua_State* state) {
        push_system(state, read_system(state, 1, symbols));
        return 1;
    });
    lua.add_stack_function("run", [&run, symbols](lua_State* state) { return run_in_script(state, run, symbols); });
}

} // namespace tribode
