#include "tribode/diagnosis/system_step.hpp"
#include "tribode/diagnosis/prediction_statistics.hpp"

#include <algorithm>
#include <cmath>
#include <functional>

namespace tribode {

namespace {

constexpr double as_good = 1.02;   // of the best score: then the simplest is taken
constexpr double min_rival = 0.05; // probability worth showing
constexpr std::size_t max_rivals = 5;
constexpr std::size_t max_told_apart = 3; // rivals, by the next experiment

std::set<std::string> new_kinds(const SystemCandidate& candidate, const SystemCandidate& current) {
    return kinds_from(candidate, kept_of(candidate, current));
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

double independent_errors(const SystemCandidate& candidate) {
    return static_cast<double>(candidate.fitted.size()) / correlation_length(candidate.fitted) +
           static_cast<double>(candidate.predicted.size()) / correlation_length(candidate.predicted);
}

std::optional<std::size_t> simplest(const std::vector<SystemCandidate>& found, const std::vector<std::size_t>& passed) {
    if (passed.empty()) return std::nullopt;
    const SystemCandidate& best = found[passed.front()];
    const auto price = [](const SystemCandidate& one) {
        const auto nameless = std::count_if(one.terms.begin(), one.terms.end(),
                                            [](const auto& term) { return term.name == nameless_term; });
        return std::pair(one.model.parameters.size(), nameless);
    };
    const auto kinds = kinds_from(best, 0);
    std::size_t taken = passed.front();
    for (const std::size_t i : passed) {
        const auto own = kinds_from(found[i], 0);
        const bool is_part = own.size() < kinds.size() && std::ranges::includes(kinds, own) &&
                             probability_of_gain(found[i].predicted, best.predicted) < sure_enough;
        const bool is_as_good = !best.is_noise && found[i].score() <= as_good * best.score();
        if ((is_as_good || is_part) && price(found[i]) < price(found[taken])) taken = i;
    }
    // Another one that costs no more than a part of the best may do better than that.
    return *std::ranges::find_if(passed, [&](std::size_t i) { return price(found[i]) <= price(found[taken]); });
}

void SystemStep::weigh(const SystemCandidate& current, const std::vector<SystemCandidate>& found,
                       const std::vector<std::size_t>& passed, std::size_t chosen, const std::vector<double>& scores,
                       double independent) {
    const auto& best = found[chosen];
    independent = std::max(4.0, independent);
    const auto taken = new_kinds(best, current);
    struct Weight {
        double value = 0;
        std::size_t place = 0; // of the best that has these terms
    };
    std::map<std::set<std::string>, Weight> weights; // by the kinds of the new terms, in whatever order these are
    double sum = 0;
    for (const std::size_t i : passed) {
        // What does about as well as the best is no less likely: such differences are due to what the model lacks, not to noise.
        const double excess = std::log(scores[i] / scores[passed.front()]) - (best.is_noise ? 0 : std::log(as_good));
        const double w = std::exp(-independent * std::max(excess, 0.0));
        const bool is_same = found[i].equals(best);
        if (is_same && new_kinds(found[i], current) != taken)
            same_as.push_back(found[i].names_from(kept_of(found[i], current)));
        auto& weight = weights[is_same ? taken : new_kinds(found[i], current)];
        if (w <= weight.value) continue;
        sum += w - weight.value;
        weight = {w, i};
    }
    for (const auto& kind : taken) {
        WeighedTerm& term = weighed[kind];
        term.probability = 0;
        for (const auto& [kinds, weight] : weights) {
            if (kinds.contains(kind)) {
                term.probability += weight.value / sum * certainty;
            } else if (weight.value / sum > min_rival) {
                const auto& rival = found[weight.place];
                term.rivals.emplace_back(rival.names_from(kept_of(rival, current)), weight.value / sum);
            }
        }
        std::stable_sort(term.rivals.begin(), term.rivals.end(),
                         [](const auto& a, const auto& b) { return a.second > b.second; });
        if (term.rivals.size() > max_rivals) term.rivals.resize(max_rivals);
    }
    // A richer model that has the same terms speaks for them.
    std::vector<Weight> rivals;
    for (const auto& [kinds, weight] : weights) {
        if (weight.value / sum > min_rival && !std::ranges::includes(kinds, taken)) rivals.push_back(weight);
    }
    std::ranges::stable_sort(rivals, std::greater{}, &Weight::value);
    if (rivals.size() > max_told_apart) rivals.resize(max_told_apart);
    contenders = {best};
    for (const Weight& rival : rivals) contenders.push_back(found[rival.place]);
}

double evidence(double gain, double independent, double parameters, std::size_t hypotheses) {
    const auto choices = static_cast<double>(std::max<std::size_t>(hypotheses, 2));
    return gain / (parameters * std::log(independent) + 2 * std::log(choices));
}

double evidence(const SystemStep& before, const SystemStep& after, std::size_t hypotheses) {
    const auto size = [](const std::vector<double>& errors) { return static_cast<double>(errors.size()); };
    const auto gain_of_each = [](const std::vector<double>& without, const std::vector<double>& with) {
        return 2 * std::log(rms_of_errors(without) / rms_of_errors(with));
    };
    const double on_validation = size(after.on_validation) / correlation_length(after.on_validation);
    const double each = gain_of_each(before.on_validation, after.on_validation);
    double independent = on_validation, gain = on_validation * each;
    if (!before.on_fitted.empty() && !after.on_fitted.empty()) {
        const double on_fitted = std::min(size(after.on_fitted) / correlation_length(after.on_fitted),
                                          size(after.on_fitted) * on_validation / size(after.on_validation));
        independent += on_fitted;
        gain += on_fitted * std::min(each, gain_of_each(before.on_fitted, after.on_fitted));
    }
    if (!(gain > 0)) return 0;
    // One that took the place of others may have fewer.
    const double parameters = std::max(1.0, static_cast<double>(after.candidate.model.parameters.size()) -
                                                static_cast<double>(before.candidate.model.parameters.size()));
    return evidence(gain, independent, parameters, hypotheses);
}

} // namespace tribode
