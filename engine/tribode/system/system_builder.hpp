#pragma once
#include "tribode/system/equations.hpp"

#include <memory>
#include <string>
#include <utility>
#include <vector>

namespace tribode {

// A value in the equations of a SystemBuilder: a number, a variable, or what arithmetic makes of them. It is small and is
// passed by value. Comparisons give conditions, 1 or 0, which are joined by && and ||, both sides of which are always made.
class Expression {
  public:
    Expression(double number = 0) : number_(number) {} // numbers stand in equations as they are
    Expression(std::shared_ptr<Expressions> graph, Term term) : graph_(std::move(graph)), term_(term) {}

    // Operands that the operation does not have are ignored. Throws InputError where they are of two builders.
    static Expression make(Op op, const Expression& a, const Expression& b = 0, const Expression& c = 0);

    const std::shared_ptr<Expressions>& graph() const { return graph_; } // null: a number
    Term in(Expressions& graph) const;                                   // in its own graph, where it has one

    // Hidden friends, so that a number may stand on either side.
    friend Expression operator+(const Expression& a, const Expression& b) { return make(Op::add, a, b); }
    friend Expression operator-(const Expression& a, const Expression& b) { return make(Op::subtract, a, b); }
    friend Expression operator*(const Expression& a, const Expression& b) { return make(Op::multiply, a, b); }
    friend Expression operator/(const Expression& a, const Expression& b) { return make(Op::divide, a, b); }
    friend Expression operator-(const Expression& a) { return make(Op::negate, a); }
    friend Expression operator<(const Expression& a, const Expression& b) { return make(Op::less, a, b); }
    friend Expression operator<=(const Expression& a, const Expression& b) { return make(Op::less_equal, a, b); }
    friend Expression operator>(const Expression& a, const Expression& b) { return make(Op::less, b, a); }
    friend Expression operator>=(const Expression& a, const Expression& b) { return make(Op::less_equal, b, a); }
    friend Expression operator&&(const Expression& a, const Expression& b) { return make(Op::all, a, b); }
    friend Expression operator||(const Expression& a, const Expression& b) { return make(Op::any, a, b); }
    friend Expression operator!(const Expression& a) { return make(Op::logical_not, a); }
    friend Expression pow(const Expression& a, const Expression& b) { return make(Op::power, a, b); }
    friend Expression sin(const Expression& a) { return make(Op::sin, a); }
    friend Expression cos(const Expression& a) { return make(Op::cos, a); }
    friend Expression tan(const Expression& a) { return make(Op::tan, a); }
    friend Expression atan2(const Expression& y, const Expression& x) { return make(Op::atan2, y, x); }
    friend Expression tanh(const Expression& a) { return make(Op::tanh, a); }
    friend Expression exp(const Expression& a) { return make(Op::exp, a); }
    friend Expression log(const Expression& a) { return make(Op::log, a); }
    friend Expression sqrt(const Expression& a) { return make(Op::sqrt, a); }
    friend Expression floor(const Expression& a) { return make(Op::floor, a); }
    // Where the condition holds a, else b; the solver locates the instant at which it changes.
    friend Expression where(const Expression& condition, const Expression& a, const Expression& b) {
        return make(Op::select, condition, a, b);
    }

  private:
    std::shared_ptr<Expressions> graph_;
    Term term_ = 0;
    double number_ = 0;
};

// Writes the equations of a system in C++. What events, samples and their order mean is said at EquationSystem.
//
//     SystemBuilder ball("ball");
//     const Expression h = ball.state("h", 1, "m"), v = ball.state("v", 0, "m/s");
//     ball.rate(h, v);
//     ball.rate(v, -9.81);
//     ball.when("impact", h < 0, {{h, 0}, {v, -0.8 * v}});
//     const EquationSystem system(ball.equations());
//
// A builder and its expressions are for one thread. What equations() gives is independent of them.
class SystemBuilder {
  public:
    // New values of states and discrete variables, all at once: the right sides are those before it.
    using Assignments = std::vector<std::pair<Expression, Expression>>;

    explicit SystemBuilder(std::string name);

    Expression time() const { return variable(equations_.time); } // [s]

    // Constant during a run; Equations has its value.
    Expression parameter(std::string name, double value, std::string unit = "");
    // A state; its absolute tolerance is `nominal`, of the size of its values, times the run's. Each needs a rate().
    Expression state(std::string name, double start, std::string unit = "", double nominal = 1);
    // A variable that events and samples alone change.
    Expression discrete(std::string name, double start, std::string unit = "");
    // A variable that is found from the residuals, as many as there are algebraic variables; `guess` is its start.
    Expression algebraic(std::string name, double guess, std::string unit = "", double nominal = 1);

    void rate(const Expression& state, const Expression& value); // d state/dt
    void residual(std::string name, const Expression& value);    // 0 = value
    void output(std::string name, const Expression& value, std::string unit = "");

    // The event at which the condition becomes true.
    void when(std::string name, const Expression& condition, const Assignments& set);
    // The same, where it also ends the run.
    void stop_when(std::string name, const Expression& condition, const Assignments& set = {});
    // At offset + k period [s], k = 0, 1, ...
    void sample(std::string name, double period, double offset, const Assignments& set);

    // Throws InputError where a state has no rate, or residuals and algebraic variables differ in number. Whatever else is
    // wrong with the equations EquationSystem says.
    Equations equations() const;

  private:
    Expression variable(Term term) const { return {equations_.graph, term}; }
    Term term(const Expression& value) const;
    Equations::Assignments assignments(const Assignments& set) const;
    void add_when(std::string name, const Expression& condition, const Assignments& set, bool stop);

    Equations equations_;
    std::vector<bool> has_rate_; // of each state
    std::vector<std::pair<std::string, Term>> residuals_;
};

} // namespace tribode
