#include "tribode/diagnosis/system_record.hpp"
#include "tribode/base/error.hpp"
#include "tribode/base/text.hpp"
#include "tribode/diagnosis/system_terms.hpp"

#include <algorithm>
#include <fmt/format.h>
#include <fmt/ranges.h>
#include <optional>

namespace tribode {

namespace {

constexpr double max_change = 1e4; // of a parameter, as a factor

constexpr std::size_t min_record_samples = 20;
constexpr const char* measured_state = "_measured"; // behind the name of a state: the output that is measured of it

template <class List>
std::vector<std::string> names_of(const List& list) {
    std::vector<std::string> names;
    for (const auto& one : list) names.push_back(one.name);
    return names;
}

bool contains(const std::vector<std::string>& list, const std::string& name) {
    return std::find(list.begin(), list.end(), name) != list.end();
}

// Outputs, then states.
std::vector<std::string> measurable(const Equations& equations) {
    auto names = names_of(equations.outputs);
    for (const auto& state : equations.states) names.push_back(state.name);
    return names;
}

// Columns that --columns gives are sorted into inputs and outputs.
SystemColumns sorted(SystemColumns columns, const Equations& equations) {
    const auto inputs = names_of(equations.inputs);
    for (const auto& [name, column] : columns.record.columns) {
        if (name != "t") (contains(inputs, name) ? columns.inputs : columns.outputs)[name] = column;
    }
    std::erase_if(columns.record.columns, [](const auto& one) { return one.first != "t"; });
    return columns;
}

void check_names(const SystemColumns& columns, const Equations& equations) {
    const auto inputs = names_of(equations.inputs);
    for (const auto& [name, column] : columns.inputs) {
        if (contains(inputs, name)) continue;
        throw InputError(fmt::format("--input {}: is not an input of the system{}", name, suggestion(name, inputs)));
    }
    const auto outputs = measurable(equations);
    for (const auto& [name, column] : columns.outputs) {
        if (contains(outputs, name)) continue;
        throw InputError(
            fmt::format("--output {}: is not an output or a state of the system{}", name, suggestion(name, outputs)));
    }
    for (const auto& [name, factor] : columns.record.scale) {
        if (name == "t" || contains(inputs, name) || contains(outputs, name)) continue;
        throw InputError(fmt::format("--scale {}: is not t, an input, an output or a state of the system", name));
    }
}

// The name of the column of the time in a file; nothing: there is none.
std::optional<std::string> time_column(const std::filesystem::path& file, const RecordOptions& options) {
    if (const auto named = options.columns.find("t"); named != options.columns.end()) return named->second;
    const auto all = column_names(file);
    for (const char* name : {"t", "t_s", "time", "time_s"}) {
        if (contains(all, name)) return name;
    }
    return std::nullopt;
}

} // namespace

std::vector<double> rate_of(const std::vector<double>& x, const std::vector<double>& t) {
    std::vector<double> rate(x.size(), 0);
    for (std::size_t k = 0; k < x.size(); ++k) {
        const std::size_t a = k < 2 ? 0 : k - 2, b = std::min(k + 2, x.size() - 1);
        rate[k] = (x[b] - x[a]) / (t[b] - t[a]);
    }
    return rate;
}

std::string measured_name(const SystemModel& model, std::size_t output) {
    std::string name = model.equations.outputs[model.measured[output]].name;
    if (name.ends_with(measured_state)) name.resize(name.size() - std::string_view(measured_state).size());
    return name;
}

Equations without_measured_states(const SystemModel& model) {
    Equations equations = model.equations;
    std::erase_if(equations.outputs, [&](const Equations::Output& output) {
        return std::any_of(equations.states.begin(), equations.states.end(), [&](const auto& state) {
            return output.value == state.symbol && output.name == state.name + measured_state;
        });
    });
    return equations;
}

namespace {

// States are measured without being outputs: an output that only repeats a state of its name is left out.
void name_outputs_apart(Equations& equations) {
    const auto state_of = [&](const Equations::Output& output) {
        return std::ranges::find(equations.states, output.name, [](const auto& state) { return state.name; });
    };
    std::erase_if(equations.outputs, [&](const Equations::Output& output) {
        const auto state = state_of(output);
        return state != equations.states.end() && output.value == state->symbol;
    });
    const auto refuse = [&](const auto& list, const char* what) {
        for (const auto& output : equations.outputs) {
            if (std::ranges::none_of(list, [&](const auto& one) { return one.name == output.name; })) continue;
            throw InputError(fmt::format("{}: the output {} has the name of {}, must have another name", equations.name,
                                         output.name, what));
        }
    };
    refuse(equations.states, "a state but is another value");
    refuse(equations.discrete, "a discrete variable");
    refuse(equations.parameters, "a parameter");
    refuse(equations.inputs, "an input");
}

} // namespace

SystemModel system_model_of(Equations equations, const std::vector<std::string>& free, const SystemColumns& given,
                            const std::vector<std::filesystem::path>& records) {
    name_outputs_apart(equations);
    const SystemColumns columns = sorted(given, equations);
    check_names(columns, equations);
    SystemModel model;
    const auto known = measurable(equations);
    const std::size_t outputs = equations.outputs.size();
    // Without --output: what has a column of its name.
    const auto is_measured = [&, all = columns.outputs.empty() ? column_names(records.front())
                                                               : std::vector<std::string>{}](const std::string& name) {
        return columns.outputs.empty() ? contains(all, name) : columns.outputs.contains(name);
    };
    for (std::size_t place = 0; place < known.size(); ++place) {
        if (!is_measured(known[place])) continue;
        if (place < outputs) {
            model.measured.push_back(place);
        } else {
            const auto& state = equations.states[place - outputs];
            model.measured.push_back(equations.outputs.size());
            const std::string name = state.name + measured_state;
            if (contains(known, name)) {
                throw InputError(fmt::format("{}: the system has an output {} of its own; say --output {}=COLUMN",
                                             records.front().string(), name, name));
            }
            equations.outputs.push_back({name, state.unit, state.symbol});
        }
    }
    if (model.measured.empty()) {
        throw InputError(fmt::format(
            "{}: has no column of the name of an output or a state; say --output NAME=COLUMN, where NAME is one of {}",
            records.front().string(), fmt::join(known, ", ")));
    }

    std::vector<std::string> movable = names_of(equations.parameters);
    for (const auto& state : equations.states) {
        if (!state.is_algebraic()) movable.push_back(state.name + ".start");
    }
    const auto& chosen = free.empty() ? equations.free : free;
    for (const auto& name : chosen) {
        if (contains(movable, name)) continue;
        throw InputError(
            fmt::format("--free {}: is not a parameter or STATE.start{}", name, suggestion(name, movable)));
    }
    const auto is_free = [&](const std::string& name) { return chosen.empty() || contains(chosen, name); };
    for (std::size_t p = 0; p < equations.parameters.size(); ++p) {
        const double value = std::abs(equations.parameters[p].value);
        if (is_free(equations.parameters[p].name)) {
            SystemModel::Parameter parameter{.place = p, .scale = value > 0 ? value : 1};
            // Values are about right. One that runs away, as the slope of an overflow that is as good as a wall, makes equations
            // that no solver gets through.
            if (value > 0) parameter.low = -max_change * value, parameter.high = max_change * value;
            model.parameters.push_back(parameter);
        }
    }
    for (std::size_t i = 0; i < equations.states.size(); ++i) {
        if (!equations.states[i].is_algebraic() && is_free(equations.states[i].name + ".start")) {
            model.starts.push_back(i);
        }
    }
    // The motion of an input that no state follows is imposed: a force may depend on its velocity.
    if (equations.states.empty()) {
        const auto inputs = equations.inputs;
        for (const auto& input : inputs) {
            const std::string name = rate_name_of(input.name);
            if (contains(names_of(inputs), name) || input.name.ends_with(rate_name_of(""))) continue;
            equations.inputs.push_back(
                {name, input.unit.empty() ? "" : input.unit + "/s", 0, equations.graph->variable(name)});
        }
    }
    model.equations = std::move(equations);
    return model;
}

SystemRecord read_system_record(const std::filesystem::path& file, const SystemModel& model,
                                const SystemColumns& given) {
    const SystemColumns columns = sorted(given, model.equations);
    RecordOptions options = columns.record;
    std::vector<std::string> wanted;
    for (const auto* names : {&columns.inputs, &columns.outputs}) {
        for (const auto& [name, column] : *names) options.columns[name] = column;
    }
    // Columns come in the units of the system, in SI where it states none.
    options.units.emplace();
    const auto want = [&](const std::string& name, const std::string& unit) {
        wanted.push_back(name);
        if (!unit.empty()) options.units->emplace(name, unit);
    };
    for (const auto& input : model.equations.inputs) want(input.name, input.unit);
    for (std::size_t o = 0; o < model.measured.size(); ++o) {
        want(measured_name(model, o), model.equations.outputs[model.measured[o]].unit);
    }
    const bool timeless = model.equations.states.empty();
    if (const auto time = time_column(file, columns.record)) {
        options.columns["t"] = *time;
    } else if (!timeless) {
        throw InputError(fmt::format("{}: has no column t; say --columns t=COLUMN", file.string()));
    }
    const Record all = read_record(file, options, wanted);

    SystemRecord record{.source = file.string()};
    if (const Column* t = all.table.find("t")) {
        record.t = t->values;
        const double begin = record.t.empty() ? 0 : record.t.front();
        for (double& one : record.t) one -= begin;
    } else {
        for (std::size_t k = 0; k < all.table.rows(); ++k) record.t.push_back(static_cast<double>(k));
    }
    if (record.t.size() < min_record_samples) {
        throw InputError(fmt::format("{}: has {} samples, must have {} at least", file.string(), record.t.size(),
                                     min_record_samples));
    }
    for (const auto& input : model.equations.inputs) {
        const Column* column = all.table.find(input.name);
        record.inputs.push_back(column ? column->values : std::vector<double>{});
    }
    for (std::size_t o = 0; o < model.measured.size(); ++o) {
        const auto name = measured_name(model, o);
        const Column* column = all.table.find(name);
        if (!column) {
            throw InputError(fmt::format("{}: has no column {}; say --output {}=COLUMN", file.string(), name, name));
        }
        record.outputs.push_back(column->values);
    }
    // Of rows without a time nothing has a velocity.
    for (std::size_t j = 0; j < record.inputs.size() && all.table.find("t"); ++j) {
        for (std::size_t i = 0; i < record.inputs.size(); ++i) {
            const bool own = model.equations.inputs[j].name == rate_name_of(model.equations.inputs[i].name);
            if (own && record.inputs[j].empty() && !record.inputs[i].empty()) {
                record.inputs[j] = rate_of(record.inputs[i], record.t);
            }
        }
    }
    return record;
}

} // namespace tribode
