#pragma once
#include "tribode/base/options.hpp"
#include "tribode/base/run_control.hpp"
#include "tribode/diagnosis/system_comparison.hpp"
#include "tribode/diagnosis/system_next_experiment.hpp"

#include <algorithm>
#include <optional>
#include <string>
#include <utility>
#include <vector>

namespace tribode {

struct SystemDiagnosisOptions {
    std::size_t max_effects = 3; // kinds of terms; 0: the model is fitted and compared, nothing is sought
    double budget = 300;         // processor time of each worker after which what is known is the answer [s]

    static void describe(auto& o, auto& fields) {
        fields.integer("max_effects", o.max_effects, 0, 6, "how many kinds of terms may be missing together");
        fields.number("budget_s", o.budget, "s", Allowed::positive,
                      "processor time of each thread after which what is known is the answer");
    }
};

// A model with terms that was fitted. rms of its errors over the fitted part of the records and over the rest, which it
// predicted, relative to the standard deviation of the outputs.
struct SystemHypothesis {
    std::vector<std::string> names; // of all its terms, the new ones last
    std::size_t before = 0;         // of these, how many the model had that it was tried beside
    double score = 0;               // rms that it promises on other records
    double fitted = 0, predicted = 0;
    std::string lost; // why it lost; empty: it was taken
};

struct SystemEffect {
    std::string name, equation, expression;
    std::vector<std::string> parameters, units; // names in the equations; units, where they are known
    std::vector<double> values, standard_errors;
    double probability = 0;
    std::vector<std::pair<std::string, double>> rivals; // kind of term, probability
    std::vector<std::string> same_as;                   // kinds of terms that are the same in other words
    bool is_open = false;                               // not decided: less likely than something else, or chance
    std::string evidence;

    // Of an open one: that it is none of these, but forces at random or something that the library lacks.
    double probability_of_none() const {
        double rest = is_open ? 1 - probability : 0;
        for (const auto& rival : rivals) rest -= is_open ? rival.second : 0;
        return std::max(rest, 0.0);
    }
};

// What is left of the gap on the validation records without the effects that are open: nothing is open; at most three times the noise;
// less than half of the squared gap; more.
enum class OpenRest { none, little, less_than_half, most };

struct FittedValue {
    std::string name, unit;
    double value = 0, standard_error = 0;
};

struct SystemDiagnosis {
    std::string verdict; // effect_found, partial, nothing_missing, unknown_effect or undecided
    std::vector<SystemEffect> effects;
    std::string where; // one paragraph
    SystemModel before, after;
    std::vector<FittedValue> free; // parameters of the model as it was given, fitted along with the effects
    std::vector<SystemComparison> fitted, validation;
    Gap fitted_gap, validation_gap;
    // What noise lets the prediction of the validation records be off through the values that were fitted, rms, in the unit
    // of the gap.
    double prediction_uncertainty = 0;
    OpenRest open_rest = OpenRest::none;
    double explained = 0;                                  // share of the squared gap on the validation records
    std::optional<std::pair<std::string, double>> nearest; // what came nearest without being found, share of the gap
    std::optional<SystemExperiment> next_experiment;       // where rivals were not told apart
    std::vector<SystemHypothesis> hypotheses;
    Interpolation interpolation = Interpolation::hold;
    bool out_of_time = false;
    std::vector<std::string> remarks; // what was done to the records before, a sentence each
};

// Finds which terms a system lacks. Terms of a library (system_terms.hpp) are screened by their effect on the outputs, one by
// one and in pairs; the likeliest are fitted with all free values to a part of the records, and judged by how well
// they predict the rest. What is found is fitted to the whole records and simulated freely on the validation records, which
// take no part in the search: an effect that does not predict them better is not found, and where more than noise is left they
// choose among the few likeliest. `validation`: without any, the last
// third of the first record.
// Throws InputError where the model cannot be simulated on a record, EndedEarly on a stop request.
SystemDiagnosis diagnose_system(const SystemModel& model, std::vector<SystemRecord> records,
                                std::vector<SystemRecord> validation, const SystemDiagnosisOptions& options,
                                const RunControl& control);

} // namespace tribode
