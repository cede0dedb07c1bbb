#pragma once
#include "tribode/analysis/frequency_response.hpp"
#include "tribode/analysis/modal_model.hpp"
#include "tribode/base/run_control.hpp"
#include "tribode/experiment/servo_run.hpp"
#include "tribode/machine/friction_model.hpp"
#include "tribode/machine/machine_model.hpp"
#include "tribode/record/table.hpp"

#include <array>
#include <complex>
#include <cstdint>
#include <filesystem>
#include <optional>
#include <string>
#include <utility>
#include <vector>

namespace tribode {

// The three frequency-response analyses of the paper, in its order: what stands for the input of the plant, with
// y the detected position, fh the friction model driven by y, C the delay model.
//   FRA-1     u          eqs. (2), (3)
//   FRA-2     u - fh     eqs. (4)-(7), observer form (Fig. 7)
//   Proposed  C u - fh   eqs. (8)-(10)
//
// A further one, "Improved", is made on request (docs/open-question.md): phasors in the time of the driven point, Y_n of
// the n-th harmonic of y, U of u, w = 2 pi f,
//
//     Improved  X_1 / (A U - F),   X_n = Y_n exp(j n w output_delay),   F = friction_phasor(X)
//     A = sinc(f Ts) exp(-j w (Ts/2 + input_delay)) / (1 + j f/current_loop_hz)
//
// with hold, delays and thrust lag as the machine describes them, instead of C, and the friction between the samples.
// The images of the hold that fold onto f are left: (f Ts/(1 - f Ts))^3 of the response of a mass, and less by the lag.
//
// Where friction is really fed back (friction_feedback p > 0; docs/friction-compensation.md), "Add-on" is FRA-2 as the
// paper's Fig. 6 has it, from the thrust before the feedback is added: y / (u - p fh). At p = 1 it is the same as
// "FRA-2" of this sweep.
constexpr std::size_t analysis_count = 3;
inline const std::array<std::string, analysis_count> analysis_names = {"FRA-1", "FRA-2", "Proposed"};

struct SweepOptions {
    std::vector<double> frequency_hz; // ascending, up to 0.45 of the sampling rate
    double amplitude = 15;            // A of the excitation A sin(2 pi f t), added to the controller's output [N]
    std::vector<double> amplitudes;   // at each frequency, in the place of that [N]
    // What the axis is moved along by the reference, so that it sticks seldom or never: r = v t, or A (1 - cos(2 pi fc t)) with fc
    // up to a fifth from carrier_hz, so that 2 f is an odd multiple: what friction makes of the carrier is not at f then.
    double bias_velocity = 0;     // v [m/s]
    double carrier_amplitude = 0; // A [m]
    double carrier_hz = 0.5;
    // Settling: after settle_periods and settle_time, whichever is later, the phasors of u and y over two windows in
    // a row must agree within settle_tolerance; given up after settle_time_limit.
    double settle_periods = 5;
    double settle_time = 0.5;       // [s]
    double settle_tolerance = 2e-3; // relative
    double settle_time_limit = 5;   // [s]
    long measure_periods = 10;      // at least
    double measure_time = 0.1;      // [s], at least; rounded up to whole periods
    int harmonics = 5;              // fitted, for the distortion
    std::optional<double> delay;    // L of the delay model C [s]; none: loop_dead_time() of the machine
    int delay_order = 4;            // of its Pade approximant, eq. (19)
    bool improved = false;          // make the analysis "Improved" too
    double friction_feedback = 0;   // p: share of the modeled friction that is added to u (ClosedLoop)
    // fh of the analyses, not of the feedback; none: the machine's own
    std::optional<FrictionModel> friction_model;
    // An encoder step is 1e-7 m; tighter tolerances do not show in the responses (docs/decisions/0005).
    SolverOptions solver{.relative_tolerance = 1e-6, .absolute_tolerance = 1e-10};
    std::uint64_t seed = 0; // of the noise; every frequency has noise of its own

    static void describe(auto& o, auto& fields) {
        fields.numbers("frequency_hz", o.frequency_hz, "Hz", Allowed::positive, 1'000'000,
                       "ascending, up to 0.45 of the sampling rate");
        fields.number("amplitude_N", o.amplitude, "N", Allowed::positive,
                      "of the excitation A sin 2πft, added to the controller's output");
        fields.numbers("amplitudes_N", o.amplitudes, "N", Allowed::positive, 1'000'000,
                       "one for each frequency, in the place of `amplitude_N`");
        fields.number("bias_velocity_m_per_s", o.bias_velocity, "m/s", Allowed::finite,
                      "velocity at which the reference moves the axis meanwhile, so that it does not reverse "
                      "([how](how-to/sweep-with-bias-velocity.md))");
        fields.number("carrier_amplitude_m", o.carrier_amplitude, "m", Allowed::non_negative,
                      "of a slow sine of the reference, along which the axis moves meanwhile");
        fields.number("carrier_hz", o.carrier_hz, "Hz", Allowed::positive,
                      "its frequency, at most half of the lowest one of the sweep. It is changed a little with each "
                      "frequency, so that no harmonic of the carrier meets it");
        fields.number("settle_periods", o.settle_periods, "", Allowed::non_negative, "minimum settling, in periods");
        fields.number("settle_time_s", o.settle_time, "s", Allowed::non_negative, "minimum settling time");
        fields.number("settle_tolerance", o.settle_tolerance, "", Allowed::positive,
                      "settled when the phasors of u and y of two consecutive windows agree within this, relative");
        fields.number("settle_time_limit_s", o.settle_time_limit, "s", Allowed::positive, "maximum settling time");
        fields.integer("measure_periods", o.measure_periods, 2, 1'000'000, "minimum length of the measured window");
        fields.number("measure_time_s", o.measure_time, "s", Allowed::non_negative,
                      "the same as a time, rounded up to whole periods");
        fields.integer("harmonics", o.harmonics, 1, 50,
                       "number of fitted harmonics, including the fundamental, for the distortion and for the motion "
                       "that drives the friction of `\"Improved\"`");
        fields.number(
            "delay_s", o.delay, "s", Allowed::non_negative,
            "dead time of the delay model C_dly; default: half a sample of hold, the delays and the thrust lag of "
            "the machine");
        fields.integer("delay_order", o.delay_order, 1, 10, "order of its Padé approximant, eq. (19)");
        fields.flag("improved", o.improved,
                    "adds the analysis `\"Improved\"`, with hold, delays and thrust lag of the machine description "
                    "instead of C_dly, and with friction between the samples ([open question](open-question.md))");
        fields.number("friction_feedback", o.friction_feedback, "", Allowed::non_negative,
                      "share of the modeled friction that is added to u ([how](friction-compensation.md)); if "
                      "positive, adds the analysis `\"Add-on\"`, FRA-2 in the form of Fig. 6");
        fields.table("friction_model", o.friction_model,
                     "`{ elements = {…}, viscous = 0 }` as in a machine description [N, N/m, N s/m]: the friction that "
                     "the analyses assume and `friction_feedback` adds; default the machine's own");
        fields.integer("seed", o.seed, 0, 1L << 53, "of the noise; each frequency has noise of its own");
        SolverOptions::describe(o.solver, fields);
    }
};

// One frequency of a sweep, measured over a whole number of periods.
struct SweepPoint {
    double frequency_hz = 0;
    std::array<std::complex<double>, analysis_count> response{}; // y over each input [m/N]
    std::array<double, analysis_count> coherence{};
    std::optional<std::complex<double>> improved; // where it was asked for [m/N]
    std::optional<std::complex<double>> add_on;   // where friction is fed back [m/N]
    std::complex<double> loop_gain;               // L = A/U - 1: what comes back as -L of the thrust sent out
    std::complex<double> thrust;                  // phasor of u [N]: what the loop made of the excitation
    std::complex<double> position;                // phasor of y [m]
    double thrust_distortion = 0;                 // total harmonic distortion of u
    double position_distortion = 0;               // of y
    double settling_time = 0;                     // from the start to the measured window [s]
    bool settled = false;
    RunOutcome outcome;
    RunStatistics statistics;
};

struct SweepResult {
    std::vector<SweepPoint> points; // of every frequency, in order; fewer where the sweep was interrupted
    bool complete = false;
    bool with_improved = false, with_add_on = false; // whether these analyses were asked for

    FrequencyResponse response(std::size_t analysis) const; // of the points that ended well
    FrequencyResponse improved() const;                     // empty where it was not asked for
    FrequencyResponse add_on() const;                       // empty where no friction is fed back
    // Those that were asked for, by their names, in the order of the paper.
    std::vector<std::pair<std::string, FrequencyResponse>> responses() const;
    // Loop gain L of the closed loop, opened at u, at the amplitude each frequency had: with A the phasor of the
    // excitation and U that of u, U = A/(1 + L).
    FrequencyResponse loop_gain() const;
    Table table() const; // one row per point; units in the names
    RunStatistics statistics() const;
    std::vector<std::string> warnings() const; // points that failed or did not settle
};

// Sine sweep in closed loop, section II-C: at each frequency the axis starts from rest, r = 0. The friction model and
// the delay model run at the controller's sample time; the friction model has the machine's elements and viscous
// friction, where the options hold no other. Frequencies are independent and shared among control.workers; the result does not depend on how many.
//
// Where `checkpoint` is not empty, points that are done are kept there now and then and when the sweep is
// interrupted; a later sweep of the same machine and options goes on from it. A sweep that is complete removes it.
// Throws InputError where options or machine do not fit.
SweepResult run_sweep(const MachineModel& machine, const SweepOptions& options, const RunControl& control = {},
                      const std::filesystem::path& checkpoint = {});

// The linear dynamics P_l of the machine, eq. (1): what an analysis should find.
ModalModel modal_model_of(const MachineModel& machine);

// The signals of one frequency over the last periods before the end (Fig. 11).
struct SweepSignals {
    ServoTrace trace;                      // t from the first sample shown [s]
    std::vector<double> delayed_thrust;    // C u [N]
    std::vector<double> friction_estimate; // fh [N]
    std::vector<double> effective_thrust;  // C u - fh [N]
};

SweepSignals run_single_frequency(const MachineModel& machine, const SweepOptions& options, double frequency_hz,
                                  long periods_shown, const RunControl& control = {});

} // namespace tribode
