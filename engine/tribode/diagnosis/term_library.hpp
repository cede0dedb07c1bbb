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

// A derivative, an output or an inner signal to which a term may be added.
struct TermTarget {
    std::string name; // "der(v)", "output y", "what der(v) and der(w) share"
    std::string unit;
    bool is_output = false;
    bool is_inner = false; // an output that stands for an inner signal
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
    double step = 0;     // between its samples, median [s]
    std::vector<TermTarget> targets;
    std::vector<SystemVariable> differences; // of two states or inputs, which are in the equations
    std::vector<SystemTerm> terms;

    TermLibrary(const SystemModel& model, std::size_t states, const SystemFit& fit,
                const std::vector<SystemVariable>& variables, const std::vector<double>& errors);

    void add_inner(); // differences, and targets that several derivatives share

    bool is_state(Term term) const;
    // What an input may have been before the records in place of their first value: its own, where nothing is connected. Nothing where
    // these are the same.
    std::optional<double> before(const SystemVariable& input) const;
    // Whether a rate is nothing but another variable or a number: the definition of a velocity, which lacks nothing.
    bool is_definition(Term rate) const;
    // Of a measured output, over the samples of the records; not a number where it was not measured.
    std::vector<double> errors_of(std::size_t output) const;
    // Values of a term of the model over the samples of the records, from its variables.
    std::vector<double> values_of(Term term) const;
    // Typical rate of change of a state over the samples of the records [1/s].
    double rate_scale(const std::vector<double>& values) const;
    // An amplitude that moves the target by a hundredth of what it does, of a factor of this rms and unit.
    SystemTerm::Parameter amplitude(const TermTarget& target, const std::string& name, double rms,
                                    const std::string& unit) const;
};

double rms_of_values(const std::vector<double>& values);

// Of a divided by b, where both are known; a plain number has none.
std::string unit_of_quotient(const std::string& a, const std::string& b);

// Of the rate of what has this unit, as an engineer says it: rad/s, not 1/s.
std::string per_second(const std::string& unit);

// A name for a state or a discrete variable that none has yet: this one, with "_" behind it as often as it takes.
std::string free_name(const Equations& equations, std::string name);

// Each adds its terms to the list.
void add_shapes(TermLibrary& library,
                bool with_nameless);      // functions of one variable or two in a derivative or an output
void add_curves(TermLibrary& library);    // of one variable, of any shape
void add_periodic(TermLibrary& library);  // in a variable, or in time
void add_overflows(TermLibrary& library); // of one state, or of one into another
void add_paths(TermLibrary& library);     // of inputs, outputs and inner signals

// A signal as a function of what it was.
using SignalFunction = std::function<Term(const TermArithmetic&, Term signal)>;
// Adds what lets through one direction of a signal alone, from a level on, as a diode, a check valve or a rope, and of the rest a share.
// `size`: the largest value of the signal, in `unit`. `change`: replaces the signal by a function of it, and returns what it is then.
void add_one_ways(TermLibrary& library, const std::string& equation, double size, const std::string& unit,
                  const std::function<Term(Equations&, const SignalFunction&)>& change);

// Puts something else in the place of an inner signal, in all equations. An output that shows the signal itself goes on doing so.
void replace_inner(Equations& equations, std::size_t output, Term changed);

} // namespace tribode
