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
    const auto first_result = static_cast<std::uint32_t>(input_count_ + constants_.size());
    for (const Term term : order) {
        const auto& node = graph[term];
        const int count = operand_count(node.op);
        if (count == 0 || is_merged(term)) continue;
        if (node.op == Op::no_event) {
            place[term] = place[node.a];
            continue;
        }
        Instruction made{static_cast<std::uint32_t>(node.op), 0, 0, 0};
        const bool sum = node.op == Op::add || node.op == Op::subtract;
        if (sum && is_merged(node.b)) {
            const auto& product = graph[node.b];
            made = {node.op == Op::add ? multiply_add : subtract_product, place[product.a], place[product.b],
                    place[node.a]};
        } else if (sum && is_merged(node.a)) {
            const auto& product = graph[node.a];
            made = {node.op == Op::add ? multiply_add : multiply_subtract, place[product.a], place[product.b],
                    place[node.b]};
        } else {
            made.a = place[node.a];
            if (count > 1) made.b = place[node.b];
            if (count > 2) made.c = place[node.c];
        }
        place[term] = first_result + static_cast<std::uint32_t>(code_.size());
        code_.push_back(made);
    }
    for (const Term output : outputs) outputs_.push_back(place[output]);
}

void Tape::evaluate(std::initializer_list<std::span<const double>> inputs, std::span<double> outputs) const {
    // Most tapes fit on the stack; a large one has the thread's own memory, which grows once.
    constexpr std::size_t usual = 512;
    std::array<double, usual> small;
    double* registers = small.data();
    const std::size_t needed = input_count_ + constants_.size() + code_.size();
    if (needed > usual) {
        thread_local std::vector<double> large;
        if (large.size() < needed) large.resize(needed);
        registers = large.data();
    }
    double* next = registers;
    for (const auto part : inputs) next = std::copy(part.begin(), part.end(), next);
    assert(next == registers + input_count_ && outputs.size() == outputs_.size());
    next = std::copy(constants_.begin(), constants_.end(), next);

    for (const auto& [code, place_a, place_b, place_c] : code_) {
        const double a = registers[place_a], b = registers[place_b];
        switch (code) {
        case static_cast<std::uint32_t>(Op::add): *next = a + b; break;
        case static_cast<std::uint32_t>(Op::subtract): *next = a - b; break;
        case static_cast<std::uint32_t>(Op::multiply): *next = a * b; break;
        case static_cast<std::uint32_t>(Op::divide): *next = a / b; break;
        case static_cast<std::uint32_t>(Op::negate): *next = -a; break;
        case multiply_add: *next = a * b + registers[place_c]; break;
        case multiply_subtract: *next = a * b - registers[place_c]; break;
        case subtract_product: *next = registers[place_c] - a * b; break;
        case static_cast<std::uint32_t>(Op::select): *next = a != 0 ? b : registers[place_c]; break;
        default: *next = apply(static_cast<Op>(code), a, b, 0);
        }
        ++next;
    }
    for (std::size_t i = 0; i < outputs_.size(); ++i) outputs[i] = registers[outputs_[i]];
}

} // namespace tribode
