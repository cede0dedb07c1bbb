#pragma once
#include "tribode/base/run_control.hpp"
#include "tribode/experiment/run_state.hpp"
#include "tribode/record/table.hpp"
#include "tribode/solver/integrator.hpp"
#include "tribode/solver/run_outcome.hpp"
#include "tribode/system/equation_system.hpp"

namespace tribode {

struct SystemRunOptions {
    double start = 0, end = 1;        // [s]
    double output_step = 0;           // of the grid of the results [s]; 0: a thousandth of the duration
    std::vector<double> output_times; // ascending, instead of the grid [s]; empty: the grid
    bool output_jumps = false;        // also a row just before and one just after each event and each jump
    SolverOptions solver;             // absolute tolerance: times the nominal value of each state
    std::optional<RunState> resume;   // begins with this, at its time, instead of with the start values
    std::string fingerprint;          // of the equations, for the state at the end
};

// What a run of a system of equations gave, up to where it came.
struct SystemRun {
    Table table;     // t, states, discrete variables, outputs, at the grid: left limits; where an event ends
                     // the run, a last row there
    EventLog events; // in time; subject: the place of the `when`
    std::vector<double> final_states; // right limits, in the order of the equations
    std::vector<double> final_discrete;
    RunState state;                    // there, to continue with
    Method method = Method::automatic; // the one used
    std::optional<double> stiff_from;  // then it went on by BDF [s]; nothing: it did not
    RunOutcome outcome;
    std::optional<std::size_t> ended_by; // the `when` that ended it
    RunStatistics statistics;
};

// Runs the system from its start values, or on from the state of another run of it. A run whose rates were not finite says
// which one, and when. Throws InputError where the options are wrong or the solver cannot run the system.
SystemRun run_system(const EquationSystem& system, const SystemRunOptions& options, const RunControl& control = {});

} // namespace tribode
