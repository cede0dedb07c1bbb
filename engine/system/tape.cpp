#include "system/tape.hpp"
#include "base/error.hpp"

#include <algorithm>
#include <array>
#include <cassert>
#include <cmath>
#include <fmt/format.h>
#include <memory>

namespace tribode {

namespace {

// Products that are only a summand are one instruction with their sum. Both are rounded, as if they were two.
constexpr auto multiply_add = static_cast<std::uint32_t>(Op::no_event) + 1; // a b + c
constexpr auto multiply_subtract = multiply_add + 1;                        // a b - c
constexpr auto subtract_product = multiply_add + 2;                         // c - a b

} // namespace

Tape::Tape(const Expressions& graph, const std::vector<Term>& inputs, const std::vector<Term>& outputs)
    : input_count_(inputs.size()) {
    const auto order = graph.reachable(outputs);

    // How often each product is used, and whether by an output: then it keeps a register of its own.
    std::unordered_map<Term, int> uses;
    for (const Term term : order) {
        const auto& node = graph[term];
        const int count = operand_count(node.op);
        if (count > 0) ++uses[node.a];
        if (count > 1) ++uses[node.b];
        if (count > 2) ++uses[node.c];
    }
    for (const Term output : outputs) ++uses[output];
    const auto merges = [&](Term term) { return graph[term].op == Op::multiply && uses[term] == 1; };

    // Registers: inputs, constants, results.
    std::unordered_map<Term, std::uint32_t> place;
    for (std::size_t i = 0; i < inputs.size(); ++i) place[inputs[i]] = static_cast<std::uint32_t>(i);
    std::vector<Term> merged;
    for (const Term term : order) {
        const auto& node = graph[term];
        if (node.op == Op::constant) {
            place[term] = static_cast<std::uint32_t>(input_count_ + constants_.size());
            constants_.push_back(node.value);
        }
        if (node.op == Op::variable && !place.contains(term)) {
            throw InputError(fmt::format("{} is not known here", graph.name(term)));
        }
        // One product per sum goes into it, the later one: the earlier has more time to be ready.
        if (node.op == Op::add || node.op == Op::subtract) {
            if (merges(node.b)) {
                merged.push_back(node.b);
            } else if (merges(node.a)) {
                merged.push_back(node.a);
            }
        }
    }
    std::sort(merged.begin(), merged.end());
    const auto is_merged = [&](Term term) { return std::binary_search(merged.begin(), merged.end(), term); };
    // Instructions by the terms that they need; those of one depth need none of that depth.
    struct Instruction {
        Term term;
        std::uint32_t code;
        std::size_t depth;
        Term a, b, c;
    };
    std::vector<Instruction> code;
    std::unordered_map<Term, std::size_t> depth;
    std::unordered_map<Term, Term> same; // a term that is another's value
    const auto value_of = [&](Term term) {
        const auto other = same.find(term);
        return other == same.end() ? term : other->second;
    };
    for (const Term term : order) {
        const auto& node = graph[term];
        const int count = operand_count(node.op);
        if (count == 0 || is_merged(term)) continue;
        if (node.op == Op::no_event) {
            same[term] = value_of(node.a);
            continue;
        }
        Instruction made{term, static_cast<std::uint32_t>(node.op), 0, node.a, node.a, node.a};
        const bool sum = node.op == Op::add || node.op == Op::subtract;
        if (sum && is_merged(node.b)) {
            const auto& product = graph[node.b];
            made = {term, node.op == Op::add ? multiply_add : subtract_product, 0, product.a, product.b, node.a};
        } else if (sum && is_merged(node.a)) {
            const auto& product = graph[node.a];
            made = {term, node.op == Op::add ? multiply_add : multiply_subtract, 0, product.a, product.b, node.b};
        } else {
            if (count > 1) made.b = node.b;
            if (count > 2) made.c = node.c;
        }
        for (Term* operand : {&made.a, &made.b, &made.c}) {
            *operand = value_of(*operand);
            made.depth = std::max(made.depth, depth[*operand]);
        }
        depth[term] = ++made.depth;
        code.push_back(made);
    }
    std::stable_sort(code.begin(), code.end(), [](const Instruction& a, const Instruction& b) {
        return a.depth != b.depth ? a.depth < b.depth : a.code < b.code;
    });
    auto next = static_cast<std::uint32_t>(input_count_ + constants_.size());
    for (const auto& made : code) {
        // A run may go on into the next depth: within it, too, operands come first.
        if (runs_.empty() || runs_.back().code != made.code) runs_.push_back({made.code, 0});
        ++runs_.back().count;
        operands_.push_back({place[made.a], place[made.b], place[made.c]});
        place[made.term] = next++;
    }
    for (const Term output : outputs) outputs_.push_back(place[value_of(output)]);
}

void Tape::evaluate(std::initializer_list<std::span<const double>> inputs, std::span<double> outputs) const {
    // Most tapes fit on the stack; a large one has the thread's own memory, which grows once.
    constexpr std::size_t usual = 512;
    std::array<double, usual> small;
    double* registers = small.data();
    const std::size_t needed = input_count_ + constants_.size() + operands_.size();
    if (needed > usual) {
        thread_local std::vector<double> large;
        if (large.size() < needed) large.resize(needed);
        registers = large.data();
    }
    double* next = registers;
    for (const auto part : inputs) next = std::copy(part.begin(), part.end(), next);
    assert(next == registers + input_count_ && outputs.size() == outputs_.size());
    next = std::copy(constants_.begin(), constants_.end(), next);

    const Operands* operands = operands_.data();
    const auto run = [&](std::uint32_t count, const auto& operation) {
        for (const Operands* end = operands + count; operands != end; ++operands) {
            *next++ = operation(registers[operands->a], registers[operands->b], registers[operands->c]);
        }
    };
    for (const auto& [code, count] : runs_) {
        switch (code) {
        case static_cast<std::uint32_t>(Op::add): run(count, [](double a, double b, double) { return a + b; }); break;
        case static_cast<std::uint32_t>(Op::subtract):
            run(count, [](double a, double b, double) { return a - b; });
            break;
        case static_cast<std::uint32_t>(Op::multiply):
            run(count, [](double a, double b, double) { return a * b; });
            break;
        case static_cast<std::uint32_t>(Op::divide):
            run(count, [](double a, double b, double) { return a / b; });
            break;
        case static_cast<std::uint32_t>(Op::negate): run(count, [](double a, double, double) { return -a; }); break;
        case multiply_add: run(count, [](double a, double b, double c) { return a * b + c; }); break;
        case multiply_subtract: run(count, [](double a, double b, double c) { return a * b - c; }); break;
        case subtract_product: run(count, [](double a, double b, double c) { return c - a * b; }); break;
        case static_cast<std::uint32_t>(Op::select):
            run(count, [](double a, double b, double c) { return a != 0 ? b : c; });
            break;
        default: run(count, [op = static_cast<Op>(code)](double a, double b, double c) { return apply(op, a, b, c); });
        }
    }
    for (std::size_t i = 0; i < outputs_.size(); ++i) outputs[i] = registers[outputs_[i]];
}

} // namespace tribode
