#include "tribode/diagnosis/system_search.hpp"
#include "tribode/base/error.hpp"
#include "tribode/diagnosis/prediction_statistics.hpp"

#include <algorithm>
#include <cmath>
#include <fmt/format.h>
#include <map>

namespace tribode {

namespace {

// Of each record, the part that is fitted in the search; the rest is predicted.
constexpr double fitted_share = 0.7;
// How many hypotheses are fitted: the best of all, the best of each name, and pairs, of which some are of terms with one
// parameter each: richer ones explain more to first order, whatever is missing.
constexpr std::size_t fitted_singles = 8, fitted_of_a_kind = 2, fitted_pairs = 5, fitted_plain_pairs = 5;
constexpr double negligible = 0.02; // of what the best single term explains to first order
constexpr int iterations = 20;
// Far from where a term was screened its effect may be another: its amplitudes begin with the first of these shares at which
// the error is no larger than without it.
constexpr double begun[] = {1, 0.25, 0.05, 0.01};
constexpr double worth_another_way = 0.98; // of the error, for another way of the inputs between samples
constexpr double dispensable = 1.01;       // of the score without a term, for the term to be left out

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
                           std::vector<double> scale, std::chrono::steady_clock::time_point deadline,
                           const RunControl& control)
    : first_(model),
      records_(records),
      scale_(std::move(scale)),
      deadline_(deadline),
      control_(control) {
    for (const auto& record : records_) {
        used_.push_back(
            std::max<std::size_t>(static_cast<std::size_t>(fitted_share * static_cast<double>(record.size())), 2));
        whole_.push_back(record.size());
    }
}

bool SystemSearch::late() const { return control_.stop_requested() || std::chrono::steady_clock::now() > deadline_; }

bool SystemSearch::fit(SystemCandidate& candidate, int steps) const {
    const auto result = fit_of_first_part().fit(candidate.model, candidate.values, steps, [this] { return late(); });
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

SystemCandidate SystemSearch::begin() {
    const bool sampled = std::any_of(records_.begin(), records_.end(), [](const auto& record) {
        return std::any_of(record.inputs.begin(), record.inputs.end(), [](const auto& u) { return !u.empty(); });
    });
    // Without states, nothing is between the samples.
    std::vector<Interpolation> ways = {Interpolation::hold};
    if (sampled && !first_.equations.states.empty()) {
        ways = {Interpolation::hold, Interpolation::linear, Interpolation::band_limited};
    } else if (sampled) {
        ways = {Interpolation::linear};
    }
    std::optional<SystemCandidate> best;
    for (const Interpolation between : ways) {
        if (best && late()) break;
        const Interpolation kept = between_;
        between_ = between;
        SystemCandidate candidate{.model = first_, .values = first_.values(records_.size())};
        const bool better =
            fit(candidate, 2 * iterations) &&
            (!best || rms_of_errors(candidate.fitted) < worth_another_way * rms_of_errors(best->fitted));
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
    const auto is_late = [this] { return late(); };
    const auto list = chosen(
        screened_terms(current.model, current.values, current.fitted, terms, fit_first, control_, is_late), terms);
    std::vector<SystemCandidate> found(list.size());
    for_each_index(list.size(), control_, fmt::format("fitting {} hypotheses", list.size()), [&](std::size_t c) {
        if (late()) return;
        SystemCandidate candidate{.model = current.model, .values = {}, .terms = current.terms, .texts = current.texts};
        for (const std::size_t i : list[c].terms) {
            std::string text;
            candidate.model = extended(candidate.model, terms[i],
                                       list[c].starts[candidate.terms.size() - current.terms.size()], &text);
            candidate.terms.push_back(terms[i]);
            candidate.texts.push_back(text);
        }
        for (const double share : begun) {
            candidate.values = current.values;
            for (std::size_t i = 0; i < list[c].terms.size(); ++i) {
                const SystemTerm& term = terms[list[c].terms[i]];
                std::vector<double> own = list[c].starts[i];
                for (std::size_t p = 0; p < term.amplitudes; ++p) {
                    own[p] = term.neutral[p] + share * (own[p] - term.neutral[p]);
                }
                candidate.values.insert(candidate.values.begin() + static_cast<std::ptrdiff_t>(
                                                                       candidate.values.size() - current.values.size() +
                                                                       current.model.parameters.size()),
                                        own.begin(), own.end());
            }
            const double sum = SystemFit::sum_of_squares(fit_first.errors(candidate.model, candidate.values));
            if (late() || sum <= SystemFit::sum_of_squares(current.fitted)) break;
        }
        if (fit(candidate, iterations)) found[c] = std::move(candidate);
    });
    std::erase_if(found, [](const SystemCandidate& c) { return c.predicted.empty(); });
    std::stable_sort(found.begin(), found.end(),
                     [](const SystemCandidate& a, const SystemCandidate& b) { return a.score() < b.score(); });
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
