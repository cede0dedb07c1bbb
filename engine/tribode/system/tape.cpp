#include "tribode/system/tape.hpp"
#include "tribode/base/error.hpp"
#include "tribode/base/lanes.hpp"
#include "tribode/system/lane_functions.hpp"
#include "tribode/system/work_space.hpp"

#include <algorithm>
#include <array>
#include <bit>
#include <cassert>
#include <cmath>
#include <cstring>
#include <fmt/format.h>
#include <iterator>
#include <map>
#include <optional>
#include <set>
#include <tuple>
#include <unordered_map>
#include <unordered_set>
#include <utility>

namespace tribode {

namespace {

// Kinds of cells beside those of Op. A sum: sum_code; of few summands, n, sum_code + n, so that it is written out.
constexpr auto sum_code = static_cast<std::uint32_t>(Op::before) + 1;
constexpr std::uint32_t few = 12;
constexpr std::uint32_t lesser_code = sum_code + few + 1;  // a < b: a, else b
constexpr std::uint32_t greater_code = sum_code + few + 2; // a < b: b, else a
constexpr std::uint32_t block_code = sum_code + few + 3;   // the head of a block
static_assert(block_code < 256);
constexpr std::uint32_t bits_of_step = 2;
constexpr std::size_t constant_part = 2; // of the inputs

std::optional<BlockOperation> block_operation(std::uint32_t code) {
    switch (code) {
    case static_cast<std::uint32_t>(Op::add): return BlockOperation::add;
    case static_cast<std::uint32_t>(Op::subtract): return BlockOperation::subtract;
    case static_cast<std::uint32_t>(Op::multiply): return BlockOperation::multiply;
    case static_cast<std::uint32_t>(Op::divide): return BlockOperation::divide;
    case static_cast<std::uint32_t>(Op::negate): return BlockOperation::negate;
    case static_cast<std::uint32_t>(Op::less): return BlockOperation::less;
    case static_cast<std::uint32_t>(Op::less_equal): return BlockOperation::less_equal;
    case static_cast<std::uint32_t>(Op::equal): return BlockOperation::equal;
    case static_cast<std::uint32_t>(Op::select): return BlockOperation::select;
    case lesser_code: return BlockOperation::lesser;
    case greater_code: return BlockOperation::greater;
    default: return std::nullopt;
    }
}

// A product as a summand takes no register: factor a b, in the order in which it was written.
struct Summand {
    double factor;
    std::optional<Term> a, b; // absent: 1

    bool is_value() const { return std::abs(factor) == 1 && a && !b; }
};

// An operation on operands, or a sum of summands.
struct Instruction {
    Term term;
    std::uint32_t code;
    std::vector<Term> operands;
    std::vector<Summand> summands;
    std::size_t depth = 0; // those of one depth do not need one another
    std::size_t form = 0;  // the same where the same has been written with other variables and constants
    bool is_constant = true;

    // In the places of the same number stand operands that correspond to one another where the form is the same.
    std::size_t slot_count() const { return operands.size() + 2 * summands.size(); }
    std::optional<Term> slot(std::size_t i) const {
        if (i < operands.size()) return operands[i];
        const Summand& summand = summands[(i - operands.size()) / 2];
        return (i - operands.size()) % 2 == 0 ? summand.a : summand.b;
    }
};

// What a tape does, as terms.
class Program {
  public:
    Program(const Expressions& graph, const std::vector<Term>& outputs, const std::unordered_set<Term>& constant_inputs)
        : graph_(graph) {
        const auto order = graph.reachable(outputs);
        std::unordered_map<Term, bool> needed; // in a register of its own
        for (const Term term : order) {
            const auto& node = graph[term];
            const int count = operand_count(node.op);
            if (count > 0) ++uses_[node.a];
            if (count > 1) ++uses_[node.b];
            if (count > 2) ++uses_[node.c];
        }
        for (const Term output : outputs) {
            ++uses_[output];
            needed[value_of(output)] = true;
        }
        for (auto term = order.rbegin(); term != order.rend(); ++term) {
            if (!needed[*term]) continue;
            if (operand_count(graph[*term].op) == 0) {
                leaves_.push_back(*term);
                continue;
            }
            code_.push_back(instruction_of(*term));
            for (const Term operand : operands_of(code_.back())) needed[operand] = true;
        }
        std::reverse(leaves_.begin(), leaves_.end());
        std::reverse(code_.begin(), code_.end());
        std::unordered_map<Term, std::size_t> depth, form;
        std::unordered_map<Term, bool> is_constant;
        for (const Term leaf : leaves_) {
            is_constant[leaf] = graph[leaf].op == Op::constant || constant_inputs.contains(leaf);
        }
        std::map<std::vector<std::size_t>, std::size_t> forms; // by code and forms of the operands, as they come
        constexpr std::size_t constant = 1, variable = 2;
        const auto form_of = [&](const std::optional<Term>& operand) {
            if (!operand) return std::size_t{0};
            if (operand_count(graph[*operand].op) > 0) return form.at(*operand);
            return graph[*operand].op == Op::constant ? constant : variable;
        };
        for (auto& made : code_) {
            for (const Term operand : operands_of(made)) {
                made.depth = std::max(made.depth, depth[operand]);
                made.is_constant = made.is_constant && is_constant.at(operand);
            }
            is_constant[made.term] = made.is_constant;
            depth[made.term] = ++made.depth;
            std::vector<std::size_t> parts = {made.code, made.summands.size()};
            for (std::size_t i = 0; i < made.slot_count(); ++i) parts.push_back(form_of(made.slot(i)));
            form[made.term] = made.form = forms.try_emplace(parts, variable + 1 + forms.size()).first->second;
        }
        const auto key = [](const Instruction& i) {
            return std::tuple(!i.is_constant, i.depth, i.code, i.summands.size(), i.form);
        };
        std::stable_sort(code_.begin(), code_.end(), [&](const auto& a, const auto& b) { return key(a) < key(b); });
        order_leaves();
    }

    const std::vector<Term>& leaves() const { return leaves_; } // constants and variables
    const std::vector<Instruction>& code() const { return code_; }

    // The term of the same value that is no mere name for another.
    Term value_of(Term term) const {
        const auto is_name = [&] {
            const Op op = graph_[term].op;
            return op == Op::no_event || op == Op::delay || op == Op::before;
        };
        while (is_name()) term = graph_[term].a;
        return term;
    }

  private:
    // As the instructions need them, those of corresponding operands one behind another.
    void order_leaves() {
        std::vector<Term> ordered;
        std::set<Term> left(leaves_.begin(), leaves_.end());
        for (std::size_t i = 0, end = 0; i < code_.size(); i = end) {
            const auto is_like_it = [&](const Instruction& other) {
                return other.form == code_[i].form && other.depth == code_[i].depth &&
                       other.is_constant == code_[i].is_constant;
            };
            while (end < code_.size() && is_like_it(code_[end])) ++end;
            for (std::size_t slot = 0; slot < code_[i].slot_count(); ++slot) {
                for (std::size_t k = i; k < end; ++k) {
                    const auto operand = code_[k].slot(slot);
                    if (operand && left.erase(*operand) > 0) ordered.push_back(*operand);
                }
            }
        }
        // Those that are outputs as they are.
        std::copy_if(leaves_.begin(), leaves_.end(), std::back_inserter(ordered),
                     [&](Term leaf) { return left.contains(leaf); });
        leaves_ = std::move(ordered);
    }

    static bool is_sum(Op op) { return op == Op::add || op == Op::subtract; }

    static std::vector<Term> operands_of(const Instruction& instruction) {
        std::vector<Term> list = instruction.operands;
        for (const auto& summand : instruction.summands) {
            if (summand.a) list.push_back(*summand.a);
            if (summand.b) list.push_back(*summand.b);
        }
        return list;
    }

    // k a, (k a) b, a b, or a value by itself.
    Summand summand_of(Term term) const {
        term = value_of(term);
        const auto& node = graph_[term];
        if (node.op == Op::constant) return {node.value, std::nullopt, std::nullopt};
        if (node.op != Op::multiply) return {1, term, std::nullopt};
        const Term a = value_of(node.a), b = value_of(node.b);
        for (const auto& [part, other] : {std::pair(a, b), std::pair(b, a)}) {
            if (graph_[part].op == Op::constant) return {graph_[part].value, other, std::nullopt};
        }
        for (const auto& [part, other] : {std::pair(a, b), std::pair(b, a)}) {
            if (graph_[part].op != Op::multiply) continue;
            const Summand scaled = summand_of(part);
            if (!scaled.b) return {scaled.factor, scaled.a, other};
        }
        return {1, a, b};
    }

    // All that is added up, in the written order: a sum that is needed here only goes on in this one.
    std::vector<Summand> summands_of(Term sum) const {
        std::vector<Summand> list; // the last first
        for (;;) {
            const auto& node = graph_[sum];
            const auto goes_on = [&](Term part) { return is_sum(graph_[part].op) && uses_.at(part) == 1; };
            Term first = node.a, second = node.b;
            if (node.op == Op::add && !goes_on(first)) std::swap(first, second);
            list.push_back(summand_of(second));
            if (node.op == Op::subtract) list.back().factor = -list.back().factor;
            if (!goes_on(first)) {
                list.push_back(summand_of(first));
                break;
            }
            sum = first;
        }
        std::reverse(list.begin(), list.end());
        return list;
    }

    Instruction instruction_of(Term term) const {
        const auto& node = graph_[term];
        const int count = operand_count(node.op);
        Instruction made{term, static_cast<std::uint32_t>(node.op), {}, {}};
        if (is_sum(node.op)) made.summands = summands_of(term);
        if (node.op == Op::multiply) made.summands = {summand_of(term)};
        // Two registers and no factor are quicker as what they are.
        const bool is_plain = std::all_of(made.summands.begin(), made.summands.end(), [&](const Summand& summand) {
            return node.op == Op::multiply ? summand.factor == 1 : summand.is_value();
        });
        if (made.summands.size() > 2 || !is_plain) {
            made.code = sum_code;
            return made;
        }
        made.summands.clear();
        if (node.op == Op::select && graph_[node.a].op == Op::less && uses_.at(node.a) == 1) {
            // A minimum or maximum needs no condition of its own.
            const Term a = value_of(graph_[node.a].a), b = value_of(graph_[node.a].b);
            const Term holds = value_of(node.b), fails = value_of(node.c);
            if ((holds == a && fails == b) || (holds == b && fails == a)) {
                made.code = holds == a ? lesser_code : greater_code;
                made.operands = {a, b};
                return made;
            }
        }
        if (count > 0) made.operands.push_back(value_of(node.a));
        if (count > 1) made.operands.push_back(value_of(node.b));
        if (count > 2) made.operands.push_back(value_of(node.c));
        return made;
    }

    const Expressions& graph_;
    std::unordered_map<Term, int> uses_;
    std::vector<Term> leaves_;
    std::vector<Instruction> code_;
};

} // namespace

Tape::Tape(const Expressions& graph, const std::vector<Term>& inputs, const std::vector<Term>& outputs)
    : Tape(graph, inputs, outputs, {inputs.size(), 0, 0}) {}

Tape::Tape(const Expressions& graph, const std::vector<Term>& inputs, const std::vector<Term>& outputs,
           const Parts& parts) {
    std::unordered_map<Term, std::uint32_t> place;
    std::unordered_map<Term, std::pair<std::uint32_t, std::uint32_t>> input_of; // its part, its place in it
    std::unordered_set<Term> constant_inputs;
    std::uint32_t next = 1, part = 0, first = 0; // the place of the part's first input
    for (std::uint32_t i = 0; i < inputs.size(); ++i) {
        while (i - first >= parts[part]) first += static_cast<std::uint32_t>(parts[part++]);
        if (input_of.try_emplace(inputs[i], part, i - first).second && part == constant_part) {
            constant_inputs.insert(inputs[i]);
        }
    }
    const Program program(graph, outputs, constant_inputs);
    const auto is_constant = [&](Term leaf) { return graph[leaf].op == Op::constant; };
    for (part = 0; part < parts.size(); ++part) {
        for (const Term leaf : program.leaves()) {
            if (is_constant(leaf)) continue;
            const auto input = input_of.find(leaf);
            if (input == input_of.end()) throw InputError(fmt::format("{} is not known here", graph.name(leaf)));
            if (input->second.first != part) continue;
            place[leaf] = next++;
            reads_.push_back(input->second.second);
            ++read_counts_[part];
        }
    }
    for (const Term leaf : program.leaves()) {
        if (!is_constant(leaf)) continue;
        place[leaf] = next++;
        constants_.push_back(graph[leaf].value);
    }
    for (const auto& made : program.code()) {
        const auto length = static_cast<std::uint32_t>(made.summands.size());
        if (length > 0) {
            code_.push_back({made.code + (length <= few ? length : 0), length, 0, 0});
            for (const auto& [factor, a, b] : made.summands) {
                code_.push_back(Cell::summand(factor, a ? place[*a] : one, b ? place[*b] : one));
            }
        } else {
            const auto operand = [&](std::size_t i) {
                return place[made.operands[std::min(i, made.operands.size() - 1)]];
            };
            code_.push_back({made.code, operand(0), operand(1), operand(2)});
        }
        if (made.code == static_cast<std::uint32_t>(Op::lookup)) {
            const auto& table = graph.table_of(made.term);
            const auto known = std::find(tables_.begin(), tables_.end(), table);
            code_.back().code += 256 * static_cast<std::uint32_t>(known - tables_.begin());
            if (known == tables_.end()) {
                tables_.push_back(table);
                slopes_.push_back({table->slope(0), table->variables() > 1 ? table->slope(1) : nullptr});
            }
        }
        place[made.term] = next++;
    }
    register_count_ = next;
    instruction_count_ = program.code().size();
    constant_count_ = static_cast<std::size_t>(std::ranges::count_if(program.code(), &Instruction::is_constant));
    for (const Term output : outputs) outputs_.push_back(place[program.value_of(output)]);
    find_blocks();
}

Tape::Cell Tape::Cell::summand(double factor, std::uint32_t a, std::uint32_t b) {
    const auto halves = std::bit_cast<std::array<std::uint32_t, 2>>(factor);
    return {halves[0], halves[1], a, b};
}

std::uint32_t Tape::Cell::summand_count() const {
    return kind() < sum_code || kind() > sum_code + few ? 0 : kind() == sum_code ? a : kind() - sum_code;
}

template <class Visit>
void Tape::for_instructions(const Visit& visit) const {
    for (std::size_t i = 0; i < code_.size();) {
        const Cell& head = code_[i++];
        if (head.kind() == block_code) continue;
        const std::size_t count = head.summand_count();
        visit(head, std::span(code_).subspan(i, count));
        i += count;
    }
}

std::vector<Tape::Placed> Tape::instructions() const {
    std::vector<Placed> all;
    for_instructions([&](const Cell& head, std::span<const Cell> summands) { all.push_back({&head, summands}); });
    return all;
}

// Puts heads before instructions that can be carried out in blocks: those of one kind that do not need one another, and each
// operand of which is a constant number of registers ahead of that of the instruction before.
void Tape::find_blocks() {
    constexpr auto longest_step = static_cast<std::uint32_t>(Step::two);
    const std::vector<Placed> all = instructions();
    const auto slot = [&](std::size_t i, std::size_t k) {
        const auto& [head, summands] = all[i];
        if (!summands.empty()) return k % 2 == 0 ? summands[k / 2].b : summands[k / 2].c;
        return k == 0 ? head->a : k == 1 ? head->b : head->c;
    };
    const auto step = [&](std::size_t i, std::size_t k) { return slot(i + 1, k) - slot(i, k); };
    const auto first_result = static_cast<std::uint32_t>(1 + reads_.size() + constants_.size());
    const auto end_of_block = [&](std::size_t i, std::size_t slots) {
        const auto goes_on = [&](std::size_t next, std::size_t k) {
            return step(next - 1, k) == step(i, k) && step(i, k) <= longest_step && slot(next, k) < first_result + i;
        };
        std::size_t end = i + 1;
        for (; end < all.size() && end != constant_count_ && all[end].head->code == all[i].head->code; ++end) {
            for (std::size_t k = 0; k < slots; ++k) {
                if (!goes_on(end, k)) return end;
            }
        }
        return end;
    };
    std::vector<Cell> code;
    for (std::size_t i = 0, end = 0; i < all.size(); i = end) {
        if (i == constant_count_) constant_code_ = code.size();
        const auto& [head, summands] = all[i];
        const bool is_sum = !summands.empty();
        const auto operation = block_operation(head->kind());
        const bool may_be_block = is_sum ? summands.size() <= few : operation.has_value();
        const std::size_t slots = is_sum ? 2 * summands.size() : 3;
        end = may_be_block ? end_of_block(i, slots) : i + 1;
        const std::size_t whole = (end - i) / smallest_block * smallest_block;
        if (whole > 0) {
            std::uint64_t steps = 0;
            for (std::size_t k = slots; k-- > 0;) steps = (steps << bits_of_step) + step(i, k);
            code.push_back(
                {block_code + 256 * static_cast<std::uint32_t>(whole),
                 is_sum ? static_cast<std::uint32_t>(factors_.size()) : static_cast<std::uint32_t>(*operation),
                 static_cast<std::uint32_t>(steps), static_cast<std::uint32_t>(steps >> 32)});
            for (std::size_t n = 0; n < summands.size(); ++n) {
                for (std::size_t at = i; at < i + whole; ++at) factors_.push_back(all[at].summands[n].factor());
            }
        }
        for (std::size_t at = i; at < end; ++at) {
            code.push_back(*all[at].head);
            code.insert(code.end(), all[at].summands.begin(), all[at].summands.end());
        }
    }
    if (all.size() == constant_count_) constant_code_ = code.size();
    code_ = std::move(code);
}

void Tape::operate(const Cell& block, const Cell* first, const double* registers, double* results) const {
    static_assert(2 * few * bits_of_step <= 64);
    std::uint64_t steps = block.b + (std::uint64_t{block.c} << 32);
    const auto next_step = [&] {
        const auto step = static_cast<Step>(steps % (1U << bits_of_step));
        steps >>= bits_of_step;
        return step;
    };
    const std::uint32_t count = block.extra(), length = first->summand_count();
    if (length == 0) {
        BlockOperands operands{{registers + first->a, registers + first->b, registers + first->c}, {}};
        for (Step& step : operands.step) step = next_step();
        operate_in_blocks(static_cast<BlockOperation>(block.a), operands, count, results);
        return;
    }
    std::array<BlockSummand, few> summands;
    const double* factors = factors_.data() + block.a;
    for (std::uint32_t n = 0; n < length; ++n, factors += count) {
        const Cell& summand = first[1 + n];
        const Step a = next_step(), b = next_step();
        summands[n] = {factors, {registers + summand.b, registers + summand.c}, {a, b}};
    }
    sum_in_blocks({summands.data(), length}, count, results);
}

namespace {

// Numbers of several sets of inputs, with operations as of one number.
template <std::size_t lanes>
struct Several {
    using Type __attribute__((vector_size(lanes * sizeof(double)), may_alias)) = double;
};
template <>
struct Several<1> {
    using Type = double;
};

} // namespace

// Carries out some of the instructions. `next`: the register of the first result.
template <std::size_t lanes, bool by_lane_functions>
inline void Tape::interpret(const Cell* at, const Cell* end, double* registers, double* next) const {
    using Value = typename Several<lanes>::Type;
    // By reference, as what a function that returns vectors does depends on the instructions it may use.
    const auto value = [registers](std::uint32_t place) -> const Value& {
        return *reinterpret_cast<const Value*>(registers + place * lanes);
    };
    const auto result = [&next]() -> Value& {
        auto& place = *reinterpret_cast<Value*>(next);
        next += lanes;
        return place;
    };
    const Value zeros = {}, ones = zeros + 1.0;
    // Lane by lane. The results of all before one is written: what is written is none of the operands.
    const auto of_operands = [&](const Cell& cell, const auto& operation) {
        const double *a = registers + cell.a * lanes, *b = registers + cell.b * lanes, *c = registers + cell.c * lanes;
        double results[lanes];
        for (std::size_t l = 0; l < lanes; ++l) results[l] = operation(a[l], b[l], c[l]);
        for (std::size_t l = 0; l < lanes; ++l) *next++ = results[l];
    };
    // Of few summands written out: a loop over them would cost more than they do.
    const auto sum = [&]<std::size_t... further>(std::index_sequence<further...>) {
        Value total = at[0].factor() * value(at[0].b) * value(at[0].c);
        ((total = total + at[1 + further].factor() * value(at[1 + further].b) * value(at[1 + further].c)), ...);
        at += 1 + sizeof...(further);
        result() = total;
    };
    const auto long_sum = [&](std::uint32_t length) {
        const Cell* last = at + length;
        Value total = at->factor() * value(at->b) * value(at->c);
        for (++at; at != last; ++at) total = total + at->factor() * value(at->b) * value(at->c);
        result() = total;
    };
    const auto function = [&](const Cell& cell, const auto& of_lanes) {
        if constexpr (by_lane_functions) {
            of_lanes(registers + cell.a * lanes, next);
            next += lanes;
        } else {
            of_operands(cell,
                        [&](double a, double b, double c) { return apply(static_cast<Op>(cell.kind()), a, b, c); });
        }
    };
    constexpr auto op = [](Op of) { return static_cast<std::uint32_t>(of); };

    while (at != end) {
        const Cell& cell = *at++;
        switch (cell.kind()) {
        case sum_code: long_sum(cell.a); break;
        case sum_code + 1: sum(std::make_index_sequence<0>()); break;
        case sum_code + 2: sum(std::make_index_sequence<1>()); break;
        case sum_code + 3: sum(std::make_index_sequence<2>()); break;
        case sum_code + 4: sum(std::make_index_sequence<3>()); break;
        case sum_code + 5: sum(std::make_index_sequence<4>()); break;
        case sum_code + 6: sum(std::make_index_sequence<5>()); break;
        case sum_code + 7: sum(std::make_index_sequence<6>()); break;
        case sum_code + 8: sum(std::make_index_sequence<7>()); break;
        case sum_code + 9: sum(std::make_index_sequence<8>()); break;
        case sum_code + 10: sum(std::make_index_sequence<9>()); break;
        case sum_code + 11: sum(std::make_index_sequence<10>()); break;
        case sum_code + 12: sum(std::make_index_sequence<11>()); break;
        case block_code:
            if constexpr (lanes == 1) { // else the instructions follow one by one
                operate(cell, at, registers, next);
                next += cell.extra();
                at += std::size_t{cell.extra()} * (1 + at->summand_count());
            }
            break;
        case lesser_code: {
            const Value &a = value(cell.a), &b = value(cell.b);
            result() = a < b ? a : b;
            break;
        }
        case greater_code: {
            const Value &a = value(cell.a), &b = value(cell.b);
            result() = a < b ? b : a;
            break;
        }
        case op(Op::add): result() = value(cell.a) + value(cell.b); break;
        case op(Op::subtract): result() = value(cell.a) - value(cell.b); break;
        case op(Op::multiply): result() = value(cell.a) * value(cell.b); break;
        case op(Op::divide): result() = value(cell.a) / value(cell.b); break;
        case op(Op::negate): result() = -value(cell.a); break;
        case op(Op::select): {
            const Value &holds = value(cell.b), &fails = value(cell.c);
            result() = value(cell.a) != 0.0 ? holds : fails;
            break;
        }
        case op(Op::less): result() = value(cell.a) < value(cell.b) ? ones : zeros; break;
        case op(Op::less_equal): result() = value(cell.a) <= value(cell.b) ? ones : zeros; break;
        case op(Op::equal): result() = value(cell.a) == value(cell.b) ? ones : zeros; break;
        case op(Op::logical_not): result() = value(cell.a) == 0.0 ? ones : zeros; break;
        case op(Op::all):
            of_operands(cell, [](double a, double b, double) { return a != 0 && b != 0 ? 1.0 : 0.0; });
            break;
        case op(Op::any):
            of_operands(cell, [](double a, double b, double) { return a != 0 || b != 0 ? 1.0 : 0.0; });
            break;
        case op(Op::power): of_operands(cell, [](double a, double b, double) { return power(a, b); }); break;
        case op(Op::floor): of_operands(cell, [](double a, double, double) { return std::floor(a); }); break;
        case op(Op::sin): function(cell, [](const double* x, double* y) { lane_functions::sin<lanes>(x, y); }); break;
        case op(Op::cos): function(cell, [](const double* x, double* y) { lane_functions::cos<lanes>(x, y); }); break;
        case op(Op::exp): function(cell, [](const double* x, double* y) { lane_functions::exp<lanes>(x, y); }); break;
        case op(Op::tanh): function(cell, [](const double* x, double* y) { lane_functions::tanh<lanes>(x, y); }); break;
        case op(Op::lookup):
            of_operands(cell, [&table = *tables_[cell.extra()]](double x, double y, double side) {
                return table.value(x, y, static_cast<int>(side));
            });
            break;
        default:
            of_operands(cell,
                        [&](double a, double b, double c) { return apply(static_cast<Op>(cell.kind()), a, b, c); });
        }
    }
}

// The inputs of a part into the registers from `next`. Returns the register behind them.
template <std::size_t lanes>
inline double* Tape::read(std::size_t part, const double* inputs, double* next) const {
    const std::uint32_t* place = reads_.data();
    for (std::size_t before = 0; before < part; ++before) place += read_counts_[before];
    for (std::uint32_t count = read_counts_[part]; count > 0; --count) {
        std::memcpy(next, inputs + std::size_t{*place++} * lanes, lanes * sizeof(double)); // in one move
        next += lanes;
    }
    return next;
}

template <std::size_t lanes>
inline void Tape::write(const double* registers, double* outputs) const {
    for (const std::uint32_t output : outputs_) {
        std::memcpy(outputs, registers + output * lanes, lanes * sizeof(double));
        outputs += lanes;
    }
}

void Tape::evaluate_one(const std::array<const double*, 3>& inputs, double* outputs) const {
    WorkSpace<double, 512> memory(register_count_ + 1); // see operate_in_blocks()
    double* registers = memory.data();
    double* next = registers;
    *next++ = 1;
    for (std::size_t part = 0; part < inputs.size(); ++part) next = read<1>(part, inputs[part], next);
    // A loop, because a call for a handful of numbers costs more than they do.
    constexpr std::size_t handful = 16;
    if (constants_.size() > handful) {
        next = std::copy(constants_.begin(), constants_.end(), next);
    } else {
        for (const double value : constants_) *next++ = value;
    }
    interpret<1, false>(code_.data(), code_.data() + code_.size(), registers, next);
    write<1>(registers, outputs);
}

template <std::size_t lanes>
inline void Tape::prepare(const double* constant, double* registers) const {
    const auto fill = [](double* to, double value) {
        for (std::size_t l = 0; l < lanes; ++l) *to++ = value;
        return to;
    };
    fill(registers, 1);
    double* next = read<lanes>(constant_part, constant, registers + (1 + read_counts_[0] + read_counts_[1]) * lanes);
    for (const double value : constants_) next = fill(next, value);
    interpret<lanes, true>(code_.data(), code_.data() + constant_code_, registers, next);
}

template <std::size_t lanes>
inline void Tape::go_on(const double* part0, const double* part1, double* registers, double* outputs) const {
    read<lanes>(1, part1, read<lanes>(0, part0, registers + lanes));
    const std::size_t first = 1 + reads_.size() + constants_.size() + constant_count_;
    interpret<lanes, true>(code_.data() + constant_code_, code_.data() + code_.size(), registers,
                           registers + first * lanes);
    write<lanes>(registers, outputs);
}

// With the widest registers that the processor has; no operation is contracted, so the bits are the same on all of them.
[[gnu::flatten]] TRIBODE_CLONES void Tape::prepare_four(const double* constant, double* registers) const {
    prepare<4>(constant, registers);
}
[[gnu::flatten]] TRIBODE_CLONES void Tape::prepare_eight(const double* constant, double* registers) const {
    prepare<8>(constant, registers);
}
[[gnu::flatten]] TRIBODE_CLONES void Tape::evaluate_four(const double* part0, const double* part1, double* registers,
                                                         double* outputs) const {
    go_on<4>(part0, part1, registers, outputs);
}
[[gnu::flatten]] TRIBODE_CLONES void Tape::evaluate_eight(const double* part0, const double* part1, double* registers,
                                                          double* outputs) const {
    go_on<8>(part0, part1, registers, outputs);
}

template <std::size_t lanes>
Tape::SideBySide<lanes>::SideBySide(const Tape& tape, const double* constant)
    : tape_(tape),
      registers_((tape.register_count_ + 1) * lanes) { // see operate_in_blocks()
    if constexpr (lanes == 1) tape_.prepare<1>(constant, registers_.data());
    if constexpr (lanes == 4) tape_.prepare_four(constant, registers_.data());
    if constexpr (lanes == 8) tape_.prepare_eight(constant, registers_.data());
}

template <std::size_t lanes>
void Tape::SideBySide<lanes>::evaluate(const double* part0, const double* part1, double* outputs) {
    double* registers = registers_.data();
    if constexpr (lanes == 1) tape_.go_on<1>(part0, part1, registers, outputs);
    if constexpr (lanes == 4) tape_.evaluate_four(part0, part1, registers, outputs);
    if constexpr (lanes == 8) tape_.evaluate_eight(part0, part1, registers, outputs);
}

template class Tape::SideBySide<1>;
template class Tape::SideBySide<4>;
template class Tape::SideBySide<8>;

void Tape::enclose(const EnclosedInputs& inputs, std::span<Enclosure> outputs) const {
    WorkSpace<Enclosure, 256> memory(register_count_);
    Enclosure* registers = memory.data();
    Enclosure* next = registers;
    *next++ = Enclosure::constant(1);
    const std::uint32_t* read = reads_.data();
    for (std::size_t part = 0; part < read_counts_.size(); ++part) {
        for (std::uint32_t i = 0; i < read_counts_[part]; ++i, ++read) {
            *next++ =
                part < inputs.moving.size() ? inputs.moving[part][*read] : Enclosure::constant(inputs.constant[*read]);
        }
    }
    for (const double value : constants_) *next++ = Enclosure::constant(value);
    for_instructions([&](const Cell& head, std::span<const Cell> summands) {
        Enclosure result;
        bool is_first = true;
        for (const Cell& summand : summands) {
            const Enclosure part = product(summand.factor(), registers[summand.b], registers[summand.c]);
            result = is_first ? part : sum(result, part);
            is_first = false;
        }
        if (summands.empty()) {
            const Enclosure &a = registers[head.a], &b = registers[head.b], &c = registers[head.c];
            const auto op = static_cast<Op>(head.kind());
            const bool is_lesser = head.kind() == lesser_code;
            result = is_lesser || head.kind() == greater_code
                         ? apply(Op::select, apply(Op::less, a, b, c), is_lesser ? a : b, is_lesser ? b : a)
                     : op == Op::lookup ? look_up(*tables_[head.extra()], slopes_[head.extra()], a, b, c)
                                        : apply(op, a, b, c);
        }
        *next++ = result;
    });
    for (std::size_t i = 0; i < outputs_.size(); ++i) outputs[i] = registers[outputs_[i]];
}

Tape Tape::part(std::span<const std::size_t> outputs) const {
    // From the last instruction back: operands stand before what needs them.
    std::vector<char> needed(register_count_);
    needed[one] = true;
    for (const std::size_t output : outputs) needed[outputs_[output]] = true;
    const std::vector<Placed> all = instructions();
    std::size_t result = register_count_;
    for (auto instruction = all.rbegin(); instruction != all.rend(); ++instruction) {
        const auto& [head, summands] = *instruction;
        if (needed[--result] == 0) continue;
        for (const Cell& summand : summands) needed[summand.b] = needed[summand.c] = true;
        if (summands.empty()) needed[head->a] = needed[head->b] = needed[head->c] = true;
    }
    Tape part;
    std::vector<std::uint32_t> place(register_count_);
    std::size_t present = 0;
    std::uint32_t next = 0;
    const auto keeps = [&] {
        const bool is_needed = needed[present] != 0;
        place[present++] = is_needed ? next++ : 0;
        return is_needed;
    };
    keeps(); // the number 1
    const std::uint32_t* read = reads_.data();
    for (std::size_t of = 0; of < read_counts_.size(); ++of) {
        for (std::uint32_t i = 0; i < read_counts_[of]; ++i, ++read) {
            if (!keeps()) continue;
            part.reads_.push_back(*read);
            ++part.read_counts_[of];
        }
    }
    for (const double value : constants_) {
        if (keeps()) part.constants_.push_back(value);
    }
    for (const auto& [head, summands] : all) {
        const bool is_constant = present < 1 + reads_.size() + constants_.size() + constant_count_;
        if (!keeps()) continue;
        ++part.instruction_count_;
        if (is_constant) ++part.constant_count_;
        part.code_.push_back(*head);
        Cell& kept = part.code_.back();
        if (summands.empty()) kept = {head->code, place[head->a], place[head->b], place[head->c]};
        for (const Cell& summand : summands) {
            part.code_.push_back(Cell::summand(summand.factor(), place[summand.b], place[summand.c]));
        }
    }
    part.register_count_ = next;
    part.find_blocks();
    part.tables_ = tables_;
    part.slopes_ = slopes_;
    for (const std::size_t output : outputs) part.outputs_.push_back(place[outputs_[output]]);
    return part;
}

// ---- as C --------------------------------------------------------------------------------------------------------

namespace {

// An operation as it is written in C.
std::string c_text(Op op, const std::string& a, const std::string& b, const std::string& c) {
    switch (op) {
    case Op::add: return fmt::format("{} + {}", a, b);
    case Op::subtract: return fmt::format("{} - {}", a, b);
    case Op::multiply: return fmt::format("{} * {}", a, b);
    case Op::divide: return fmt::format("{} / {}", a, b);
    case Op::negate: return fmt::format("-{}", a);
    case Op::power: return fmt::format("power({}, {})", a, b);
    case Op::sin: return fmt::format("sin({})", a);
    case Op::cos: return fmt::format("cos({})", a);
    case Op::tan: return fmt::format("tan({})", a);
    case Op::asin: return fmt::format("asin({})", a);
    case Op::acos: return fmt::format("acos({})", a);
    case Op::atan: return fmt::format("atan({})", a);
    case Op::atan2: return fmt::format("atan2({}, {})", a, b);
    case Op::tanh: return fmt::format("tanh({})", a);
    case Op::exp: return fmt::format("exp({})", a);
    case Op::log: return fmt::format("log({})", a);
    case Op::sqrt: return fmt::format("sqrt({})", a);
    case Op::floor: return fmt::format("floor({})", a);
    case Op::less: return fmt::format("{} < {}", a, b);
    case Op::less_equal: return fmt::format("{} <= {}", a, b);
    case Op::equal: return fmt::format("{} == {}", a, b);
    case Op::all: return fmt::format("{} != 0 && {} != 0", a, b);
    case Op::any: return fmt::format("{} != 0 || {} != 0", a, b);
    case Op::logical_not: return fmt::format("{} == 0", a);
    case Op::select: return fmt::format("{} != 0 ? {} : {}", a, b, c);
    case Op::constant:
    case Op::variable:
    case Op::lookup:
    case Op::delay:
    case Op::rate:
    case Op::before:
    case Op::no_event: break;
    }
    return a;
}

// What C calls. Its address and that of the table lie beside each other behind the constants, as bits of numbers.
double value_of_table(const void* table, double x, double y, double side) {
    return static_cast<const LookupTable*>(table)->value(x, y, static_cast<int>(side));
}

static_assert(sizeof(double) == sizeof(void*) && sizeof(double) == sizeof(&value_of_table));

} // namespace

const char* Tape::c_declarations() {
    return "#if __FLT_EVAL_METHOD__ != 0\n#error this machine does not round each operation to a double\n#endif\n"
           "double sin(double), cos(double), tan(double), asin(double), acos(double), atan(double), tanh(double);\n"
           "double exp(double), log(double), sqrt(double), floor(double), pow(double, double), atan2(double, "
           "double);\n"
           "static double power(double a, double b) {\n" // as power() of expressions.hpp
           "  return b == 2 ? a * a : b == 3 ? a * a * a : b == 1 ? a : b == 4 ? (a * a) * (a * a) : pow(a, b);\n}\n"
           "typedef union { double bits; const void *table; double (*value)(const void *, double, double, double); } "
           "cell;\n"
           "static double lookup(const double *k, double x, double y, double side) {\n"
           "  cell value, table;\n  value.bits = k[0];\n  table.bits = k[1];\n"
           "  return value.value(table.table, x, y, side);\n}\n";
}

std::string Tape::c_function(const std::string& name) const {
    std::vector<std::string> registers = {"1.0"};
    const std::uint32_t* read = reads_.data();
    for (std::size_t part = 0; part < read_counts_.size(); ++part) {
        for (std::uint32_t i = 0; i < read_counts_[part]; ++i)
            registers.push_back(fmt::format("p{}[{}]", part, *read++));
    }
    std::size_t constant_count = 0;
    const auto next_constant = [&] { return fmt::format("k[{}]", constant_count++); };
    for (std::size_t i = 0; i < constants_.size(); ++i) registers.push_back(next_constant());

    std::string text = fmt::format("void {}(const double *p0, const double *p1, const double *p2, const double *k, "
                                   "double *y) {{\n",
                                   name);
    std::size_t factors = 0;
    for_instructions([&](const Cell&, std::span<const Cell> summands) {
        for (const Cell& summand : summands) factors += summand.is_signed() ? 0 : 1;
    });
    const std::size_t first_table = constants_.size() + factors;
    const auto product = [&](const Cell& summand, bool first) {
        const bool is_signed = summand.is_signed();
        std::string written = is_signed && summand.factor() < 0 ? (first ? "-" : " - ") : (first ? "" : " + ");
        written += is_signed ? registers[summand.b] : next_constant();
        if (!is_signed && summand.b != one) written += " * " + registers[summand.b];
        if (summand.c != one) written += " * " + registers[summand.c];
        return written;
    };
    for_instructions([&](const Cell& head, std::span<const Cell> summands) {
        const std::string result = fmt::format("r{}", registers.size());
        text += fmt::format("  const double {} = ", result);
        for (const Cell& summand : summands) text += product(summand, &summand == summands.data());
        if (head.kind() == lesser_code || head.kind() == greater_code) {
            const bool is_lesser = head.kind() == lesser_code;
            const auto &a = registers[head.a], &b = registers[head.b];
            text += fmt::format("{} < {} ? {} : {}", a, b, is_lesser ? a : b, is_lesser ? b : a);
        } else if (head.kind() == static_cast<std::uint32_t>(Op::lookup)) {
            text += fmt::format("lookup(k + {}, {}, {}, {})", first_table + 2 * head.extra(), registers[head.a],
                                registers[head.b], registers[head.c]);
        } else if (summands.empty()) {
            text += c_text(static_cast<Op>(head.kind()), registers[head.a], registers[head.b], registers[head.c]);
        }
        text += ";\n";
        registers.push_back(result);
    });
    for (std::size_t i = 0; i < outputs_.size(); ++i) {
        text += fmt::format("  y[{}] = {};\n", i, registers[outputs_[i]]);
    }
    return text + "}\n";
}

void Tape::use(CFunction function, std::shared_ptr<const void> owner) {
    function_ = function;
    owner_ = std::move(owner);
    function_constants_ = constants_;
    for_instructions([&](const Cell&, std::span<const Cell> summands) {
        for (const Cell& summand : summands) {
            if (!summand.is_signed()) function_constants_.push_back(summand.factor());
        }
    });
    for (const auto& table : tables_) {
        function_constants_.push_back(std::bit_cast<double>(&value_of_table));
        function_constants_.push_back(std::bit_cast<double>(static_cast<const void*>(table.get())));
    }
}

} // namespace tribode
