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
#include <fmt/format.h>
#include <optional>
#include <set>
#include <tuple>
#include <unordered_map>
#include <utility>

namespace tribode {

namespace {

// A sum: sum_code; of few summands, n, sum_code + n, so that it is written out.
constexpr auto sum_code = static_cast<std::uint32_t>(Op::no_event) + 1;
constexpr std::uint32_t few = 12;

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
};

// What a tape does, as terms.
class Program {
  public:
    Program(const Expressions& graph, const std::vector<Term>& outputs) : graph_(graph) {
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
        std::unordered_map<Term, std::size_t> depth;
        for (auto& made : code_) {
            for (const Term operand : operands_of(made)) made.depth = std::max(made.depth, depth[operand]);
            depth[made.term] = ++made.depth;
        }
        const auto key = [](const Instruction& i) { return std::tuple(i.depth, i.code, i.summands.size()); };
        std::stable_sort(code_.begin(), code_.end(), [&](const auto& a, const auto& b) { return key(a) < key(b); });
    }

    const std::vector<Term>& leaves() const { return leaves_; } // constants and variables
    const std::vector<Instruction>& code() const { return code_; }

    // The term of the same value that is no mere name for another.
    Term value_of(Term term) const {
        while (graph_[term].op == Op::no_event || graph_[term].op == Op::delay) term = graph_[term].a;
        return term;
    }

  private:
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
    const Program program(graph, outputs);
    std::unordered_map<Term, std::uint32_t> place;
    std::uint32_t next = 1;
    const std::set<Term> leaves(program.leaves().begin(), program.leaves().end());
    std::uint32_t part = 0, first = 0; // the place of its first input
    for (std::uint32_t i = 0; i < inputs.size(); ++i) {
        while (i - first >= parts[part]) first += static_cast<std::uint32_t>(parts[part++]);
        if (!leaves.contains(inputs[i])) continue;
        place[inputs[i]] = next++;
        reads_.push_back({part, i - first});
    }
    for (const Term leaf : program.leaves()) {
        if (graph[leaf].op == Op::constant) {
            place[leaf] = next++;
            constants_.push_back(graph[leaf].value);
        } else if (!place.contains(leaf)) {
            throw InputError(fmt::format("{} is not known here", graph.name(leaf)));
        }
    }
    for (const auto& made : program.code()) {
        // A run may go on into the next depth: within it, too, operands come first.
        auto length = static_cast<std::uint32_t>(made.summands.size());
        if (made.code == static_cast<std::uint32_t>(Op::lookup)) {
            const auto& table = graph.table_of(made.term);
            const auto known = std::find(tables_.begin(), tables_.end(), table);
            length = static_cast<std::uint32_t>(known - tables_.begin());
            if (known == tables_.end()) {
                tables_.push_back(table);
                slopes_.push_back({table->slope(0), table->variables() > 1 ? table->slope(1) : nullptr});
            }
        }
        const std::uint32_t code = made.code + (made.code == sum_code && length <= few ? length : 0);
        if (runs_.empty() || runs_.back().code != code || runs_.back().length != length) {
            runs_.push_back({code, 0, length});
        }
        ++runs_.back().count;
        for (const auto& summand : made.summands) {
            summands_.push_back(
                {summand.factor, summand.a ? place[*summand.a] : one, summand.b ? place[*summand.b] : one});
        }
        if (made.summands.empty()) {
            const auto operand = [&](std::size_t i) {
                return place[made.operands[std::min(i, made.operands.size() - 1)]];
            };
            operands_.push_back({operand(0), operand(1), operand(2)});
        }
        place[made.term] = next++;
    }
    register_count_ = next;
    instruction_count_ = program.code().size();
    for (const Term output : outputs) outputs_.push_back(place[program.value_of(output)]);
}

template <std::size_t lanes, bool by_lane_functions>
inline void Tape::interpret(const std::array<const double*, 3>& inputs, double* outputs) const {
    WorkSpace<double, 512 * (lanes > 1 ? 4 : 1)> memory(register_count_ * lanes);
    double* registers = memory.data();
    double* next = registers;
    const auto fill = [&next](double value) {
        for (std::size_t l = 0; l < lanes; ++l) *next++ = value;
    };
    fill(1);
    for (const auto& [part, index] : reads_) {
        for (std::size_t l = 0; l < lanes; ++l) *next++ = inputs[part][index * lanes + l];
    }
    // A loop, because a call for a handful of numbers costs more than they do.
    for (const double value : constants_) fill(value);

    // The results of all lanes before one is written: what is written is none of the operands.
    const auto write = [&](const auto& value) {
        double results[lanes];
        for (std::size_t l = 0; l < lanes; ++l) results[l] = value(l);
        for (std::size_t l = 0; l < lanes; ++l) *next++ = results[l];
    };
    const Operands* operands = operands_.data();
    const auto run = [&](std::uint32_t count, const auto& operation) {
        for (const Operands* end = operands + count; operands != end; ++operands) {
            const double *a = registers + operands->a * lanes, *b = registers + operands->b * lanes,
                         *c = registers + operands->c * lanes;
            write([&](std::size_t l) { return static_cast<double>(operation(a[l], b[l], c[l])); });
        }
    };
    const Summand* summands = summands_.data();
    const auto product = [&](const Summand& s, std::size_t l) {
        return s.factor * registers[s.a * lanes + l] * registers[s.b * lanes + l];
    };
    const auto add_up = [&]<std::size_t... i>(std::index_sequence<i...>, std::size_t l) {
        return (... + product(summands[i], l));
    };
    // Sums of one length: a loop over the summands of each would cost more than they do.
    const auto sums = [&]<std::size_t... i>(std::uint32_t count, std::index_sequence<i...> all) {
        for (; count > 0; --count, summands += sizeof...(i)) {
            write([&](std::size_t l) { return add_up(all, l); });
        }
    };
    const auto long_sums = [&](std::uint32_t count, std::uint32_t length) {
        for (; count > 0; --count) {
            const Summand* end = summands + length;
            double sum[lanes];
            for (std::size_t l = 0; l < lanes; ++l) sum[l] = add_up(std::make_index_sequence<few>(), l);
            for (summands += few; end - summands > 1; summands += 2) {
                for (std::size_t l = 0; l < lanes; ++l) {
                    sum[l] = sum[l] + product(summands[0], l) + product(summands[1], l);
                }
            }
            if (summands != end) {
                for (std::size_t l = 0; l < lanes; ++l) sum[l] += product(*summands, l);
                ++summands;
            }
            write([&](std::size_t l) { return sum[l]; });
        }
    };

    const auto of_lanes = [&](std::uint32_t count, const auto& function) {
        for (const Operands* end = operands + count; operands != end; ++operands, next += lanes) {
            function(registers + operands->a * lanes, next);
        }
    };

    for (const auto& [code, count, length] : runs_) {
        if constexpr (by_lane_functions) {
            switch (static_cast<Op>(code)) {
            case Op::sin:
                of_lanes(count, [](const double* x, double* y) { lane_functions::sin<lanes>(x, y); });
                continue;
            case Op::cos:
                of_lanes(count, [](const double* x, double* y) { lane_functions::cos<lanes>(x, y); });
                continue;
            case Op::exp:
                of_lanes(count, [](const double* x, double* y) { lane_functions::exp<lanes>(x, y); });
                continue;
            case Op::tanh:
                of_lanes(count, [](const double* x, double* y) { lane_functions::tanh<lanes>(x, y); });
                continue;
            default: break;
            }
        }
        switch (code) {
        case sum_code: long_sums(count, length); break;
        case sum_code + 1: sums(count, std::make_index_sequence<1>()); break;
        case sum_code + 2: sums(count, std::make_index_sequence<2>()); break;
        case sum_code + 3: sums(count, std::make_index_sequence<3>()); break;
        case sum_code + 4: sums(count, std::make_index_sequence<4>()); break;
        case sum_code + 5: sums(count, std::make_index_sequence<5>()); break;
        case sum_code + 6: sums(count, std::make_index_sequence<6>()); break;
        case sum_code + 7: sums(count, std::make_index_sequence<7>()); break;
        case sum_code + 8: sums(count, std::make_index_sequence<8>()); break;
        case sum_code + 9: sums(count, std::make_index_sequence<9>()); break;
        case sum_code + 10: sums(count, std::make_index_sequence<10>()); break;
        case sum_code + 11: sums(count, std::make_index_sequence<11>()); break;
        case sum_code + 12: sums(count, std::make_index_sequence<12>()); break;
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
        case static_cast<std::uint32_t>(Op::select):
            run(count, [](double a, double b, double c) { return a != 0 ? b : c; });
            break;
        case static_cast<std::uint32_t>(Op::less): run(count, [](double a, double b, double) { return a < b; }); break;
        case static_cast<std::uint32_t>(Op::less_equal):
            run(count, [](double a, double b, double) { return a <= b; });
            break;
        case static_cast<std::uint32_t>(Op::equal):
            run(count, [](double a, double b, double) { return a == b; });
            break;
        case static_cast<std::uint32_t>(Op::all):
            run(count, [](double a, double b, double) { return a != 0 && b != 0; });
            break;
        case static_cast<std::uint32_t>(Op::lookup):
            run(count, [&table = *tables_[length]](double x, double y, double side) {
                return table.value(x, y, static_cast<int>(side));
            });
            break;
        default: run(count, [op = static_cast<Op>(code)](double a, double b, double c) { return apply(op, a, b, c); });
        }
    }
    for (std::size_t i = 0; i < outputs_.size(); ++i) {
        for (std::size_t l = 0; l < lanes; ++l) outputs[i * lanes + l] = registers[outputs_[i] * lanes + l];
    }
}

void Tape::evaluate_one(const std::array<const double*, 3>& inputs, double* outputs) const {
    interpret<1, false>(inputs, outputs);
}

void Tape::evaluate_single_lane(const std::array<const double*, 3>& inputs, double* outputs) const {
    interpret<1, true>(inputs, outputs);
}

// With the widest registers that the processor has; no operation is contracted, so the bits are the same on all of them.
[[gnu::flatten]] TRIBODE_CLONES void Tape::evaluate_four(const std::array<const double*, 3>& inputs,
                                                         double* outputs) const {
    interpret<4, true>(inputs, outputs);
}

[[gnu::flatten]] TRIBODE_CLONES void Tape::evaluate_eight(const std::array<const double*, 3>& inputs,
                                                          double* outputs) const {
    interpret<8, true>(inputs, outputs);
}

void Tape::enclose(const EnclosedInputs& inputs, std::span<Enclosure> outputs) const {
    WorkSpace<Enclosure, 256> memory(register_count_);
    Enclosure* registers = memory.data();
    Enclosure* next = registers;
    *next++ = Enclosure::constant(1);
    for (const auto& [part, index] : reads_) {
        *next++ =
            part < inputs.moving.size() ? inputs.moving[part][index] : Enclosure::constant(inputs.constant[index]);
    }
    for (const double value : constants_) *next++ = Enclosure::constant(value);
    const Operands* operands = operands_.data();
    const Summand* summands = summands_.data();
    for (const auto& [code, count, length] : runs_) {
        for (std::uint32_t i = 0; i < count; ++i) {
            Enclosure result;
            if (code >= sum_code) {
                for (std::uint32_t n = 0; n < length; ++n, ++summands) {
                    const Enclosure part = product(summands->factor, registers[summands->a], registers[summands->b]);
                    result = n == 0 ? part : sum(result, part);
                }
            } else {
                const Enclosure &a = registers[operands->a], &b = registers[operands->b], &c = registers[operands->c];
                const auto op = static_cast<Op>(code);
                result = op == Op::lookup ? look_up(*tables_[length], slopes_[length], a, b, c) : apply(op, a, b, c);
                ++operands;
            }
            *next++ = result;
        }
    }
    for (std::size_t i = 0; i < outputs_.size(); ++i) outputs[i] = registers[outputs_[i]];
}

Tape Tape::part(std::span<const std::size_t> outputs) const {
    // From the last instruction back: operands stand before what needs them.
    std::vector<char> needed(register_count_);
    needed[one] = true;
    for (const std::size_t output : outputs) needed[outputs_[output]] = true;
    std::size_t result = register_count_, operand = operands_.size(), summand = summands_.size();
    for (auto run = runs_.rbegin(); run != runs_.rend(); ++run) {
        for (std::uint32_t i = 0; i < run->count; ++i) {
            const bool is_needed = needed[--result] != 0;
            if (run->code < sum_code) {
                const auto& [a, b, c] = operands_[--operand];
                if (is_needed) needed[a] = needed[b] = needed[c] = true;
                continue;
            }
            summand -= run->length;
            for (std::uint32_t n = 0; is_needed && n < run->length; ++n) {
                needed[summands_[summand + n].a] = needed[summands_[summand + n].b] = true;
            }
        }
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
    for (const Read& read : reads_) {
        if (keeps()) part.reads_.push_back(read);
    }
    for (const double value : constants_) {
        if (keeps()) part.constants_.push_back(value);
    }
    for (const Run& run : runs_) {
        Run kept{run.code, 0, run.length};
        for (std::uint32_t i = 0; i < run.count; ++i) {
            const bool is_kept = keeps();
            if (is_kept) ++kept.count;
            if (run.code < sum_code) {
                const auto& [a, b, c] = operands_[operand++];
                if (is_kept) part.operands_.push_back({place[a], place[b], place[c]});
                continue;
            }
            for (std::uint32_t n = 0; n < run.length; ++n) {
                const auto& [factor, a, b] = summands_[summand++];
                if (is_kept) part.summands_.push_back({factor, place[a], place[b]});
            }
        }
        part.instruction_count_ += kept.count;
        if (kept.count > 0) part.runs_.push_back(kept);
    }
    part.register_count_ = next;
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
    case Op::power: return fmt::format("pow({}, {})", a, b);
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
           "typedef union { double bits; const void *table; double (*value)(const void *, double, double, double); } "
           "cell;\n"
           "static double lookup(const double *k, double x, double y, double side) {\n"
           "  cell value, table;\n  value.bits = k[0];\n  table.bits = k[1];\n"
           "  return value.value(table.table, x, y, side);\n}\n";
}

std::string Tape::c_function(const std::string& name) const {
    std::vector<std::string> registers = {"1.0"};
    for (const auto& [part, index] : reads_) registers.push_back(fmt::format("p{}[{}]", part, index));
    std::size_t constant_count = 0;
    const auto next_constant = [&] { return fmt::format("k[{}]", constant_count++); };
    for (std::size_t i = 0; i < constants_.size(); ++i) registers.push_back(next_constant());

    std::string text = fmt::format("void {}(const double *p0, const double *p1, const double *p2, const double *k, "
                                   "double *y) {{\n",
                                   name);
    const auto factors =
        std::count_if(summands_.begin(), summands_.end(), [](const auto& s) { return !s.is_signed(); });
    const std::size_t first_table = constants_.size() + static_cast<std::size_t>(factors);
    const auto product = [&](const Summand& summand, bool first) {
        const bool is_signed = summand.is_signed();
        std::string written = is_signed && summand.factor < 0 ? (first ? "-" : " - ") : (first ? "" : " + ");
        written += is_signed ? registers[summand.a] : next_constant();
        if (!is_signed && summand.a != one) written += " * " + registers[summand.a];
        if (summand.b != one) written += " * " + registers[summand.b];
        return written;
    };
    auto operands = operands_.begin();
    auto summands = summands_.begin();
    for (const auto& [code, count, length] : runs_) {
        for (std::uint32_t i = 0; i < count; ++i) {
            const std::string result = fmt::format("r{}", registers.size());
            text += fmt::format("  const double {} = ", result);
            if (code >= sum_code) {
                for (std::uint32_t n = 0; n < length; ++n) text += product(*summands++, n == 0);
            } else {
                const auto& [a, b, c] = *operands++;
                if (code == static_cast<std::uint32_t>(Op::lookup)) {
                    text += fmt::format("lookup(k + {}, {}, {}, {})", first_table + 2 * length, registers[a],
                                        registers[b], registers[c]);
                } else
                    text += c_text(static_cast<Op>(code), registers[a], registers[b], registers[c]);
            }
            text += ";\n";
            registers.push_back(result);
        }
    }
    for (std::size_t i = 0; i < outputs_.size(); ++i) {
        text += fmt::format("  y[{}] = {};\n", i, registers[outputs_[i]]);
    }
    return text + "}\n";
}

void Tape::use(CFunction function, std::shared_ptr<const void> owner) {
    function_ = function;
    owner_ = std::move(owner);
    function_constants_ = constants_;
    for (const auto& summand : summands_) {
        if (!summand.is_signed()) function_constants_.push_back(summand.factor);
    }
    for (const auto& table : tables_) {
        function_constants_.push_back(std::bit_cast<double>(&value_of_table));
        function_constants_.push_back(std::bit_cast<double>(static_cast<const void*>(table.get())));
    }
}

} // namespace tribode
