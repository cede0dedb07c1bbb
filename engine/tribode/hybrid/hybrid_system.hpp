#pragma once
#include "tribode/hybrid/enclosure.hpp"
#include "tribode/hybrid/system_state.hpp"

#include <cstddef>
#include <optional>
#include <span>
#include <string>
#include <vector>

namespace tribode {

using GuardId = std::size_t;
using ClockId = std::size_t;

struct StateVariable {
    std::string name;
    std::string unit;
    std::optional<std::size_t> rate; // the state that is its derivative: a position's velocity
    double scale = 1; // its absolute tolerance is scale times the run's: 1 for a position, for which atol is in meters
    double limit = 1e100; // a size beyond which the solution counts as diverged
    // Of an algebraic variable its equation, for messages: it has no derivative, derivative() gives the value of the equation
    // that must be zero. Empty: a state.
    std::string equation;

    bool is_algebraic() const { return !equation.empty(); }
};

// Sample instants are offset + k period with an integer k >= 0, never a running sum.
struct SampleClock {
    std::string name;
    double period; // [s], > 0
    double offset; // [s], >= 0

    double instant(long k) const { return offset + static_cast<double>(k) * period; }
};

// One entry of the event log: at time t, `subject` (an element, a body) took on the state `kind`. What the numbers mean
// each system says; for a servo machine see ServoPlant.
struct Event {
    double t; // [s]
    int subject;
    int kind;
};

using EventLog = std::vector<Event>;

class PiecewiseAffine;

// What handling an event did to the right side.
enum class EventEffect {
    none,       // x, the derivative and the guards are as before: the integrator goes on
    guards,     // the guards changed, x and the derivative did not: it goes on with the new ones
    derivative, // the derivative changed, x and the guards did not: the integrator starts afresh
    restart     // x jumped, or the guards changed: they are looked at again, and the integrator starts afresh
};

// Of a sparse square matrix: column j has entries in rows[starts[j]], ... rows[starts[j + 1] - 1], ascending.
struct SparsityPattern {
    std::vector<std::size_t> starts, rows;
};

// A system of ordinary differential equations with events and sampled blocks:
//
//     dx/dt = f(t, x; d)         between events, d constant
//     g(t, x; d) > 0             guards: each is positive while the present discrete state is valid; at a zero
//                                crossing on_crossing changes d (and, where need be, x)
//     (x, d) := h(k, x, d)       at the instants of the sample clocks, on_sample
//
// Some of x may be algebraic variables: in place of their dx/dt stand equations f = 0 of index 1, which hold in the initial
// state and after each handler.
//
// The system is constant and may be shared by threads; everything that changes is in SystemState. The order of things
// at one instant is that of Simulator. A guard which does not matter in the present discrete state returns 1, and a
// handler leaves no guard of its own below zero: then nothing fires twice, and no dead time is needed.
class HybridSystem {
  public:
    virtual ~HybridSystem() = default;

    virtual const std::vector<StateVariable>& states() const = 0;
    virtual const std::vector<SampleClock>& clocks() const = 0; // at one instant they fire in this order
    virtual std::size_t guard_count() const = 0;
    virtual SystemState initial_state() const = 0; // t = 0

    // f(t, x; d) into dxdt; both have states().size() entries.
    virtual void derivative(double t, std::span<const double> x, const DiscreteState& d,
                            std::span<double> dxdt) const = 0;

    // dx/dt of all variables where the algebraic equations hold; false: those of algebraic variables have no value there.
    virtual bool rates(double t, std::span<const double> x, const DiscreteState& d, std::span<double> dxdt) const;

    // df/dx into a column-major square matrix preset to zero; false: not available, differences will do. A system with
    // algebraic variables has it, and its pattern.
    virtual bool jacobian(double t, std::span<const double> x, const DiscreteState& d, std::span<double> matrix) const;

    // Where the entries of df/dx are that are not always zero, whatever d is; null: not known. Then sparse_jacobian() gives
    // them in this order.
    virtual const SparsityPattern* jacobian_pattern() const { return nullptr; }
    virtual void sparse_jacobian(double t, std::span<const double> x, const DiscreteState& d,
                                 std::span<double> entries) const;

    // g(t, x; d), guard_count() entries.
    virtual void guards(double t, std::span<const double> x, const DiscreteState& d, std::span<double> g) const = 0;

    // Whether enclose_guards() is there: bounds of g(t, x; d), and of its rate of change along a trajectory, from those of
    // t and of x and dx/dt, over a piece of the trajectory; guard_count() entries. They hold all values, rounding
    // included. Then events are found for certain (EventSearch).
    virtual bool encloses_guards() const { return false; }
    virtual void enclose_guards(const Enclosure& t, std::span<const Enclosure> x, const DiscreteState& d,
                                std::span<Enclosure> g) const;
    // Of a system that encloses its guards: whether this one does not depend on x, whatever d is.
    virtual bool depends_on_time_alone(GuardId) const { return false; }

    // The guard crossed zero. Throws NoSolution where the algebraic equations have none then; so does on_sample. Discrete
    // states change here and in on_sample, nowhere else. Changes are logged.
    virtual EventEffect on_crossing(GuardId guard, SystemState& state, EventLog& log) const = 0;

    // Guards that crossed zero at one instant, in declared order. Unless overridden they are handled one after the other, and
    // then none of them may say `guards`.
    virtual EventEffect on_crossings(std::span<const GuardId> guards, SystemState& state, EventLog& log) const;

    // Sample instant k of the clock.
    virtual EventEffect on_sample(ClockId clock, long k, SystemState& state) const = 0;

    // Whether an event of the instant just handled ends the run.
    virtual bool ends_run(const SystemState&) const { return false; }

    // For solvers that use the structure of the equations; null: none is known.
    virtual const PiecewiseAffine* piecewise_affine() const { return nullptr; }

    // For messages: what the guard watches at present ("element 3").
    virtual std::string guard_name(GuardId guard, const SystemState& state) const = 0;
};

} // namespace tribode
