#pragma once
#include "tribode/base/json.hpp"
#include "tribode/base/options.hpp"
#include "tribode/base/run_control.hpp"
#include "tribode/machine/machine_model.hpp"
#include "tribode/record/given_record.hpp"
#include "tribode/record/run_folder.hpp"

#include <limits>
#include <string>
#include <vector>

namespace tribode {

// Joint estimation of the parameters of a machine from records of any kind: friction, modes, mass and delays at once, by the
// output error. The machine is simulated without noise and rounding, and what the detected position has besides the simulated one is the
// residual e. A record with u is simulated under u, with a slow controller that keeps the simulated position near the measured
// one (an observer): so u makes the axis reverse where it did, noise of encoder and controller included, and neither the controller
// of the drive nor what excited it need be known. A record without u is simulated in closed loop under r and exc.
//
// In the frequency domain, of the differences of e from sample to sample (so that drift and unequal ends stay at low
// frequencies), the fit minimizes
//
//     V = sum over records and bands of n ln(mean of abs(E)^2)
//
// over disjoint bands of n lines: the maximum likelihood for Gaussian residuals with a spectrum that is unknown and constant in
// each band. So frequencies at which friction or noise leave much weigh little, and nothing need be known of the noise.
struct IdentifyOptions {
    // Paths: of a number, "modes[1].freq_hz"; of a table or list, "modes" or "friction", for all numbers in it that are not zero;
    // [*] for every entry. An element of friction is one parameter, its level F with 2F/K fixed, unless its F or K is named.
    // The sum of the shares of gms_friction stays 1: those that are not named take up the rest, or the last one of all.
    // Empty: rigid gain, modes, friction without exponents (transition) and shares, and the input delay.
    std::vector<std::string> parameters;
    double f_min = 0;    // lines below do not count [Hz]
    double f_max = 0;    // lines above do not count [Hz]; 0: all do
    double band = 0.1;   // width of a band relative to its frequency
    double observer = 2; // bandwidth of the slow controller [Hz]; 0: none, u as an open loop
    int iterations = 40;
    int simulations = 0; // of a record, after which no iteration begins; 0: no limit

    static void describe(auto& o, auto& fields) {
        fields.texts("parameters", o.parameters,
                     "[paths](batch-analysis.md#fields-of-a-machine) of what is fitted; empty: rigid gain, modes, "
                     "friction and input delay, where they are "
                     "not zero");
        fields.number("f_min_hz", o.f_min, "Hz", Allowed::non_negative, "frequencies below do not count");
        fields.number("f_max_hz", o.f_max, "Hz", Allowed::non_negative,
                      "frequencies above do not count; 0: up to half the sampling rate");
        fields.number("band", o.band, "", Allowed::positive,
                      "relative width of the bands in which the spectrum of the residual is taken for constant");
        fields.number(
            "observer_hz", o.observer, "Hz", Allowed::non_negative,
            "bandwidth with which the simulated position follows the measured one where the record has u; 0: not");
        fields.integer("iterations", o.iterations, 0, 1000,
                       "at most, of the Gauss-Newton method; 0: only residuals and objective of the machine as it is");
        fields.integer("simulations", o.simulations, 0, 1000000,
                       "no iteration begins after so many simulations of a record; 0: no limit");
    }
};

struct IdentifiedParameter {
    std::string name; // its path; of a whole element "friction.elements[3]", with its level as value
    std::string unit;
    double start = 0, value = 0;
    double standard_error = std::numeric_limits<double>::infinity(); // stays so where the records do not determine it
};

struct Identification {
    MachineModel machine;
    std::vector<IdentifiedParameter> parameters;
    // Of the parameters in their order. Rows and columns of those that are not determined are zero. Empty without an iteration.
    std::vector<std::vector<double>> covariance;
    std::vector<std::vector<double>> residuals; // of each record: measured less simulated position [m]
    // How many times larger the standard errors are than they would be if the residual was noise that is independent from line
    // to line: about one where the model is right.
    double excess = 1;
    double objective =
        0; // V. Of two structures the one with more parameters is better if it lowers V by more than two for each
    int iterations = 0;
    long simulations = 0; // of a record
    bool converged = false;
    std::vector<std::string> notes; // sentences

    std::vector<double> residual_rms() const; // of each record [m]
    // All but the residuals themselves; an error that is infinite is null there.
    Json json() const;
    std::string text() const; // a summary for people
};

// The machine's numbers are the start. Its noise and encoder resolution are kept, and not used.
//
// Covariance: H^-1 B H^-1 with the Hessian H of V and the covariance B of its gradient, which is summed over single lines, over
// bands, or taken for H, whichever makes the error of a parameter largest. So what a wrong model leaves counts as an error, with its
// correlation over neighboring frequencies and over repetitions in a record; but what is the same at all frequencies
// cannot be seen.
//
// Throws InputError where a record lacks y or an input, or the machine has no number of a path, or runs away at the start.
Identification identify(const MachineModel& machine, const std::vector<GivenRecord>& records,
                        const RecordOptions& columns, const IdentifyOptions& options, const RunControl& control = {});

// machine.json, which all commands read, identify.json, parameters.csv, and residual.png with the spectra of the residuals.
void write_identification(const Identification& found, RunFolder& folder, const RunControl& control = {});

} // namespace tribode
