#pragma once
#include "tribode/analysis/loop_gain.hpp"
#include "tribode/base/run_control.hpp"
#include "tribode/design/feedforward.hpp"
#include "tribode/experiment/servo_run.hpp"
#include "tribode/machine/friction_model.hpp"
#include "tribode/machine/machine_model.hpp"
#include "tribode/record/table.hpp"

#include <cstdint>
#include <optional>
#include <vector>

namespace tribode {

struct PositioningOptions {
    double duration = 0.3;       // of the run, and of the window of the errors [s]
    std::optional<double> delay; // L of C_dly on r*, before it meets y_dly [s]; none: loop_dead_time() of the machine
    int delay_order = 4;         // of its Pade approximant
    bool friction_compensation = true;
    std::optional<FrictionModel> friction_model; // FM; none: the machine's own
    double friction_feedback = 0;                // share fed back from y instead, as eqs. (11) and (16) can be read
    double velocity_feedforward = 1;             // share of the reference's velocity that a cascade does not brake
    double band = 5e-6;                          // settled within +- this [m]
    double rated_thrust = 150;                   // [N]
    double stroke = 0.78;                        // [m]
    double spectrum_max_hz = 200;                // of the residual vibration
    SolverOptions solver;
    std::uint64_t seed = 0; // of the noise

    static void describe(auto& o, auto& fields) {
        fields.number("duration_s", o.duration, "s", Allowed::positive, "of the run and of the errors");
        fields.number("delay_s", o.delay, "s", Allowed::non_negative,
                      "dead time of the delay model C_dly of the reference; default: half a sample of hold, the delays "
                      "and the thrust lag of the machine");
        fields.integer("delay_order", o.delay_order, 1, 10, "order of its Padé approximant");
        fields.flag("friction_compensation", o.friction_compensation,
                    "compensation by the friction model, driven by r*");
        fields.table("friction_model", o.friction_model, "as for `tb.sweep`; default the machine's own");
        fields.number("friction_feedback", o.friction_feedback, "", Allowed::non_negative,
                      "share of the friction model that is fed back from the detected position; "
                      "not zero: in place of the compensation by r*");
        fields.number("velocity_feedforward", o.velocity_feedforward, "", Allowed::non_negative,
                      "with a cascade: share of the reference's velocity that its velocity loop does not brake");
        fields.number("band_m", o.band, "m", Allowed::positive, "settled within ± this");
        fields.number("rated_thrust_N", o.rated_thrust, "N", Allowed::positive, "for `within_rating`");
        fields.number("stroke_m", o.stroke, "m", Allowed::positive, "for `within_stroke`");
        fields.number("spectrum_max_hz", o.spectrum_max_hz, "Hz", Allowed::positive, "highest frequency of `spectrum`");
        fields.integer("seed", o.seed, 0, 1L << 53, "of the noise");
        SolverOptions::describe(o.solver, fields);
    }
};

struct PositioningResult {
    ServoTrace trace;                          // r is the delayed r*
    std::vector<double> error;                 // y - distance [m]
    std::vector<double> tracking_error;        // delayed r* - y [m]
    std::vector<double> feedforward;           // u_ff [N]
    std::vector<double> friction_compensation; // [N]
    double rmse = 0;                           // of the tracking error [m]
    double max_error = 0;                      // largest abs of it [m]
    std::optional<double> settling_time;       // instant from which abs(error) <= band to the end [s]; none: never
    double peak_thrust = 0;                    // largest abs(u) [N]
    double peak_position = 0;                  // largest abs(x) [m]
    bool within_rating = false;                // peak_thrust <= rated_thrust
    bool within_stroke = false;                // peak_position <= stroke
    std::vector<double> spectrum_hz;           // every 0.5 Hz
    std::vector<double> spectrum;              // of the error after the task's duration [m]
    RunOutcome outcome;
    RunStatistics statistics;

    Table table() const; // one row per sample
};

// Positioning with two degrees of freedom, section V-C:
//
//     u = C(z) (C_dly r* - y_dly) + u_ff + FM(r*)
//
// with the machine's own PID as C(z), and the friction model FM with the machine's friction, or that of the options, driven
// by r* at the sample time. With a cascade, kv d(C_dly r*)/dt is added (velocity_feedforward), filtered and delayed as in the
// controller. With friction_feedback p, p FM(y_dly) takes the place of FM(r*). The run starts at rest at
// zero; the step of the reference is at t = 0. y is the detected position y_dly. Throws InputError where the machine has no
// controller, the sample times differ or the run is shorter than the task, EndedEarly when interrupted, Error where the run
// fails.
PositioningResult run_positioning(const MachineModel& machine, const Feedforward& feedforward,
                                  const PositioningOptions& options, const RunControl& control = {});

// Margins of the loop around the linear dynamics, without friction, with the machine's true delays, hold and
// lag, from 0.5 Hz to the Nyquist frequency. Throws InputError where the machine has no controller.
StabilityMargins positioning_margins(const MachineModel& machine);

} // namespace tribode
