#pragma once
#include "tribode/base/run_control.hpp"
#include "tribode/diagnosis/gap.hpp"
#include "tribode/diagnosis/next_experiment.hpp"
#include "tribode/diagnosis/search.hpp"

#include <optional>
#include <string>
#include <vector>

namespace tribode {

struct DiagnosisOptions {
    std::size_t max_effects = 3;
    std::optional<double> budget; // after so long what is known is the answer [s]; none: searches to the end

    static void describe(auto& o, auto& fields) {
        fields.integer("max_effects", o.max_effects, 1, 6, "how many effects may be missing together");
        fields.number("budget_s", o.budget, "s", Allowed::positive,
                      "after so long what is known is the answer; default: no limit");
    }
};

struct Rival {
    std::string name;
    double probability;
};

struct NamedEffect {
    std::string name;
    Json parameters, standard_errors; // as in the machine description; errors of the fitted parameters
    double probability = 0;
    std::vector<Rival> rivals; // alternatives to this one effect, the others being as they are
    std::string evidence;      // one paragraph
    bool is_open = false;      // not decided between it and its rivals
};

// One record, measured and simulated.
struct Compared {
    Measurement measurement;
    std::vector<double> y_before, u_before, y_after, u_after; // [m], [N]
    Gap gap;
    double described_floor = 0; // what noise and rounding of the machine as described would leave [m]
    std::size_t first = 0;      // first sample of those that count

    std::size_t samples() const { return measurement.size() - first; }
};

struct Diagnosis {
    std::string verdict;              // effect_found, partial, nothing_missing, unknown_effect or undecided
    std::vector<NamedEffect> effects; // the strongest first, which the verdict is of; others may be open
    std::string where;                // one paragraph
    Gap fitted_gap, validation_gap;
    std::vector<Compared> fitted, validation;
    struct Nearest {
        std::string name;
        double share; // of the rms of the whitened gap
    };
    std::optional<Nearest> nearest;
    // Fields that explain all, or all that the effects leave, if they are farther off than their tolerances let them be. The
    // machine after has them.
    struct Field {
        std::string name;
        double deviations; // from what the machine says, in its tolerance
    };
    std::vector<Field> fields_off;
    std::optional<NextExperiment> next_experiment;
    MachineModel before, after; // the machine as described, fields within their tolerance; with the effects
    SearchResult search;
    double explained = 0;         // share of the squared gap on the validation record
    double false_alarm_limit = 0; // chi square per sample above which something is missing
};

// Finds where a machine and its measured records disagree and which effect it lacks. `validation`: a record that is not
// fitted; without it the last third of the first record is used. Throws InputError where a record and the machine have
// nothing to do with each other, EndedEarly with what is known so far on a stop request.
Diagnosis diagnose(const MachineModel& machine, std::vector<Measurement> fitted, std::optional<Measurement> validation,
                   const DiagnosisOptions& options, const RunControl& control);

} // namespace tribode
