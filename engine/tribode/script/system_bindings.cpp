#include "tribode/script/system_bindings.hpp"
#include "tribode/analysis/frequency_response.hpp"
#include "tribode/analysis/loop_gain.hpp"
#include "tribode/base/error.hpp"
#include "tribode/base/field_reader.hpp"
#include "tribode/base/random.hpp"
#include "tribode/base/text.hpp"
#include "tribode/experiment/simulation.hpp"
#include "tribode/experiment/system_run.hpp"
#include "tribode/script/lookup_bindings.hpp"
#include "tribode/script/ready_parts.hpp"
#include "tribode/script/system_reader.hpp"
#include "tribode/script/value.hpp"
#include "tribode/script/vector_names.hpp"
#include "tribode/system/contacts.hpp"
#include "tribode/system/input_delays.hpp"
#include "tribode/system/linearization.hpp"
#include "tribode/system/steady_state.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <fmt/format.h>
#include <lua.hpp>
#include <map>

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
    close_contacts(copy);
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
    std::vector<std::string> names;
    for (const auto& variable : variables) names.push_back(variable.name);
    const std::string where = fmt::format("{}: {}", function, key);
    const Json flat = flattened(options[key], names, where);
    FieldReader values(flat, where);
    for (auto& variable : variables) {
        variable.*member = values.number(variable.name, variable.unit, Allowed::finite, variable.*member);
    }
    values.finish();
}

std::vector<std::string> names_of_values(const Equations& equations) {
    std::vector<std::string> names;
    for (const auto& state : equations.states) names.push_back(state.name);
    for (const auto& discrete : equations.discrete) names.push_back(discrete.name);
    return names;
}

// A mode is given by its name.
double discrete_value(FieldReader& values, const Equations::Discrete& discrete) {
    const auto& names = discrete.modes;
    if (names.empty()) return values.number(discrete.name, discrete.unit, Allowed::finite, discrete.start);
    const auto mode = values.choice(discrete.name, names, names[static_cast<std::size_t>(discrete.start)]);
    return static_cast<double>(std::find(names.begin(), names.end(), mode) - names.begin());
}

// What the samples of an input are, as cubics in (t - t_k)/period.
struct Samples {
    double period = 0, offset = 0; // [s]
    std::vector<std::array<double, 4>> pieces;
    std::size_t degree = 0; // beyond which all coefficients are zero
};

Samples read_samples(const Json& table, const std::string& unit, const std::string& what) {
    FieldReader fields(table, what);
    Samples samples;
    samples.period = fields.number("sample_time_s", "s", Allowed::positive);
    samples.offset = fields.number("offset_s", "s", Allowed::non_negative, 0);
    const auto values = fields.numbers("values", unit, Allowed::finite, {});
    const auto between = fields.choice("interpolation", {"hold", "linear", "band_limited"}, "hold");
    fields.finish();
    if (values.empty()) throw InputError(fmt::format("{}.values is empty, must have a value", what));
    if (between == "band_limited") {
        samples.degree = 3;
        samples.pieces = band_limited(values);
        return samples;
    }
    samples.degree = between == "linear" ? 1 : 0;
    for (std::size_t k = 0; k < values.size(); ++k) {
        const bool rises = between == "linear" && k + 1 < values.size();
        samples.pieces.push_back({values[k], rises ? values[k + 1] - values[k] : 0, 0, 0});
    }
    return samples;
}

// Of the names below, what stands behind that of the input.
bool is_held_part(std::string_view name) {
    return name == ".since" || name.starts_with("(t - ") ||
           (name.size() == 3 && name.starts_with(".c") && name[2] >= '0' && name[2] <= '3');
}

// The coefficients become discrete variables, whose clock comes before all others; what stands before the first sample is
// the input's value. Where it moves between its samples the input becomes an output.
void add_samples(Equations& equations, const Equations::Input& input, Samples samples, double start) {
    auto& graph = *equations.graph;
    Equations::Function function;
    std::vector<Term> held;
    const auto add = [&](const std::string& name, const std::string& unit, double value) {
        held.push_back(graph.variable(name));
        equations.discrete.push_back({name, unit, value, held.back(), {}});
    };
    // The sample at the start, or the last one before it.
    const double last = std::floor((start - samples.offset) / samples.period * (1 + 1e-15));
    const std::size_t piece = std::min(static_cast<std::size_t>(std::max(last, 0.0)), samples.pieces.size() - 1);
    const auto first = last >= 0 ? samples.pieces[piece] : std::array{input.value, 0.0, 0.0, 0.0};
    Term value = 0;
    if (samples.degree == 0) {
        add(input.name, input.unit, first[0]);
        value = held[0];
    } else {
        for (std::size_t n = 0; n <= samples.degree; ++n)
            add(fmt::format("{}.c{}", input.name, n), input.unit, first[n]);
        add(input.name + ".since", "s", last >= 0 ? samples.offset + last * samples.period : 0);
        const Term elapsed = graph.make(Op::subtract, equations.time, held.back());
        const Term s = graph.make(Op::multiply, graph.constant(1 / samples.period), elapsed);
        value = held[samples.degree];
        for (std::size_t n = samples.degree; n-- > 0;) {
            value = graph.make(Op::add, held[n], graph.make(Op::multiply, s, value));
        }
        equations.outputs.push_back({input.name, input.unit, value});
    }
    equations.replace({{input.symbol, value}});
    Equations::Clock clock{.name = "input " + input.name, .period = samples.period, .offset = samples.offset};
    function.writes = held;
    function.call = [samples = std::move(samples)](long k, std::span<const double>, std::span<double> written) {
        const auto& now = samples.pieces[std::min(static_cast<std::size_t>(k), samples.pieces.size() - 1)];
        std::copy_n(now.begin(), samples.degree + 1, written.begin());
        if (samples.degree > 0) written.back() = samples.offset + static_cast<double>(k) * samples.period;
    };
    clock.function = std::move(function);
    equations.clocks.insert(equations.clocks.begin(), std::move(clock));
}

// inputs = { u = 3, v = function(t) return … end, w = { sample_time_s =, values = {…}, … } } [-0, +0]
void read_inputs(lua_State* lua, Equations& equations, const Graph& symbols, double start, const char* function) {
    if (lua_getfield(lua, 1, "inputs") == LUA_TNIL) {
        lua_pop(lua, 1);
        lua_newtable(lua);
    }
    if (!lua_istable(lua, -1)) throw InputError(fmt::format("{}: inputs must be a table of named inputs", function));
    std::vector<std::string> known;
    std::map<std::string, std::size_t> vectors;
    for (const auto& input : equations.inputs) {
        known.push_back(input.name);
        if (const auto element = element_of(input.name)) vectors[element->first] = element->second;
    }
    auto delays = take_out_delays(equations);
    // Calls `connect` for the delayed ones of an input, which are connected then.
    const auto each_delayed = [&](Term input, const auto& connect) {
        for (const auto& delayed : delays) {
            if (delayed.input == input) connect(delayed);
        }
        std::erase_if(delays, [&](const auto& delayed) { return delayed.input == input; });
    };
    // What is on top of the stack.
    const auto connect = [&](const std::string& name) {
        const auto input = std::find_if(equations.inputs.begin(), equations.inputs.end(),
                                        [&](const auto& i) { return i.name == name; });
        const std::string what = fmt::format("{}: inputs.{}", function, name);
        if (input == equations.inputs.end()) {
            throw InputError(
                fmt::format("{}: inputs: {} is not an input of the system{}", function, name, suggestion(name, known)));
        }
        if (lua_isfunction(lua, -1)) {
            auto& graph = *equations.graph;
            const Term recorded = record_input(lua, -1, symbols, what);
            equations.replace({{input->symbol, delayed_in_time(equations, recorded, 0)}});
            each_delayed(input->symbol, [&](const DelayedInput& delayed) {
                const Term before = graph.make(Op::less, equations.time, graph.constant(delayed.delay));
                const Term then = delayed_in_time(equations, recorded, delayed.delay);
                equations.replace(
                    {{delayed.symbol, graph.make(Op::select, before, graph.constant(input->value), then)}});
            });
            equations.inputs.erase(input);
        } else if (lua_istable(lua, -1)) {
            const Equations::Input own = *input; // the list changes
            const Samples samples = read_samples(to_json(lua, -1, what), own.unit, what);
            equations.inputs.erase(input);
            add_samples(equations, own, samples, start);
            each_delayed(own.symbol, [&](const DelayedInput& delayed) {
                Samples later = samples;
                later.offset += delayed.delay;
                add_samples(equations, {equations.graph->name(delayed.symbol), own.unit, own.value, delayed.symbol},
                            std::move(later), start);
            });
        } else {
            const Json number = to_json(lua, -1, what);
            if (!number.is_number() || !std::isfinite(number.get<double>())) {
                throw InputError(fmt::format("{} must be a finite number, a function of the time, or "
                                             "{{sample_time_s =, values =}}",
                                             what));
            }
            input->value = number.get<double>();
        }
    };
    lua_pushnil(lua);
    while (lua_next(lua, -2)) {
        const std::string name = lua_type(lua, -2) == LUA_TSTRING ? lua_tostring(lua, -2) : luaL_typename(lua, -2);
        const auto size = vectors.find(name);
        if (size == vectors.end()) {
            connect(name);
        } else if (!lua_istable(lua, -1) || lua_rawlen(lua, -1) != size->second) {
            throw InputError(fmt::format("{}: inputs.{} must be a list of {} inputs", function, name, size->second));
        } else {
            for (std::size_t i = 1; i <= size->second; ++i) {
                lua_rawgeti(lua, -1, static_cast<lua_Integer>(i));
                connect(element_name(name, i));
                lua_pop(lua, 1);
            }
        }
        lua_pop(lua, 1);
    }
    lua_pop(lua, 1);
    // What is constant was the same before.
    for (const auto& delayed : delays) equations.replace({{delayed.symbol, delayed.input}});
}

// start = { x = number, mode = "name" } into states and discrete variables. Inputs, and what samples of them are held in,
// may stand in it, as they do in `final` of a run: they are what `inputs` says. "steady" is the steady state at the start time.
void read_start(const Json& options, Equations& equations, const std::vector<std::string>& inputs, double start_time) {
    if (!options.contains("start")) return;
    if (options["start"] == "steady") {
        OperatingPoint point{.t = start_time};
        std::vector<Term> free;
        for (const auto& state : equations.states) {
            point.states.push_back(state.start);
            free.push_back(state.symbol);
        }
        for (const auto& discrete : equations.discrete) point.discrete.push_back(discrete.start);
        const SteadyState found = find_steady_state(equations, point, free);
        for (std::size_t i = 0; i < free.size(); ++i) equations.states[i].start = found.values[i];
        return;
    }
    const Json given = flattened(options["start"], names_of_values(equations), "tb.run_system: start");
    FieldReader values(given, "tb.run_system: start");
    const auto is_input = [&](const std::string& name) {
        return std::any_of(inputs.begin(), inputs.end(), [&](const std::string& input) {
            return name == input || (name.starts_with(input) && is_held_part(name.substr(input.size())));
        });
    };
    if (given.is_object()) {
        for (const auto& [name, value] : given.items()) {
            if (is_input(name)) values.value(name);
        }
    }
    for (auto& state : equations.states) {
        state.start = values.number(state.name, state.unit, Allowed::finite, state.start);
    }
    for (auto& discrete : equations.discrete) {
        if (is_input(discrete.name)) continue;
        discrete.start = discrete_value(values, discrete);
    }
    values.finish();
}

// The start and the end of a run; the state that it goes on from, whose fingerprint is still to be compared.
SystemRunOptions run_options(FieldReader& fields) {
    SystemRunOptions options;
    const Json& resumed = fields.value("resume");
    if (!resumed.is_null()) {
        for (const char* key : {"start", "start_time_s"}) {
            if (fields.has(key)) fields.fail(key, "cannot stand beside resume, which says where the run begins");
        }
        options.start = time_of_run_state(resumed, "tb.run_system: resume");
    }
    options.start = fields.number("start_time_s", "s", Allowed::non_negative, options.start);
    if (fields.has("duration_s") && fields.has("end_time_s")) {
        fields.fail("duration_s", "and end_time_s say both when the run ends, must be one of the two");
    }
    if (fields.has("end_time_s")) {
        options.end = fields.number("end_time_s", "s", Allowed::positive);
        if (!(options.end > options.start)) {
            fields.fail("end_time_s", fmt::format("= {} s, must be after the start at {} s", to_text(options.end),
                                                  to_text(options.start)));
        }
    } else {
        options.end = options.start + fields.number("duration_s", "s", Allowed::positive);
    }
    options.output_step = fields.number("output_step_s", "s", Allowed::non_negative, 0);
    options.output_times = fields.numbers("output_times_s", "s", Allowed::non_negative, {});
    if (fields.has("output_times_s")) {
        if (fields.has("output_step_s")) fields.fail("output_times_s", "and output_step_s are both there, must be one");
        if (options.output_times.empty()) fields.fail("output_times_s", "is empty, must have a time");
        const auto bad = std::adjacent_find(options.output_times.begin(), options.output_times.end(),
                                            [](double a, double b) { return !(a < b); });
        if (bad != options.output_times.end()) {
            fields.fail("output_times_s",
                        fmt::format("has {} behind {}, must increase", to_text(bad[1]), to_text(*bad)));
        }
    }
    options.output_jumps = fields.boolean("output_events", false);
    OptionReader reader(fields);
    SolverOptions::describe(options.solver, reader, false);
    return options;
}

Json statistics_of(const RunStatistics& s) {
    Json json;
    for (const auto& [name, count] : RunStatistics::counts) json[name] = s.*count;
    return json;
}

Json to_json(const SystemRun& run, const Equations& equations) {
    Json json{{"final", Json::object()}};
    for (std::size_t i = 0; i < equations.states.size(); ++i) {
        set_element(json["final"], equations.states[i].name, run.final_states[i]);
    }
    for (std::size_t i = 0; i < equations.discrete.size(); ++i) {
        const auto& discrete = equations.discrete[i];
        const double value = run.final_discrete[i];
        if (discrete.modes.empty()) {
            set_element(json["final"], discrete.name, value);
        } else {
            json["final"][discrete.name] = discrete.modes[static_cast<std::size_t>(value)];
        }
    }
    json["events"] = Json::array();
    for (const auto& event : run.events) {
        json["events"].push_back(
            {{"t", event.t}, {"name", equations.whens[static_cast<std::size_t>(event.subject)].name}});
    }
    json["state"] = to_json(run.state);
    json["solver"] = name_of(run.method);
    if (run.stiff_from) json["stiff_from_s"] = *run.stiff_from;
    json["ok"] = run.outcome.ok();
    json["message"] = run.outcome.message;
    json["t_end"] = run.outcome.t;
    if (run.ended_by) json["ended_by"] = equations.whens[*run.ended_by].name;
    json["statistics"] = statistics_of(run.statistics);
    return json;
}

// t, values and columns of the table on top. They are long, so they are handed over as they are, and once: a list of
// `values` and that of its column are the same. [-0, +0]
void add_lists(lua_State* lua, const Table& table) {
    lua_newtable(lua);
    lua_createtable(lua, static_cast<int>(table.columns.size()), 0);
    const int columns = lua_gettop(lua), values = columns - 1, result = columns - 2;
    for (std::size_t i = 0; i < table.columns.size(); ++i) {
        const Column& column = table.columns[i];
        lua_createtable(lua, static_cast<int>(column.values.size()), 0);
        for (std::size_t k = 0; k < column.values.size(); ++k) {
            lua_pushnumber(lua, column.values[k]);
            lua_rawseti(lua, -2, static_cast<lua_Integer>(k) + 1);
        }
        lua_pushvalue(lua, -1);
        if (const auto element = element_of(column.name)) {
            luaL_getsubtable(lua, values, element->first.c_str());
            lua_insert(lua, -2);
            lua_rawseti(lua, -2, static_cast<lua_Integer>(element->second));
            lua_pop(lua, 1);
        } else {
            lua_setfield(lua, column.name == "t" ? result : values, column.name.c_str());
        }
        push(lua, {{"name", column.name}, {"unit", column.unit}});
        lua_insert(lua, -2);
        lua_setfield(lua, -2, "values");
        lua_rawseti(lua, columns, static_cast<lua_Integer>(i) + 1);
    }
    lua_setfield(lua, result, "columns");
    lua_setfield(lua, result, "values");
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

// { states = { { name =, unit =, value = }, … }, … }: the value of a state is its start.
int variables_in_script(lua_State* lua) {
    const Equations equations = system_of(lua, "tb.system_variables");
    const Json options = plain_options(lua, {"system"}, "tb.system_variables: options");
    FieldReader(options, "tb.system_variables").finish();
    Json json;
    const auto list = [&](const char* kind, const auto& variables, const auto& value_of) {
        Json& entries = json[kind] = Json::array();
        for (const auto& variable : variables) {
            entries.push_back({{"name", variable.name}, {"unit", variable.unit}});
            if (const std::optional<double> value = value_of(variable)) entries.back()["value"] = *value;
        }
    };
    const auto start_of = [](const auto& variable) { return std::optional(variable.start); };
    const auto value_of = [](const auto& variable) { return std::optional(variable.value); };
    auto states = equations.states;
    std::erase_if(states, [](const auto& state) { return state.is_algebraic(); });
    list("states", states, start_of);
    auto algebraic = equations.states;
    std::erase_if(algebraic, [](const auto& state) { return !state.is_algebraic(); });
    list("algebraic", algebraic, start_of);
    list("discrete", equations.discrete, start_of);
    list("parameters", equations.parameters, value_of);
    list("inputs", equations.inputs, value_of);
    list("outputs", equations.outputs, [](const auto&) { return std::optional<double>(); });
    push(lua, json);
    return 1;
}

int run_in_script(lua_State* lua, ScriptRun& run, const Graph& symbols) {
    Equations equations = system_of(lua, "tb.run_system");
    const Json options = plain_options(lua, {"system", "inputs"}, "tb.run_system: options");
    FieldReader fields(options, "tb.run_system");
    SystemRunOptions run_with = run_options(fields);
    for (const char* key : {"parameters", "start"}) fields.value(key);
    fields.finish();
    read_values(options, "parameters", equations.parameters, &Equations::Parameter::value, "tb.run_system");
    std::vector<std::string> inputs;
    for (const auto& input : equations.inputs) inputs.push_back(input.name);
    read_inputs(lua, equations, symbols, run_with.start, "tb.run_system");
    read_start(options, equations, inputs, run_with.start);
    run_with.fingerprint = equations.fingerprint();
    if (options.contains("resume")) {
        run_with.resume = read_run_state(options["resume"], run_with.fingerprint, "tb.run_system: resume");
    }

    EquationSystem system(std::move(equations));
    if (run.request().compile) {
        try {
            system.compile({});
        } catch (const Error& problem) {
            run.remark(fmt::format("equations are not compiled, but evaluated as tapes: {}", problem.what()));
        }
    }
    const RunningOn here(*symbols, lua);
    const SystemRun result = run_system(system, run_with, run.control());
    if (result.outcome.end == RunEnd::interrupted) throw EndedEarly(result.outcome.message);
    run.note_work({{"function", "run_system"},
                   {"system", system.equations().name},
                   {"solver", name_of(result.method)},
                   {"outcome", result.outcome.message},
                   {"statistics", statistics_of(result.statistics)}});
    push(lua, to_json(result, system.equations()));
    add_lists(lua, result.table);
    return 1;
}

// ---- linear systems ----------------------------------------------------------------------------------------------

Json rows_of(const Eigen::MatrixXd& matrix) {
    Json rows = Json::array();
    for (Eigen::Index i = 0; i < matrix.rows(); ++i) {
        Json row = Json::array();
        for (Eigen::Index j = 0; j < matrix.cols(); ++j) row.push_back(matrix(i, j));
        rows.push_back(std::move(row));
    }
    return rows;
}

// The place of a name; where there is but one, it needs not be named.
std::size_t chosen(FieldReader& fields, const char* key, const std::vector<std::string>& names) {
    if (names.empty()) fields.fail(key, fmt::format("cannot be chosen: the system has no {}", key));
    if (names.size() == 1 && !fields.has(key)) return 0;
    const std::string name = fields.choice(key, names, fields.has(key) ? names.front() : "");
    return static_cast<std::size_t>(std::find(names.begin(), names.end(), name) - names.begin());
}

// at = { x = number, mode = "name" }: start values where nothing is given.
OperatingPoint point_of(const Json& options, const Equations& equations, const char* function) {
    OperatingPoint point;
    const std::string where = fmt::format("{}: at", function);
    const Json given =
        options.contains("at") ? flattened(options["at"], names_of_values(equations), where) : Json::object();
    FieldReader values(given, where);
    point.t = values.number("t", "s", Allowed::finite, 0);
    for (const auto& state : equations.states) {
        point.states.push_back(values.number(state.name, state.unit, Allowed::finite, state.start));
    }
    for (const auto& discrete : equations.discrete) point.discrete.push_back(discrete_value(values, discrete));
    values.finish();
    return point;
}

Json margins_of(const Linearization& linear, std::size_t input, std::size_t output,
                const std::vector<double>& frequency_hz) {
    const auto [low, high] = std::minmax_element(frequency_hz.begin(), frequency_hz.end());
    const auto margins = stability_margins([&](double f) { return linear.response(f, input, output); }, *low, *high);
    const auto or_null = [](const std::optional<double>& value) { return value ? Json(*value) : Json(nullptr); };
    return {{"gain_margin", or_null(margins.gain_margin)},
            {"gain_reduction_margin", or_null(margins.gain_reduction_margin)},
            {"phase_crossover_hz", or_null(margins.phase_crossover_hz)},
            {"phase_margin_deg", or_null(margins.phase_margin_deg)},
            {"gain_crossover_hz", or_null(margins.gain_crossover_hz)},
            {"modulus_margin", margins.modulus_margin}};
}

int linearize_in_script(lua_State* lua, const Graph& symbols) {
    Equations equations = system_of(lua, "tb.linearize");
    const Json options = plain_options(lua, {"system"}, "tb.linearize: options");
    FieldReader fields(options, "tb.linearize");
    for (const char* key : {"parameters", "inputs", "at"}) fields.value(key);
    read_values(options, "parameters", equations.parameters, &Equations::Parameter::value, "tb.linearize");
    read_values(options, "inputs", equations.inputs, &Equations::Input::value, "tb.linearize");
    const auto frequency_hz = fields.numbers("frequency_hz", "Hz", Allowed::positive, {});
    const OperatingPoint point = point_of(options, equations, "tb.linearize");
    const RunningOn here(*symbols, lua);
    const Linearization linear = linearize(equations, point);

    Json json{{"A", rows_of(linear.a)},        {"B", rows_of(linear.b)},
              {"C", rows_of(linear.c)},        {"D", rows_of(linear.d)},
              {"states", linear.states},       {"inputs", linear.inputs},
              {"outputs", linear.outputs},     {"sample_time_s", linear.sample_time},
              {"stable", linear.is_stable()},  {"rate_left", linear.rate_left},
              {"jump_left", linear.jump_left}, {"left_out", linear.left_out},
              {"poles", Json::array()}};
    for (const auto& pole : linear.poles()) json["poles"].push_back({{"real", pole.real()}, {"imag", pole.imag()}});
    if (!frequency_hz.empty()) {
        const std::size_t input = chosen(fields, "input", linear.inputs);
        const std::size_t output = chosen(fields, "output", linear.outputs);
        FrequencyResponse response{frequency_hz, {}};
        for (const double f : frequency_hz) response.value.push_back(linear.response(f, input, output));
        std::vector<double> real, imag;
        for (const auto& value : response.value) {
            real.push_back(value.real());
            imag.push_back(value.imag());
        }
        json["response"] = {{"frequency_hz", frequency_hz},
                            {"real", real},
                            {"imag", imag},
                            {"gain_db", response.gain_db()},
                            {"phase_deg", response.phase_deg()}};
        if (frequency_hz.size() > 1) json["margins"] = margins_of(linear, input, output, frequency_hz);
    }
    fields.finish();
    push(lua, json);
    return 1;
}

// ---- steady states -----------------------------------------------------------------------------------------------

// Values by name, modes by theirs.
template <class Variables, class Value>
Json by_name(const Variables& variables, Value value) {
    Json json = Json::object();
    for (const auto& variable : variables) set_element(json, variable.name, value(variable));
    return json;
}

Json start_value(const Equations::Discrete& discrete) {
    return discrete.modes.empty() ? Json(discrete.start)
                                  : Json(discrete.modes[static_cast<std::size_t>(discrete.start)]);
}

int steady_state_in_script(lua_State* lua, const Graph& symbols) {
    constexpr const char* function = "tb.steady_state";
    Equations equations = system_of(lua, function);
    const Json options = plain_options(lua, {"system"}, "tb.steady_state: options");
    FieldReader fields(options, function);
    for (const char* key : {"parameters", "inputs", "at"}) fields.value(key);
    const auto names = fields.texts("free", {});
    const bool all_states = !fields.has("free");
    fields.finish();
    read_values(options, "parameters", equations.parameters, &Equations::Parameter::value, function);
    read_values(options, "inputs", equations.inputs, &Equations::Input::value, function);
    const OperatingPoint point = point_of(options, equations, function);

    // Each free variable, and where its value belongs.
    std::vector<std::pair<Term, double*>> all;
    std::vector<std::string> known;
    const auto offer = [&](auto& variables, auto member) {
        for (auto& variable : variables) {
            all.emplace_back(variable.symbol, &(variable.*member));
            known.push_back(variable.name);
        }
    };
    offer(equations.states, &Equations::State::start);
    const std::size_t state_count = known.size();
    offer(equations.inputs, &Equations::Input::value);
    offer(equations.parameters, &Equations::Parameter::value);
    std::vector<Term> free;
    std::vector<double*> targets;
    for (std::size_t i = 0; i < point.states.size(); ++i) equations.states[i].start = point.states[i];
    for (std::size_t i = 0; i < point.discrete.size(); ++i) equations.discrete[i].start = point.discrete[i];
    for (const auto& name :
         all_states ? std::vector(known.begin(), known.begin() + static_cast<long>(state_count)) : names) {
        const auto place = static_cast<std::size_t>(std::find(known.begin(), known.end(), name) - known.begin());
        if (place == known.size()) {
            fields.fail("free", fmt::format("names {}, which is neither a state nor an input nor a parameter{}", name,
                                            suggestion(name, known)));
        }
        if (std::find(free.begin(), free.end(), all[place].first) != free.end()) {
            fields.fail("free", fmt::format("names {} twice", name));
        }
        free.push_back(all[place].first);
        targets.push_back(all[place].second);
    }
    // Algebraic variables follow from what is free.
    for (auto& state : equations.states) {
        if (!state.is_algebraic() || std::find(free.begin(), free.end(), state.symbol) != free.end()) continue;
        free.push_back(state.symbol);
        targets.push_back(&state.start);
    }
    const RunningOn here(*symbols, lua);
    const SteadyState found = find_steady_state(equations, point, free);
    for (std::size_t i = 0; i < targets.size(); ++i) *targets[i] = found.values[i];

    Json start = by_name(equations.states, [](const auto& state) { return state.start; });
    for (const auto& discrete : equations.discrete) set_element(start, discrete.name, start_value(discrete));
    const auto value_of = [](const auto& variable) { return variable.value; };
    push(lua, Json{{"start", std::move(start)},
                   {"inputs", by_name(equations.inputs, value_of)},
                   {"parameters", by_name(equations.parameters, value_of)},
                   {"residual", found.residual},
                   {"iterations", found.iterations},
                   {"conditions", found.conditions}});
    return 1;
}

// tb.standard_normal(seed, stream, index)
int normal_in_script(lua_State* lua, const Symbols& symbols) {
    if (symbols.state == Symbols::State::recording) {
        throw InputError(
            "tb.standard_normal would give one number for the whole run, as an equation is recorded once; a "
            "sample clock calls it in `call`");
    }
    std::array<std::uint64_t, 3> place{};
    constexpr std::array names = {"seed", "stream", "index"};
    for (int i = 0; i < 3; ++i) {
        int is_whole = 0;
        const lua_Integer value = lua_tointegerx(lua, i + 1, &is_whole);
        const auto n = static_cast<std::size_t>(i);
        if (!is_whole || value < 0) {
            throw InputError(
                fmt::format("tb.standard_normal: {} is {}, must be a whole number from 0", names[n],
                            is_whole ? std::to_string(value) : fmt::format("a {}", luaL_typename(lua, i + 1))));
        }
        place[n] = static_cast<std::uint64_t>(value);
    }
    lua_pushnumber(lua, standard_normal(place[0], place[1], place[2]));
    return 1;
}

} // namespace

void add_system_bindings(LuaState& lua, ScriptRun& run) {
    const auto symbols = std::make_shared<Symbols>();
    add_symbols(lua, symbols);
    add_lookups(lua, symbols);
    add_ready_parts(lua);
    lua.add_stack_function("system", [symbols](lua_State* state) {
        push_system(state, read_system(state, 1, symbols));
        return 1;
    });
    lua.add_stack_function("standard_normal",
                           [symbols](lua_State* state) { return normal_in_script(state, *symbols); });
    lua.add_stack_function("system_variables", variables_in_script);
    lua.add_stack_function("linearize", [symbols](lua_State* state) { return linearize_in_script(state, symbols); });
    lua.add_stack_function("steady_state",
                           [symbols](lua_State* state) { return steady_state_in_script(state, symbols); });
    lua.add_stack_function("run_system",
                           [&run, symbols](lua_State* state) { return run_in_script(state, run, symbols); });
}

} // namespace tribode
