#pragma once
#include "tribode/base/run_control.hpp"
#include "tribode/experiment/simulation.hpp"
#include "tribode/record/plot.hpp"
#include "tribode/record/run_folder.hpp"

#include <optional>
#include <string>
#include <vector>

namespace tribode {

// One way to run the machine, and how it did beside the reference.
struct MethodResult {
    std::string name; // e.g. "erk 1e-6", "euler 50 us"
    SolverOptions solver;
    RunOutcome outcome;
    // Of the true position at the sample instants, to the reference [m]; of a run that ended early over what it reached.
    double max_difference = 0, rms_difference = 0;
    bool diverged = false; // ended early, or went ten times the motion astray
    // Stick-slip transitions of the reference that the method has too: same element, same kind, at most one sample
    // time apart; those it misses; and those it has alone.
    long events_found = 0, events_missed = 0, events_extra = 0;
    // Position at the excitation frequency, to the reference: abs - 1, and the phase ahead of it [deg].
    std::optional<double> gain_error, phase_error_deg;
    std::optional<double> stable_stiffness; // of fixed-step methods, at the driven point [N/m]
    double seconds = 0;                     // processor time of the run
    RunStatistics statistics;
    ServoTrace trace;
};

struct ComparisonOptions {
    std::vector<double> tolerances = {1e-4, 1e-6, 1e-8, 1e-10}; // relative; absolute: times 1e-3 m
    std::vector<long> divisions = {1, 2, 5, 10, 20, 50, 100};   // fixed steps Ts/n
    std::uint64_t seed = 0;                                     // of the noise

    static void describe(auto& o, auto& fields) {
        fields.numbers("tolerances", o.tolerances, "", Allowed::positive, 1000,
                       "relative tolerances of the variable steps; the absolute ones are 1e-3 m times that");
        fields.integers("divisions", o.divisions, 1, 1'000'000, "fixed steps Ts/n: the values of n");
        fields.integer("seed", o.seed, 0, 1L << 53, "of the noise");
    }
};

struct Comparison {
    std::string reference; // "exact", or "erk 1e-12" where the machine is not piecewise affine, with the reason
    std::optional<double> excitation_hz; // the strongest frequency of the input, where it stands out
    double friction_stiffness = 0;       // of all elements in stick [N/m]
    MethodResult exact;                  // the reference itself
    std::vector<MethodResult> methods;

    std::vector<const MethodResult*> all() const; // the reference, then the methods
    Table table() const;                          // a row for each of them; without times, so the same for every run
    std::string text() const;                     // table of the main columns, for people
    Json json() const;                            // findings, reference and methods, as tb.compare returns them
    std::vector<std::string> findings() const;    // what the discrete methods get wrong, in words
};

// One machine and one input through every method: variable step (exact, ERK, Adams, BDF) and fixed step (Runge-Kutta,
// explicit and semi-implicit Euler, zero-order hold) of 1, 1/2, ... of a sample time. The reference is the exact solver,
// or ERK at 1e-12 where the machine is not piecewise affine.
Comparison compare(const MachineModel& machine, const DriveRecord& record, const ComparisonOptions& options,
                   const RunControl& control = {});

// comparison.csv, cost.csv (processor times, which differ from run to run), findings.txt and the plots trajectories,
// differences, hysteresis, work_precision.
void write_comparison(const Comparison& comparison, const MachineModel& machine, RunFolder& folder);

} // namespace tribode
