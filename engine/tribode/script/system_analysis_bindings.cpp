#include "tribode/base/error.hpp"
#include "tribode/base/text.hpp"
#include "tribode/script/conversions.hpp"
#include "tribode/script/system_bindings.hpp"
#include "tribode/script/system_options.hpp"
#include "tribode/script/value.hpp"
#include "tribode/system/linearization.hpp"
#include "tribode/system/steady_state.hpp"

#include <algorithm>
#include <fmt/format.h>
#include <lua.hpp>

namespace tribode {

namespace {

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
    return to_json(stability_margins([&](double f) { return linear.response(f, input, output); }, *low, *high));
}

int linearize_in_script(const ScriptContext& script, lua_State* lua) {
    Equations equations = system_of(lua, "tb.linearize");
    const Json options = plain_options(lua, {"system"}, "tb.linearize: options");
    FieldReader fields(options, "tb.linearize");
    for (const char* key : {"parameters", "inputs", "at"}) fields.value(key);
    read_values(options, "parameters", equations.parameters, &Equations::Parameter::value, "tb.linearize");
    read_values(options, "inputs", equations.inputs, &Equations::Input::value, "tb.linearize");
    const auto frequency_hz = fields.numbers("frequency_hz", "Hz", Allowed::positive, {});
    const OperatingPoint point = point_of(options, equations, "tb.linearize");
    const RunningOn here(*script.symbols, lua);
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
        json["response"] = to_json(response);
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

int steady_state_in_script(const ScriptContext& script, lua_State* lua) {
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
    const RunningOn here(*script.symbols, lua);
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

} // namespace

std::vector<LuaFunction> system_analysis_functions() {
    return {
        {"steady_state", steady_state_in_script, "`tb.steady_state{ system =, at =, free = {…}, … }`",
         "the point at which all derivatives are zero: `start`, `inputs`, `parameters`, `residual`, `iterations`, "
         "`conditions`. Errors: none is found, it is not unique, an event occurs before it "
         "([more](systems.md#steady-states))"},
        {"linearize", linearize_in_script, "`tb.linearize{ system =, at =, frequency_hz = {…}, … }`",
         "a linear system about a point, the sampled controller included: `A, B, C, D`, `poles`, `stable`, `response`, "
         "`margins`, `sample_time_s`, `rate_left`, `jump_left`. Errors: clocks without a common period, a derivative "
         "that is not finite there"},
    };
}

} // namespace tribode
