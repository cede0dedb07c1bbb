#include "tribode/diagnosis/system_step.hpp"

#include <algorithm>
#include <cmath>
#include <functional>
#include <limits>

namespace tribode {

namespace {

constexpr double as_good = 1.02;    // of the best score: then the simplest is taken
constexpr double about_noise = 1.7; // of the noise: a random force as large as that, and some more
constexpr double min_rival = 0.05;  // probability worth showing
constexpr double named_odds = 10; // how much likelier beforehand a term with a name is than one of a form that has none
constexpr std::size_t max_rivals = 5;
constexpr std::size_t max_told_apart = 3; // rivals, by the next experiment

std::set<std::string> new_kinds(const SystemCandidate& candidate, const SystemCandidate& current) {
    return kinds_from(candidate, kept_of(candidate, current));
}

// That a model with more parameters has for these; infinite where it has no more, or where the other one leaves more than a random
// force that is no larger than the noise.
double evidence_for_further(const SystemCandidate& less, const SystemCandidate& more, const SystemErrors& errors) {
    const bool leaves_little = rms_of_errors(less.fitted) < about_noise * errors.noise;
    if (more.model.parameters.size() <= less.model.parameters.size() || !leaves_little) {
        return std::numeric_limits<double>::infinity();
    }
    const Stretches& stretches = errors.stretches;
    const auto further = static_cast<double>(more.model.parameters.size() - less.model.parameters.size());
    const double gain = likelihood_gain(less.fitted, more.fitted, stretches.fitted) +
                        likelihood_gain(less.predicted, more.predicted, stretches.predicted);
    return evidence(gain, more.fitted.size() + more.predicted.size(), further, more.library);
}

std::size_t nameless_of(const SystemCandidate& one) {
    return static_cast<std::size_t>(
        std::ranges::count(one.terms, std::string_view(nameless_term), [](const auto& term) { return term.name; }));
}

// Where both have as many parameters: whether what the second one explains more does not outweigh that the first one has names.
bool has_likelier_names(const SystemCandidate& one, const SystemCandidate& other, const SystemErrors& errors) {
    const auto more = nameless_of(other), less = nameless_of(one);
    if (one.model.parameters.size() != other.model.parameters.size() || less >= more) return false;
    const double gain = likelihood_gain(one.fitted, other.fitted, errors.stretches.fitted) +
                        likelihood_gain(one.predicted, other.predicted, errors.stretches.predicted);
    return gain < 2 * static_cast<double>(more - less) * std::log(named_odds);
}

// Less is plainer: a constant is a constant, though the dead zone of an input that never crosses it is the same.
std::size_t plainness(const SystemCandidate& one) {
    std::size_t sum = 0;
    for (const auto& term : one.terms) {
        const bool is_constant = term.name == "constant" || term.name == "constant_force";
        sum += is_constant && term.equation.starts_with("der(") ? 0 : term.name == "offset" ? 1 : 2;
    }
    return sum;
}

} // namespace

Improvement improvement_of(const SystemCandidate& candidate, const SystemCandidate& current) {
    return {1 - rms_of_errors(candidate.predicted) / rms_of_errors(current.predicted),
            probability_of_gain(current.predicted, candidate.predicted)};
}

std::size_t kept_of(const SystemCandidate& candidate, const SystemCandidate& current) {
    std::multiset<std::string> there;
    for (const auto& term : current.terms) there.insert(term.kind());
    std::size_t kept = 0;
    for (; kept < candidate.terms.size(); ++kept) {
        const auto place = there.find(candidate.terms[kept].kind());
        if (place == there.end()) break;
        there.erase(place);
    }
    return kept;
}

std::set<std::string> kinds_from(const SystemCandidate& candidate, std::size_t begin) {
    std::set<std::string> kinds;
    for (std::size_t i = begin; i < candidate.terms.size(); ++i) kinds.insert(candidate.terms[i].kind());
    return kinds;
}

std::vector<std::string> kinds_of(const SystemCandidate& candidate) {
    std::vector<std::string> names;
    for (const auto& term : candidate.terms) names.push_back(term.kind());
    return names;
}

namespace {

std::vector<std::string> sorted_kinds_of(const SystemCandidate& candidate) {
    auto names = kinds_of(candidate);
    std::ranges::sort(names);
    return names;
}

} // namespace

double independent_errors(const SystemCandidate& candidate) {
    return static_cast<double>(candidate.fitted.size()) / correlation_length(candidate.fitted) +
           static_cast<double>(candidate.predicted.size()) / correlation_length(candidate.predicted);
}

std::optional<std::size_t> simplest(const std::vector<SystemCandidate>& found, const std::vector<std::size_t>& passed,
                                    const SystemErrors& errors) {
    if (passed.empty()) return std::nullopt;
    const SystemCandidate& best = found[passed.front()];
    const auto price = [](const SystemCandidate& one) {
        return std::pair(one.model.parameters.size(), nameless_of(one));
    };
    const auto kinds = kinds_from(best, 0);
    std::size_t taken = passed.front();
    for (const std::size_t i : passed) {
        const auto own = kinds_from(found[i], 0);
        const bool is_part = own.size() < kinds.size() && std::ranges::includes(kinds, own) &&
                             probability_of_gain(found[i].predicted, best.predicted) < sure_enough;
        const bool is_as_good = !best.is_noise && found[i].score() <= as_good * best.score();
        const bool is_as_likely = evidence_for_further(found[i], best, errors) < convincing;
        const bool is_named = has_likelier_names(found[i], best, errors);
        if ((is_as_good || is_part || is_as_likely || is_named) && price(found[i]) < price(found[taken])) taken = i;
    }
    // Another one that costs no more than a part of the best may do better than that.
    taken = *std::ranges::find_if(passed, [&](std::size_t i) { return price(found[i]) <= price(found[taken]); });
    // Another form of the same terms, such as dry friction as a tanh in place of one that sticks, is the same answer: the better one. A curve
    // of more levels is no other form.
    const auto form = std::ranges::find_if(passed, [&](std::size_t i) {
        return i == taken || (sorted_kinds_of(found[i]) == sorted_kinds_of(found[taken]) &&
                              std::ranges::none_of(found[i].terms, &SystemTerm::is_flexible));
    });
    if (found[*form].score() * as_good < found[taken].score()) taken = *form;
    // And of what is the same in other words, the plainest ones.
    return *std::ranges::min_element(passed, {}, [&](std::size_t i) {
        return std::pair(i != taken && !found[i].equals(found[taken]), plainness(found[i]));
    });
}

double price_of_names(const SystemCandidate& candidate, double independent_errors) {
    return std::pow(named_odds, static_cast<double>(nameless_of(candidate)) / independent_errors);
}

void SystemStep::weigh(const SystemCandidate& current, const std::vector<SystemCandidate>& found,
                       const std::vector<std::size_t>& passed, std::size_t chosen, const std::vector<double>& scores,
                       double independent, const SystemErrors& errors) {
    const auto& best = found[chosen];
    independent = std::max(4.0, independent);
    const auto taken = new_kinds(best, current);
    for (const std::size_t i : passed) {
        const auto kinds = new_kinds(found[i], current);
        if (!found[i].equals(best) || kinds == taken) continue;
        auto names = found[i].names_from(kept_of(found[i], current));
        if (std::ranges::find(same_as, names) == same_as.end()) same_as.push_back(std::move(names));
    }
    struct Weight {
        double value = 0;
        std::size_t place = 0; // of the best that has these terms
    };
    // By the kinds of the new terms, in whatever order these are; their sum is one.
    using Weights = std::map<std::set<std::string>, Weight>;
    const auto weights_of = [&](const auto& logarithm) {
        double most = -std::numeric_limits<double>::infinity(), sum = 0;
        for (const std::size_t i : passed) most = std::max(most, logarithm(i));
        Weights weights;
        for (const std::size_t i : passed) {
            const double w = std::exp(logarithm(i) - most);
            auto& weight = weights[found[i].equals(best) ? taken : new_kinds(found[i], current)];
            if (w <= weight.value) continue;
            sum += w - weight.value;
            weight = {w, i};
        }
        for (auto& [kinds, weight] : weights) weight.value /= sum;
        return weights;
    };
    const auto likelihood = [&](std::size_t i) {
        // What does about as well as the best is no less likely: such differences are due to what the model lacks, not to noise.
        const double excess = std::log(scores[i] / scores[passed.front()]) - (best.is_noise ? 0 : std::log(as_good));
        return -independent * std::max(excess, 0.0) - static_cast<double>(nameless_of(found[i])) * std::log(named_odds);
    };
    // What has more parameters may follow random forces.
    const Weights weights = weights_of([&](std::size_t i) {
        const double odds = evidence_for_further(best, found[i], errors) / convincing;
        return std::min(likelihood(i), likelihood(chosen) + 2 * std::log(odds));
    });
    for (const auto& kind : taken) {
        WeighedTerm& term = weighed[kind];
        term.probability = 0;
        for (const auto& [kinds, weight] : weights) {
            if (kinds.contains(kind)) {
                term.probability += weight.value * certainty;
            } else if (weight.value > min_rival) {
                const auto& rival = found[weight.place];
                term.rivals.emplace_back(rival.names_from(kept_of(rival, current)), weight.value);
            }
        }
        std::stable_sort(term.rivals.begin(), term.rivals.end(),
                         [](const auto& a, const auto& b) { return a.second > b.second; });
        if (term.rivals.size() > max_rivals) term.rivals.resize(max_rivals);
    }
    // The validation records tell whether what has more parameters follows random forces. A richer model that has the same terms speaks
    // for these.
    std::vector<Weight> rivals;
    for (const auto& [kinds, weight] : weights_of(likelihood)) {
        if (weight.value > min_rival && !std::ranges::includes(kinds, taken)) rivals.push_back(weight);
    }
    std::ranges::stable_sort(rivals, std::greater{}, &Weight::value);
    if (rivals.size() > max_told_apart) rivals.resize(max_told_apart);
    contenders = {best};
    for (const Weight& rival : rivals) contenders.push_back(found[rival.place]);
}

double evidence(double gain, std::size_t errors, double parameters, std::size_t hypotheses) {
    if (!(gain > 0)) return 0;
    const auto choices = static_cast<double>(std::max<std::size_t>(hypotheses, 2));
    return gain / (parameters * std::log(static_cast<double>(errors)) + 2 * std::log(choices));
}

double evidence(const SystemStep& before, const SystemStep& after, const Stretches& stretches, std::size_t hypotheses) {
    const auto size = [](const std::vector<double>& errors) { return static_cast<double>(errors.size()); };
    double gain = likelihood_gain(before.on_validation, after.on_validation, stretches.predicted);
    std::size_t errors = after.on_validation.size();
    if (!before.on_fitted.empty() && !after.on_fitted.empty()) {
        const double there = likelihood_gain(before.on_fitted, after.on_fitted, stretches.fitted);
        gain += std::min(there, gain / size(after.on_validation) * size(after.on_fitted));
        errors += after.on_fitted.size();
    }
    // One that took the place of others may have fewer.
    const double parameters = std::max(1.0, static_cast<double>(after.candidate.model.parameters.size()) -
                                                static_cast<double>(before.candidate.model.parameters.size()));
    return evidence(gain, errors, parameters, hypotheses);
}

} // namespace tribode
