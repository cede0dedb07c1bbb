#pragma once
#include "tribode/diagnosis/system_search.hpp"

#include <map>
#include <optional>
#include <set>
#include <string>
#include <utility>
#include <vector>

namespace tribode {

// How sure it must be that a term predicts better. Of many hypotheses some are by chance: so each step must be as sure again
// on the validation records, which chose nothing.
constexpr double sure_enough = 0.95;
constexpr double convincing = 4;  // evidence with which half of the names are right
constexpr double min_gain = 0.03; // of the rms of a prediction, for a term to be worth having

// By how much errors decrease, as a share of their rms, and with which probability they do.
struct Improvement {
    double share = 0, certainty = 0;
    bool passes() const { return share > min_gain && certainty > sure_enough; }
};

// Of a candidate over the current model, in what was not fitted in the search.
Improvement improvement_of(const SystemCandidate& candidate, const SystemCandidate& current);

// A new term of a step: how likely it is among all that passed, and what passed without it.
struct WeighedTerm {
    double probability = 1;
    std::vector<std::pair<std::string, double>> rivals = {};
};

// A model on the way from the first one to the last, each with more terms.
struct SystemStep {
    SystemCandidate candidate;
    std::size_t before = 0;                          // how many of its terms were there before
    std::map<std::string, WeighedTerm> weighed = {}; // of each kind that is new
    std::vector<std::string> same_as = {};
    std::vector<SystemCandidate> contenders = {}; // the one taken and the likeliest that lack a term of it
    double gain = 0, certainty = 0;
    double confirmed = 1; // probability that it predicts the validation records better
    double evidence = 0;  // that the records give for it
    // Its errors there, and on the fitted records, after a fit to all of these.
    std::vector<double> on_validation = {}, on_fitted = {};
    std::size_t compared_with = 0; // others, of which it predicts the validation records best; 0: it was not compared
    // What was fitted beside its terms, and the place of each among the hypotheses that are told.
    std::optional<std::vector<SystemCandidate>> tried = {};
    std::vector<std::size_t> told = {};

    // `current`: the model of the step before. `found`, `passed`: what was tried, and which of these may be taken, the likeliest first.
    // `scores`: of each found one, its error. `independent`: how many errors count.
    // Probabilities by the likelihood of the errors: that of a term is the share of all hypotheses that have it. The likeliest that lack
    // it become its rivals.
    void weigh(const SystemCandidate& current, const std::vector<SystemCandidate>& found,
               const std::vector<std::size_t>& passed, std::size_t chosen, const std::vector<double>& scores,
               double independent, const SystemErrors& errors);
};

// How much more of the errors a step explains than further parameters do by chance: above 1 the Bayesian information criterion
// [Schwarz 1978] prefers it, with a price for the choice among `hypotheses` [Chen 2008].
// Fitted values follow what random forces did on the fitted records: an error there counts no more than one of the validation records.
double evidence(const SystemStep& before, const SystemStep& after, const Stretches& stretches, std::size_t hypotheses);
// The same of any gain: twice the logarithm of a likelihood ratio, of so many errors, by so many further parameters.
double evidence(double gain, std::size_t errors, double parameters, std::size_t hypotheses);

// Of those that do about as well as the best, the one with the fewest parameters, and of these one that has a name; where
// noise decides, the best, whose score has the price of its parameters. What has some of the terms of the best, and predicts no worse
// for sure, does as well: each further term must be as sure as the first. So does what leaves little more than noise where the best
// is not much likelier for the price of its further parameters: that may be what random forces did. `passed`: the best score first.
std::optional<std::size_t> simplest(const std::vector<SystemCandidate>& found, const std::vector<std::size_t>& passed,
                                    const SystemErrors& errors);

// By which the score of a model is worse than that of one whose terms all have names, for the same probability.
double price_of_names(const SystemCandidate& candidate, double independent_errors);

double independent_errors(const SystemCandidate& candidate); // how many of all that it was fitted to or predicts

// How many of its first terms those of the current model are: others may have been exchanged, and what was new came behind.
std::size_t kept_of(const SystemCandidate& candidate, const SystemCandidate& current);

// Kinds of its terms: in their order, and as a set from a term on.
std::vector<std::string> kinds_of(const SystemCandidate& candidate);
std::set<std::string> kinds_from(const SystemCandidate& candidate, std::size_t begin);

} // namespace tribode
