#include "tribode/system/system_builder.hpp"
#include "tribode/base/error.hpp"

#include <algorithm>
#include <cmath>
#include <fmt/format.h>
#include <tuple>

namespace tribode {

Expression Expression::make(Op op, const Expression& a, const Expression& b, const Expression& c) {
    std::shared_ptr<Expressions> graph;
    for (const Expression* operand : {&a, &b, &c}) {
        if (!operand->graph_) continue;
        if (graph && graph != operand->graph_) {
            throw InputError("an expression is made of variables of two systems, must be of one");
        }
        graph = operand->graph_;
    }
    if (!graph) return apply(op, a.number_, b.number_, c.number_);
    const int count = operand_count(op);
    const Term term = graph->make(op, a.in(*graph), count > 1 ? b.in(*graph) : 0, count > 2 ? c.in(*graph) : 0);
    return {std::move(graph), term};
}

Term Expression::in(Expressions& graph) const { return graph_ ? term_ : graph.constant(number_); }

SystemBuilder::SystemBuilder(std::string name) {
    equations_.name = std::move(name);
    equations_.graph = std::make_shared<Expressions>();
    equations_.time = equations_.graph->variable("t");
}

Expression SystemBuilder::parameter(std::string name, double value, std::string unit) {
    Equations::Parameter parameter{std::move(name), std::move(unit), value, 0};
    parameter.symbol = equations_.graph->variable(parameter.name);
    equations_.parameters.push_back(std::move(parameter));
    return variable(equations_.parameters.back().symbol);
}

Expression SystemBuilder::state(std::string name, double start, std::string unit, double nominal) {
    if (!std::isfinite(start) || !(nominal > 0) || !std::isfinite(nominal)) {
        throw InputError(fmt::format("{}: {} has the start value {} and the nominal value {}, must be finite, and the "
                                     "latter positive",
                                     equations_.name, name, start, nominal));
    }
    Equations::State state;
    state.name = std::move(name);
    state.unit = std::move(unit);
    state.start = start;
    state.nominal = nominal;
    state.symbol = equations_.graph->variable(state.name);
    equations_.states.push_back(std::move(state));
    has_rate_.push_back(false);
    return variable(equations_.states.back().symbol);
}

Expression SystemBuilder::discrete(std::string name, double start, std::string unit) {
    Equations::Discrete discrete;
    discrete.name = std::move(name);
    discrete.unit = std::move(unit);
    discrete.start = start;
    discrete.symbol = equations_.graph->variable(discrete.name);
    equations_.discrete.push_back(std::move(discrete));
    return variable(equations_.discrete.back().symbol);
}

// Until equations() it carries its own name in the place of its equation's.
Expression SystemBuilder::algebraic(std::string name, double guess, std::string unit, double nominal) {
    Expression made = state(std::move(name), guess, std::move(unit), nominal);
    equations_.states.back().equation = equations_.states.back().name;
    return made;
}

void SystemBuilder::rate(const Expression& state, const Expression& value) {
    const Term symbol = term(state);
    for (std::size_t i = 0; i < equations_.states.size(); ++i) {
        auto& known = equations_.states[i];
        if (known.symbol != symbol || known.is_algebraic()) continue;
        if (has_rate_[i]) {
            throw InputError(fmt::format("{}: the state {} has two rates, must be one", equations_.name, known.name));
        }
        known.rate = term(value);
        has_rate_[i] = true;
        return;
    }
    throw InputError(
        fmt::format("{}: a rate is given for {}, which is no state", equations_.name, equations_.graph->text(symbol)));
}

void SystemBuilder::residual(std::string name, const Expression& value) {
    residuals_.emplace_back(std::move(name), term(value));
}

void SystemBuilder::output(std::string name, const Expression& value, std::string unit) {
    equations_.outputs.push_back({std::move(name), std::move(unit), term(value)});
}

void SystemBuilder::when(std::string name, const Expression& condition, const Assignments& set) {
    add_when(std::move(name), condition, set, false);
}

void SystemBuilder::stop_when(std::string name, const Expression& condition, const Assignments& set) {
    add_when(std::move(name), condition, set, true);
}

void SystemBuilder::add_when(std::string name, const Expression& condition, const Assignments& set, bool stop) {
    const Term made = term(condition);
    if (!is_condition((*equations_.graph)[made].op)) {
        throw InputError(fmt::format("{}: the condition of \"{}\" is {}, must be a comparison or made of comparisons",
                                     equations_.name, name, equations_.graph->text(made)));
    }
    Equations::When when;
    when.name = std::move(name);
    when.condition = made;
    when.set = assignments(set);
    when.stop = stop;
    equations_.whens.push_back(std::move(when));
}

void SystemBuilder::sample(std::string name, double period, double offset, const Assignments& set) {
    Equations::Clock clock;
    clock.name = std::move(name);
    clock.period = period;
    clock.offset = offset;
    clock.set = assignments(set);
    equations_.clocks.push_back(std::move(clock));
}

Term SystemBuilder::term(const Expression& value) const {
    if (value.graph() && value.graph() != equations_.graph) {
        throw InputError(fmt::format("{}: an expression has variables of another system", equations_.name));
    }
    return value.in(*equations_.graph);
}

Equations::Assignments SystemBuilder::assignments(const Assignments& set) const {
    Equations::Assignments made;
    for (const auto& [variable, value] : set) {
        const Term symbol = term(variable);
        const auto is_it = [&](const auto& known) { return known.symbol == symbol; };
        const bool is_state = std::any_of(equations_.states.begin(), equations_.states.end(),
                                          [&](const auto& known) { return is_it(known) && !known.is_algebraic(); });
        if (!is_state && std::none_of(equations_.discrete.begin(), equations_.discrete.end(), is_it)) {
            throw InputError(fmt::format("{}: {} gets a new value, must be a state or a discrete variable",
                                         equations_.name, equations_.graph->text(symbol)));
        }
        made.emplace_back(symbol, term(value));
    }
    return made;
}

Equations SystemBuilder::equations() const {
    Equations made = equations_;
    made.graph = std::make_shared<Expressions>(*equations_.graph); // the same terms; a system adds its own
    std::size_t used = 0;
    for (std::size_t i = 0; i < made.states.size(); ++i) {
        auto& state = made.states[i];
        if (state.is_algebraic()) {
            if (used < residuals_.size()) std::tie(state.equation, state.rate) = residuals_[used];
            ++used;
        } else if (!has_rate_[i]) {
            throw InputError(fmt::format("{}: the state {} has no rate", made.name, state.name));
        }
    }
    if (used != residuals_.size()) {
        throw InputError(fmt::format("{}: there are {} algebraic variables and {} residuals, must be as many",
                                     made.name, used, residuals_.size()));
    }
    return made;
}

} // namespace tribode
