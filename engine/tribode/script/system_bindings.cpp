#include "tribode/script/system_bindings.hpp"
#include "tribode/base/error.hpp"
#include "tribode/base/random.hpp"
#include "tribode/base/text.hpp"
#include "tribode/experiment/system_run.hpp"
#include "tribode/fmu_import/unit_system.hpp"
#include "tribode/script/system_options.hpp"
#include "tribode/script/system_reader.hpp"
#include "tribode/script/value.hpp"
#include "tribode/system/contacts.hpp"
#include "tribode/system/sensitivities.hpp"
#include "tribode/system/steady_state.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <fmt/format.h>
#include <lua.hpp>

namespace tribode {

namespace {

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
    read_options(options, fields);
    return options;
}

Json statistics_of(const RunStatistics& s) {
    Json json;
    for (const auto& [name, count] : RunStatistics::counts) json[name] = s.*count;
    return json;
}

Json to_json(const SystemRun& run, const Equations& equations) {
    Json json{{"final", Json::object()}};
    for (std::size_t i = 0; i < run.final_states.size(); ++i) {
        set_element(json["final"], equations.states[i].name, run.final_states[i]);
    }
    for (std::size_t i = 0; i < run.final_discrete.size(); ++i) {
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

// A table of lists by name in the field `sensitivities` of what is on top. [-0, +0]
void add_sensitivities(lua_State* lua, const std::vector<SystemSensitivity>& all) {
    if (all.empty()) return;
    lua_newtable(lua);
    for (const auto& by : all) {
        lua_newtable(lua);
        add_lists(lua, by.table);
        lua_getfield(lua, -1, "values");
        lua_setfield(lua, -3, by.name.c_str());
        lua_pop(lua, 1);
    }
    lua_setfield(lua, -2, "sensitivities");
}

// { states = { { name =, unit =, value = }, … }, … }: the value of a state is its start.
int variables_in_script(const ScriptContext&, lua_State* lua) {
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

int run_in_script(const ScriptContext& script, lua_State* lua) {
    Equations equations = given_system(lua, "tb.run_system");
    const Json options = plain_options(lua, {"system", "inputs"}, "tb.run_system: options");
    FieldReader fields(options, "tb.run_system");
    SystemRunOptions run_with = run_options(fields);
    for (const char* key : {"parameters", "start"}) fields.value(key);
    const auto sensitivities = fields.texts("sensitivities", {});
    if (!sensitivities.empty() && options.contains("start") && options["start"] == "steady") {
        fields.fail("sensitivities", "cannot stand beside start = \"steady\", which depends on the parameters too; "
                                     "start = tb.steady_state{ … }.start is a fixed one");
    }
    fields.finish();
    read_values(options, "parameters", equations.parameters, &Equations::Parameter::value, "tb.run_system");
    check_delays(equations, sensitivities);
    std::vector<std::string> inputs;
    for (const auto& input : equations.inputs) inputs.push_back(input.name);
    read_inputs(lua, equations, script.symbols, run_with.start, "tb.run_system");
    close_contacts(equations);
    read_start(options, equations, inputs, run_with.start);
    equations = with_sensitivities(std::move(equations), sensitivities);
    run_with.fingerprint = equations.fingerprint();
    if (options.contains("resume")) {
        run_with.resume = read_run_state(options["resume"], run_with.fingerprint, "tb.run_system: resume");
    }

    EquationSystem system(std::move(equations));
    if (script.run.request().compile) {
        try {
            system.compile({});
        } catch (const Error& problem) {
            script.run.remark(fmt::format("equations are not compiled, but evaluated as tapes: {}", problem.what()));
        }
    }
    const RunningOn here(*script.symbols, lua);
    const SystemRun result = run_system(system, run_with, script.run.control());
    if (result.outcome.end == RunEnd::interrupted) throw EndedEarly(result.outcome.message);
    script.run.note_work({{"function", "run_system"},
                          {"system", system.equations().name},
                          {"solver", name_of(result.method)},
                          {"outcome", result.outcome.message},
                          {"statistics", statistics_of(result.statistics)}});
    push(lua, to_json(result, system.equations()));
    add_lists(lua, result.table);
    add_sensitivities(lua, result.sensitivities);
    return 1;
}

// tb.standard_normal(seed, stream, index)
int normal_in_script(const ScriptContext& script, lua_State* lua) {
    if (script.symbols->state == Symbols::State::recording) {
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

// tb.fmu{ file =, period_s = }
int import_unit(const ScriptContext& script, lua_State* lua) {
    const Json options = plain_options(lua, {}, "tb.fmu: options");
    FieldReader fields(options, "tb.fmu");
    const std::string file = fields.text("file");
    const double period = fields.number("period_s", "s", Allowed::positive);
    fields.finish();
    const auto unit = script.run.unit(file);
    const auto& left_out = unit->description().left_out;
    if (!left_out.empty()) {
        script.run.remark(fmt::format("{}: variables that are no single numbers are left out: {}", printable(file),
                                      printable(fmt::format("{}", fmt::join(left_out, ", ")))));
    }
    push_system(lua, equations_of_unit(unit, period));
    return 1;
}

int make_system(const ScriptContext& script, lua_State* lua) {
    push_system(lua, read_system(lua, 1, script.symbols));
    return 1;
}

} // namespace

const std::vector<LuaFunction>& system_functions() {
    static const std::vector<LuaFunction> functions = [] {
        // Those without a function are of add_symbols(), add_lookups() and add_ready_parts().
        std::vector<LuaFunction> all = {
            {"system", make_system, "`tb.system{ states =, der =, … }`",
             "a hybrid system from its equations: states, algebraic variables, parameters, inputs, discrete variables, "
             "outputs, events, modes, sample clocks, parts. Its functions are recorded once. Errors: a branch that "
             "cannot be recorded, a variable that is not known, a state without an equation, an algebraic loop"},
            {"fmu", import_unit, "`tb.fmu{ file =, period_s = }`",
             "a functional mock-up unit for co-simulation as a system for the `parts` of `tb.system`, which takes a "
             "step of "
             "`period_s` at each sample; [how](how-to/import-an-fmu.md). Errors: a file that the user has not named "
             "with "
             "`--fmu`, a unit that is damaged, is for model exchange alone, has no library for this computer or does "
             "not "
             "start"},
            {"parts.coulomb",
             {},
             "`tb.parts.coulomb{ velocity =, level =, static =, stribeck_velocity =, exponent = 1 }`",
             "dry friction that sticks: a [ready part](systems.md#ready-parts) for the `parts` of `tb.system`. Errors "
             "of all parts: an option that is missing or not known; at `tb.system` a force that does not act on its "
             "velocity"},
            {"parts.impact",
             {},
             "`tb.parts.impact{ gap =, restitution =, rest_speed = }`",
             "impact that comes to rest"},
            {"parts.play", {}, "`tb.parts.play{ input =, width = }`", "play"},
            {"parts.maxwell", {}, "`tb.parts.maxwell{ position =, stiffness =, level = }`", "a Maxwell-slip element"},
            {"parts.relay",
             {},
             "`tb.parts.relay{ input =, on =, off =, high = 1, low = 0 }`",
             "a relay with hysteresis"},
            {"parts.backlash", {}, "`tb.parts.backlash{ distance =, gap =, stiffness =, damping = 0 }`", "backlash"},
            {"system_variables", variables_in_script, "`tb.system_variables{ system = }`",
             "`states`, `algebraic`, `discrete`, `parameters`, `inputs`, `outputs`: lists of `{ name, unit, value }`, "
             "where the value is the start value or the default of a run; outputs have none"},
            {"run_system", run_in_script, "`tb.run_system{ system =, duration_s =, … }`",
             "runs it, with any solver: `t`, `values`, `columns`, `events`, `final`, `state`, `ok`, `message`, "
             "`t_end`, `ended_by`, `solver`, `statistics`. `resume = run.state` [continues a "
             "run](systems.md#continuing-a-run). A run that ends early is not an error; then `ok` is false and "
             "`message` gives the reason",
             [] {
                 return option_rows<SystemRunOptions>({
                     {"system", "", "system", "required", "what `tb.system` returned"},
                     {"resume", "", "table", "none", "the `state` of an earlier run, [below](#continuing-a-run)"},
                     {"parameters", "", "table of numbers", "none",
                      "`{ name = number }`: values that replace the system's"},
                     {"start", "", "table or `\"steady\"`", "none",
                      "`\"steady\"`: the [steady state](#steady-states) at the start time. Or `{ name = value }` to "
                      "replace "
                      "the system's start values of states, discrete variables and modes (by name). A state without a "
                      "start value in the system starts at 0"},
                     {"inputs", "", "table", "none",
                      "`{ name = … }`: a number, a function of the time, which is recorded, or samples, below"},
                     {"sensitivities", "", "list of texts", "none",
                      "parameters, inputs that are numbers, and `\"STATE.start\"`, by which the run is differentiated "
                      "([sensitivities](sensitivities.md#systems-of-equations))"},
                 });
             }},
            {"table1",
             {},
             "`tb.table1{ x =, y =, … }`",
             "a [table](systems.md#tables) as a function of one variable, symbolic or a number: `interpolation` "
             "`\"linear\"`, `\"pchip\"`, `\"spline\"`, `\"natural\"`, `extrapolation` `\"refuse\"`, `\"hold\"`, "
             "`\"linear\"`, units. Errors: abscissas that do not increase, fewer than two, numbers that are not "
             "finite"},
            {"table2", {}, "`tb.table2{ x =, y =, z =, … }`", "the same of two variables; `z` has a row for each x"},
            {"delay",
             {},
             "`tb.delay(x, seconds)`",
             "in an equation: delayed inputs and functions of the time ([values before the delay has "
             "passed](systems.md#delays)). Errors: a negative delay, a delay of a state"},
            {"less", {}, "`tb.less(a, b)`", "a < b as a condition of an equation; of numbers, a boolean"},
            {"less_equal", {}, "`tb.less_equal(a, b)`", "a ≤ b, in the same way"},
            {"greater", {}, "`tb.greater(a, b)`", "a > b, in the same way"},
            {"greater_equal", {}, "`tb.greater_equal(a, b)`", "a ≥ b, in the same way"},
            {"all", {}, "`tb.all(a, b, …)`", "a condition: all of these; of booleans, a boolean"},
            {"any", {}, "`tb.any(a, b, …)`", "a condition: one of these at least, in the same way"},
            {"negation", {}, "`tb.negation(a)`", "the opposite condition, in the same way"},
            {"where", {}, "`tb.where(condition, a, b)`", "one of two values"},
            {"no_event", {}, "`tb.no_event(x)`", "a value whose conditions are not events"},
            {"before", {}, "`tb.before(x)`", "the value of x when the instant of an event began"},
            {"tanh",
             {},
             "`tb.tanh(x)`",
             "hyperbolic tangent; `sin cos tan asin acos atan exp log sqrt abs min max` of `math` take symbolic values "
             "too"},
            {"standard_normal", normal_in_script, "`tb.standard_normal(seed, stream, index)`",
             "a number from the standard normal distribution that depends only on three integers from 0: noise without "
             "a state, the same on every computer"},
        };
        const auto more = system_analysis_functions();
        all.insert(all.end(), more.begin(), more.end());
        return all;
    }();
    return functions;
}

} // namespace tribode
