#pragma once
#include "tribode/diagnosis/system_terms.hpp"

namespace tribode {

// Arithmetic on the terms of one graph. Conditions are no events: what a term does at them is continuous, or too short to
// matter.
struct TermArithmetic {
    Expressions& g;

    Term number(double value) const { return g.constant(value); }
    Term add(Term a, Term b) const { return g.make(Op::add, a, b); }
    Term subtract(Term a, Term b) const { return g.make(Op::subtract, a, b); }
    Term multiply(Term a, Term b) const { return g.make(Op::multiply, a, b); }
    Term divide(Term a, Term b) const { return g.make(Op::divide, a, b); }
    Term negate(Term a) const { return g.make(Op::negate, a); }
    Term less(Term a, Term b) const { return g.make(Op::less, a, b); }
    Term where(Term condition, Term a, Term b) const {
        return g.make(Op::no_event, g.make(Op::select, condition, a, b));
    }
    Term abs(Term a) const { return where(less(a, number(0)), negate(a), a); }
    Term positive(Term a) const { return where(less(a, number(0)), number(0), a); } // max(a, 0)
    // As a minimum of a maximum, which is seen to have no jump and so has derivatives.
    Term clip(Term a, Term low, Term high) const {
        const Term above = where(less(a, low), low, a);
        return where(less(high, above), high, above);
    }
};

// A derivative or an output to which a term may be added.
struct TermTarget {
    std::string name; // "der(v)", "output y"
    std::string unit;
    bool is_output = false;
    std::size_t place = 0; // of the state or the output
    double scale = 0;      // how much it moves, in its unit
    // Where it is an acceleration, or a force over an imposed motion: the names of position and velocity. Else empty.
    std::string position, velocity;

    void add(Equations& equations, Term term) const;
};

// What the library is made from, and the list of terms as it grows.
struct TermLibrary {
    const SystemModel& model;
    std::size_t states; // of the user's
    const SystemFit& fit;
    const std::vector<SystemVariable>& variables;
    const std::vector<double>& errors;
    double duration = 0; // of the longest record [s]
    std::vector<TermTarget> targets;
    std::vector<SystemTerm> terms;

    TermLibrary(const SystemModel& model, std::size_t states, const SystemFit& fit,
                const std::vector<SystemVariable>& variables, const std::vector<double>& errors);

    bool is_state(Term term) const;
    // Whether a rate is nothing but another variable or a number: the definition of a velocity, which lacks nothing.
    bool is_definition(Term rate) const;
    // Typical rate of change of a state over the samples of the records [1/s].
    double rate_scale(const std::vector<double>& values) const;
    // An amplitude that moves the target by a hundredth of what it does, of a factor of this rms and unit.
    SystemTerm::Parameter amplitude(const TermTarget& target, const std::string& name, double rms,
                                    const std::string& unit) const;
};

double rms_of_values(const std::vector<double>& values);

// Each adds its terms to the list.
void add_shapes(TermLibrary& library,
                bool with_nameless);      // functions of one variable or two in a derivative or an output
void add_periodic(TermLibrary& library);  // in a variable, or in time
void add_overflows(TermLibrary& library); // of one state, or of one into another
void add_paths(TermLibrary& library);     // of inputs and outputs

} // namespace tribode
