#pragma once
#include "scenario.hpp"

#include <functional>
#include <optional>
#include <string>
#include <vector>

namespace tribode::bench {

// What came of a run.
struct Run {
    std::vector<double> x; // true position at the sample instants [m]; fewer where the run ended early
    long samples = 0, steps = 0, events = 0;
};

// A way to run a scenario.
struct Contender {
    std::string name; // without a comma
    std::function<Run(const Scenario&)> run;
};

// Through the engine, with an observer that keeps the position; the exact solver first.
std::vector<Contender> engine_methods();
// The exact solver as `tribode simulate` calls it: seven columns, and the log of events.
Contender engine_with_all_columns();

// The machine written as a system of equations, by exact and by erk at 1e-6. Recording and differentiating it, once, is
// not part of a run.
std::vector<Contender> machine_as_system();

// What one would write without the engine (by_hand/).
//   RK4     7 states, classical Runge-Kutta with `divisions` steps a sample; events are not located
//   ARKODE  7 states, explicit Runge-Kutta of order 5, events by two root functions; at each sample and event a
//           restart, anew as the library's manual has it, or with the step size carried over
//   CVODE   27 states, called anew at every sample; no events, elements stop in the right side
Contender rk4_by_hand(int divisions);
enum class Restart { with_step, anew };
Contender arkode_by_hand(double relative_tolerance, Restart restart = Restart::with_step);
enum class Multistep { adams, bdf };
Contender cvode_by_hand(Multistep family, double relative_tolerance);

// One line of the table: a method and what it runs.
struct Entry {
    std::string scenario, method;
    std::function<Run()> run;
    const Reference* reference = nullptr; // null: the error is not measured

    std::string name() const { return scenario + "/" + method; }
};

} // namespace tribode::bench
