#pragma once
#include "tribode/base/run_control.hpp"
#include "tribode/diagnosis/model_fit.hpp"

#include <chrono>
#include <limits>
#include <memory>
#include <string>
#include <vector>

namespace tribode {

// A hypothesis with its score on all records: the fitted ones and the validation records. It is ranked with parameters
// fitted to all of them together, since a poor record leaves parameters uncertain and a rich one tells names apart. It
// is validated with parameters fitted to the first kind alone.
struct Scored {
    Hypothesis together;                                 // parameters fitted to all records
    double together_fitted = 0, together_validation = 0; // chi square per sample: 1 where only noise remains
    double score = 0;                  // chi square of all records, plus the penalty of the free parameters
    Hypothesis hypothesis;             // parameters of the fitted records
    double fitted = 0, validation = 0; // chi square per sample with these: the latter is predicted
    // By how many standard deviations it predicts what is left out worse than the first of its ranking; infinite where it was not compared.
    double behind = std::numeric_limits<double>::infinity();

    std::vector<std::string> names() const;
    // Whether the other one is a special case of this one: it lacks one of the effects, or has simpler kinds in its place or
    // beside a form of it with fewer parameters.
    bool contains(const Scored& other) const;
    // The same of the effects alone, however many parameters the other one has.
    bool covers(const Scored& other) const;
};

struct SearchResult {
    Scored baseline;             // no effect added; uncertain fields fitted
    std::vector<Scored> ranking; // the best hypotheses with effects, best first, at the level at which the search ended
    std::vector<Scored> steps;   // the best one with one effect, with two, ...: how the gap shrank
    std::vector<Evidence> fitted, validation; // floors as those of the best hypothesis

    bool out_of_time = false; // the deadline ended it

    bool shared = false; // the first half of the validation records had to be fitted too

    // Chi square per sample up to which noise explains the remaining errors of some records.
    static double limit(const std::vector<Evidence>& records);
    bool explained_by_noise(const Scored& one) const;
    // Part of a sentence, for a search that is ended early: the remaining error without an effect, with one, with two.
    std::string found_so_far() const;
};

// Looks for the effects that a machine lacks: tries all of them one at a time by full simulation, refines the best, and
// while more than noise remains adds another one to the best three. At the deadline it returns what is known. Throws
// EndedEarly on a stop request.
SearchResult search_effects(const MachineModel& machine, std::vector<Evidence> fitted, std::vector<Evidence> validation,
                            std::size_t max_effects, std::chrono::steady_clock::time_point deadline,
                            const RunControl& control);

} // namespace tribode
