#pragma once
#include "base/run_control.hpp"
#include "diagnosis/model_fit.hpp"

#include <memory>
#include <string>
#include <vector>

namespace tribode {

// A hypothesis with its score on all records: those it was fitted to and those kept out of the fit.
struct Scored {
    Hypothesis hypothesis;
    double fitted = 0;   // chi square per sample on the fitted records: 1 where noise is all that is left
    double kept_out = 0; // likewise on the records kept out, as the fit foretells them
    // Likewise with numbers that suit all records together. A poor record leaves them uncertain, and then a rich one
    // lies beyond what the fit foretold though nothing is missing.
    double together_fitted = 0, together_kept_out = 0;
    double score = 0; // chi square of all records with those numbers, and the penalty of the numbers that were free

    std::vector<std::string> names() const;
};

struct SearchResult {
    Scored baseline;             // no effect added; uncertain fields fitted
    std::vector<Scored> ranking; // the best hypotheses with effects, best first, at the level at which the search ended
    std::vector<Scored> steps;   // the best one with one effect, with two, ...: how the gap shrank
    std::vector<Evidence> fitted, kept_out; // floors as those of the best hypothesis

    // Chi square per sample up to which noise explains what is left of some records.
    static double limit(const std::vector<Evidence>& records);
    bool explained_by_noise(const Scored& one) const;
};

// Looks for the effects that a machine lacks: all of them one at a time by full simulation, the best ones refined, and
// as long as more than noise is left another one on top of the best three.
SearchResult search_effects(const MachineModel& machine, std::vector<Evidence> fitted, std::vector<Evidence> kept_out,
                            std::size_t max_effects, const RunControl& control);

} // namespace tribode
