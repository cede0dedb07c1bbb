#pragma once
#include "tribode/base/run_control.hpp"
#include "tribode/experiment/run_state.hpp"
#include "tribode/record/table.hpp"
#include "tribode/solver/integrator.hpp"
#include "tribode/solver/run_outcome.hpp"
#include "tribode/system/equation_system.hpp"

namespace tribode {

struct SystemRunOptions {
    double start = 0;                    // [s]
    std::optional<double> end, duration; // one of the two: when the run ends, or how long it is [s]
    double output_step = 0;              // of the grid of the results [s]; 0: a thousandth of the duration
    std::vector<double> output_times;    // ascending, instead of the grid [s]; empty: the grid
    bool output_jumps = false;           // also a row just before and one just after each event and each jump
    SolverOptions solver;                // absolute tolerance: times the nominal value of each state
    std::optional<RunState> resume;      // begins with this, at its time, instead of with the start values
    std::string fingerprint;             // of the equations, for the state at the end

    static void describe(auto& o, auto& fields) {
        fields.number("duration_s", o.duration, "s", Allowed::positive, "length of the run");
        fields.number("end_time_s", o.end, "s", Allowed::positive, "instead: the time at which it ends");
        fields.number("start_time_s", o.start, "s", Allowed::non_negative,
                      "the time at which it starts. Clocks keep their instants, samples of inputs their times");
        fields.number("output_step_s", o.output_step, "s", Allowed::non_negative,
                      "grid of the results; 0: a thousandth of the duration");
        fields.numbers("output_times_s", o.output_times, "s", Allowed::non_negative, 10'000'000,
                       "instead: the times of the results, an increasing list");
        fields.flag("output_events", o.output_jumps,
                    "adds a row just before and a row just after each event and each jump of a state or discrete "
                    "variable, with the same time, so that plots show steps");
        SolverOptions::describe(o.solver, fields, false);
    }
    void check(const FieldReader& fields) const;
};

// The derivatives of a run by a parameter or a start value: a column for each state, discrete variable and output, in the rows
// of the run. Those of discrete variables that depend on none, such as modes, are left out: they are zero.
struct SystemSensitivity {
    std::string name;
    Table table;
};

// What a run of a system of equations gave, up to where it came.
struct SystemRun {
    Table table; // t, states, discrete variables, outputs, at the grid: left limits; where an event ends
                 // the run, a last row there
    std::vector<SystemSensitivity> sensitivities; // where the equations have them
    EventLog events;                              // in time; subject: the place of the `when`
    std::vector<double> final_states;             // right limits, in the order of the equations
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
