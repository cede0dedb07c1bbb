#include "tribode/diagnosis/system_search.hpp"
#include "tribode/base/error.hpp"
#include "tribode/diagnosis/fixed_steps.hpp"
#include "tribode/diagnosis/lane_fit.hpp"
#include "tribode/diagnosis/segments.hpp"
#include "tribode/diagnosis/thinned_records.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <fmt/format.h>
#include <limits>
#include <map>
#include <numeric>
#include <set>
#include <span>

namespace tribode {

namespace {

// Parts of each record that the search does not fit, but predicts. One lies within the record: what comes last in a sweep or a staircase
// may be like nothing before it, so that a model of the beginning alone lacks what shows only there.
struct Part {
    double begin, end; // shares of the samples
};
constexpr std::array hidden_parts = {Part{0.3, 0.45}, Part{0.85, 1.0}};
// Of a system without states, as a map over an angle: its harmonics are told apart by one long stretch.
constexpr std::array hidden_rows = {Part{0.7, 1.0}};
// How many hypotheses are fitted: the best of all, the best of each name, and pairs, of which some are of terms with one
// parameter each: richer ones explain more to first order, whatever is missing.
constexpr std::size_t fitted_singles = 8, fitted_of_a_kind = 2, fitted_pairs = 5, fitted_plain_pairs = 5;
// Over segments: how many of the best sums of each length are then fitted to the records.
constexpr std::size_t followed_of_a_length = 3;
constexpr int segment_iterations = 8;
constexpr std::size_t longest_sum = 3;
constexpr int max_exchanges = 2; // of one term of a sum for another
// Of a term, relative to what moves its derivative as much as all else does.
constexpr std::array sizes = {0.03, -0.03, 0.1, -0.1, 0.3, -0.3, 1.0, -1.0};
constexpr std::size_t shortest_beginning = 60; // samples
// A second term is sought beside so many single terms that fit best, and as many of those with one parameter; so many of each
// are fitted.
constexpr std::size_t deepened_singles = 3, fitted_seconds = 8, fitted_curves = 3;
constexpr double worth_a_fit = 0.5;        // of what the best second term explains, for a plain one
constexpr double negligible = 0.02;        // of what the best single term explains to first order
constexpr double lost_with_samples = 1e-3; // of the errors that the first model leaves
constexpr double explains_little = 0.5;    // errors over the outputs' deviations
constexpr double explains_most = 0.1;      // errors over those of the model before
// Iterations of a fit at first, of the best and of those that begin anew, and of those that promise most; and how many go on.
constexpr int first_iterations = 6, iterations = 20, last_iterations = 60;
constexpr double first_least_gain = 1e-3; // of the squared errors, by one of the first iterations
constexpr std::size_t gone_on = 16, plain_gone_on = 6, grown = 10, polished = 8, plain_polished = 4;
// Far from where a term was screened its effect may be another: its amplitudes begin with the first of these shares at which
// the error is no larger than without it.
constexpr double begun[] = {1, 0.25, 0.05, 0.01};
// Where a fit gains less than this share of what screening promised, the errors are bent on the way: it is tried once more over
// growing parts of the records.
constexpr double kept_promise = 0.5, worth_growing = 0.1;
constexpr double worth_growing_again = 1.02; // of the least errors of the present way
constexpr double least_jump = 0.02;          // of an input's range, in a staircase
constexpr double worth_another_way = 0.98;   // of both errors, for another way of the inputs between samples
constexpr std::size_t alternatives = 4;      // that are fitted in the place of a term
constexpr double worth_exchanging = 0.97;    // of the score
// Of the best, how many are tried with another way of the inputs, and where one suits better, how many are fitted again.
constexpr std::size_t first_reconsidered = 3, reconsidered = 8;
// Of a parameter that keeps its sign; and of the error, for the values that keep theirs to be taken.
constexpr double least_of_given = 1e-4, as_good_with_signs = 1.01;
constexpr double chance = 0.05;      // of the best of many frequencies, for a wave or a mode to be left out
constexpr double dispensable = 1.01; // of the score without a term, for the term to be left out

} // namespace

namespace {

// A delay or a lag in the path of an input or an output.
bool is_timing(const SystemTerm& term) { return term.of.empty() && term.parameters.front().unit == "s"; }

// Values that stay for some samples and then jump far.
bool is_staircase(const std::vector<double>& values) {
    if (values.empty()) return false;
    const auto [low, high] = std::ranges::minmax(values);
    std::size_t jumps = 0, moves = 0;
    for (std::size_t k = 1; k < values.size(); ++k) {
        const double move = std::abs(values[k] - values[k - 1]);
        moves += move > 0 ? 1 : 0;
        jumps += move > least_jump * (high - low) ? 1 : 0;
    }
    return moves > 0 && 2 * moves < values.size() && 2 * jumps > moves;
}

void sort_by_score(std::vector<SystemCandidate>& found) {
    std::ranges::stable_sort(found, {}, [](const SystemCandidate& one) { return one.score(); });
}

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

bool SystemCandidate::equals(const SystemCandidate& other) const {
    constexpr double alike = 1e-3; // of the errors, rms
    const auto differ = [](const std::vector<double>& a, const std::vector<double>& b) {
        double sum = a.size() == b.size() ? 0 : std::numeric_limits<double>::infinity();
        for (std::size_t k = 0; k < std::min(a.size(), b.size()); ++k) sum += (a[k] - b[k]) * (a[k] - b[k]);
        return sum > alike * alike * SystemFit::sum_of_squares(a);
    };
    return model.parameters.size() == other.model.parameters.size() && !differ(fitted, other.fitted) &&
           !differ(predicted, other.predicted);
}

bool SystemCandidate::is_chance_beside(const SystemCandidate& fewer) const {
    const auto ways = [](const SystemCandidate& one) { // to choose the frequencies, logarithm
        double sum = 0;
        for (const auto& term : one.terms) sum += std::log(static_cast<double>(term.looked_at));
        return sum;
    };
    const double looked_at = ways(*this) - ways(fewer);
    if (!(looked_at > 0)) return false;
    // Twice the logarithm of the likelihood ratio. Of one frequency in white noise it is above x with a probability of exp(-x/2).
    const double independent = static_cast<double>(fewer.fitted.size()) / correlation_length(fewer.fitted);
    const double gain =
        independent * std::log(SystemFit::sum_of_squares(fewer.fitted) / SystemFit::sum_of_squares(fitted));
    return gain < 2 * (looked_at - std::log(chance));
}

double SystemCandidate::score() const {
    if (fitted.empty() || predicted.empty()) return std::numeric_limits<double>::infinity();
    std::size_t parameters = 0;
    for (const auto& term : terms) parameters += term.parameters.size();
    if (is_noise) {
        const double samples = static_cast<double>(fitted.size() + predicted.size());
        const double squares = SystemFit::sum_of_squares(fitted) + SystemFit::sum_of_squares(predicted);
        return std::sqrt((squares / samples + solvers_errors * solvers_errors) *
                         std::exp((static_cast<double>(parameters) * std::log(samples) +
                                   2 * static_cast<double>(terms.size()) * std::log(static_cast<double>(library))) /
                                  samples));
    }
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
      control_(control),
      searched_(records) {
    hide_parts();
}

void SystemSearch::hide_parts() {
    shown_.clear();
    hidden_.clear();
    whole_.clear();
    for (const auto& record : searched_) {
        whole_.push_back(record.size());
        SystemRecord shown = record, hidden = record;
        for (auto& values : hidden.outputs) std::ranges::fill(values, std::numeric_limits<double>::quiet_NaN());
        const auto samples = static_cast<double>(record.size());
        const bool is_map = first_.equations.states.empty();
        for (const Part& part : is_map ? std::span<const Part>(hidden_rows) : std::span<const Part>(hidden_parts)) {
            const auto end = static_cast<std::size_t>(std::round(part.end * samples));
            for (auto k = static_cast<std::size_t>(std::round(part.begin * samples)); k < end; ++k) {
                for (std::size_t o = 0; o < record.outputs.size(); ++o) {
                    std::swap(shown.outputs[o][k], hidden.outputs[o][k]);
                }
            }
        }
        shown_.push_back(std::move(shown));
        hidden_.push_back(std::move(hidden));
    }
}

SystemFit SystemSearch::fit_of_all_samples(Interpolation between) const {
    std::vector<std::size_t> whole;
    for (const auto& record : records_) whole.push_back(record.size());
    return {records_, scale_, between, whole};
}

SystemErrors SystemSearch::errors() const {
    return {{stretches_of(first_, shown_), stretches_of(first_, hidden_)}, fit_of_all_samples(between_).noise()};
}

bool SystemSearch::fit(SystemCandidate& candidate) const { return fit(candidate, iterations); }

bool SystemSearch::fit(SystemCandidate& candidate, int steps, bool growing, const FoundMinimum* found) const {
    SystemFit part = fit_of(shown_, candidate.substeps);
    if (steps <= first_iterations) part.begin_search(candidate.substeps, first_least_gain);
    if (found) part.look_elsewhere(*found);
    if (is_followed_ && FixedSteps::of(candidate.model.with(candidate.values))) part.keep_to_fixed_steps();
    const auto ended = [this] { return late(); };
    const auto result = growing ? part.fit_growing(candidate.model, candidate.values, steps, ended)
                                : part.fit(candidate.model, candidate.values, steps, ended);
    if (result.errors.empty() || result.gave_up) return false;
    candidate.values = result.values;
    candidate.fitted = result.errors;
    candidate.curvature = result.curvature;
    candidate.substeps = result.substeps;
    candidate.predicted = fit_of(hidden_, candidate.substeps).errors(candidate.model, candidate.values);
    candidate.is_noise = false;
    if (is_nothing_left(candidate.fitted)) fit_whole(candidate, steps);
    return !candidate.predicted.empty();
}

void SystemSearch::fit_whole(SystemCandidate& candidate, int steps) const {
    const auto ended = [this] { return late(); };
    SystemCandidate whole = candidate;
    // Where a motion is unstable, errors of values grow along it: the part that is fitted grows with care.
    for (const double share : {0.85, 1.0}) {
        std::vector<std::size_t> used;
        for (const auto& record : searched_) {
            used.push_back(static_cast<std::size_t>(std::ceil(share * static_cast<double>(record.size()))));
        }
        SystemFit part(searched_, scale_, between_, used);
        part.begin_search(whole.substeps);
        const auto result = part.fit(whole.model, whole.values, steps, ended);
        if (result.errors.empty() || late()) return;
        whole.values = result.values;
        if (!is_nothing_left(result.errors)) return;
    }
    whole.fitted = fit_of(shown_, whole.substeps).errors(whole.model, whole.values);
    whole.predicted = fit_of(hidden_, whole.substeps).errors(whole.model, whole.values);
    if (whole.fitted.empty() || whole.predicted.empty()) return;
    whole.is_noise = true;
    candidate = std::move(whole);
}

// Without states, nothing is between the samples.
std::vector<Interpolation> SystemSearch::ways() const {
    const bool sampled = std::any_of(records_.begin(), records_.end(), [](const auto& record) {
        return std::any_of(record.inputs.begin(), record.inputs.end(), [](const auto& u) { return !u.empty(); });
    });
    if (!sampled) return {Interpolation::hold};
    if (first_.equations.states.empty()) return {Interpolation::linear};
    return {Interpolation::hold, Interpolation::linear, Interpolation::band_limited};
}

// Those for a model that lacks something: what it leaves says little about the way of the inputs, but a staircase is held.
std::vector<Interpolation> SystemSearch::first_ways() const {
    auto all = ways();
    const bool is_held = std::ranges::any_of(
        records_, [](const auto& record) { return std::ranges::any_of(record.inputs, is_staircase); });
    if (is_held) all.resize(1);
    return all;
}

void SystemSearch::reconsider_inputs(SystemCandidate& candidate) {
    if (every() > 1) return; // with fewer samples all ways come to about the same
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

// Binds the first model's parameters to their signs.
void SystemSearch::keep_signs(SystemModel& model, const std::vector<double>& given) const {
    for (std::size_t p = 0; p < first_.parameters.size(); ++p) {
        auto& own = model.parameters[p];
        if (given[p] > 0) own.low = std::max(own.low, least_of_given * given[p]);
        if (given[p] < 0) own.high = std::min(own.high, least_of_given * given[p]);
    }
}

// Fits from the given values. A step from these may lead a time constant or a mass below zero, where no way leads back: then once more
// with the signs that were given.
bool SystemSearch::fit_from_afar(SystemCandidate& candidate) const {
    const auto in_both_ways = [&](SystemCandidate& one) {
        SystemCandidate grown = one;
        const bool fits = fit(one, 2 * iterations);
        const bool grows = fit(grown, 2 * iterations, true);
        if (grows && (!fits || rms_of_errors(grown.fitted) < rms_of_errors(one.fitted))) one = std::move(grown);
        return fits || grows;
    };
    const std::vector<double> given = candidate.values;
    SystemCandidate same = candidate;
    const bool fits = in_both_ways(candidate);
    const auto changes_sign = [&](std::size_t p) { return given[p] * candidate.values[p] < 0; };
    bool has_changed = false;
    for (std::size_t p = 0; p < first_.parameters.size(); ++p) {
        has_changed = has_changed || changes_sign(p);
    }
    keep_signs(same.model, given);
    if (fits && !has_changed) return true;
    if (!in_both_ways(same)) return fits;
    if (!fits || rms_of_errors(same.fitted) < as_good_with_signs * rms_of_errors(candidate.fitted)) {
        same.model = first_;
        candidate = std::move(same);
    }
    return true;
}

SystemCandidate SystemSearch::begin() {
    std::optional<SystemCandidate> best;
    for (const Interpolation between : first_ways()) {
        if (best && late()) break;
        const Interpolation kept = between_;
        between_ = between;
        // The first way begins with values that may be far off, the others with what it found.
        SystemCandidate candidate{.model = first_, .values = best ? best->values : first_.values(records_.size())};
        const bool fits = best ? fit(candidate, 2 * iterations) : fit_from_afar(candidate);
        const bool better = fits && (!best || suits_better(candidate, *best));
        if (better) {
            best = std::move(candidate);
        } else {
            between_ = kept;
        }
    }
    if (best) {
        best = with_fewer_samples(*std::move(best));
        is_followed_ = best->substeps > 0;
        return with_way_over_segments(*std::move(best));
    }
    std::string problem;
    const auto values = first_.values(records_.size());
    for (std::size_t r = 0; r < records_.size() && problem.empty(); ++r) {
        fit_of_all().simulate(first_, values, r, records_[r].size(), &problem);
    }
    throw InputError("the system cannot be simulated on the records with its own values: " + problem);
}

// What is missing leaves far more than what is lost so. Where nothing is, there is little to search.
SystemCandidate SystemSearch::with_fewer_samples(SystemCandidate candidate) {
    if (candidate.is_noise) return candidate;
    std::vector<double> negligible_errors;
    for (const double scale : scale_) {
        negligible_errors.push_back(lost_with_samples * rms_of_errors(candidate.fitted) * scale);
    }
    searched_ = thinned(first_, records_, negligible_errors);
    if (every() == 1) return candidate;
    hide_parts();
    SystemCandidate fewer = candidate;
    if (fit(fewer, iterations)) return fewer;
    searched_ = records_;
    hide_parts();
    return candidate;
}

// A model that lacks something may be nearer the records with inputs that run as they do not. Over segments it lacks little, and the way
// shows.
SystemCandidate SystemSearch::with_way_over_segments(SystemCandidate candidate) {
    const auto all = first_ways();
    if (all.size() < 2 || candidate.is_noise || every() > 1 || late()) return candidate;
    const auto segments = segmented(candidate.model, candidate.values, fit_of_shown(), late_);
    if (!segments || late()) return candidate;
    const Interpolation present = between_;
    double least = worth_another_way * rms_of_errors(segments->errors);
    for (const Interpolation between : all) {
        if (between == present) continue;
        SystemFit fit_segments = segments->fit(scale_, between, segments->substeps);
        if (FixedSteps::of(candidate.model)) fit_segments.keep_to_fixed_steps();
        const auto result = fit_segments.fit(segments->model, segments->values, segment_iterations, late_);
        const double error = rms_of_errors(result.errors);
        if (!(error < least)) continue;
        least = worth_another_way * error;
        between_ = between;
    }
    if (between_ == present) return candidate;
    SystemCandidate other = candidate;
    if (fit(other, iterations)) return other;
    between_ = present;
    return candidate;
}

std::vector<ScreenedTerms> SystemSearch::chosen(const Screening& screening, const std::vector<SystemTerm>& terms,
                                                bool from_afar) const {
    std::vector<ScreenedTerms> list;
    std::map<std::string, std::size_t> count, named;
    std::size_t further = 0;
    for (const auto& single : screening.singles) {
        const SystemTerm& term = terms[single.terms[0]];
        if (term.is_flexible) continue; // see flexible()
        const bool is_first = named[term.name]++ == 0;
        // A term of one value is quickly fitted, and one that turns the motion into another one explains little to first order.
        const bool is_quick = from_afar && term.parameters.size() == 1 && count[term.kind()] == 0;
        if (!is_quick && single.explained < negligible * screening.singles.front().explained) continue;
        if (!is_quick && !is_first && (further == fitted_singles || count[term.kind()] == fitted_of_a_kind)) continue;
        ++count[term.kind()];
        if (!is_quick && !is_first) ++further;
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
    list.insert(list.end(), screening.sums.begin(), screening.sums.end());
    return list;
}

// The library over the motion of the candidate; empty where it cannot be simulated.
std::vector<SystemTerm> SystemSearch::terms_beside(const SystemCandidate& current, bool with_nameless) const {
    const SystemFit fit_shown = fit_of_shown();
    std::vector<SystemTrace> traces;
    for (std::size_t r = 0; r < records_.size(); ++r) {
        auto trace = fit_shown.simulate(current.model, current.values, r, whole_[r]);
        if (!trace) return {};
        traces.push_back(std::move(*trace));
    }
    const SystemModel model = current.model.with(current.values);
    const std::size_t states = first_.equations.states.size();
    return system_terms(model, states, fit_shown, variables_of(model, states, fit_shown, traces), current.fitted,
                        with_nameless);
}

// Dry friction with a constant force, as of an axis with a preloaded seal or on a slope: without the other one, either may have to stop
// a motion that it should let pass.
void SystemSearch::add_friction_by_direction(const SystemCandidate& current, const std::vector<SystemTerm>& terms,
                                             std::vector<Hypothesis>& list) const {
    for (std::size_t i = 0; i < terms.size(); ++i) {
        const SystemTerm& friction = terms[i];
        if (friction.name != "coulomb_friction" || friction.parameters.size() > 1) continue;
        for (std::size_t j = 0; j < terms.size(); ++j) {
            if (terms[j].name != "constant_force" || terms[j].equation != friction.equation) continue;
            list.push_back(
                {current,
                 {.terms = {j, i}, .starts = {{terms[j].parameters[0].start}, {friction.parameters[0].start}}}});
        }
    }
}

std::vector<SystemCandidate> SystemSearch::next(const SystemCandidate& current) {
    // Without what it lacks most, a model may have been led far off.
    const bool from_afar = current.terms.empty();
    const auto terms = terms_beside(current, false);
    const Screening screening = screened_terms(current.model, current.values, current.fitted, terms,
                                               fit_of(shown_, current.substeps), control_, late_);
    std::vector<Hypothesis> list;
    for (auto& some : chosen(screening, terms, from_afar)) {
        list.push_back({current, std::move(some)});
    }
    if (current.terms.empty() && rms_of_errors(current.fitted) > explains_little) {
        // To first order such a model says little about what it lacks: what has one value is tried wherever it is.
        std::set<std::string> known;
        for (const auto& one : list) {
            if (one.terms.terms.size() == 1) known.insert(terms[one.terms.terms[0]].kind());
        }
        for (std::size_t i = 0; i < terms.size(); ++i) {
            if (terms[i].parameters.size() > 1 || !known.insert(terms[i].kind()).second) continue;
            list.push_back({current, {.terms = {i}, .starts = {{terms[i].parameters[0].start}}}});
        }
    }
    if (from_afar) add_friction_by_direction(current, terms, list);
    auto found = fitted(list, terms, from_afar);
    // Where one leaves nothing but noise, a second one has nothing to explain.
    const auto is_enough = [&] {
        return std::any_of(found.begin(), found.end(), [](const auto& one) { return one.is_noise; });
    };
    const auto add = [&](std::vector<SystemCandidate> more) {
        found.insert(found.end(), std::make_move_iterator(more.begin()), std::make_move_iterator(more.end()));
    };
    sort_by_score(found);
    // What explains nearly all, and leaves more than noise, may lack the way of the inputs alone.
    if (!found.empty() && !is_enough() && found.front().score() < explains_most * rms_of_errors(current.fitted)) {
        reconsider_inputs(found);
    }
    if (!is_enough()) add(followed(current));
    if (!is_enough()) add(fitted(deepened(current, found, terms), terms, from_afar));
    if (!is_enough()) add(flexible(current, screening, terms));
    sort_by_score(found);
    reconsider_inputs(found);
    return found;
}

void SystemSearch::reconsider_inputs(std::vector<SystemCandidate>& found) {
    if (every() > 1) return;
    const Interpolation present = between_;
    std::size_t least_parameters = std::numeric_limits<std::size_t>::max() - 1;
    for (const auto& one : found) {
        least_parameters = std::min(least_parameters, one.model.parameters.size() - one.terms.back().parameters.size());
    }
    for (const Interpolation between : ways()) {
        if (between == present || found.empty() || late()) continue;
        const Interpolation kept = between_;
        between_ = between;
        const std::size_t best = std::min(reconsidered, found.size());
        std::vector<SystemCandidate> others(found.begin(), found.begin() + static_cast<std::ptrdiff_t>(best));
        // Richer ones may have made up for the present way, which one value more cannot.
        std::vector<std::size_t> plain;
        for (std::size_t i = best; i < found.size() && plain.size() < reconsidered; ++i) {
            if (found[i].model.parameters.size() > least_parameters + 1) continue;
            plain.push_back(i);
            others.push_back(found[i]);
        }
        // A delay or a lag may stand for the way of the inputs alone: then what is without it suits another way.
        for (std::size_t i = 0; i < std::min(first_reconsidered, best); ++i) {
            for (std::size_t t = 0; found[i].terms.size() > 1 && t < found[i].terms.size(); ++t) {
                if (is_timing(found[i].terms[t])) others.insert(others.begin(), without(found[i], t));
            }
        }
        // And what a share of the input does at once shows only with the right way.
        const auto at_once = std::ranges::find_if(
            found, [](const SystemCandidate& one) { return one.terms.back().name == "feedthrough"; });
        if (at_once - found.begin() >= static_cast<std::ptrdiff_t>(first_reconsidered) && at_once != found.end()) {
            others.insert(others.begin(), *at_once);
        }
        const std::size_t shorter = others.size() - best - plain.size();
        const auto refit = [&](std::size_t begin, std::size_t end, bool growing) {
            for_each_index(
                end - begin, control_, fmt::format("fitting {} hypotheses to inputs between samples", end - begin),
                [&](std::size_t n) {
                    SystemCandidate& one = others[begin + n];
                    SystemCandidate grown = one;
                    if (!late() && !fit(one, iterations)) one.predicted.clear();
                    // Shifted by half a sample, a motion may come to other places, from where no way leads back.
                    const double least = rms_of_errors(found.front().fitted);
                    const auto error = [](const SystemCandidate& c) {
                        return c.predicted.empty() ? std::numeric_limits<double>::infinity() : rms_of_errors(c.fitted);
                    };
                    if (!growing || late() || error(one) < worth_growing_again * least) return;
                    if (fit(grown, iterations, true) && error(grown) < error(one)) one = std::move(grown);
                });
        };
        const std::size_t some = shorter + std::min(first_reconsidered, best);
        refit(0, some, true);
        // What is simpler, or was without its way until now, needs to do only as well, unless the present way does that, too.
        const auto does_as_well_now = [&](const SystemCandidate& other) {
            return std::ranges::any_of(found, [&](const SystemCandidate& one) {
                return one.names_from(0) == other.names_from(0) && worth_another_way * one.score() < other.score();
            });
        };
        const auto is_better = [&](std::size_t i) {
            if (i < shorter) {
                return others[i].score() < dispensable * found.front().score() && !does_as_well_now(others[i]);
            }
            return others[i].is_noise ? others[i].score() < found.front().score()
                                      : suits_better(others[i], found.front());
        };
        bool is_any_better = false;
        for (std::size_t i = 0; i < some && !is_any_better; ++i) is_any_better = is_better(i);
        if (!is_any_better || late()) {
            between_ = kept;
            continue;
        }
        refit(some, others.size(), false);
        for (std::size_t i = shorter; i < others.size(); ++i) {
            const std::size_t place = i - shorter;
            if (!others[i].predicted.empty()) found[place < best ? place : plain[place - best]] = std::move(others[i]);
        }
        for (std::size_t i = 0; i < shorter; ++i) {
            if (!others[i].predicted.empty()) found.push_back(std::move(others[i]));
        }
        sort_by_score(found);
    }
}

namespace {

// Terms beside a model over segments.
struct OnSegments {
    ScreenedTerms terms;
    SystemModel model;
    std::vector<double> values, errors = {};
    std::size_t substeps = 0; // of a sample, that were enough; 0: not known

    // The Bayesian information criterion [Schwarz 1978] of each sample.
    double criterion() const {
        const double samples = static_cast<double>(errors.size());
        return std::log(SystemFit::sum_of_squares(errors)) +
               static_cast<double>(model.parameters.size()) * std::log(samples) / samples;
    }
};

OnSegments extended_on_segments(const OnSegments& from, const ScreenedTerms& added,
                                const std::vector<SystemTerm>& terms) {
    OnSegments more = from;
    more.errors.clear();
    for (std::size_t i = 0; i < added.terms.size(); ++i) {
        more.values = more_values(more.model, more.values, added.starts[i]);
        more.model = extended(more.model, terms[added.terms[i]], added.starts[i]);
        more.terms.terms.push_back(added.terms[i]);
        more.terms.starts.push_back(added.starts[i]);
    }
    return more;
}

// Without its term of this place. `begin`: what it grew from, without any.
OnSegments less_on_segments(const OnSegments& from, std::size_t without, const OnSegments& begin,
                            const std::vector<SystemTerm>& terms) {
    OnSegments less{.terms = {}, .model = begin.model, .values = {}, .substeps = from.substeps};
    std::size_t place = begin.model.parameters.size();
    less.values.assign(from.values.begin(), from.values.begin() + static_cast<std::ptrdiff_t>(place));
    for (std::size_t i = 0; i < from.terms.terms.size(); ++i) {
        const SystemTerm& term = terms[from.terms.terms[i]];
        const auto first = from.values.begin() + static_cast<std::ptrdiff_t>(place);
        const std::vector<double> own(first, first + static_cast<std::ptrdiff_t>(term.parameters.size()));
        place += own.size();
        if (i == without) continue;
        less.values.insert(less.values.end(), own.begin(), own.end());
        less.model = extended(less.model, term, own);
        less.terms.terms.push_back(from.terms.terms[i]);
        less.terms.starts.push_back(own);
    }
    less.values.insert(less.values.end(), from.values.begin() + static_cast<std::ptrdiff_t>(place), from.values.end());
    return less;
}

void sort_by_criterion(std::vector<OnSegments>& list) {
    std::stable_sort(list.begin(), list.end(),
                     [](const OnSegments& a, const OnSegments& b) { return a.criterion() < b.criterion(); });
}

std::set<std::string> forms_of(const ScreenedTerms& some, const std::vector<SystemTerm>& terms) {
    std::set<std::string> forms;
    for (const std::size_t i : some.terms) forms.insert(terms[i].form());
    return forms;
}

} // namespace

std::vector<SystemCandidate> SystemSearch::followed(const SystemCandidate& current) const {
    const SystemFit fit_shown = fit_of_shown();
    auto segments = segmented(current.model, current.values, fit_shown, late_);
    if (late()) return {};
    // Without segments, the records themselves.
    if (!segments) {
        segments.emplace();
        segments->model = current.model;
        for (std::size_t r = 0; r < records_.size(); ++r) {
            segments->first_of.push_back(r);
            segments->records.push_back(shown_[r]);
        }
        segments->values = current.values;
        segments->errors = current.fitted;
        segments->substeps = current.substeps;
    }
    const bool has_fixed_steps = FixedSteps::of(current.model).has_value();
    const auto fit_segments = [&](std::size_t substeps) {
        SystemFit made = segments->fit(scale_, between_, substeps);
        if (has_fixed_steps) made.keep_to_fixed_steps();
        return made;
    };
    const SystemFit fit_begin = fit_segments(segments->substeps);
    std::vector<SystemTrace> traces;
    for (std::size_t r = 0; r < segments->records.size(); ++r) {
        auto trace = fit_begin.simulate(segments->model, segments->values, r, segments->records[r].size());
        if (!trace) return {};
        traces.push_back(std::move(*trace));
    }
    const std::size_t states = first_.equations.states.size();
    const SystemModel model = segments->model.with(segments->values);
    const auto terms =
        system_terms(model, states, fit_begin, variables_of(model, states, fit_begin, traces), segments->errors, true);
    const auto fitted_on_segments = [&](std::vector<OnSegments> some) {
        for_each_index(
            some.size(), control_, fmt::format("fitting {} hypotheses to segments", some.size()), [&](std::size_t c) {
                if (late()) return;
                auto result =
                    fit_segments(some[c].substeps).fit(some[c].model, some[c].values, segment_iterations, late_);
                some[c].values = std::move(result.values);
                some[c].errors = std::move(result.errors);
                some[c].substeps = result.substeps;
            });
        std::erase_if(some, [](const OnSegments& one) { return one.errors.empty(); });
        sort_by_criterion(some);
        return some;
    };
    const OnSegments begin{.terms = {},
                           .model = segments->model,
                           .values = segments->values,
                           .errors = segments->errors,
                           .substeps = segments->substeps};
    // The best further terms beside a sum, each form once, without the sums that are known.
    std::set<std::set<std::string>> known;
    const auto longer = [&](const OnSegments& one) {
        std::vector<OnSegments> list;
        for (const auto& single :
             screened_singles(one.model, one.values, one.errors, terms, fit_segments(one.substeps), control_, late_)) {
            if (terms[single.terms[0]].is_flexible) continue;
            auto more = extended_on_segments(one, single, terms);
            if (!known.insert(forms_of(more.terms, terms)).second) continue;
            list.push_back(std::move(more));
            if (list.size() == fitted_seconds) break;
        }
        return list;
    };
    std::vector<OnSegments> list;
    for (auto& some : chosen(screened_terms(begin.model, begin.values, begin.errors, terms, fit_begin, control_, late_),
                             terms, current.terms.empty())) {
        list.push_back(extended_on_segments(begin, some, terms));
        known.insert(forms_of(list.back().terms, terms));
    }
    auto found = fitted_on_segments(std::move(list));
    const auto add = [&](std::vector<OnSegments> more) {
        found.insert(found.end(), std::make_move_iterator(more.begin()), std::make_move_iterator(more.end()));
        sort_by_criterion(found);
    };
    // What is left beside a term shows better where that term was fitted: sums grow from the best of each length. What began a sum
    // may have stood for terms that came later: each term of the best is taken out, and what suits the others best is sought again, as
    // in a floating search [Pudil 1994].
    const auto best_of = [&](std::size_t length) {
        return std::ranges::find_if(found, [&](const OnSegments& one) { return one.terms.terms.size() == length; });
    };
    bool gains = true;
    for (std::size_t length = 1; length < longest_sum && gains; ++length) {
        list.clear();
        std::size_t grown = 0;
        for (const auto& one : found) {
            if (one.terms.terms.size() != length || late()) continue;
            if (grown++ == deepened_singles) break;
            for (auto& more : longer(one)) list.push_back(std::move(more));
        }
        add(fitted_on_segments(std::move(list)));
        for (int exchange = 0; exchange < max_exchanges && !late(); ++exchange) {
            const auto best = best_of(length + 1);
            if (best == found.end()) break;
            const double present = best->criterion();
            list.clear();
            for (std::size_t i = 0; i <= length; ++i) list.push_back(less_on_segments(*best, i, begin, terms));
            std::vector<OnSegments> exchanged;
            for (const auto& less : fitted_on_segments(std::move(list))) {
                for (auto& more : longer(less)) exchanged.push_back(std::move(more));
            }
            add(fitted_on_segments(std::move(exchanged)));
            if (!(best_of(length + 1)->criterion() < present)) break;
        }
        const auto shorter = best_of(length), more = best_of(length + 1);
        gains = more != found.end() && (shorter == found.end() || more->criterion() < shorter->criterion());
    }
    std::vector<Hypothesis> best;
    std::map<std::size_t, std::size_t> of_length;
    for (auto& one : found) {
        if (++of_length[one.terms.terms.size()] > followed_of_a_length) continue;
        Hypothesis followed{current, std::move(one.terms), true};
        const std::size_t own = current.model.parameters.size();
        auto place = one.values.begin() + static_cast<std::ptrdiff_t>(own);
        for (auto& starts : followed.terms.starts) {
            std::copy_n(place, starts.size(), starts.begin());
            place += static_cast<std::ptrdiff_t>(starts.size());
        }
        followed.from.values = segments->whole(current.model, one.values);
        followed.from.values.erase(followed.from.values.begin() + static_cast<std::ptrdiff_t>(own),
                                   followed.from.values.begin() + (place - one.values.begin()));
        best.push_back(std::move(followed));
    }
    return fitted(best, terms, current.terms.empty());
}

// A delay or a lag does what time constants do, but for what shows where these have moved: each form that is not known beside a model.
void SystemSearch::add_timing(const SystemCandidate& one, const std::vector<SystemTerm>& terms,
                              std::set<std::string>& forms, std::vector<Hypothesis>& list) const {
    for (std::size_t i = 0; i < terms.size(); ++i) {
        if (!is_timing(terms[i]) || !forms.insert(terms[i].form()).second) continue;
        list.push_back({one, {.terms = {i}, .starts = {{}}, .explained = 0}});
        for (const auto& parameter : terms[i].parameters) list.back().terms.starts[0].push_back(parameter.start);
    }
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
        const auto screened = screened_singles(one->model, one->values, one->fitted, terms,
                                               fit_of(shown_, one->substeps), control_, late_);
        const SystemTerm& first = one->terms.back();
        std::set<std::string> seconds;
        std::size_t best = 0;
        for (const auto& term : terms) {
            if (kinds.contains(term.kind())) seconds.insert(term.form());
        }
        add_timing(*one, terms, seconds, list);
        for (const auto& single : screened) {
            const SystemTerm& second = terms[single.terms[0]];
            // Two of a kind say little, and a pair is the same in either order.
            if (kinds.contains(second.kind()) || seconds.contains(second.form()) || second.is_flexible) continue;
            // Functions of the same variable make up a curve together that none of them is, as drag and dry friction do.
            const bool is_same_variable = second.equation == first.equation && second.of == first.of;
            // Others that explain to first order what a better one does say nothing new, but one with one parameter may do so with
            // whatever values a fit finds.
            const bool is_further = best < fitted_seconds && !single.is_alike;
            const bool is_plain_too =
                second.parameters.size() == 1 && single.explained > worth_a_fit * screened.front().explained;
            if (!is_further && !is_same_variable && !is_plain_too) continue;
            if (is_further) ++best;
            seconds.insert(second.form());
            list.push_back({*one, single});
        }
    }
    return list;
}

// The likeliest curves and other flexible terms, the best of them also with a delay or a lag. Among the terms of a screening they would
// crowd out all else.
std::vector<SystemCandidate> SystemSearch::flexible(const SystemCandidate& current, const Screening& screening,
                                                    const std::vector<SystemTerm>& terms) const {
    std::vector<Hypothesis> list;
    std::map<std::string, std::size_t> of_name;
    for (const auto& single : screening.singles) {
        const SystemTerm& term = terms[single.terms[0]];
        if (term.is_flexible && ++of_name[term.name] <= fitted_curves) list.push_back({current, single});
    }
    const bool from_afar = current.terms.empty();
    auto found = fitted(list, terms, from_afar);
    if (found.empty()) return found;
    sort_by_score(found);
    list.clear();
    std::set<std::string> forms;
    add_timing(found.front(), terms, forms, list);
    std::ranges::move(fitted(list, terms, from_afar), std::back_inserter(found));
    return found;
}

SystemCandidate SystemSearch::started(const Hypothesis& hypothesis, const std::vector<SystemTerm>& terms) const {
    const SystemCandidate& from = hypothesis.from;
    const ScreenedTerms& added = hypothesis.terms;
    SystemCandidate candidate{.model = from.model,
                              .values = {},
                              .terms = from.terms,
                              .texts = from.texts,
                              .library = std::max<std::size_t>(1, terms.size()),
                              .substeps = from.substeps};
    for (std::size_t i = 0; i < added.terms.size(); ++i) {
        std::string text;
        candidate.model = extended(candidate.model, terms[added.terms[i]], added.starts[i], &text);
        candidate.terms.push_back(terms[added.terms[i]]);
        candidate.texts.push_back(text);
    }
    const SystemFit fit_shown = fit_of(shown_, from.substeps);
    const double before = SystemFit::sum_of_squares(from.fitted);
    for (const double share : begun) {
        if (hypothesis.is_followed && share < 1) break;
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
        const double sum = SystemFit::sum_of_squares(fit_shown.errors(candidate.model, candidate.values));
        if (late() || sum <= before) break;
    }
    return candidate;
}

// With the size of its last term, where that is one value, which suits the beginnings of the records best. To first order a term that
// turns the motion into another one says nothing about its size.
std::optional<SystemCandidate> SystemSearch::sized(SystemCandidate candidate) const {
    const SystemTerm& term = candidate.terms.back();
    if (term.amplitudes != 1) return std::nullopt;
    std::vector<std::size_t> beginning;
    for (const std::size_t size : whole_) beginning.push_back(std::min(size, std::max(size / 12, shortest_beginning)));
    const SystemFit fit(shown_, scale_, between_, beginning);
    const std::size_t place = candidate.model.parameters.size() - term.parameters.size();
    const auto& amplitude = term.parameters.front();
    std::vector<std::vector<double>> sets;
    for (const double share : sizes) {
        sets.push_back(candidate.values);
        sets.back()[place] = std::clamp(term.neutral[0] + share * amplitude.scale, amplitude.low, amplitude.high);
    }
    const auto lanes = LaneFit::of(fit, candidate.model, sets.front(), candidate.substeps);
    if (!lanes) return std::nullopt;
    double best = std::numeric_limits<double>::infinity();
    const auto errors = lanes->errors(sets);
    for (std::size_t l = 0; l < sets.size(); ++l) {
        const double sum = SystemFit::sum_of_squares(errors[l]);
        if (sum >= best) continue;
        best = sum;
        candidate.values = sets[l];
    }
    if (!std::isfinite(best)) return std::nullopt;
    return candidate;
}

// With the first model's parameters and start values as they were given, and its terms as they are.
SystemCandidate SystemSearch::with_given_values(SystemCandidate candidate) const {
    const auto given = first_.values(records_.size());
    const auto own = static_cast<std::ptrdiff_t>(first_.parameters.size());
    std::copy_n(given.begin(), own, candidate.values.begin());
    std::copy(given.begin() + own, given.end(),
              candidate.values.begin() + static_cast<std::ptrdiff_t>(candidate.model.parameters.size()));
    return candidate;
}

std::vector<SystemCandidate> SystemSearch::fitted(const std::vector<Hypothesis>& list,
                                                  const std::vector<SystemTerm>& terms, bool from_afar) const {
    std::vector<SystemCandidate> start(list.size()), found(list.size());
    const auto sum = [&](std::size_t c) { return SystemFit::sum_of_squares(found[c].fitted); };
    const auto fit_each = [&](const std::vector<std::size_t>& some, const std::string& what, const auto& one) {
        for_each_index(some.size(), control_, fmt::format("{} {} hypotheses", what, some.size()), [&](std::size_t n) {
            if (!late()) one(some[n]);
        });
    };
    const auto take_if_better = [&](std::size_t c, SystemCandidate& other) {
        if (SystemFit::sum_of_squares(other.fitted) < sum(c)) found[c] = std::move(other);
    };
    const auto go_on_with = [&](std::size_t c, int steps) {
        SystemCandidate further = found[c];
        if (fit(further, steps)) take_if_better(c, further);
    };
    // From elsewhere, unless that leads to where it is.
    const auto try_from = [&](std::size_t c, SystemCandidate other, int steps, bool growing) {
        const FoundMinimum present{found[c].values, sum(c), found[c].fitted.size(), found[c].curvature};
        if (fit(other, steps, growing, &present)) take_if_better(c, other);
    };
    // The first ones of a sorted list, and further on the first ones of terms with one parameter each: after few iterations richer
    // terms are ahead, whatever is missing.
    const auto first_of = [&](const std::vector<std::size_t>& sorted, std::size_t count, std::size_t plain) {
        std::vector<std::size_t> some;
        for (const std::size_t c : sorted) {
            const auto& added = list[c].terms.terms;
            const bool is_plain =
                std::ranges::all_of(added, [&](std::size_t i) { return terms[i].parameters.size() == 1; }) &&
                std::ranges::all_of(list[c].from.terms,
                                    [](const SystemTerm& term) { return term.parameters.size() == 1; });
            if (some.size() < count || (is_plain && plain > 0)) some.push_back(c);
            if (is_plain && plain > 0) --plain;
        }
        return some;
    };
    // A few iterations of each show most of what it can do.
    std::vector<std::size_t> all(list.size());
    std::iota(all.begin(), all.end(), std::size_t{0});
    fit_each(all, "fitting", [&](std::size_t c) {
        start[c] = started(list[c], terms);
        if (!late()) try_from(c, start[c], first_iterations, false);
        if (late() || !from_afar || list[c].is_followed || list[c].terms.terms.size() > 1 || found[c].is_noise) return;
        if (auto other = sized(start[c])) try_from(c, *std::move(other), first_iterations, true);
        if (found[c].is_noise || late()) return;
        auto given = with_given_values(start[c]);
        auto other = sized(given);
        try_from(c, other ? *std::move(other) : std::move(given), first_iterations, false);
    });
    // The best go on. Of the others those of which screening promised most, and which fell short of it, begin anew.
    auto sorted = all;
    std::ranges::stable_sort(sorted, {}, sum);
    const auto go_on = first_of(sorted, gone_on, plain_gone_on);
    std::vector<std::size_t> begin_anew;
    for (const std::size_t c : all) {
        const double before = SystemFit::sum_of_squares(list[c].from.fitted);
        const double promised = list[c].terms.explained;
        const bool is_short = sum(c) > before * (1 - kept_promise * promised) && promised > worth_growing;
        if (list[c].is_followed || is_short) begin_anew.push_back(c);
    }
    std::stable_sort(begin_anew.begin(), begin_anew.end(), [&](std::size_t a, std::size_t b) {
        return std::pair(!list[a].is_followed, -list[a].terms.explained) <
               std::pair(!list[b].is_followed, -list[b].terms.explained);
    });
    begin_anew.resize(std::min(begin_anew.size(), grown));
    fit_each(begin_anew, "fitting growing records to", [&](std::size_t c) { try_from(c, start[c], iterations, true); });
    fit_each(go_on, "fitting the best", [&](std::size_t c) {
        if (found[c].is_noise || found[c].predicted.empty()) return;
        go_on_with(c, iterations);
        // Without the term the other values made up for it, and may have led into another minimum. So once more from the values
        // as they were given.
        if (found[c].is_noise || late() || !from_afar) return;
        try_from(c, with_given_values(found[c]), iterations, true);
    });
    // What promises most is followed to its minimum, in whatever valley of values it lies: a few percent decide.
    std::erase_if(sorted, [&](std::size_t c) { return found[c].predicted.empty() || found[c].is_noise; });
    std::ranges::stable_sort(sorted, {}, [&](std::size_t c) { return found[c].score(); });
    fit_each(first_of(sorted, polished, plain_polished), "fitting to the end",
             [&](std::size_t c) { go_on_with(c, last_iterations); });
    std::erase_if(found, [](const SystemCandidate& c) { return c.predicted.empty(); });
    return found;
}

SystemCandidate SystemSearch::without(const SystemCandidate& candidate, std::size_t term) const {
    return with_others(candidate, {term}, candidate, candidate.terms.size());
}

SystemCandidate SystemSearch::with_others(const SystemCandidate& candidate, const std::set<std::size_t>& left_out,
                                          const SystemCandidate& other, std::size_t first) const {
    // Built again from the first model, its values where they are.
    SystemCandidate made{.model = first_,
                         .library = std::max(candidate.library, other.library),
                         .substeps = std::max(candidate.substeps, other.substeps)};
    const auto place = [&](const SystemCandidate& one, std::size_t end) {
        std::size_t begin = first_.parameters.size();
        for (std::size_t t = 0; t < end; ++t) begin += one.terms[t].parameters.size();
        return one.values.begin() + static_cast<std::ptrdiff_t>(begin);
    };
    made.values.assign(candidate.values.begin(), place(candidate, 0));
    made.values.insert(made.values.end(), place(candidate, candidate.terms.size()), candidate.values.end());
    const auto add = [&](const SystemCandidate& from, std::size_t t) {
        const std::vector<double> own(place(from, t), place(from, t + 1));
        std::string text;
        made.values = more_values(made.model, made.values, own);
        made.model = extended(made.model, from.terms[t], own, &text);
        made.terms.push_back(from.terms[t]);
        made.texts.push_back(text);
    };
    for (std::size_t t = 0; t < candidate.terms.size(); ++t) {
        if (!left_out.contains(t)) add(candidate, t);
    }
    for (std::size_t t = first; t < other.terms.size(); ++t) add(other, t);
    return made;
}

SystemCandidate SystemSearch::pruned(SystemCandidate candidate) const {
    for (std::size_t i = 0; candidate.terms.size() > 1 && i < candidate.terms.size() && !late();) {
        SystemCandidate less = without(candidate, i);
        if (fit(less, iterations) &&
            (less.score() < dispensable * candidate.score() || candidate.is_chance_beside(less))) {
            candidate = std::move(less);
            i = 0;
        } else {
            ++i;
        }
    }
    return candidate;
}

std::optional<SystemCandidate> SystemSearch::simplified(const SystemCandidate& candidate) const {
    std::optional<SystemCandidate> simpler;
    for (std::size_t i = 0; i < candidate.terms.size() && !late(); ++i) {
        const SystemCandidate& present = simpler ? *simpler : candidate;
        const std::size_t own = present.terms[i].parameters.size();
        if (own == 1) continue;
        // Not fitted without the term: the other values are right beside it.
        SystemCandidate less = without(present, i);
        less.fitted = fit_of_shown().errors(less.model, less.values);
        if (less.fitted.empty()) continue;
        const auto terms = terms_beside(less, false);
        std::vector<Hypothesis> list;
        std::set<std::string> forms;
        for (const auto& single : screened_singles(less.model, less.values, less.fitted, terms,
                                                   fit_of(shown_, less.substeps), control_, late_)) {
            const SystemTerm& term = terms[single.terms[0]];
            if (term.parameters.size() >= own || !forms.insert(term.form()).second) continue;
            list.push_back({less, single});
            if (list.size() == alternatives) break;
        }
        std::optional<SystemCandidate> best;
        for (auto& other : fitted(list, terms, false)) {
            const bool is_as_good = other.is_noise >= present.is_noise && other.score() < dispensable * present.score();
            if (is_as_good && (!best || other.score() < best->score())) best = std::move(other);
        }
        if (best) simpler = std::move(best);
    }
    return simpler;
}

SystemCandidate SystemSearch::with_given_signs(SystemCandidate candidate) const {
    const auto given = first_.values(records_.size());
    SystemCandidate same = candidate;
    bool has_changed = false;
    for (std::size_t p = 0; p < first_.parameters.size(); ++p) {
        if (given[p] * same.values[p] >= 0) continue;
        same.values[p] = -same.values[p];
        has_changed = true;
    }
    keep_signs(same.model, given);
    const bool is_as_good = has_changed && fit(same, iterations) && same.is_noise >= candidate.is_noise &&
                            same.score() < as_good_with_signs * candidate.score();
    if (!is_as_good) return candidate;
    same.model = candidate.model;
    return same;
}

std::optional<SystemCandidate> SystemSearch::exchanged(const SystemCandidate& candidate) const {
    std::optional<SystemCandidate> better;
    if (candidate.terms.size() < 2) return better; // all alone were tried
    for (int exchange = 0; exchange < max_exchanges; ++exchange) {
        const SystemCandidate& present = better ? *better : candidate;
        std::optional<SystemCandidate> best;
        for (std::size_t i = 0; i < present.terms.size() && !present.is_noise && !late(); ++i) {
            SystemCandidate less = without(present, i);
            if (!fit(less, iterations)) continue;
            const auto terms = terms_beside(less, true);
            std::vector<Hypothesis> list;
            std::set<std::string> forms = {present.terms[i].form()};
            for (const auto& single : screened_singles(less.model, less.values, less.fitted, terms,
                                                       fit_of(shown_, less.substeps), control_, late_)) {
                if (!forms.insert(terms[single.terms[0]].form()).second) continue;
                list.push_back({less, single});
                if (list.size() == alternatives) break;
            }
            for (auto& other : fitted(list, terms, false)) {
                if (other.score() < worth_exchanging * (best ? *best : present).score()) best = std::move(other);
            }
        }
        if (!best) break;
        better = std::move(best);
    }
    return better;
}

} // namespace tribode
