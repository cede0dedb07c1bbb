#pragma once
#include "tribode/system/lookup_table.hpp"

#include <cmath>
#include <cstdint>
#include <map>
#include <optional>
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
    floor,  // jumps; its derivative is zero
    lookup, // a table at x = a, y = b, on the sides c
    delay,  // a, b seconds earlier: to be taken out before a run (see take_out_delays); evaluated, it is a
    // Conditions: 1 where they hold, else 0. Their derivative is zero.
    less,
    less_equal,
    equal,
    all,         // a and b
    any,         // a or b
    logical_not, // not a
    select,      // a != 0: b, else c
    no_event,    // a; relations below it are no events (see EquationSystem)
    rate,        // how a changes by time along the equations: to be taken out before a run (see close_contacts)
    before       // a when the present instant began (see EquationSystem); evaluated, it is a
};

// How many operands an operation has.
int operand_count(Op op);

// Whether the value is a condition.
bool is_condition(Op op);

// a^b. Small whole exponents, which are most of those in equations, are products: these take a tenth of the time.
inline double power(double a, double b) {
    return b == 2 ? a * a : b == 3 ? a * a * a : b == 1 ? a : b == 4 ? (a * a) * (a * a) : std::pow(a, b);
}

// The operation on numbers, as a tape evaluates it, but for a lookup. Operands that it does not have are ignored.
double apply(Op op, double a, double b, double c);

// A graph of expressions in real variables. Each expression is held once (common terms are shared), operations on
// constants are carried out, and the neutral and absorbing cases of sums and products are taken out: x + 0, 1 x, 0 x,
// x - x, x / 1, x^1, x^2 as x x. So 0 times what is not finite is 0. Operands come before what is made of them.
// Throws InputError above max_terms.
class Expressions {
  public:
    static constexpr std::size_t max_terms = 4'000'000; // some 200 MB: a script that runs away

    struct Node {
        Op op = Op::constant;
        Term a = 0, b = 0, c = 0; // operands; a of a variable is its number
        double value = 0;         // of a constant; of a lookup the number of its table

        bool operator==(const Node&) const = default;
    };

    Term constant(double value);
    Term variable(std::string name); // another one at each call
    Term make(Op op, Term a, Term b = 0, Term c = 0);
    // The value of a table; y is ignored where it has one variable. The sides on which x and y are become relations, whose
    // events keep kinks from lying within a step.
    Term look_up(const std::shared_ptr<const LookupTable>& table, Term x, Term y);
    Term look_up(const std::shared_ptr<const LookupTable>& table, Term x, Term y, Term side) {
        return look_up(number_of(table), x, y, side);
    }
    const std::shared_ptr<const LookupTable>& table_of(Term lookup) const { return tables_[table_number(lookup)]; }

    const Node& operator[](Term term) const { return nodes_[term]; }
    std::size_t size() const { return nodes_.size(); } // terms, from 0
    bool is_constant(Term term, double value) const {
        return nodes_[term].op == Op::constant && nodes_[term].value == value;
    }
    const std::string& name(Term variable) const { return names_[nodes_[variable].a]; }

    // Whether a branch goes on continuously where its condition changes, as far as that is seen: those of max, min and abs.
    bool is_continuous(Term select) const;

    // As one would write it: "x*(y + 2)". Of terms in `names` only the name is written.
    std::string text(Term term, const std::unordered_map<Term, std::string>& names = {}) const;

    // The roots and all that they are made of, ascending: operands first. `into_no_event`: also what is below a
    // no_event.
    std::vector<Term> reachable(std::span<const Term> roots, bool into_no_event = true) const;

    // A graph of the roots and what they are made of alone, and of each term its place there.
    std::pair<Expressions, std::vector<Term>> part(std::span<const Term> roots) const;

    // The variables that any of the roots depends on, ascending.
    std::vector<Term> variables_of(std::span<const Term> roots) const;

    // The roots with terms replaced; what is put in is not looked at again.
    using Replacement = std::unordered_map<Term, Term>;
    std::vector<Term> substitute(std::span<const Term> roots, const Replacement& replacement);

    // The derivatives of the roots by one variable. Where a function has a kink or a jump, the derivative of the side
    // that its condition says.
    std::vector<Term> derivatives(std::span<const Term> roots, Term variable);
    // The same along a direction, which gives for each variable that moves its derivative.
    std::vector<Term> derivatives(std::span<const Term> roots, const Replacement& direction);

    // The derivatives of the roots by the variables that are not zero, column by column. The effort grows with their number
    // and that of the derivatives of all that the roots are made of.
    struct Derivative {
        std::size_t row = 0, column = 0; // the places of a root and a variable
        Term term = 0;
    };
    std::vector<Derivative> jacobian(std::span<const Term> roots, std::span<const Term> variables);

  private:
    const char* continuous_name(Term select) const;
    bool is_negative_of(Term a, Term b) const;
    bool is_sign_times(Term select) const;

    struct Hash {
        std::size_t operator()(const Node& node) const;
    };

    Term keep(const Node& node);
    std::size_t table_number(Term lookup) const { return static_cast<std::size_t>(nodes_[lookup].value); }
    std::size_t number_of(const std::shared_ptr<const LookupTable>& table);
    Term look_up(std::size_t table, Term x, Term y, Term side);
    Term slope(Term lookup, int variable);
    Term derivative_of(Term term, Term da, Term db, Term dc);

    std::vector<Node> nodes_;
    std::vector<std::string> names_; // of the variables
    std::vector<std::shared_ptr<const LookupTable>> tables_;
    std::map<std::pair<std::size_t, int>, std::optional<std::size_t>>
        slopes_; // of a table by a variable; nothing: zero
    std::unordered_map<Node, Term, Hash> places_;
};

} // namespace tribode
