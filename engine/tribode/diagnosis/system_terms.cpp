#include "tribode/diagnosis/system_terms.hpp"
#include "tribode/diagnosis/term_library.hpp"
#include "tribode/system/tape.hpp"
#include "tribode/system/units.hpp"

#include <algorithm>
#include <cmath>
#include <fmt/format.h>
#include <set>

namespace tribode {

std::string unit_of_quotient(const std::string& a, const std::string& b) {
    if (a.empty() || b.empty()) return "";
    const Dimension dimension = dimension_of(fmt::format("({})/({})", a, b));
    return !dimension || dimension->empty() ? "" : to_readable_text(dimension);
}

std::string per_second(const std::string& unit) {
    const bool is_one_word = !unit.empty() && unit != "1" && unit.find_first_of(" /*^()") == std::string::npos;
    return is_one_word ? unit + "/s" : unit_of_quotient(unit, "s");
}

std::string free_name(const Equations& equations, std::string name) {
    const auto is_taken = [&](const auto& list) {
        return std::ranges::any_of(list, [&](const auto& one) { return one.name == name; });
    };
    while (is_taken(equations.states) || is_taken(equations.discrete)) name += "_";
    return name;
}

void replace_inner(Equations& equations, std::size_t output, Term changed) {
    const Term now = equations.outputs[output].value;
    std::vector<std::size_t> shown;
    for (std::size_t o = 0; o < output; ++o) {
        if (equations.outputs[o].value == now) shown.push_back(o);
    }
    equations.replace({{now, changed}});
    for (const std::size_t o : shown) equations.outputs[o].value = now;
}

void TermTarget::add(Equations& equations, Term term) const {
    if (is_inner) {
        const Term now = equations.outputs[place].value;
        return replace_inner(equations, place, equations.graph->make(Op::add, now, term));
    }
    Term& own = is_output ? equations.outputs[place].value : equations.states[place].rate;
    own = equations.graph->make(Op::add, own, term);
}

double rms_of_values(const std::vector<double>& values) {
    double sum = 0;
    for (const double v : values) sum += v * v;
    return std::sqrt(sum / static_cast<double>(std::max<std::size_t>(values.size(), 1)));
}

TermLibrary::TermLibrary(const SystemModel& m, std::size_t n, const SystemFit& f, const std::vector<SystemVariable>& v,
                         const std::vector<double>& e)
    : model(m),
      states(n),
      fit(f),
      variables(v),
      errors(e) {
    for (std::size_t r = 0; r < fit.records().size(); ++r) {
        const auto& t = fit.records()[r].t;
        if (fit.used()[r] < 2 || t[fit.used()[r] - 1] <= duration) continue;
        duration = t[fit.used()[r] - 1];
        step = sample_time(t);
    }
    for (std::size_t i = 0; i < states; ++i) {
        const auto& state = model.equations.states[i];
        if (state.is_algebraic() || is_definition(state.rate)) continue;
        const auto variable =
            std::find_if(variables.begin(), variables.end(), [&](const auto& one) { return one.state == i; });
        TermTarget target{.name = fmt::format("der({})", state.name),
                          .unit = state.unit.empty() ? "" : fmt::format("({})/s", state.unit),
                          .place = i,
                          .scale = variable == variables.end() ? state.nominal / std::max(duration, 1e-12)
                                                               : rate_scale(variable->values)};
        for (std::size_t j = 0; j < states; ++j) {
            if (model.equations.states[j].rate != state.symbol) continue;
            target.position = model.equations.states[j].name;
            target.velocity = state.name;
        }
        targets.push_back(std::move(target));
    }
    for (std::size_t o = 0; o < model.measured.size(); ++o) {
        const auto& output = model.equations.outputs[model.measured[o]];
        if (is_state(output.value)) continue; // a sensor's path, see add_paths()
        TermTarget target{.name = "output " + output.name,
                          .unit = output.unit,
                          .is_output = true,
                          .place = model.measured[o],
                          .scale = fit.scale()[o]};
        bool is_motion = false;
        // Of an imposed motion: the input with a rate that is a length or an angle, where units say so, else the last one,
        // as x among p and x.
        for (const auto& input : variables) {
            const bool has_rate = std::any_of(variables.begin(), variables.end(), [&](const auto& other) {
                return other.name == rate_name_of(input.name);
            });
            if (!has_rate || is_motion) continue;
            is_motion = input.unit == "m" || input.unit == "mm" || input.unit == "rad" || input.unit == "deg";
            target.position = input.name;
            target.velocity = rate_name_of(input.name);
        }
        targets.push_back(std::move(target));
    }
    add_inner();
}

void TermLibrary::add_inner() {
    const auto& graph = *model.equations.graph;
    const auto variable_of = [&](Term symbol) {
        return std::find_if(variables.begin(), variables.end(), [&](const auto& one) { return one.symbol == symbol; });
    };
    const auto rate_of = [&](const SystemVariable& variable) -> std::optional<Term> {
        if (!variable.state || !is_definition(model.equations.states[*variable.state].rate)) return std::nullopt;
        return model.equations.states[*variable.state].rate;
    };
    const auto add_difference = [&](const SystemVariable& a, const SystemVariable& b, Term term) {
        SystemVariable difference{.name = a.name + " - " + b.name, .unit = a.unit, .symbol = term};
        for (std::size_t k = 0; k < a.values.size(); ++k) difference.values.push_back(a.values[k] - b.values[k]);
        const auto [low, high] = std::minmax_element(difference.values.begin(), difference.values.end());
        difference.low = *low;
        difference.high = *high;
        if (*high > *low) differences.push_back(std::move(difference));
    };
    std::string position, velocity; // of a coupling
    for (const auto& signal : model.inner) {
        const auto node = graph[signal.term];
        if (signal.kind != SystemModel::InnerSignal::Kind::difference || node.op != Op::subtract) continue;
        const auto a = variable_of(node.a), b = variable_of(node.b);
        if (a == variables.end() || b == variables.end()) continue;
        add_difference(*a, *b, signal.term);
        const auto va = rate_of(*a), vb = rate_of(*b);
        if (!va || !vb || !position.empty()) continue;
        const auto one = variable_of(*va), other = variable_of(*vb);
        if (one == variables.end() || other == variables.end()) continue;
        position = a->name + " - " + b->name;
        velocity = one->name + " - " + other->name;
    }
    for (const auto& signal : model.inner) {
        const auto& output = model.equations.outputs[signal.output];
        if (signal.kind != SystemModel::InnerSignal::Kind::shared) continue;
        const double scale = rms_of_values(values_of(output.value));
        if (!(scale > 0) || !std::isfinite(scale)) continue;
        targets.push_back({.name = output.name,
                           .unit = output.unit,
                           .is_output = false,
                           .is_inner = true,
                           .place = signal.output,
                           .scale = scale,
                           .position = position,
                           .velocity = velocity});
    }
}

std::optional<double> TermLibrary::before(const SystemVariable& input) const {
    const auto own = std::ranges::find(model.equations.inputs, input.symbol, &Equations::Input::symbol);
    const bool is_other = own != model.equations.inputs.end() && own->value != input.values.front();
    return is_other ? std::optional(own->value) : std::nullopt;
}

std::vector<double> TermLibrary::values_of(Term term) const {
    std::vector<Term> symbols;
    std::vector<double> at;
    const auto add = [&](Term symbol, double value) {
        symbols.push_back(symbol);
        at.push_back(value);
    };
    for (const auto& variable : variables) add(variable.symbol, 0);
    const auto is_moving = [&](Term symbol) {
        return std::any_of(variables.begin(), variables.end(), [&](const auto& one) { return one.symbol == symbol; });
    };
    const auto& e = model.equations;
    for (const auto& parameter : e.parameters) add(parameter.symbol, parameter.value);
    for (const auto& state : e.states) {
        if (!is_moving(state.symbol)) add(state.symbol, state.start);
    }
    for (const auto& input : e.inputs) {
        if (!is_moving(input.symbol)) add(input.symbol, input.value);
    }
    for (const auto& one : e.discrete) add(one.symbol, one.start);
    for (const auto& contact : e.contacts) add(contact.force, 0);
    add(e.time, 0);
    const Tape tape(*e.graph, symbols, {term});
    std::vector<double> values(variables.empty() ? 0 : variables.front().values.size());
    for (std::size_t k = 0; k < values.size(); ++k) {
        for (std::size_t v = 0; v < variables.size(); ++v) at[v] = variables[v].values[k];
        tape.evaluate({at}, std::span(&values[k], 1));
    }
    return values;
}

bool TermLibrary::is_state(Term term) const {
    return std::any_of(model.equations.states.begin(), model.equations.states.end(),
                       [&](const auto& state) { return state.symbol == term; });
}

bool TermLibrary::is_definition(Term rate) const {
    const Op op = (*model.equations.graph)[rate].op;
    return op == Op::variable || op == Op::constant;
}

std::vector<double> TermLibrary::errors_of(std::size_t output) const {
    std::vector<double> own;
    std::size_t next = 0;
    for (std::size_t r = 0; r < fit.records().size(); ++r) {
        for (std::size_t o = 0; o < model.measured.size(); ++o) {
            for (std::size_t k = 0; k < fit.used()[r]; ++k) {
                const double measured = fit.records()[r].outputs[o][k];
                const double error = std::isnan(measured) ? measured : errors[next++];
                if (o == output) own.push_back(error);
            }
        }
    }
    return own;
}

double TermLibrary::rate_scale(const std::vector<double>& values) const {
    double sum = 0;
    std::size_t count = 0, begin = 0;
    for (std::size_t r = 0; r < fit.records().size(); ++r) {
        const auto& t = fit.records()[r].t;
        for (std::size_t k = 1; k < fit.used()[r]; ++k, ++count) {
            const double rate = (values[begin + k] - values[begin + k - 1]) / (t[k] - t[k - 1]);
            sum += rate * rate;
        }
        begin += fit.used()[r];
    }
    return std::sqrt(sum / static_cast<double>(std::max<std::size_t>(count, 1)));
}

SystemTerm::Parameter TermLibrary::amplitude(const TermTarget& target, const std::string& name, double rms,
                                             const std::string& unit) const {
    const double probe = 0.01 * target.scale / std::max(rms, 1e-30);
    return {.name = name, .start = probe, .scale = 1e2 * probe, .unit = unit_of_quotient(target.unit, unit)};
}

std::string rate_name_of(const std::string& input) { return input + "_rate"; }

std::vector<SystemVariable> variables_of(const SystemModel& model, std::size_t states, const SystemFit& fit,
                                         const std::vector<SystemTrace>& traces) {
    std::vector<SystemVariable> found;
    const auto add = [&](SystemVariable variable) {
        const double n = static_cast<double>(std::max<std::size_t>(variable.values.size(), 1));
        double sum = 0, squares = 0, size = 0;
        for (const double v : variable.values) sum += v;
        for (const double v : variable.values) {
            squares += (v - sum / n) * (v - sum / n);
            size = std::max(size, std::abs(v));
        }
        if (!(std::sqrt(squares / n) > 1e-9 * size)) return; // it does not move
        const auto [low, high] = std::minmax_element(variable.values.begin(), variable.values.end());
        variable.low = *low;
        variable.high = *high;
        found.push_back(std::move(variable));
    };
    for (std::size_t i = 0; i < states; ++i) {
        const auto& state = model.equations.states[i];
        SystemVariable variable{.name = state.name, .unit = state.unit, .symbol = state.symbol, .state = i};
        for (std::size_t r = 0; r < traces.size(); ++r) {
            const auto& values = traces[r].states[i];
            variable.values.insert(variable.values.end(), values.begin(),
                                   values.begin() + static_cast<std::ptrdiff_t>(fit.used()[r]));
        }
        add(std::move(variable));
    }
    for (std::size_t i = 0; i < model.equations.inputs.size(); ++i) {
        const auto& input = model.equations.inputs[i];
        SystemVariable variable{.name = input.name, .unit = input.unit, .symbol = input.symbol};
        for (std::size_t r = 0; r < traces.size(); ++r) {
            const auto& given = fit.records()[r].inputs[i];
            for (std::size_t k = 0; k < fit.used()[r]; ++k) {
                variable.values.push_back(given.empty() ? input.value : given[k]);
            }
        }
        add(std::move(variable));
    }
    return found;
}

std::vector<SystemTerm> system_terms(const SystemModel& model, std::size_t states, const SystemFit& fit,
                                     const std::vector<SystemVariable>& variables, const std::vector<double>& errors,
                                     bool with_nameless) {
    TermLibrary library(model, states, fit, variables, errors);
    add_shapes(library, with_nameless);
    add_periodic(library);
    add_overflows(library);
    add_paths(library);
    if (!with_nameless) add_curves(library);
    return std::move(library.terms);
}

namespace {

// Whether a term is of states, inputs and parameters alone.
bool is_known_at_start(const Equations& equations, Term term) {
    std::set<Term> known;
    for (const auto& state : equations.states) known.insert(state.symbol);
    for (const auto& input : equations.inputs) known.insert(input.symbol);
    for (const auto& parameter : equations.parameters) known.insert(parameter.symbol);
    const auto& graph = *equations.graph;
    return std::ranges::all_of(graph.reachable(std::vector{term}),
                               [&](Term one) { return graph[one].op != Op::variable || known.contains(one); });
}

} // namespace

SystemModel extended(const SystemModel& model, const SystemTerm& term, const std::vector<double>& values,
                     std::string* text) {
    SystemModel more = model;
    more.equations = deep_copy(model.equations);
    auto& parameters = more.equations.parameters;
    std::vector<Term> symbols;
    const auto add = [&](const SystemTerm::Parameter& parameter, double value) {
        std::string name = term.name + "_" + parameter.name;
        const auto taken = [&](const std::string& one) {
            return std::any_of(parameters.begin(), parameters.end(), [&](const auto& p) { return p.name == one; });
        };
        for (int n = 2; taken(name); ++n) name = fmt::format("{}{}_{}", term.name, n, parameter.name);
        symbols.push_back(more.equations.graph->variable(name));
        parameters.push_back({name, parameter.unit, value, symbols.back()});
    };
    for (std::size_t i = 0; i < term.parameters.size(); ++i) {
        const auto& parameter = term.parameters[i];
        more.parameters.push_back({parameters.size(), parameter.low, parameter.high, parameter.scale});
        add(parameter, values[i]);
    }
    for (const auto& constant : term.constants) add(constant, constant.start);
    if (term.begins_as) {
        const Term at_rest = term.begins_as(more.equations);
        if (is_known_at_start(more.equations, at_rest)) {
            for (const std::size_t place : term.begin_so) {
                more.beginnings.push_back({more.equations.states.size() + place, at_rest, term.begins_as_measured});
            }
        }
    }
    const auto apply = [&] {
        if (term.begins_as) return term.apply(more.equations, symbols);
        // What has memory begins behind what the term makes of its input: as outputs the beginnings change with the equations.
        auto& outputs = more.equations.outputs;
        const std::size_t own = outputs.size();
        for (const auto& one : more.beginnings) outputs.push_back({{}, {}, one.at_rest});
        const Term added = term.apply(more.equations, symbols);
        for (std::size_t b = 0; b < more.beginnings.size(); ++b) {
            if (const Term at_rest = outputs[own + b].value; is_known_at_start(more.equations, at_rest)) {
                more.beginnings[b].at_rest = at_rest;
            }
        }
        outputs.resize(own);
        return added;
    };
    if (!text) {
        apply();
        return more;
    }
    // What is there already has a name: a formula that repeats it cannot be read.
    std::unordered_map<Term, std::string> names;
    const auto name = [&](Term value, const std::string& own) {
        if (operand_count((*more.equations.graph)[value].op) > 0) names.try_emplace(value, own);
    };
    for (const auto& signal : more.inner) {
        const auto& output = more.equations.outputs[signal.output];
        name(output.value, output.name);
    }
    for (const auto& state : more.equations.states) name(state.rate, fmt::format("der({})", state.name));
    *text = more.equations.graph->text(apply(), names);
    return more;
}

std::vector<double> more_values(const SystemModel& model, const std::vector<double>& values,
                                const std::vector<double>& own) {
    std::vector<double> all = values;
    all.insert(all.begin() + static_cast<std::ptrdiff_t>(model.parameters.size()), own.begin(), own.end());
    return all;
}

} // namespace tribode
