#pragma once
#include "tribode/base/run_control.hpp"
#include "tribode/diagnosis/model_fit.hpp"

#include <memory>
#include <string>
#include <vector>

namespace tribode {

// A hypothesis with its score on all records: those to fit and those kept out of the fit. It is ranked by numbers that
// suit all of them together, as a poor record leaves numbers uncertain and a rich one tells names apart; the proof is made
// with numbers fitted to the first kind alone.
struct Scored {
    Hypothesis together;                               // numbers that suit all records
    double together_fitted = 0, together_kept_out = 0; // chi square per sample: 1 where noise is all that is left
    double score = 0;                // chi square of all records, and the penalty of the numbers that were free
    Hypothesis hypothesis;           // numbers of the fitted records
    double fitted = 0, kept_out = 0; // chi square per sample with these: the latter is foretold by the fit

    std::vector<std::string> names() const;
};

struct SearchResult {
    Scored baseline;             // no effect added; uncertain fields fitted
    std::vector<Scored> ranking; // the best hypotheses with effects, best first, at the level at which the search ended
    std::vector<Scored> steps;   // the best one with one effect, with two, ...: how the gap shrank
    std::vector<Evidence> fitted, kept_out; // floors as those of the best hypothesis

    bool shared = false; // the first half of what was kept out had to be fitted too

    // Chi square per sample up to which noise explains what is left of some records.
    static double limit(const std::vector<Evidence>& records);
    bool explained_by_noise(const Scored& one) const;
    // Part of a sentence, for a search that is ended early: what is left without an effect, with one, with two.
    std::string found_so_far() const;
};

// Looks for the effects that a machine lacks: all of them one at a time by full simulation, the best ones refined, and
// as long as more than noise is left another one on top of the best three. Throws EndedEarly on a stop request.
SearchResult search_effects(const MachineModel& machine, std::vector<Evidence> fitted, std::vector<Evidence> kept_out,
                            std::size_t max_effects, const RunControl& control);

} // namespace tribode
