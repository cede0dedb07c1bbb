#include "tribode/system/expressions.hpp"
#include "tribode/base/error.hpp"
#include "tribode/base/text.hpp"

#include <algorithm>
#include <array>
#include <bit>
#include <cassert>
#include <cmath>
#include <fmt/format.h>

namespace tribode {

int operand_count(Op op) {
    switch (op) {
    case Op::constant:
    case Op::variable: return 0;
    case Op::add:
    case Op::subtract:
    case Op::multiply:
    case Op::divide:
    case Op::power:
    case Op::atan2:
    case Op::delay:
    case Op::less:
    case Op::less_equal:
    case Op::equal:
    case Op::all:
    case Op::any: return 2;
    case Op::select:
    case Op::lookup: return 3;
    case Op::negate:
    case Op::sin:
    case Op::cos:
    case Op::tan:
    case Op::asin:
    case Op::acos:
    case Op::atan:
    case Op::tanh:
    case Op::exp:
    case Op::log:
    case Op::sqrt:
    case Op::floor:
    case Op::rate:
    case Op::before:
    case Op::logical_not:
    case Op::no_event: break;
    }
    return 1;
}

bool is_condition(Op op) { return op >= Op::less && op <= Op::logical_not; }

double apply(Op op, double a, double b, double c) {
    switch (op) {
    case Op::constant:
    case Op::variable:
    case Op::lookup: assert(false && "no operation"); return a;
    case Op::add: return a + b;
    case Op::subtract: return a - b;
    case Op::multiply: return a * b;
    case Op::divide: return a / b;
    case Op::negate: return -a;
    case Op::power: return power(a, b);
    case Op::sin: return std::sin(a);
    case Op::cos: return std::cos(a);
    case Op::tan: return std::tan(a);
    case Op::asin: return std::asin(a);
    case Op::acos: return std::acos(a);
    case Op::atan: return std::atan(a);
    case Op::atan2: return std::atan2(a, b);
    case Op::tanh: return std::tanh(a);
    case Op::exp: return std::exp(a);
    case Op::log: return std::log(a);
    case Op::sqrt: return std::sqrt(a);
    case Op::floor: return std::floor(a);
    case Op::less: return a < b;
    case Op::less_equal: return a <= b;
    case Op::equal: return a == b;
    case Op::all: return a != 0 && b != 0;
    case Op::any: return a != 0 || b != 0;
    case Op::logical_not: return a == 0;
    case Op::select: return a != 0 ? b : c;
    case Op::delay:
    case Op::rate:
    case Op::before:
    case Op::no_event: break;
    }
    return a;
}

std::size_t Expressions::Hash::operator()(const Node& node) const {
    std::uint64_t h = std::bit_cast<std::uint64_t>(node.value) ^ (static_cast<std::uint64_t>(node.op) << 56);
    for (const std::uint64_t part : {node.a, node.b, node.c}) {
        h = (h ^ part) * 0x9E3779B97F4A7C15ull;
        h ^= h >> 29;
    }
    return h;
}

Term Expressions::keep(const Node& node) {
    // Two numbers that are no numbers are not equal, so they are not looked for.
    if (const auto known = places_.find(node); known != places_.end()) return known->second;
    if (nodes_.size() >= max_terms) {
        throw InputError(
            fmt::format("the equations have more than {} terms; is there a loop without an end?", max_terms));
    }
    nodes_.push_back(node);
    const auto place = static_cast<Term>(nodes_.size() - 1);
    if (!std::isnan(node.value)) places_.emplace(node, place);
    return place;
}

Term Expressions::constant(double value) {
    // Zero of either sign is one place.
    return keep({Op::constant, 0, 0, 0, value == 0 ? 0 : value});
}

Term Expressions::variable(std::string name) {
    names_.push_back(std::move(name));
    return keep({Op::variable, static_cast<Term>(names_.size() - 1), 0, 0, 0});
}

std::size_t Expressions::number_of(const std::shared_ptr<const LookupTable>& table) {
    const auto known = std::find(tables_.begin(), tables_.end(), table);
    if (known == tables_.end()) {
        tables_.push_back(table);
        return tables_.size() - 1;
    }
    return static_cast<std::size_t>(known - tables_.begin());
}

Term Expressions::look_up(std::size_t table, Term x, Term y, Term side) {
    const auto is_number = [&](Term term) { return nodes_[term].op == Op::constant; };
    if (is_number(x) && is_number(y) && is_number(side)) {
        const auto number = [&](Term term) { return nodes_[term].value; };
        return constant(tables_[table]->value(number(x), number(y), static_cast<int>(number(side))));
    }
    return keep({Op::lookup, x, y, side, static_cast<double>(table)});
}

Term Expressions::look_up(const std::shared_ptr<const LookupTable>& table, Term x, Term y) {
    const Term zero = constant(0);
    if (table->variables() == 1) y = zero;
    const auto side_of = [&](int variable, Term at) {
        const auto border = table->border(variable);
        if (!border) return zero;
        return make(Op::less, zero, look_up(number_of(border), at, zero, zero));
    };
    Term side = side_of(0, x);
    if (table->variables() == 2) side = make(Op::add, side, make(Op::multiply, constant(2), side_of(1, y)));
    return look_up(number_of(table), x, y, side);
}

// The slope of the table at the same place.
Term Expressions::slope(Term lookup, int variable) {
    const Node node = nodes_[lookup];
    const std::pair key(table_number(lookup), variable);
    auto known = slopes_.find(key);
    if (known == slopes_.end()) {
        const auto made = tables_[key.first]->slope(variable);
        known = slopes_.emplace(key, made ? std::optional(number_of(made)) : std::nullopt).first;
    }
    return known->second ? look_up(*known->second, node.a, node.b, node.c) : constant(0);
}

Term Expressions::make(Op op, Term a, Term b, Term c) {
    const int count = operand_count(op);
    assert(count > 0 && op != Op::lookup);
    if (count < 2) b = 0;
    if (count < 3) c = 0;
    const auto is_number = [&](Term term) { return nodes_[term].op == Op::constant; };
    const auto number = [&](Term term) { return nodes_[term].value; };
    if (is_number(a) && (count < 2 || is_number(b)) && (count < 3 || is_number(c))) {
        return constant(apply(op, number(a), number(b), number(c)));
    }
    const auto is = [&](Term term, double value) { return is_constant(term, value); };
    const auto negated = [&](Term term) { return nodes_[term].op == Op::negate; };
    switch (op) {
    case Op::add:
        if (is(a, 0)) return b;
        if (is(b, 0)) return a;
        if (negated(b)) return make(Op::subtract, a, nodes_[b].a);
        if (negated(a)) return make(Op::subtract, b, nodes_[a].a);
        break;
    case Op::subtract:
        if (a == b) return constant(0);
        if (is(b, 0)) return a;
        if (is(a, 0)) return make(Op::negate, b);
        if (negated(b)) return make(Op::add, a, nodes_[b].a);
        break;
    case Op::multiply:
        if (is(a, 0) || is(b, 0)) return constant(0);
        if (is(a, 1)) return b;
        if (is(b, 1)) return a;
        if (is(a, -1)) return make(Op::negate, b);
        if (is(b, -1)) return make(Op::negate, a);
        if (negated(a) && negated(b)) return make(Op::multiply, nodes_[a].a, nodes_[b].a);
        if (negated(a)) return make(Op::negate, make(Op::multiply, nodes_[a].a, b));
        if (negated(b)) return make(Op::negate, make(Op::multiply, a, nodes_[b].a));
        break;
    case Op::divide:
        if (is(a, 0)) return constant(0);
        if (is(b, 1)) return a;
        if (is(b, -1)) return make(Op::negate, a);
        if (negated(a)) return make(Op::negate, make(Op::divide, nodes_[a].a, b));
        break;
    case Op::negate:
        if (negated(a)) return nodes_[a].a;
        if (nodes_[a].op == Op::subtract) return make(Op::subtract, nodes_[a].b, nodes_[a].a);
        break;
    case Op::power:
        if (is(b, 0)) return constant(1);
        if (is(b, 1)) return a;
        if (is(b, 2)) return make(Op::multiply, a, a);
        if (is(b, -1)) return make(Op::divide, constant(1), a);
        break;
    case Op::all:
        if (is_number(a)) return number(a) != 0 ? b : constant(0);
        if (is_number(b)) return number(b) != 0 ? a : constant(0);
        if (a == b) return a;
        break;
    case Op::any:
        if (is_number(a)) return number(a) != 0 ? constant(1) : b;
        if (is_number(b)) return number(b) != 0 ? constant(1) : a;
        if (a == b) return a;
        break;
    case Op::logical_not:
        if (nodes_[a].op == Op::logical_not) return nodes_[a].a;
        break;
    case Op::delay:
        if (is_number(a) || is(b, 0)) return a;
        break;
    case Op::rate:
        if (is_number(a)) return constant(0);
        break;
    case Op::before:
        if (is_number(a)) return a;
        break;
    case Op::select:
        if (is_number(a)) return number(a) != 0 ? b : c;
        if (b == c) return b;
        break;
    case Op::less:
        if (a == b) return constant(0);
        break;
    case Op::less_equal:
    case Op::equal:
        if (a == b) return constant(1);
        break;
    default: break;
    }
    // The order of these operands is nothing to the value, so it is nothing to the place.
    const bool commutes = op == Op::add || op == Op::multiply || op == Op::equal;
    if (commutes && b < a) std::swap(a, b);
    return keep({op, a, b, c, 0});
}

std::vector<Term> Expressions::reachable(std::span<const Term> roots, bool into_no_event) const {
    std::vector<Term> order, open(roots.begin(), roots.end());
    std::vector<bool> seen(nodes_.size());
    while (!open.empty()) {
        const Term term = open.back();
        open.pop_back();
        if (seen[term]) continue;
        seen[term] = true;
        order.push_back(term);
        const Node& node = nodes_[term];
        if (node.op == Op::no_event && !into_no_event) continue;
        const int count = operand_count(node.op);
        if (count > 0) open.push_back(node.a);
        if (count > 1) open.push_back(node.b);
        if (count > 2) open.push_back(node.c);
    }
    std::sort(order.begin(), order.end());
    return order;
}

std::pair<Expressions, std::vector<Term>> Expressions::part(std::span<const Term> roots) const {
    Expressions made;
    std::vector<Term> place(nodes_.size());
    for (const Term term : reachable(roots)) {
        Node node = nodes_[term];
        const int count = operand_count(node.op);
        if (node.op == Op::variable) {
            place[term] = made.variable(names_[node.a]);
            continue;
        }
        if (node.op == Op::lookup) node.value = static_cast<double>(made.number_of(tables_[table_number(term)]));
        if (count > 0) node.a = place[node.a];
        if (count > 1) node.b = place[node.b];
        if (count > 2) node.c = place[node.c];
        place[term] = made.keep(node);
    }
    return {std::move(made), std::move(place)};
}

std::vector<Term> Expressions::variables_of(std::span<const Term> roots) const {
    std::vector<Term> found = reachable(roots);
    std::erase_if(found, [&](Term term) { return nodes_[term].op != Op::variable; });
    return found;
}

std::vector<Term> Expressions::substitute(std::span<const Term> roots, const Replacement& replacement) {
    std::unordered_map<Term, Term> made;
    for (const Term term : reachable(roots)) {
        if (const auto other = replacement.find(term); other != replacement.end()) {
            made[term] = other->second;
            continue;
        }
        const Node node = nodes_[term]; // a copy: the vector grows
        const int count = operand_count(node.op);
        if (count == 0) {
            made[term] = term;
            continue;
        }
        const Term a = made[node.a], b = count > 1 ? made[node.b] : 0, c = count > 2 ? made[node.c] : 0;
        const bool same = a == node.a && (count < 2 || b == node.b) && (count < 3 || c == node.c);
        made[term] = same                    ? term
                     : node.op == Op::lookup ? look_up(table_number(term), a, b, c)
                                             : make(node.op, a, b, c);
    }
    std::vector<Term> result;
    for (const Term root : roots) result.push_back(made[root]);
    return result;
}

// The chain rule; `term` has the derivatives da, db, dc of its operands.
Term Expressions::derivative_of(Term term, Term da, Term db, Term dc) {
    const Node node = nodes_[term];
    const Term a = node.a, b = node.b;
    const auto number = [&](double of) { return constant(of); };
    const auto square = [&](Term x) { return make(Op::multiply, x, x); };
    // The slope has no limit at the edge of the domain. Where the operand rests there, in a branch, the derivative is zero and
    // not zero times infinity.
    const auto unless_at_rest = [&](Term derivative) {
        if (nodes_[da].op == Op::constant && !is_constant(da, 0)) return derivative;
        return make(Op::select, make(Op::equal, da, number(0)), number(0), derivative);
    };
    const auto slope_of_arc = [&] {
        return unless_at_rest(make(Op::divide, da, make(Op::sqrt, make(Op::subtract, number(1), square(a)))));
    };
    switch (node.op) {
    case Op::add: return make(Op::add, da, db);
    case Op::subtract: return make(Op::subtract, da, db);
    case Op::multiply: return make(Op::add, make(Op::multiply, da, b), make(Op::multiply, a, db));
    case Op::divide:
        // (da - (a/b) db)/b, with the quotient that there is already.
        return make(Op::divide, make(Op::subtract, da, make(Op::multiply, term, db)), b);
    case Op::negate: return make(Op::negate, da);
    case Op::power: {
        // b a^(b-1) da + a^b log(a) db; the second part only where the exponent varies, and where the power does not vanish.
        Term base_part =
            make(Op::multiply, make(Op::multiply, b, make(Op::power, a, make(Op::subtract, b, number(1)))), da);
        const bool is_steep = nodes_[b].op != Op::constant || (nodes_[b].value > 0 && nodes_[b].value < 1);
        if (is_steep) base_part = unless_at_rest(base_part);
        if (is_constant(db, 0)) return base_part;
        const Term logarithm = make(Op::multiply, term, make(Op::log, a));
        return make(Op::add, base_part,
                    make(Op::multiply, make(Op::select, make(Op::equal, term, number(0)), number(0), logarithm), db));
    }
    case Op::sin: return make(Op::multiply, make(Op::cos, a), da);
    case Op::cos: return make(Op::negate, make(Op::multiply, make(Op::sin, a), da));
    case Op::tan: return make(Op::multiply, make(Op::add, number(1), square(term)), da);
    case Op::asin: return slope_of_arc();
    case Op::acos: return make(Op::negate, slope_of_arc());
    case Op::atan: return make(Op::divide, da, make(Op::add, number(1), square(a)));
    case Op::atan2:
        return make(Op::divide, make(Op::subtract, make(Op::multiply, b, da), make(Op::multiply, a, db)),
                    make(Op::add, square(a), square(b)));
    case Op::tanh: return make(Op::multiply, make(Op::subtract, number(1), square(term)), da);
    case Op::exp: return make(Op::multiply, term, da);
    case Op::log: return make(Op::divide, da, a);
    case Op::sqrt: return unless_at_rest(make(Op::divide, da, make(Op::multiply, number(2), term)));
    case Op::select: return make(Op::select, a, db, dc);
    case Op::lookup:
        return make(Op::add, make(Op::multiply, slope(term, 0), da),
                    is_constant(db, 0) ? constant(0) : make(Op::multiply, slope(term, 1), db));
    case Op::delay: return make(Op::delay, da, b);
    case Op::rate: return make(Op::rate, da);
    case Op::before: return make(Op::before, da);
    case Op::no_event: return make(Op::no_event, da);
    case Op::constant:
    case Op::variable:
    case Op::floor:
    case Op::less:
    case Op::less_equal:
    case Op::equal:
    case Op::all:
    case Op::any:
    case Op::logical_not: break;
    }
    return constant(0);
}

bool Expressions::is_continuous(Term select) const {
    const Node& node = nodes_[select];
    if (node.op != Op::select) return false;
    const Node& relation = nodes_[node.a];
    if (relation.op != Op::less && relation.op != Op::less_equal) return false;
    const auto are = [&](Term x, Term y) {
        return (x == relation.a && y == relation.b) || (x == relation.b && y == relation.a);
    };
    if (are(node.b, node.c)) return true;
    // abs: one branch the negative of the other, which is compared with zero.
    const Term compared = is_constant(relation.b, 0) ? relation.a : relation.b;
    const bool with_zero = is_constant(relation.a, 0) || is_constant(relation.b, 0);
    const auto is_negative = [&](Term x) { return is_negative_of(x, compared) || is_negative_of(compared, x); };
    return with_zero && ((node.b == compared && is_negative(node.c)) || (node.c == compared && is_negative(node.b)));
}

std::vector<Term> Expressions::derivatives(std::span<const Term> roots, Term variable) {
    return derivatives(roots, Replacement{{variable, constant(1)}});
}

std::vector<Term> Expressions::derivatives(std::span<const Term> roots, const Replacement& direction) {
    const Term zero = constant(0);
    std::unordered_map<Term, Term> made; // those that are not zero
    const auto of = [&](Term term) {
        const auto known = made.find(term);
        return known == made.end() ? zero : known->second;
    };
    for (const Term term : reachable(roots)) {
        if (const auto moves = direction.find(term); moves != direction.end()) {
            made[term] = moves->second;
            continue;
        }
        const Node node = nodes_[term];
        const int count = operand_count(node.op);
        const Term da = count > 0 ? of(node.a) : zero, db = count > 1 ? of(node.b) : zero,
                   dc = count > 2 ? of(node.c) : zero;
        if (da == zero && db == zero && dc == zero) continue;
        if (const Term d = derivative_of(term, da, db, dc); d != zero) made[term] = d;
    }
    std::vector<Term> result;
    for (const Term root : roots) result.push_back(of(root));
    return result;
}

std::vector<Expressions::Derivative> Expressions::jacobian(std::span<const Term> roots,
                                                           std::span<const Term> variables) {
    using Gradient = std::vector<std::pair<std::size_t, Term>>; // by column
    const Term zero = constant(0), one = constant(1);
    std::unordered_map<Term, std::size_t> columns;
    for (std::size_t j = 0; j < variables.size(); ++j) columns[variables[j]] = j;
    const auto order = reachable(roots);
    // A gradient is kept as long as it is needed.
    std::unordered_map<Term, std::size_t> uses;
    const auto operands_of = [&](Term term) {
        const Node& node = nodes_[term];
        const int count = operand_count(node.op);
        std::vector<Term> list;
        if (count > 0) list.push_back(node.a);
        if (count > 1) list.push_back(node.b);
        if (count > 2) list.push_back(node.c);
        return list;
    };
    for (const Term term : order) {
        for (const Term operand : operands_of(term)) ++uses[operand];
    }
    for (const Term root : roots) ++uses[root];
    std::unordered_map<Term, Gradient> gradients; // those that are not zero
    for (const Term term : order) {
        if (const auto column = columns.find(term); column != columns.end()) {
            gradients[term] = {{column->second, one}};
            continue;
        }
        const auto operands = operands_of(term);
        std::array<const Gradient*, 3> of{};
        std::array<std::size_t, 3> next{};
        for (std::size_t i = 0; i < operands.size(); ++i) {
            const auto known = gradients.find(operands[i]);
            if (known != gradients.end()) of[i] = &known->second;
        }
        Gradient made;
        for (;;) {
            std::size_t column = variables.size();
            for (std::size_t i = 0; i < 3; ++i) {
                if (of[i] && next[i] < of[i]->size()) column = std::min(column, (*of[i])[next[i]].first);
            }
            if (column == variables.size()) break;
            std::array<Term, 3> d{zero, zero, zero};
            for (std::size_t i = 0; i < 3; ++i) {
                if (!of[i] || next[i] == of[i]->size() || (*of[i])[next[i]].first != column) continue;
                d[i] = (*of[i])[next[i]++].second;
            }
            if (const Term value = derivative_of(term, d[0], d[1], d[2]); value != zero)
                made.emplace_back(column, value);
        }
        for (const Term operand : operands) {
            if (--uses[operand] == 0) gradients.erase(operand);
        }
        if (!made.empty()) gradients[term] = std::move(made);
    }
    std::vector<Derivative> list;
    for (std::size_t row = 0; row < roots.size(); ++row) {
        const auto known = gradients.find(roots[row]);
        if (known == gradients.end()) continue;
        for (const auto& [column, term] : known->second) list.push_back({row, column, term});
    }
    std::stable_sort(list.begin(), list.end(), [](const auto& a, const auto& b) { return a.column < b.column; });
    return list;
}

namespace {

struct Notation {
    const char* text;
    int strength; // of its binding; 0: written as a function
};

Notation notation_of(Op op) {
    switch (op) {
    case Op::add: return {" + ", 4};
    case Op::subtract: return {" - ", 4};
    case Op::multiply: return {"*", 5};
    case Op::divide: return {"/", 5};
    case Op::negate: return {"-", 6};
    case Op::power: return {"^", 7};
    case Op::less: return {" < ", 3};
    case Op::less_equal: return {" <= ", 3};
    case Op::equal: return {" == ", 3};
    case Op::all: return {" and ", 2};
    case Op::any: return {" or ", 1};
    case Op::logical_not: return {"not", 0};
    case Op::sin: return {"sin", 0};
    case Op::cos: return {"cos", 0};
    case Op::tan: return {"tan", 0};
    case Op::asin: return {"asin", 0};
    case Op::acos: return {"acos", 0};
    case Op::atan:
    case Op::atan2: return {"atan", 0};
    case Op::tanh: return {"tanh", 0};
    case Op::exp: return {"exp", 0};
    case Op::log: return {"log", 0};
    case Op::sqrt: return {"sqrt", 0};
    case Op::floor: return {"floor", 0};
    case Op::select: return {"where", 0};
    case Op::lookup: return {"table", 0};
    case Op::delay: return {"delay", 0};
    case Op::rate: return {"rate", 0};
    case Op::before: return {"before", 0};
    case Op::no_event: return {"no_event", 0};
    case Op::constant:
    case Op::variable: break;
    }
    return {"", 8};
}

} // namespace

// Whether a is -b as it is written.
bool Expressions::is_negative_of(Term a, Term b) const {
    const Node &one = nodes_[a], &other = nodes_[b];
    const bool is_swapped = one.op == Op::subtract && other.op == Op::subtract && one.a == other.b && one.b == other.a;
    return (one.op == Op::negate && one.a == b) || is_swapped;
}

// Of a branch on the sign of something, with -X below zero and X above: a sign times X.
bool Expressions::is_sign_times(Term select) const {
    const Node& node = nodes_[select];
    if (node.op != Op::select || continuous_name(select)) return false;
    const Node& relation = nodes_[node.a];
    return relation.op == Op::less && is_constant(relation.b, 0) && is_negative_of(node.b, node.c);
}

// "max", "min" or "abs" of a branch that is one of these, of the operands of its condition; else nothing.
const char* Expressions::continuous_name(Term select) const {
    const Node& node = nodes_[select];
    if (node.op != Op::select) return nullptr;
    const Node& relation = nodes_[node.a];
    if (relation.op != Op::less && relation.op != Op::less_equal) return nullptr;
    if (node.b == relation.b && node.c == relation.a) return "max";
    if (node.b == relation.a && node.c == relation.b) return "min";
    const bool is_abs = node.c == relation.a && is_constant(relation.b, 0) && is_negative_of(node.b, node.c);
    return is_abs ? "abs" : nullptr;
}

std::string Expressions::text(Term root, const std::unordered_map<Term, std::string>& names) const {
    // Bottom up; a text longer than this is of no use to a reader, and shared terms may make it huge.
    constexpr std::size_t longest = 2000;
    std::unordered_map<Term, std::string> texts;
    for (const Term term : reachable(std::span(&root, 1))) {
        const Node& node = nodes_[term];
        const auto notation = notation_of(node.op);
        // What no event is written of is the same to a reader.
        const auto shown = [&](Term operand) {
            const Node& own = nodes_[operand];
            return own.op == Op::no_event && (continuous_name(own.a) || is_sign_times(own.a)) ? own.a : operand;
        };
        const auto part = [&](Term operand, int least) {
            const Term one = shown(operand);
            if (names.contains(operand)) {
                const bool is_word = texts[operand].find(' ') == std::string::npos;
                return is_word ? texts[operand] : fmt::format("({})", texts[operand]);
            }
            const int strength = notation_of(is_sign_times(one) ? Op::multiply : nodes_[one].op).strength;
            return strength >= least || strength == 0 ? texts[operand] : fmt::format("({})", texts[operand]);
        };
        std::string& text = texts[term];
        if (const auto named = names.find(term); named != names.end()) {
            text = named->second;
        } else if (node.op == Op::constant) {
            text = to_text(node.value);
        } else if (node.op == Op::variable) {
            text = names_[node.a];
        } else if (node.op == Op::lookup) {
            text = fmt::format("{}({}", table_of(term)->name(), texts[node.a]);
            if (table_of(term)->variables() == 2) text += ", " + texts[node.b];
            text += ")";
        } else if (const auto* name = continuous_name(term)) {
            const Node& relation = nodes_[node.a];
            text = fmt::format("{}({}", name, texts[relation.a]);
            if (std::string_view(name) != "abs") text += ", " + texts[relation.b];
            text += ")";
        } else if (is_sign_times(term)) {
            const auto strength = notation_of(Op::multiply).strength;
            text = fmt::format("sign({})*{}", texts[nodes_[node.a].a], part(node.c, strength));
        } else if (shown(term) != term) {
            text = texts[node.a];
        } else if (notation.strength == 0) {
            text = fmt::format("{}({}", notation.text, texts[node.a]);
            if (operand_count(node.op) > 1) text += ", " + texts[node.b];
            if (operand_count(node.op) > 2) text += ", " + texts[node.c];
            text += ")";
        } else if (operand_count(node.op) == 1) {
            text = notation.text + part(node.a, notation.strength);
        } else {
            text = part(node.a, notation.strength) + notation.text + part(node.b, notation.strength + 1);
        }
        if (text.size() > longest) text = "...";
    }
    return texts[root];
}

} // namespace tribode
