#pragma once
#include "tribode/base/random.hpp"
#include "tribode/system/expressions.hpp"

#include <cmath>
#include <complex>
#include <vector>

namespace tribode {

// A random graph in the given variables, all operations of real functions among them, with arguments kept where these
// are smooth: the test compares derivatives by another road.
class RandomExpressions {
  public:
    // `bounded`: the operation by which values are kept small; with another than sin there is no sin, cos, tanh or exp.
    RandomExpressions(Expressions& graph, std::vector<Term> variables, std::uint64_t seed, Op bounded = Op::sin)
        : graph_(graph),
          pool_(std::move(variables)),
          seed_(seed),
          bounded_(bounded) {}

    Term next() {
        const Term a = pick(), b = pick();
        const auto wave = [&](Term x) { return graph_.make(bounded_, x); }; // into [-pi/2, pi/2]
        const auto number = [&](double value) { return graph_.constant(value); };
        const auto other = [&](Op op, Term x) { return graph_.make(bounded_ == Op::sin ? op : bounded_, x); };
        const auto above = [&](double least, Term x) { return graph_.make(Op::add, number(least), wave(x)); };
        Term made = 0;
        switch (static_cast<int>(draw() * 16)) {
        case 0: made = graph_.make(Op::add, a, b); break;
        case 1: made = graph_.make(Op::subtract, a, graph_.make(Op::multiply, number(2 * draw()), b)); break;
        case 2: made = graph_.make(Op::multiply, a, wave(b)); break;
        case 3: made = graph_.make(Op::divide, a, above(2, b)); break;
        case 4: made = graph_.make(Op::negate, a); break;
        case 5: made = graph_.make(Op::power, above(1.5, a), wave(b)); break;
        case 6: made = other(Op::cos, a); break;
        case 7: made = graph_.make(Op::tan, wave(a)); break;
        case 8: made = graph_.make(Op::asin, graph_.make(Op::multiply, number(0.6), wave(a))); break;
        case 9: made = graph_.make(Op::acos, graph_.make(Op::multiply, number(0.6), wave(a))); break;
        case 10: made = graph_.make(Op::atan, a); break;
        case 11: made = graph_.make(Op::atan2, a, above(1.5, b)); break;
        case 12: made = other(Op::tanh, a); break;
        case 13: made = other(Op::exp, wave(a)); break;
        case 14: made = graph_.make(Op::log, above(1.5, a)); break;
        default:
            made = graph_.make(Op::select, graph_.make(Op::less, a, b), graph_.make(Op::sqrt, above(1.5, a)),
                               graph_.make(Op::power, b, number(3)));
        }
        pool_.push_back(made);
        return made;
    }

  private:
    double draw() { return uniform(seed_, 0, count_++); }
    Term pick() { return pool_[static_cast<std::size_t>(draw() * static_cast<double>(pool_.size()))]; }

    Expressions& graph_;
    std::vector<Term> pool_;
    std::uint64_t seed_, count_ = 0;
    Op bounded_;
};

// The value of a term with complex variables, which shares nothing with tape or derivative. A condition asks the real
// parts.
inline std::complex<double> complex_value(const Expressions& graph, Term root, const std::vector<Term>& variables,
                                          const std::vector<std::complex<double>>& point) {
    using Complex = std::complex<double>;
    std::unordered_map<Term, Complex> value;
    for (std::size_t i = 0; i < variables.size(); ++i) value[variables[i]] = point[i];
    for (const Term term : graph.reachable(std::span(&root, 1))) {
        const auto& node = graph[term];
        const Complex a = operand_count(node.op) > 0 ? value[node.a] : 0;
        const Complex b = operand_count(node.op) > 1 ? value[node.b] : 0;
        const Complex c = operand_count(node.op) > 2 ? value[node.c] : 0;
        switch (node.op) {
        case Op::constant: value[term] = node.value; break;
        case Op::variable: break;
        case Op::add: value[term] = a + b; break;
        case Op::subtract: value[term] = a - b; break;
        case Op::multiply: value[term] = a * b; break;
        case Op::divide: value[term] = a / b; break;
        case Op::negate: value[term] = -a; break;
        case Op::power:
            value[term] = b == 3.0 ? a * a * a : std::exp(b * std::log(a)); // a may be negative before a whole number
            break;
        case Op::sin: value[term] = std::sin(a); break;
        case Op::cos: value[term] = std::cos(a); break;
        case Op::tan: value[term] = std::sin(a) / std::cos(a); break;
        // The library's inverse functions lose imaginary parts as small as the step; these are first-order parts of
        // sin y = a and so on.
        case Op::asin: {
            const double y = std::asin(a.real());
            value[term] = {y, a.imag() / std::cos(y)};
            break;
        }
        case Op::acos: {
            const double y = std::acos(a.real());
            value[term] = {y, -a.imag() / std::sin(y)};
            break;
        }
        case Op::atan: {
            const double y = std::atan(a.real());
            value[term] = {y, a.imag() * std::cos(y) * std::cos(y)};
            break;
        }
        case Op::atan2: {
            const double y = std::atan2(a.real(), b.real()), r = std::hypot(a.real(), b.real());
            value[term] = {y, (std::cos(y) * a.imag() - std::sin(y) * b.imag()) / r};
            break;
        }
        case Op::tanh: value[term] = std::sinh(a) / std::cosh(a); break;
        case Op::exp: value[term] = std::exp(a); break;
        case Op::log: value[term] = std::log(a); break;
        case Op::sqrt: value[term] = std::sqrt(a); break;
        case Op::select: value[term] = a.real() != 0 ? b : c; break;
        case Op::no_event: value[term] = a; break;
        default: value[term] = apply(node.op, a.real(), b.real(), 0);
        }
    }
    return value[root];
}

} // namespace tribode
