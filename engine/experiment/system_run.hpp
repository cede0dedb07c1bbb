#pragma once
#include "base/run_control.hpp"
#include "record/table.hpp"
#include "solver/integrator.hpp"
#include "solver/run_outcome.hpp"
#include "system/equation_system.hpp"

namespace tribode {

struct SystemRunOptions {
    double duration = 1;    // [s]
    double output_step = 0; // of the grid of the results [s]; 0: a thousandth of the duration
    SolverOptions solver;   // absolute tolerance: times the nominal value of each state
};

// What a run of a system of equations gave, up to where it came.
struct SystemRun {
    Table table;                      // t, states, discrete variables, outputs, at the grid: left limits
    EventLog events;                  // in time; subject: the place of the `when`
    std::vector<double> final_states; // right limits, in the order of the equations
    std::vector<double> final_discrete;
    Method method = Method::automatic; // the one used
    RunOutcome outcome;
    RunStatistics statistics;
};

// Runs the system from its start values at t = 0. A run whose rates were not finite says which one, and when. Throws
// InputError where the options are wrong or the solver cannot run the system.
SystemRun run_system(const EquationSystem& system, const SystemRunOptions& options, const RunControl& control = {});

} // namespace tribode
