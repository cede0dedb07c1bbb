#pragma once
#include "tribode/system/expressions.hpp"

#include <functional>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <utility>
#include <vector>

namespace tribode {

// The equations of a system as data, in the terms of one graph:
//
//     dx/dt = f(t, x, d, u, p)     states x, discrete variables d, inputs u, parameters p
//     0 = g(t, x, d, u, p)         as many as there are algebraic variables, which are among x
//     y = h(t, x, d, u, p)         outputs
//     when c(t, x, d, u, p)        the instant at which c becomes true: some of x and d get new values
//     at offset + k period         sample clocks: some of x and d get new values
//
// A mode of operation is a discrete variable that counts from 0 and has names.
struct Equations {
    struct State {
        std::string name, unit;
        double start = 0;          // of an algebraic variable a guess
        double nominal = 1;        // its absolute tolerance is this times the run's
        Term symbol = 0, rate = 0; // of an algebraic variable the value that must be zero
        std::string where;         // of its equation, "script.lua:7"; empty: not known
        std::string equation;      // of an algebraic variable the name of the equation; empty: a state

        bool is_algebraic() const { return !equation.empty(); }
        std::string equation_text() const; // for messages: "der(x) (script.lua:7)", "the equation ohm (script.lua:7)"
    };
    struct Discrete {
        std::string name, unit;
        double start = 0;
        Term symbol = 0;
        std::vector<std::string> modes; // names of its values, where it is a mode
    };
    struct Parameter {
        std::string name, unit;
        double value = 0;
        Term symbol = 0;
    };
    struct Input {
        std::string name, unit;
        double value = 0; // where nothing else is connected
        Term symbol = 0;
    };
    struct Output {
        std::string name, unit;
        Term value = 0;
    };

    // New values of states and discrete variables, all at once: the right sides are those before it.
    using Assignments = std::vector<std::pair<Term, Term>>;

    struct When {
        std::string name;
        Term condition = 0;
        Assignments set;
        bool at_start = false; // whether it is an event already where the condition is true at the start
        bool stop = false;     // whether it ends the run
    };

    // A function from outside: gets the index of the sample and the values of `reads`, gives those of `writes`.
    struct Function {
        using Call = std::function<void(long k, std::span<const double> read, std::span<double> written)>;
        std::vector<Term> reads, writes;
        Call call;
        // In place of `call`, of one that has memory of its own, which no state of a run holds: gives what one run calls.
        // Such a system can neither be linearized nor continued.
        std::function<Call()> open;
    };

    struct Clock {
        std::string name;
        double period = 0, offset = 0; // [s]
        Assignments set;
        std::optional<Function> function; // after `set`
    };

    // A force that nature chooses: dry friction, which holds a velocity at zero as long as that takes no more than a level,
    // or a contact that lets a gap not close. The rates of change depend on the force, which is a variable that is in
    // them until close_contacts() puts in what it is.
    //
    // In stick, and at rest, the force is what keeps the velocity at zero: the solution of a linear equation, of as many as
    // there are such forces. So they may act on one another, in any number. The laws:
    //
    //     friction   mode 0 stick, 1 forward, 2 backward: force = +-level in slip; beyond +-release stick ends
    //     impact     mode 0 free, 1 rest: force = 0 in the air; where the gap closes, its rate of change v becomes -e v by
    //                an impulse. Where e |v| is below rest_speed, and the gap would close again, it rests, until the force
    //                would have to pull
    struct Contact {
        enum class Law { friction, impact };
        Law law = Law::friction;
        std::string name;         // of the part
        Term force = 0, mode = 0; // variables
        Term quantity = 0;        // the velocity of friction, the gap of an impact
        Term level = 0;           // of friction, in slip; may depend on the forces of others
        Term release = 0;         // of friction
        Term restitution = 0;     // of an impact
        std::optional<Term> rest_speed;
    };

    std::string name;
    std::shared_ptr<Expressions> graph;
    Term time = 0;
    std::vector<State> states;
    std::vector<Discrete> discrete;
    std::vector<Parameter> parameters;
    std::vector<Input> inputs;
    std::vector<Output> outputs;
    std::vector<When> whens;
    std::vector<Clock> clocks;
    std::vector<Contact> contacts;
    std::vector<std::string> free; // names of parameters and "STATE.start" that may be fitted; empty: all

    // The derivatives by a parameter or a start value, which stand behind what they are of (with_sensitivities()).
    struct Sensitivity {
        std::string name;
        Term parameter = 0;      // its symbol; of a start value a variable on which nothing depends
        std::size_t instant = 0; // among the discrete variables: dt/dp of the event that happens, else 0
        std::size_t states = 0;  // where those of the states begin, among the states
        std::size_t outputs = 0; // and those of the outputs
        std::vector<std::pair<std::size_t, std::size_t>> discrete; // of which discrete variables, and which they are
    };
    std::vector<Sensitivity> sensitivities;

    // Without derivatives.
    std::size_t own_states() const { return sensitivities.empty() ? states.size() : sensitivities.front().states; }
    std::size_t own_outputs() const { return sensitivities.empty() ? outputs.size() : sensitivities.front().outputs; }
    std::size_t own_discrete() const { return sensitivities.empty() ? discrete.size() : sensitivities.front().instant; }

    // All that is evaluated: rates, outputs, conditions, new values and what outside functions read.
    std::vector<Term> terms() const;

    // What a term of the equations is at t = 0, with start values, values of parameters and inputs, and zero for `unknown`.
    double value_at_start(Term term, std::span<const Term> unknown) const;

    // Puts terms in the place of variables, everywhere but in the lists of symbols themselves.
    void replace(const Expressions::Replacement& replacement);

    // The same with a graph of its own, of what these equations need alone.
    Equations with_own_graph() const;

    // The same for systems with the same variables, equations, parameters and inputs, in any program that runs this
    // version; start values do not matter. What an outside function does is not seen. 64 hexadecimal digits.
    std::string fingerprint() const;
};

} // namespace tribode
