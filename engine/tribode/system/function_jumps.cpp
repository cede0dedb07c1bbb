#include "tribode/system/function_jumps.hpp"

#include <numbers>

namespace tribode {

std::optional<Term> jump_of(Expressions& graph, Op op, Term a, Term b) {
    const bool has_cut = op == Op::atan2 && !(graph[b].op == Op::constant && graph[b].value >= 0);
    if (has_cut) return graph.make(Op::less, a, graph.constant(0));
    if (op == Op::tan) return graph.make(Op::less, graph.make(Op::cos, a), graph.constant(0));
    return std::nullopt;
}

Term without_jump(Expressions& graph, Op op, Term a, Term b, Term held) {
    const Term value = graph.make(op, a, b), holds = *jump_of(graph, op, a, b), zero = graph.constant(0);
    const auto choose = [&](Term condition, Term yes, Term no) { return graph.make(Op::select, condition, yes, no); };
    if (op == Op::tan) {
        // The largest that it is of any number near a pole.
        const Term large = graph.make(Op::multiply, graph.constant(1.6e16), graph.make(Op::sin, a));
        return choose(holds, choose(held, value, large), choose(held, graph.make(Op::negate, large), value));
    }
    const Term turn = graph.constant(2 * std::numbers::pi);
    const Term missing = choose(holds, choose(held, zero, turn), choose(held, graph.make(Op::negate, turn), zero));
    return graph.make(Op::add, value, choose(graph.make(Op::less, b, zero), missing, zero));
}

} // namespace tribode
