#include "tribode/system/input_delays.hpp"
#include "tribode/base/error.hpp"
#include "tribode/base/text.hpp"

#include <algorithm>
#include <cmath>
#include <fmt/format.h>
#include <map>

namespace tribode {

namespace {

class Shifting {
  public:
    Shifting(const Equations& equations, bool as_numbers)
        : equations_(equations),
          graph_(*equations.graph),
          as_numbers_(as_numbers) {
        for (const auto& parameter : equations.parameters) {
            numbers_[parameter.symbol] = graph_.constant(parameter.value);
        }
        for (const auto& input : equations.inputs) inputs_[input.symbol] = input.name;
        for (const auto& state : equations.states) states_[state.symbol] = "the state " + state.name;
        for (const auto& variable : equations.discrete) {
            states_[variable.symbol] = "the discrete variable " + variable.name;
        }
    }

    // The term `delay` seconds earlier.
    Term earlier(Term root, Term delay) {
        const auto order = graph_.reachable(std::span(&root, 1));
        // Below a delay its own holds.
        Expressions::Replacement moved;
        for (const Term term : order) {
            const auto node = graph_[term];
            if (node.op == Op::delay) moved[term] = earlier(node.a, graph_.make(Op::add, delay, seconds(term)));
            if (term == equations_.time) moved[term] = graph_.make(Op::subtract, term, delay);
        }
        if (graph_.is_constant(delay, 0)) return graph_.substitute(std::span(&root, 1), moved)[0];
        for (const Term term : outside_delays(root)) {
            if (const auto input = inputs_.find(term); input != inputs_.end()) {
                moved[term] = delayed(term, input->second, delay);
            } else if (const auto state = states_.find(term); state != states_.end()) {
                throw InputError(
                    fmt::format("{}: tb.delay of {}, which depends on {}: only inputs and functions of the "
                                "time can be delayed; a sample clock keeps earlier values in discrete variables",
                                equations_.name, shown(root), state->second));
            }
        }
        return graph_.substitute(std::span(&root, 1), moved)[0];
    }

    const std::vector<DelayedInput>& found() const { return found_; }

  private:
    std::string shown(Term term) const {
        const std::string text = graph_.text(term);
        return text.size() <= 60 ? text : text.substr(0, 57) + "...";
    }

    // Of a delay, as a number or as it is written.
    Term seconds(Term delay) {
        const Term term = graph_[delay].b, number = numbered(term);
        if (graph_[number].op != Op::constant) {
            throw InputError(
                fmt::format("{}: the delay {} must be a number or a parameter: it is constant during a run",
                            equations_.name, shown(term)));
        }
        const double value = graph_[number].value;
        if (value >= 0 && std::isfinite(value)) return as_numbers_ ? number : term;
        throw InputError(fmt::format("{}: the delay {} is {} s, must be finite and not negative", equations_.name,
                                     shown(term), to_text(value)));
    }

    Term numbered(Term term) { return graph_.substitute(std::span(&term, 1), numbers_)[0]; }

    // The variables of a term that are not below a delay.
    std::vector<Term> outside_delays(Term root) const {
        std::vector<Term> open = {root}, list;
        std::map<Term, bool> seen;
        while (!open.empty()) {
            const Term term = open.back();
            open.pop_back();
            if (seen[term]) continue;
            seen[term] = true;
            const auto& node = graph_[term];
            if (node.op == Op::delay) continue;
            if (node.op == Op::variable) list.push_back(term);
            const int count = operand_count(node.op);
            if (count > 0) open.push_back(node.a);
            if (count > 1) open.push_back(node.b);
            if (count > 2) open.push_back(node.c);
        }
        return list;
    }

    Term delayed(Term input, const std::string& name, Term delay) {
        for (const auto& known : found_) {
            if (known.input == input && known.seconds == delay) return known.symbol;
        }
        const double value = graph_[numbered(delay)].value;
        found_.push_back({graph_.variable(fmt::format("{}(t - {})", name, to_text(value))), input, delay, value});
        return found_.back().symbol;
    }

    const Equations& equations_;
    Expressions& graph_;
    bool as_numbers_;
    Expressions::Replacement numbers_;
    std::map<Term, std::string> inputs_, states_;
    std::vector<DelayedInput> found_;
};

} // namespace

std::vector<DelayedInput> take_out_delays(Equations& equations, bool as_numbers) {
    std::vector<Term> roots = equations.terms();
    auto& graph = *equations.graph;
    Shifting shifting(equations, as_numbers);
    const Term none = graph.constant(0);
    Expressions::Replacement replacement;
    for (const Term term : graph.reachable(roots)) {
        if (graph[term].op == Op::delay) replacement[term] = shifting.earlier(term, none);
    }
    if (!replacement.empty()) equations.replace(replacement);
    return shifting.found();
}

Term delayed_in_time(const Equations& equations, Term function, double delay) {
    return Shifting(equations, true).earlier(function, equations.graph->constant(delay));
}

} // namespace tribode
