#include "tribode/diagnosis/system_search.hpp"
#include "tribode/base/error.hpp"
#include "tribode/diagnosis/prediction_statistics.hpp"

#include <algorithm>
#include <cmath>
#include <fmt/format.h>
#include <map>
#include <set>

namespace tribode {

namespace {

// Of each record, the part that is fitted in the search; the rest is predicted.
constexpr double fitted_share = 0.7;
// How many hypotheses are fitted: the best of all, the best of each name, and pairs, of which some are of terms with one
// parameter each: richer ones explain more to first order, whatever is missing.
constexpr std::size_t fitted_singles = 8, fitted_of_a_kind = 2, fitted_pairs = 5, fitted_plain_pairs = 5;
// A second term is sought beside so many single terms that fit best, and as many of those with one parameter; so many of each
// are fitted.
constexpr std::size_t deepened_singles = 2, fitted_seconds = 4;
constexpr double negligible = 0.02; // of what the best single term explains to first order
constexpr int iterations = 20;
// Far from where a term was screened its effect may be another: its amplitudes begin with the first of these shares at which
// the error is no larger than without it.
constexpr double begun[] = {1, 0.25, 0.05, 0.01};
// Where a fit gains less than this share of what screening promised, the errors are bent on the way: it is tried once more over
// growing parts of the records.
constexpr double kept_promise = 0.5, worth_growing = 0.1;
constexpr double worth_another_way = 0.98; // of both errors, for another way of the inputs between samples
constexpr double dispensable = 1.01;       // of the score without a term, for the term to be left out

} // namespace

namespace {

bool suits_better(const SystemCandidate& one, const SystemCandidate& other) {
    return rms_of_errors(one.fitted) < worth_another_way * rms_of_errors(other.fitted) &&
           rms_of_errors(one.predicted) < worth_another_way * rms_of_errors(other.predicted);
}

} // namespace

std::string SystemCandidate::names_from(std::size_t term) const {
    std::string names;
    for (; term < terms.size(); ++term) names += (names.empty() ? "" : " and ") + terms[term].kind();
    return names;
}

double SystemCandidate::score() const {
    if (fitted.empty() || predicted.empty()) return std::numeric_limits<double>::infinity();
    std::size_t parameters = 0;
    for (const auto& term : terms) parameters += term.parameters.size();
    const double independent = static_cast<double>(fitted.size()) / correlation_length(fitted);
    const double taken = 1 + 2 * static_cast<double>(parameters) / std::max(independent, 1.0);
    return std::sqrt((taken * SystemFit::sum_of_squares(fitted) + SystemFit::sum_of_squares(predicted)) /
                     static_cast<double>(fitted.size() + predicted.size()));
}

SystemSearch::SystemSearch(const SystemModel& model, const std::vector<SystemRecord>& records,
                           std::vector<double> scale, std::function<bool()> late, const RunControl& control)
    : first_(model),
      records_(records),
      scale_(std::move(scale)),
      late_(std::move(late)),
      control_(control) {
    for (const auto& record : records_) {
        used_.push_back(
            std::max<std::size_t>(static_cast<std::size_t>(fitted_share * static_cast<double>(record.size())), 2));
        whole_.push_back(record.size());
    }
}

bool SystemSearch::fit(SystemCandidate& candidate, int steps, bool growing) const {
    const SystemFit part = fit_of_first_part();
    const auto ended = [this] { return late(); };
    const auto result = growing ? part.fit_growing(candidate.model, candidate.values, steps, ended)
                                : part.fit(candidate.model, candidate.values, steps, ended);
    if (result.errors.empty()) return false;
    candidate.values = result.values;
    candidate.fitted = result.errors;
    candidate.predicted = predicted(candidate.model, candidate.values);
    return !candidate.predicted.empty();
}

// The errors over what was not fitted, simulated on from the beginning of each record; empty where that fails.
std::vector<double> SystemSearch::predicted(const SystemModel& model, const std::vector<double>& values) const {
    const SystemFit fit = fit_of_all();
    std::vector<double> all;
    for (std::size_t r = 0; r < records_.size(); ++r) {
        const auto trace = fit.simulate(model, values, r, records_[r].size());
        if (!trace) return {};
        for (std::size_t o = 0; o < trace->outputs.size(); ++o) {
            for (std::size_t k = used_[r]; k < records_[r].size(); ++k) {
                all.push_back((records_[r].outputs[o][k] - trace->outputs[o][k]) / scale_[o]);
            }
        }
    }
    return all;
}

// The ways in which inputs may run between their samples. Without states, nothing is between these.
std::vector<Interpolation> SystemSearch::ways() const {
    const bool sampled = std::any_of(records_.begin(), records_.end(), [](const auto& record) {
        return std::any_of(record.inputs.begin(), record.inputs.end(), [](const auto& u) { return !u.empty(); });
    });
    if (!sampled) return {Interpolation::hold};
    if (first_.equations.states.empty()) return {Interpolation::linear};
    return {Interpolation::hold, Interpolation::linear, Interpolation::band_limited};
}

void SystemSearch::reconsider_inputs(SystemCandidate& candidate) {
    const Interpolation present = between_;
    for (const Interpolation between : ways()) {
        if (between == present || late()) continue;
        const Interpolation kept = between_;
        between_ = between;
        SystemCandidate other = candidate;
        if (fit(other, iterations) && suits_better(other, candidate)) {
            candidate = std::move(other);
        } else {
            between_ = kept;
        }
    }
}

SystemCandidate SystemSearch::begin() {
    std::optional<SystemCandidate> best;
    for (const Interpolation between : ways()) {
        if (best && late()) break;
        const Interpolation kept = between_;
        between_ = between;
        // The first way begins with values that may be far off, the others with what it found.
        SystemCandidate candidate{.model = first_, .values = best ? best->values : first_.values(records_.size())};
        SystemCandidate grown = candidate;
        bool fits = fit(candidate, 2 * iterations);
        if (!best && fit(grown, 2 * iterations, true) &&
            (!fits || rms_of_errors(grown.fitted) < rms_of_errors(candidate.fitted))) {
            candidate = std::move(grown);
            fits = true;
        }
        const bool better = fits && (!best || suits_better(candidate, *best));
        if (better) {
            best = std::move(candidate);
        } else {
            between_ = kept;
        }
    }
    if (best) return *std::move(best);
    std::string problem;
    const auto values = first_.values(records_.size());
    for (std::size_t r = 0; r < records_.size() && problem.empty(); ++r) {
        fit_of_all().simulate(first_, values, r, records_[r].size(), &problem);
    }
    throw InputError("the system cannot be simulated on the records with its own values: " + problem);
}

std::vector<ScreenedTerms> SystemSearch::chosen(const Screening& screening,
                                                const std::vector<SystemTerm>& terms) const {
    std::vector<ScreenedTerms> list;
    std::map<std::string, std::size_t> count, named;
    std::size_t further = 0;
    for (const auto& single : screening.singles) {
        if (single.explained < negligible * screening.singles.front().explained) break;
        const SystemTerm& term = terms[single.terms[0]];
        const bool is_first = named[term.name]++ == 0;
        if (!is_first && (further == fitted_singles || count[term.kind()] == fitted_of_a_kind)) continue;
        ++count[term.kind()];
        if (!is_first) ++further;
        list.push_back(single);
    }
    std::size_t any = 0, plain = 0;
    for (const auto& pair : screening.pairs) {
        const bool is_plain = std::all_of(pair.terms.begin(), pair.terms.end(),
                                          [&](std::size_t i) { return terms[i].parameters.size() == 1; });
        if (any < fitted_pairs) {
            ++any;
        } else if (is_plain && plain < fitted_plain_pairs) {
            ++plain;
        } else {
            continue;
        }
        list.push_back(pair);
    }
    return list;
}

std::vector<SystemCandidate> SystemSearch::next(const SystemCandidate& current) const {
    const SystemFit fit_first = fit_of_first_part();
    std::vector<SystemTrace> traces;
    for (std::size_t r = 0; r < records_.size(); ++r) {
        auto trace = fit_first.simulate(current.model, current.values, r, used_[r]);
        if (!trace) return {};
        traces.push_back(std::move(*trace));
    }
    const SystemModel model = current.model.with(current.values);
    const auto variables = variables_of(model, first_.equations.states.size(), fit_first, traces);
    const auto terms = system_terms(model, first_.equations.states.size(), fit_first, variables, current.fitted);
    std::vector<Hypothesis> list;
    for (auto& some : chosen(
             screened_terms(current.model, current.values, current.fitted, terms, fit_first, control_, late_), terms)) {
        list.push_back({current, std::move(some)});
    }
    auto found = fitted(list, terms);
    // Where one leaves nothing but noise, a second one has nothing to explain.
    const bool is_enough = std::any_of(found.begin(), found.end(), [](const SystemCandidate& one) {
        return is_white(one.fitted) && is_white(one.predicted);
    });
    auto seconds = is_enough ? std::vector<SystemCandidate>{} : fitted(deepened(current, found, terms), terms);
    found.insert(found.end(), std::make_move_iterator(seconds.begin()), std::make_move_iterator(seconds.end()));
    std::stable_sort(found.begin(), found.end(),
                     [](const SystemCandidate& a, const SystemCandidate& b) { return a.score() < b.score(); });
    return found;
}

std::vector<SystemSearch::Hypothesis> SystemSearch::deepened(const SystemCandidate& current,
                                                             const std::vector<SystemCandidate>& found,
                                                             const std::vector<SystemTerm>& terms) const {
    std::vector<const SystemCandidate*> singles;
    for (const auto& one : found) {
        if (one.terms.size() == current.terms.size() + 1) singles.push_back(&one);
    }
    std::stable_sort(singles.begin(), singles.end(), [](const auto* a, const auto* b) {
        return SystemFit::sum_of_squares(a->fitted) < SystemFit::sum_of_squares(b->fitted);
    });
    std::size_t any = 0, plain = 0;
    std::set<std::string> kinds;
    std::vector<Hypothesis> list;
    for (const auto* one : singles) {
        if (late()) break;
        const bool is_plain = one->terms.back().parameters.size() == 1;
        if (kinds.contains(one->terms.back().kind())) continue;
        if (any < deepened_singles) {
            ++any;
        } else if (is_plain && plain < deepened_singles) {
            ++plain;
        } else {
            continue;
        }
        kinds.insert(one->terms.back().kind());
        const auto screening =
            screened_terms(one->model, one->values, one->fitted, terms, fit_of_first_part(), control_, late_);
        std::set<std::string> seconds;
        for (const auto& single : screening.singles) {
            const auto kind = terms[single.terms[0]].kind();
            if (seconds.size() == fitted_seconds) break;
            // Two of a kind say little, and a pair is the same in either order.
            if (!kinds.contains(kind) && seconds.insert(kind).second) list.push_back({*one, single});
        }
    }
    return list;
}

std::vector<SystemCandidate> SystemSearch::fitted(const std::vector<Hypothesis>& list,
                                                  const std::vector<SystemTerm>& terms) const {
    const SystemFit fit_first = fit_of_first_part();
    std::vector<SystemCandidate> found(list.size());
    for_each_index(list.size(), control_, fmt::format("fitting {} hypotheses", list.size()), [&](std::size_t c) {
        if (late()) return;
        const SystemCandidate& from = list[c].from;
        const ScreenedTerms& added = list[c].terms;
        SystemCandidate candidate{.model = from.model, .values = {}, .terms = from.terms, .texts = from.texts};
        for (std::size_t i = 0; i < added.terms.size(); ++i) {
            std::string text;
            candidate.model = extended(candidate.model, terms[added.terms[i]], added.starts[i], &text);
            candidate.terms.push_back(terms[added.terms[i]]);
            candidate.texts.push_back(text);
        }
        const double before = SystemFit::sum_of_squares(from.fitted);
        for (const double share : begun) {
            candidate.values = from.values;
            for (std::size_t i = 0; i < added.terms.size(); ++i) {
                const SystemTerm& term = terms[added.terms[i]];
                std::vector<double> own = added.starts[i];
                for (std::size_t p = 0; p < term.amplitudes; ++p) {
                    own[p] = term.neutral[p] + share * (own[p] - term.neutral[p]);
                }
                candidate.values.insert(candidate.values.begin() +
                                            static_cast<std::ptrdiff_t>(candidate.values.size() - from.values.size() +
                                                                        from.model.parameters.size()),
                                        own.begin(), own.end());
            }
            const double sum = SystemFit::sum_of_squares(fit_first.errors(candidate.model, candidate.values));
            if (late() || sum <= before) break;
        }
        SystemCandidate grown = candidate;
        bool fits = fit(candidate, iterations);
        const bool short_of_promise =
            !fits || SystemFit::sum_of_squares(candidate.fitted) > before * (1 - kept_promise * added.explained);
        if (short_of_promise && added.explained > worth_growing && !late() && fit(grown, iterations, true) &&
            (!fits || SystemFit::sum_of_squares(grown.fitted) < SystemFit::sum_of_squares(candidate.fitted))) {
            candidate = std::move(grown);
            fits = true;
        }
        if (fits) found[c] = std::move(candidate);
    });
    std::erase_if(found, [](const SystemCandidate& c) { return c.predicted.empty(); });
    return found;
}

SystemCandidate SystemSearch::pruned(SystemCandidate candidate) const {
    for (std::size_t i = 0; candidate.terms.size() > 1 && i < candidate.terms.size() && !late();) {
        // Built again from the first model without the term, its values where they are.
        SystemCandidate without{.model = first_};
        const auto place = [&](std::size_t term) {
            std::size_t begin = first_.parameters.size();
            for (std::size_t t = 0; t < term; ++t) begin += candidate.terms[t].parameters.size();
            return static_cast<std::ptrdiff_t>(begin);
        };
        without.values.assign(candidate.values.begin(), candidate.values.begin() + place(0));
        without.values.insert(without.values.end(), candidate.values.begin() + place(candidate.terms.size()),
                              candidate.values.end());
        for (std::size_t t = 0; t < candidate.terms.size(); ++t) {
            if (t == i) continue;
            const std::vector<double> own(candidate.values.begin() + place(t), candidate.values.begin() + place(t + 1));
            std::string text;
            without.values = more_values(without.model, without.values, own);
            without.model = extended(without.model, candidate.terms[t], own, &text);
            without.terms.push_back(candidate.terms[t]);
            without.texts.push_back(text);
        }
        if (fit(without, iterations) && without.score() < dispensable * candidate.score()) {
            candidate = std::move(without);
            i = 0;
        } else {
            ++i;
        }
    }
    return candidate;
}

} // namespace tribode
