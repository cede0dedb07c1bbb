#pragma once
#include "tribode/system/equation_system.hpp"

#include <memory>

namespace tribode {

// Equations by hand, for tests.
struct Writer {
    Equations equations;
    Expressions& graph;

    Writer() : equations{.name = "test", .graph = std::make_shared<Expressions>()}, graph(*equations.graph) {
        equations.time = graph.variable("t");
    }

    Term number(double value) { return graph.constant(value); }
    Term state(const std::string& name, double start) {
        equations.states.push_back({name, "", start, 1, graph.variable(name), number(0)});
        return equations.states.back().symbol;
    }
    Term discrete(const std::string& name, double start) {
        equations.discrete.push_back({name, "", start, graph.variable(name), {}});
        return equations.discrete.back().symbol;
    }
    Writer& rate(std::size_t state, Term value) {
        equations.states[state].rate = value;
        return *this;
    }
    Writer& when(Term condition, Equations::Assignments set) {
        equations.whens.push_back({"when " + std::to_string(equations.whens.size()), condition, std::move(set)});
        return *this;
    }

    Term add(Term a, Term b) { return graph.make(Op::add, a, b); }
    Term subtract(Term a, Term b) { return graph.make(Op::subtract, a, b); }
    Term multiply(Term a, Term b) { return graph.make(Op::multiply, a, b); }
    Term less(Term a, Term b) { return graph.make(Op::less, a, b); }
    Term where(Term c, Term a, Term b) { return graph.make(Op::select, c, a, b); }
};

} // namespace tribode
