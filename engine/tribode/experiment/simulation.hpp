#pragma once
#include "tribode/base/run_control.hpp"
#include "tribode/experiment/servo_run.hpp"
#include "tribode/machine/machine_model.hpp"
#include "tribode/record/given_record.hpp"
#include "tribode/record/table.hpp"

#include <cstdint>
#include <span>
#include <string>

namespace tribode {

// What drives a machine, where it stands in memory: it must outlive the run and stay as it is meanwhile.
struct DriveView {
    std::size_t samples = 0;
    std::span<const double> t;                     // as the user wrote it [s]; empty: k Ts
    std::span<const double> u;                     // [N]; empty in closed loop
    std::span<const double> reference, excitation; // [m], [N]; empty in open loop, and where they are zero
    std::span<const double> measured;              // y of the record [m], for a fitted start; or empty

    bool closed_loop() const { return u.empty(); }
};

// What drives a machine, sample by sample: the columns of a record. Either u (open loop) or r and excitation.
struct DriveRecord {
    std::vector<double> t;                     // as the user wrote it [s]; t_k = t_0 + k Ts
    std::vector<double> u;                     // [N]; empty in closed loop
    std::vector<double> reference, excitation; // [m], [N]; empty in open loop
    std::vector<double> measured;              // y of the record [m], where it has one; for a fitted start

    bool closed_loop() const { return u.empty(); }

    operator DriveView() const { return {t.size(), t, u, reference, excitation, measured}; }

    // Whether columns drive the machine in closed loop: where there is u besides r or exc, its closed_loop decides. Throws
    // InputError where there are none of them or no rows, and where the machine has no controller to close the loop.
    static bool closes_loop(const MachineModel& machine, bool has_u, bool has_r_or_exc, std::size_t rows,
                            const std::string& where);

    // Whether a record may have a column of this name: t, u, r, exc, y, and x, v, f, which are passed over.
    static bool is_column(const std::string& name);

    // What from_table can use of a record: t, u, r, exc, y.
    static const std::vector<std::string>& columns();

    // Columns t, then u (open loop) or r and exc (closed loop; one of the two may be absent and is zero then). Where a
    // record has u and r, the machine's closed_loop decides. Throws InputError on other columns, on a time column that
    // is not uniform with the machine's sample time, and on what the machine cannot do.
    static DriveRecord from_table(Table table, const MachineModel& machine, const std::string& where);

    // The same of a record that is given as a file or as columns, which may lack t.
    static DriveRecord of(GivenRecord record, const RecordOptions& options, const MachineModel& machine);
};

// What is asked of a simulation, besides the machine and the record: by the command line and by scripts.
struct SimulationOptions {
    SolverOptions solver;
    std::uint64_t seed = 0;                 // of the noise
    std::vector<std::string> sensitivities; // what the run is differentiated by (servo_direction)
    double friction_feedback = 0; // share of the modeled friction that is added to u (ClosedLoop); in closed loop only

    static void describe(auto& o, auto& fields) {
        SolverOptions::describe(o.solver, fields);
        fields.number("friction_feedback", o.friction_feedback, "", Allowed::non_negative,
                      "in closed loop: share of the modeled friction that is added to u "
                      "([how](friction-compensation.md))");
        fields.integer("seed", o.seed, 0, 1L << 53, "of the noise");
    }
};

struct Simulation {
    ServoTrace trace;                  // at the record's instants reached; t as in the record
    Method method = Method::automatic; // the one used
    EventLog events;                   // times from the record's first instant [s]
    RunOutcome outcome;
    RunStatistics statistics;
    std::vector<ServoSensitivity> sensitivities; // of the options, in their order
};

// The method that `automatic` stands for with this machine.
Method resolved(Method method, const MachineModel& machine);

// A run of the machine under the record, from the start that its description says; the start of the options is not used.
// Throws InputError where the record has no instants, or a column with another number of values, and where the method
// cannot run the machine.
ServoRun driven_run(const MachineModel& machine, const DriveView& drive, ServoRunOptions options,
                    double friction_feedback = 0, const RunControl& control = {});

// Runs the machine under the record. The first sample is t = 0 of the machine; there it rests, or moves as the first
// samples of the measured position do where its description says "fitted". The noise of sensor and force follows from the
// seed. Throws InputError as driven_run does; a run that ends early is told by the outcome, and the trace goes as far as it
// came. Columns of an earlier run that are not needed any more give their memory.
Simulation simulate(const MachineModel& machine, const DriveView& drive, const SimulationOptions& options = {},
                    const RunControl& control = {}, ServoTrace memory = {});

// Columns t,r,u,y,x,v,f, as `tribode simulate` writes them.
Table to_table(const ServoTrace& trace);

// The event log as `tribode simulate --events` writes it: lines t,element,kind under a header.
std::string to_csv(const EventLog& events);

// u between its samples, band-limited: per sample a cubic through u[k] and u[k+1] with the slopes of the ideal
// band-limited interpolation there (windowed sinc over 32 samples on each side). Outside the record u is constant.
std::vector<std::array<double, 4>> band_limited(const std::vector<double>& u);

} // namespace tribode
