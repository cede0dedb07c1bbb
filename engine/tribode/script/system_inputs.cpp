#include "tribode/base/error.hpp"
#include "tribode/base/text.hpp"
#include "tribode/experiment/input_samples.hpp"
#include "tribode/script/system_options.hpp"
#include "tribode/script/system_reader.hpp"
#include "tribode/script/value.hpp"
#include "tribode/system/input_delays.hpp"

#include <algorithm>
#include <cmath>
#include <fmt/format.h>
#include <lua.hpp>
#include <map>

namespace tribode {

namespace {

InputSamples read_samples(const Json& table, const std::string& unit, const std::string& what) {
    FieldReader fields(table, what);
    const double period = fields.number("sample_time_s", "s", Allowed::positive);
    const double offset = fields.number("offset_s", "s", Allowed::non_negative, 0);
    const auto values = fields.numbers("values", unit, Allowed::finite, {});
    const auto between = fields.choice("interpolation", {"hold", "linear", "band_limited"}, "hold");
    fields.finish();
    if (values.empty()) throw InputError(fmt::format("{}.values is empty, must have a value", what));
    return input_samples(values, period, offset,
                         between == "hold"     ? Interpolation::hold
                         : between == "linear" ? Interpolation::linear
                                               : Interpolation::band_limited);
}

} // namespace

bool is_held_part(std::string_view name) {
    return name == ".since" || name.starts_with("(t - ") ||
           (name.size() == 3 && name.starts_with(".c") && name[2] >= '0' && name[2] <= '3');
}

void read_inputs(lua_State* lua, Equations& equations, const std::shared_ptr<Symbols>& symbols, double start,
                 const char* function) {
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
            const InputSamples samples = read_samples(to_json(lua, -1, what), own.unit, what);
            equations.inputs.erase(input);
            connect_samples(equations, own, samples, start);
            each_delayed(own.symbol, [&](const DelayedInput& delayed) {
                InputSamples later = samples;
                later.offset += delayed.delay;
                connect_samples(equations, {equations.graph->name(delayed.symbol), own.unit, own.value, delayed.symbol},
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

} // namespace tribode
