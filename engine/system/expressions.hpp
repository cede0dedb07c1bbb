#pragma once
#include <cstdint>
#include <map>
#include <span>
#include <string>
#include <string_view>
#include <unordered_map>
#include <vector>

namespace tribode {

// A place in a graph of expressions. Equal terms of one graph are equal expressions.
using Term = std::uint32_t;

enum class Op : std::uint8_t {
    constant,
    variable,
    add,
    subtract,
    multiply,
    divide,
    negate,
    power,
    sin,
    cos,
    tan,
    asin,
    acos,
    atan,
    atan2,
    tanh,
    exp,
    log,
    sqrt,
    floor, // jumps; its derivative is zero
    // Conditions: 1 where they hold, else 0. Their derivative is zero.
    less,
    less_equal,
    equal,
    all,     // a and b
    any,     // a or b
    no,      // not a
    select,  // a != 0: b, else c
    no_event // a; relations below it are no events (see EquationSystem)
};

// How many operands an operation has.
int operand_count(Op op);

// Whether the value is a condition.
bool is_condition(Op op);

// The operation on numbers, as a tape evaluates it. Operands that it does not have are ignored.
double apply(Op op, double a, double b, double c);

// A graph of expressions in real variables. Each expression is held once (common terms are shared), operations on
// constants are carried out, and the neutral and absorbing cases of sums and products are taken out: x + 0, 1 x, 0 x,
// x - x, x / 1, x^1, x^2 as x x. So 0 times what is not finite is 0. Operands come before what is made of them.
// Throws InputError above most_terms.
class Expressions {
  public:
    static constexpr std::size_t most_terms = 4'000'000; // some 200 MB: a script that runs away

    struct Node {
        Op op = Op::constant;
        Term a = 0, b = 0, c = 0; // operands; a of a variable is its number
        double value = 0;         // of a constant

        bool operator==(const Node&) const = default;
    };

    Term constant(double value);
    Term variable(std::string name); // another one at each call
    Term make(Op op, Term a, Term b = 0, Term c = 0);

    const Node& operator[](Term term) const { return nodes_[term]; }
    std::size_t size() const { return nodes_.size(); } // terms, from 0
    bool is_constant(Term term, double value) const {
        return nodes_[term].op == Op::constant && nodes_[term].value == value;
    }
    const std::string& name(Term variable) const { return names_[nodes_[variable].a]; }

    // As one would write it: "x*(y + 2)".
    std::string text(Term term) const;

    // The roots and all that they are made of, ascending: operands first. `into_no_event`: also what is below a
    // no_event.
    std::vector<Term> reachable(std::span<const Term> roots, bool into_no_event = true) const;

    // The variables that any of the roots depends on, ascending.
    std::vector<Term> variables_of(std::span<const Term> roots) const;

    // The roots with terms replaced; what is put in is not looked at again.
    using Replacement = std::unordered_map<Term, Term>;
    std::vector<Term> substitute(std::span<const Term> roots, const Replacement& replacement);

    // The derivatives of the roots by one variable. Where a function has a kink or a jump, the derivative of the side
    // that its condition says.
    std::vector<Term> derivatives(std::span<const Term> roots, Term variable);

  private:
    struct Hash {
        std::size_t operator()(const Node& node) const;
    };

    Term keep(const Node& node);
    Term derivative_of(Term term, Term da, Term db, Term dc);

    std::vector<Node> nodes_;
    std::vector<std::string> names_; // of the variables
    std::unordered_map<Node, Term, Hash> places_;
};

} // namespace tribode
