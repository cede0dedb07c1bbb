#pragma once
#include "tribode/analysis/measured_response.hpp"
#include "tribode/analysis/weighted_modal_fit.hpp"
#include "tribode/base/options.hpp"
#include "tribode/base/run_control.hpp"
#include "tribode/experiment/friction_map.hpp"
#include "tribode/machine/machine_model.hpp"
#include "tribode/record/given_record.hpp"
#include "tribode/record/run_folder.hpp"
#include "tribode/record/table.hpp"

#include <array>
#include <optional>
#include <string>
#include <vector>

namespace tribode {

// The analyses of measured records, docs/measured-frequency-response.md. Of each, what stands for the input of the plant:
//   fra1      u                                  thrust to position
//   fra2      u - fh                             with the friction model fh, driven by the measured position
//   proposed  C u - fh                           and the delay model C
//   improved  A u - fh                           with hold, dead times and thrust lag as they are: gain and phase. Of single
//                                                sines A U - F of frequency_sweep.hpp, where friction is not dry
//   bla       u, best linear approximation       multisines and other periodic or broadband excitation
inline const std::vector<std::string> fra_methods = {"fra1", "fra2", "proposed", "improved", "bla"};
// As reports call it: FRA-1, FRA-2, Proposed, Improved, BLA.
std::string title_of_method(const std::string& method);

struct MeasuredFraOptions {
    std::vector<std::string> methods = {"fra1", "fra2", "proposed", "improved"};
    std::optional<double> delay; // of the delay model C [s]; none: half a sample of hold, delays and lag of the machine
    int delay_order = 4;
    SineOptions sine;
    std::optional<int> modes; // of the fits; none: as many as the machine has
    // Band of the fits; none: 0.01 to 0.1 of the sampling rate, as in the paper, or all where too few frequencies lie there.
    std::optional<double> fit_min_hz, fit_max_hz;

    static void describe(auto& o, auto& fields) {
        fields.choices("methods", o.methods, fra_methods, "[the analyses](measured-frequency-response.md)");
        fields.number("delay_s", o.delay, "s", Allowed::non_negative,
                      "dead time of the delay model; default: half a sample of hold, delays and lag of the machine");
        fields.integer("delay_order", o.delay_order, 1, 10, "order of its Padé approximant");
        fields.integer("harmonics", o.sine.harmonics, 1, 50, "number of fitted harmonics of single sines");
        fields.integer("periods", o.sine.periods, 0, 1'000'000'000,
                       "the last periods of each single sine that are used; 0: all that have settled");
        fields.flag("keep_transients", o.sine.keep_transients, "do not remove transients from single sines");
        fields.integer("modes", o.modes, 0, 20, "modes of the fitted model; default: as many as the machine has");
        fields.number("fit_min_hz", o.fit_min_hz, "Hz", Allowed::non_negative,
                      "lower end of the band of the fit; default: 0.01 of the sampling rate");
        fields.number("fit_max_hz", o.fit_max_hz, "Hz", Allowed::positive,
                      "upper end of the band of the fit; default: 0.1 of the sampling rate");
    }
};

// What the command line, Lua and Python ask for.
struct FraRequest {
    MachineModel machine;
    std::vector<GivenRecord> records;
    RecordOptions columns; // of records that are files
    MeasuredFraOptions options;
};

struct MeasuredAnalysis {
    std::string method;
    std::vector<MeasuredPoint> points; // by ascending frequency
    std::optional<WeightedFit> fit;
};

struct MeasuredFra {
    std::vector<MeasuredAnalysis> analyses;
    std::vector<std::string> records; // what each of them is: a sentence
    std::vector<std::string> notes;   // what was left out or should be known: sentences
    double delay = 0;                 // of the delay model [s]
    // What the fitted model, of Improved or else Proposed, leaves of the thrust for friction; empty without a fit.
    std::vector<MeasuredLoop> loops;      // of single sines, some of the frequencies
    std::vector<ForceResidual> residuals; // of each record

    const MeasuredAnalysis* find(const std::string& method) const;
    std::string csv() const;  // response.csv
    Json fits() const;        // fit.json
    std::string text() const; // a summary for people
};

// The frequency responses that records with the columns t, u, y and, where the loop was closed, r or exc hold. The excitation
// is exc; else what u has besides the output of the machine's controller on r and y, where r changes if that is more than a fifth
// of u; else r; else u. Several records are
// repetitions, or other frequencies; they must be all periodic (sines, multisines) or all not.
//
// Throws InputError, one sentence that begins with the record's source: a column that is missing, another sample time, a
// record that is too short or shorter than the delay, without excitation or motion, clipped, with most of its excitation above
// 0.45 of the sampling rate, with the samples of another record, a multisine without whole periods.
MeasuredFra measure_fra(const MachineModel& machine, const std::vector<Table>& records,
                        const MeasuredFraOptions& options);

// The same of a request, whose records are read first.
MeasuredFra measure_fra(const FraRequest& request);

// The columns that it can use: t, r, exc, u, y.
const std::vector<std::string>& fra_columns();

// response.csv, fit.json, report.html, bode.png, distortion.png, uncertainty.png, settling.png, loops.png, residual.png: the last
// ones where there is what they show.
void write_measured_fra(const MeasuredFra& fra, RunFolder& folder, const RunControl& control = {});

} // namespace tribode
