#include "tribode/diagnosis/system_diagnosis.hpp"
#include "tribode/base/error.hpp"
#include "tribode/base/quantity.hpp"
#include "tribode/diagnosis/inner_signals.hpp"
#include "tribode/diagnosis/prediction_statistics.hpp"
#include "tribode/diagnosis/processor_time.hpp"
#include "tribode/diagnosis/system_record.hpp"
#include "tribode/diagnosis/system_step.hpp"

#include <algorithm>
#include <cmath>
#include <fmt/format.h>
#include <functional>
#include <limits>
#include <map>
#include <memory>
#include <numeric>
#include <set>

namespace tribode {

namespace {

// Of the budget, what the search may take, and where all fits end.
constexpr double search_share = 0.7, fit_share = 0.95;
// How often the search goes on without what the validation records refused. Each attempt must be surer, as several are looked at.
// After some of them only simpler ones count.
constexpr std::size_t max_rich_attempts = 3, max_attempts = 5;
// Of the fits to whole records: values that nearly make up for each other take many.
constexpr int final_iterations = 100;
constexpr double told_from_nothing = 2; // standard errors that what is there must have
constexpr double off_by_chance = 3;     // standard deviations of a prediction; more are one of 400
constexpr double noise_alone = 1.1;     // of the noise
constexpr std::size_t max_terms = 12;
// Compared on the validation records: how many, and by how much their scores may be larger than that of what was found. Where nothing
// was, how many of them may have a term in common.
constexpr std::size_t max_compared = 6, max_curves = 3, max_sharing = 2;
constexpr double likely_score = 3, possible_score = 10;
// Gap over the floor of a model that lacks nothing.
constexpr double nothing_left = 1.5;
constexpr double least_evidence = convincing / 2; // of the records, for a step to count
constexpr double half = 0.5;                      // of the squared gap, for a partial explanation
constexpr double more = 1.5, far_more = 4;        // times the gap of the fitted records
constexpr double least_part = 0.2;                // of a validation record, to be fitted or to be compared
// Of a name: the library may lack the right one. More so where much is left.
constexpr double most_certain = 0.98, most_certain_of_a_part = 0.75;

// A model that the validation records refused, its terms, how many of them were new, and why. Beside other terms the new ones may do
// better.
struct Refusal {
    SystemCandidate candidate;
    std::set<std::string> kinds;
    std::size_t fresh;
    std::string why;
};

class Diagnoser {
  public:
    Diagnoser(const SystemModel& model, std::vector<SystemRecord> records, std::vector<SystemRecord> validation,
              const SystemDiagnosisOptions& options, const RunControl& control)
        : model_(with_inner_signals(model)),
          records_(std::move(records)),
          validation_(std::move(validation)),
          options_(options),
          control_(control) {
        // Without another record, the last third of the first one takes no part in the search.
        if (validation_.empty()) {
            divided_ = records_.front();
            divided_at_ = 2 * records_.front().size() / 3;
            records_.front() = records_.front().head(divided_at_);
        }
    }

    // Fits the model as it was given.
    void begin() {
        search_.emplace(model_, records_, scales(), ended_after(search_share), control_);
        steps_.push_back({.candidate = search_->begin()});
        std::vector<SystemRecord> predicted = validation_;
        if (divided_) predicted.push_back(divided_->part(divided_at_, divided_->size() - divided_at_));
        stretches_ = {stretches_of(model_, search_->searched()), stretches_of(model_, predicted)};
        stop_if_asked();
    }

    const std::vector<double>& scale() const { return search_->scale(); }
    bool leaves_noise() const { return steps_.back().candidate.is_noise; }

    // Squared errors over the scales of the outputs: their mean on the fitted records, and each sample's on the first validation record.
    struct Left {
        double fitted = 0;
        std::vector<double> on_validation;
    };

    // After begin(), with validation records: what the model as it was given leaves on these and on the first `fitted` of the fitted ones.
    Left left_at_first(std::size_t fitted, const std::vector<double>& scale) {
        scale_ = search_->scale();
        between_ = search_->interpolation();
        const Judged first = judged_first(*search_);
        Left left{0, squares_of_samples(first.validation.front(), scale)};
        double samples = 0;
        for (std::size_t r = 0; r < fitted; ++r) {
            const auto squares =
                squares_of_samples(against_first(records_[r], 0, first.values, r, steps_.front().candidate), scale);
            left.fitted += std::accumulate(squares.begin(), squares.end(), 0.0);
            samples += static_cast<double>(squares.size());
        }
        left.fitted /= samples;
        return left;
    }

    // Behind which sample half of the squared errors lie. Not near its ends, so that both parts tell something.
    static std::size_t middle_of(const std::vector<double>& squares) {
        const double all = std::accumulate(squares.begin(), squares.end(), 0.0);
        double sum = 0;
        std::size_t middle = 0;
        while (middle < squares.size() && sum <= 0.5 * all) sum += squares[middle++];
        const auto least = static_cast<std::size_t>(least_part * static_cast<double>(squares.size()));
        return std::clamp(middle, least, squares.size() - least);
    }

    // After begin().
    SystemDiagnosis run() {
        SystemSearch& search = *search_;
        for (std::size_t attempt = 1; attempt <= max_attempts; ++attempt) {
            if (attempt > max_rich_attempts) most_new_ = std::max<std::size_t>(1, fewest_refused() - 1);
            extend(search);
            result_.out_of_time = search.late();
            const bool is_last = attempt == max_attempts || result_.out_of_time;
            if (confirm(search, 1 - (1 - sure_enough) / static_cast<double>(attempt), is_last)) break;
            // What is fitted cannot tell what only the others show.
            if (steps_.size() == 1 && shows_more_on_validation(search, attempt > 1 ? more : far_more)) break;
        }
        compare_on_validation(search);
        weigh_on_validation(search);
        weigh_earlier_steps(search);
        take_doubtful(search);
        stop_if_asked();
        count_all_samples(search);
        name_effects(search);
        result_.where = where_the_gap_is(result_.validation.front(), model_);
        decide();
        const bool is_undecided = result_.verdict == "undecided" || result_.verdict == "partial" ||
                                  std::ranges::any_of(result_.effects, &SystemEffect::is_open);
        for (std::size_t s = 1; s < steps_.size(); ++s) {
            const SystemStep& step = steps_[s];
            if (!is_undecided || result_.next_experiment) continue;
            const SystemCandidate& one = step.contenders.front();
            std::vector<SystemCandidate> others(step.contenders.begin() + 1, step.contenders.end());
            if (step.evidence < convincing) others.push_back(steps_[s - 1].candidate);
            if (others.empty()) continue;
            result_.next_experiment =
                next_system_experiment(one, others, records_, scale_, between_, rms_of_errors(one.predicted), control_);
            if (!result_.next_experiment) continue;
            std::string names;
            for (const auto& other : others) {
                const std::string own = other.names_from(step.before);
                names += (names.empty() ? "" : ", ") + (own.empty() ? "nothing" : own);
            }
            auto& text = result_.next_experiment->text;
            text = fmt::format("To tell {} from {}: {}", one.names_from(step.before), names, text);
        }
        const Gap& gap = result_.validation_gap;
        const bool is_left = gap.is_left() && (!result_.out_of_time || result_.effects.empty());
        const Gap& fitted = result_.fitted_gap;
        const bool is_in_both = result_.effects.empty() && fitted.is_left();
        const bool is_here_only =
            steps_.back().candidate.is_noise || gap.after > (is_in_both ? more : far_more) * fitted.after;
        is_in_validation_only_ = is_left && is_here_only && !divided_ && !control_.stop_requested();
        middle_of_what_is_left_ = middle_of(squares_of_samples(result_.validation.front(), scale_));
        values_explain_it_ = gap.after <= little_left * std::hypot(gap.floor, result_.prediction_uncertainty);
        return std::move(result_);
    }

    // After run(): the fitted records leave nothing but noise, or little beside what the validation records leave.
    bool is_seen_in_validation_only() const { return is_in_validation_only_; }

    // After run(): of the first validation record, see middle_of().
    std::size_t middle_of_what_is_left() const { return middle_of_what_is_left_; }

    // After run(): what is left on the validation records may be due to the uncertainty of the values.
    bool values_explain_it() const { return values_explain_it_; }

  private:
    // Whether to end what may take this share of the budget.
    std::function<bool()> ended_after(double share) const {
        return [this, share] { return control_.stop_requested() || time_.seconds() > share * options_.budget; };
    }

    void stop_if_asked() const {
        if (!control_.stop_requested()) return;
        std::string found = steps_.back().candidate.names_from(0);
        throw EndedEarly(fmt::format("interrupted, nothing is written; so far {}",
                                     found.empty() ? "nothing has been found" : "found: " + found));
    }

    static std::vector<double> squares_of_samples(const SystemComparison& comparison,
                                                  const std::vector<double>& scale) {
        const std::size_t samples = comparison.record.size();
        const auto errors = comparison.errors(comparison.after, scale);
        std::vector<double> squares(samples, 0);
        for (std::size_t i = 0; i < errors.size(); ++i) {
            if (std::isfinite(errors[i])) squares[i % samples] += errors[i] * errors[i]; // else it was not measured
        }
        return squares;
    }

    // The standard deviation of each output over the records.
    std::vector<double> scales() const {
        std::vector<double> scale;
        for (std::size_t o = 0; o < model_.measured.size(); ++o) {
            double sum = 0, squares = 0, count = 0;
            for (const auto& record : records_) {
                for (const double y : record.outputs[o]) {
                    sum += y;
                    ++count;
                }
            }
            const double mean = sum / count;
            for (const auto& record : records_) {
                for (const double y : record.outputs[o]) squares += (y - mean) * (y - mean);
            }
            const double spread = std::sqrt(squares / count);
            if (!(spread > 1e-12 * std::abs(mean))) {
                throw InputError(fmt::format("{}: {} does not move, so it tells nothing about the system",
                                             records_.front().source, measured_name(model_, o)));
            }
            scale.push_back(spread);
        }
        return scale;
    }

    // Whether it may take the place of the current model if it gains.
    bool is_allowed(const SystemCandidate& candidate, const SystemCandidate& current) const {
        return candidate.score() < current.score() && !is_too_rich(candidate) &&
               !has_too_many_new(candidate, current) && !refused(candidate) && !candidate.is_chance_beside(current);
    }

    // Beside what the fitted records show, too.
    bool shows_more_on_validation(const SystemSearch& search, double ratio) const {
        const double fitted = rms_of_errors(steps_.back().on_fitted);
        return fitted > little_left * search.fit_of_all_samples(between_).noise() &&
               rms_of_errors(steps_.back().on_validation) > ratio * fitted;
    }

    // Adds terms while they predict what was not fitted better.
    void extend(SystemSearch& search) {
        std::set<std::string> kinds;
        for (const auto& kind : kinds_of(steps_.back().candidate)) kinds.insert(kind);
        while (kinds.size() < options_.max_effects && steps_.back().candidate.terms.size() < max_terms) {
            SystemStep& last = steps_.back();
            const SystemCandidate& current = last.candidate;
            if (current.is_noise) break; // nothing is left to find
            if (!last.tried) {
                if (search.late()) break;
                last.tried = search.next(current);
            }
            const auto& found = *last.tried;
            stop_if_asked();
            if (found.empty()) break;
            std::vector<Improvement> gains;
            std::vector<std::size_t> passed;
            const auto judge = [&](std::size_t i) {
                gains.push_back(improvement_of(found[i], current));
                if (gains[i].passes() && is_allowed(found[i], current)) passed.push_back(i);
            };
            for (std::size_t i = 0; i < found.size(); ++i) judge(i);
            auto chosen = simplest(found, passed, search.errors());
            SystemCandidate taken;
            if (chosen) {
                taken = found[*chosen];
                search.reconsider_inputs(taken);
                taken = search.pruned(search.with_given_signs(std::move(taken)));
                for (const auto& changed : {&SystemSearch::simplified, &SystemSearch::exchanged}) {
                    auto other = (search.*changed)(taken);
                    if (!other) continue;
                    last.tried->push_back(*other);
                    judge(found.size() - 1);
                    if (passed.back() + 1 != found.size()) continue;
                    chosen = passed.back();
                    taken = *std::move(other);
                    std::ranges::stable_sort(passed, {}, [&](std::size_t i) { return found[i].score(); });
                }
            }
            tell(last, gains, chosen);
            if (!chosen) {
                // What the validation records were asked about says more.
                for (std::size_t i = 0; i < found.size() && refused_.empty(); ++i) {
                    if (!(gains[i].share > 0)) continue;
                    result_.nearest = {found[i].names_from(kept_of(found[i], current)), gains[i].share};
                    break;
                }
                break;
            }
            SystemStep step{
                .candidate = std::move(taken), .gain = gains[*chosen].share, .certainty = gains[*chosen].certainty};
            std::vector<double> scores;
            for (const auto& one : found) scores.push_back(one.score());
            step.weigh(current, found, passed, *chosen, scores, independent_errors(found[*chosen]), search.errors());
            for (const auto& term : step.candidate.terms) kinds.insert(term.kind());
            step.before = kept_of(step.candidate, current);
            if (step.candidate.score() >= current.score()) break;
            steps_.push_back(std::move(step));
        }
    }

    bool is_too_rich(const SystemCandidate& candidate) const {
        const auto names = kinds_of(candidate);
        return std::set(names.begin(), names.end()).size() > options_.max_effects;
    }

    bool has_too_many_new(const SystemCandidate& candidate, const SystemCandidate& current) const {
        return candidate.terms.size() > current.terms.size() + most_new_;
    }

    // Terms of the simplest step that the validation records refused.
    std::size_t fewest_refused() const {
        std::size_t fewest = max_terms;
        for (const Refusal& refusal : refused_) fewest = std::min(fewest, refusal.fresh);
        return fewest;
    }

    void tell(SystemStep& step, const std::vector<Improvement>& gains, std::optional<std::size_t> chosen) {
        const auto& current = step.candidate;
        const auto& found = *step.tried;
        // One more may be tried after those of later steps were told.
        while (step.told.size() < found.size()) {
            step.told.push_back(result_.hypotheses.size());
            result_.hypotheses.emplace_back();
        }
        for (std::size_t i = 0; i < found.size(); ++i) {
            SystemHypothesis one{kinds_of(found[i]),
                                 kept_of(found[i], current),
                                 found[i].score(),
                                 rms_of_errors(found[i].fitted),
                                 rms_of_errors(found[i].predicted),
                                 ""};
            const double fitted = 1 - one.fitted / rms_of_errors(current.fitted);
            if (chosen == i) {
                // taken
            } else if (gains[i].share < 0) {
                one.lost =
                    fmt::format("{} the error of the fit by {:.0f} % and raises that of the prediction by {:.0f} %",
                                fitted < 0 ? "raises" : "lowers", 100 * std::abs(fitted), -100 * gains[i].share);
            } else if (gains[i].share <= min_gain) {
                one.lost = fmt::format("predicts the rest of the records only {:.1f} % better", 100 * gains[i].share);
            } else if (gains[i].certainty <= sure_enough) {
                one.lost = fmt::format("predicts better with a probability of only {:.2f}", gains[i].certainty);
            } else if (found[i].is_chance_beside(current)) {
                one.lost = "explains no more than the best of so many frequencies does of random errors";
            } else if (const Refusal* refusal = refused(found[i])) {
                one.lost = refusal->why;
            } else if (has_too_many_new(found[i], current)) {
                one.lost = fmt::format("brings {} terms, and the validation record refused simpler ones",
                                       found[i].terms.size() - current.terms.size());
            } else if (is_too_rich(found[i])) {
                one.lost = fmt::format("has more than {} kinds of terms", options_.max_effects);
            } else if (!chosen) {
                one.lost = "its parameters cost more than it gains";
            } else {
                one.lost = fmt::format("promises an error {:.0f} % {} than the one taken, with {} parameters instead "
                                       "of {}",
                                       100 * std::abs(one.score / found[*chosen].score() - 1),
                                       one.score < found[*chosen].score() ? "smaller" : "larger",
                                       found[i].model.parameters.size(), found[*chosen].model.parameters.size());
            }
            result_.hypotheses[step.told[i]] = std::move(one);
        }
    }

    // Whether it has all terms of a model that the validation records refused, or is that model in other words.
    const Refusal* refused(const SystemCandidate& candidate) const {
        const auto kinds = kinds_from(candidate, 0);
        for (const Refusal& refusal : refused_) {
            if (std::ranges::includes(kinds, refusal.kinds) || candidate.equals(refusal.candidate)) return &refusal;
        }
        return nullptr;
    }

    // `share`: of the gap on the validation records that it explains.
    void refuse(const SystemStep& step, double share, const std::string& why) {
        const auto names = kinds_of(step.candidate);
        for (auto& hypothesis : result_.hypotheses) {
            if (hypothesis.lost.empty() && hypothesis.names == names) hypothesis.lost = why;
        }
        if (refused_.empty() || !result_.nearest || share > result_.nearest->second) {
            result_.nearest = {step.candidate.names_from(step.before), share};
        }
        const auto first_new = std::min(step.before, names.size() - 1);
        refused_.push_back({step.candidate, kinds_from(step.candidate, 0), names.size() - first_new, why});
    }

    static std::string why_not_confirmed(const Improvement& gain, double sure_here) {
        if (!std::isfinite(gain.share)) return "cannot be simulated on the validation record";
        if (gain.share > 0 && gain.certainty >= sure_here) {
            return fmt::format("predicts the validation record {:.1f} % better, which random forces explain as well",
                               100 * gain.share);
        }
        if (gain.share > 0) {
            return fmt::format("predicts the validation record {:.1f} % better, with a probability of only {:.2f}",
                               100 * gain.share, gain.certainty);
        }
        return fmt::format("raises the error on the validation record by {:.1f} %", -100 * gain.share);
    }

    // Of the terms of a model from this one on, those that have amplitudes none of which is told from nothing.
    static std::vector<std::size_t> unsure_terms(const SystemCandidate& candidate, std::size_t first,
                                                 const std::vector<double>& values,
                                                 const std::vector<double>& deviation) {
        std::vector<std::size_t> unsure;
        std::size_t place = candidate.model.parameters.size();
        for (const auto& term : candidate.terms) place -= term.parameters.size();
        for (std::size_t t = 0; t < candidate.terms.size(); ++t) {
            const auto& term = candidate.terms[t];
            bool is_sure = t < first;
            for (std::size_t p = 0; p < term.amplitudes; ++p) {
                const double size = std::abs(values[place + p] - term.neutral[p]);
                is_sure = is_sure || size > told_from_nothing * deviation[place + p];
            }
            if (!is_sure) unsure.push_back(t);
            place += term.parameters.size();
        }
        return unsure;
    }

    // A model fitted to all of the fitted records, and simulated on the validation records.
    struct Judged {
        std::vector<double> values, errors;
        std::vector<SystemComparison> validation;
        std::vector<std::vector<double>> validation_values; // of each comparison
    };

    // Whether the fitted records are worse without these parameters by more than chance. What they are good for may be told where
    // their size is not: above its edge a tank may lose little or all.
    static bool needs(const Judged& with, const Judged& without, std::size_t parameters) {
        if (without.errors.empty()) return false;
        const double independent = static_cast<double>(with.errors.size()) / correlation_length(with.errors);
        const double gain =
            independent * std::log(SystemFit::sum_of_squares(without.errors) / SystemFit::sum_of_squares(with.errors));
        return gain > told_from_nothing * told_from_nothing * static_cast<double>(parameters);
    }

    // Whether the terms from this one on are all told from nothing, by their sizes or by what the fitted records are without them.
    bool are_sure(const SystemSearch& search, const SystemCandidate& candidate, std::size_t first,
                  const Judged& fitted) const {
        const auto deviation = search.fit_of_all().standard_errors(candidate.model, fitted.values, fitted.errors);
        return std::ranges::all_of(unsure_terms(candidate, first, fitted.values, deviation), [&](std::size_t t) {
            return needs(fitted, judged(search, search.without(candidate, t)), candidate.terms[t].parameters.size());
        });
    }

    struct PoorTerm {
        std::size_t term, step;
        std::string why;
    };

    // Of the terms that the steps behind `before` brought, up to `last`: one that neither its size nor the validation records tell
    // from nothing, so that others do as well in its place; or, of several, one without which these are predicted better.
    std::optional<PoorTerm> poor_term(const SystemSearch& search, std::size_t before, std::size_t last,
                                      const Judged& fitted) {
        const SystemCandidate& candidate = steps_[last].candidate;
        const std::size_t first_new = steps_[before + 1].before;
        if (first_new + 1 >= candidate.terms.size())
            return std::nullopt; // the validation records have told the only one
        std::vector<SystemCandidate> without;
        std::vector<const SystemCandidate*> list;
        // A later step may have taken the place of earlier terms.
        std::size_t first = first_new;
        for (std::size_t s = before + 1; s <= last; ++s) first = std::min(first, steps_[s].before);
        for (std::size_t t = first; t < candidate.terms.size(); ++t) without.push_back(search.without(candidate, t));
        for (const auto& one : without) list.push_back(&one);
        const auto all = judged(search, list, ended_after(fit_share));
        const auto errors_without = [&](std::size_t term) {
            const auto& less = all[term - first];
            return !less || less->errors.empty() ? std::vector<double>{} : errors_after(less->validation);
        };
        const auto now = errors_after(fitted.validation);
        const auto deviation = search.fit_of_all().standard_errors(candidate.model, fitted.values, fitted.errors);
        for (std::size_t s = before + 1; s <= last; ++s) {
            for (const std::size_t t : unsure_terms(candidate, steps_[s].before, fitted.values, deviation)) {
                const auto& without_it = all[t - first];
                if (without_it && needs(fitted, *without_it, candidate.terms[t].parameters.size())) continue;
                const auto less = errors_without(t);
                if (less.empty() || probability_of_gain(less, now) >= sure_enough) continue;
                return PoorTerm{t, s, "has a term whose size is not told from nothing"};
            }
        }
        for (std::size_t t = first_new; t < candidate.terms.size(); ++t) {
            const auto less = errors_without(t);
            if (less.empty() || probability_of_gain(now, less) < sure_enough) continue;
            return PoorTerm{
                t, last,
                fmt::format("the validation record is predicted better without {}", candidate.terms[t].kind())};
        }
        return std::nullopt;
    }

    // The step's model without the term, if it predicts the validation records better than the model `before` for sure. Otherwise
    // nothing changes, and the result is false.
    bool drop(const SystemSearch& search, std::size_t term, const SystemStep& before, Judged& fitted, double sure_here,
              SystemStep& step) {
        SystemCandidate less = search.without(step.candidate, term);
        if (less.terms.size() <= steps_.front().candidate.terms.size()) return false;
        Judged one = judged(search, less);
        if (one.errors.empty()) return false;
        const auto now = errors_after(one.validation);
        const double certainty = probability_of_gain(before.on_validation, now);
        less.values = one.values; // from where it is fitted again, as far as there is time
        if (certainty < sure_here || !search.fit(less)) return false;
        SystemStep changed{.candidate = less, .before = kept_of(less, before.candidate)};
        weigh_beside(changed, before, search);
        changed.confirmed = certainty;
        changed.on_validation = now;
        changed.on_fitted = one.errors;
        changed.evidence = evidence(before, changed, stretches_, result_.hypotheses.size());
        changed.candidate.values = one.values;
        step = std::move(changed);
        fitted = std::move(one);
        for (auto& hypothesis : result_.hypotheses) {
            if (hypothesis.names == kinds_of(step.candidate)) hypothesis.lost.clear();
        }
        return true;
    }

    // The step's model among what was tried beside the model `before`.
    void weigh_beside(SystemStep& step, const SystemStep& before, const SystemSearch& search) const {
        const auto& current = before.candidate;
        std::vector<SystemCandidate> found = {step.candidate};
        if (before.tried) {
            std::ranges::copy_if(*before.tried, std::back_inserter(found), [&](const SystemCandidate& one) {
                return improvement_of(one, current).passes() && is_allowed(one, current) &&
                       kinds_from(one, 0) != kinds_from(step.candidate, 0);
            });
        }
        std::vector<std::size_t> passed(found.size());
        std::iota(passed.begin(), passed.end(), std::size_t{0});
        std::vector<double> scores;
        for (const auto& one : found) scores.push_back(one.score());
        std::ranges::stable_sort(passed, {}, [&](std::size_t i) { return scores[i]; });
        const Improvement gain = improvement_of(step.candidate, current);
        step.gain = gain.share;
        step.certainty = gain.certainty;
        step.weigh(current, found, passed, 0, scores, independent_errors(step.candidate), search.errors());
    }

    // Each step fitted to all of the fitted records and simulated on the validation records. The last one stays that predicts
    // these better than the last before it that does, with the probability `sure_here`; what comes behind it is dropped. False where
    // something is. `is_last`: nothing is sought in the place of what is dropped.
    bool confirm(const SystemSearch& search, double sure_here, bool is_last) {
        scale_ = search.scale();
        between_ = result_.interpolation = search.interpolation();
        // What a step does not show for sure it may show together with the next ones.
        std::vector<Judged> of_step;
        of_step.push_back(judged_first(search));
        std::vector<const SystemCandidate*> later;
        for (std::size_t s = 1; s < steps_.size(); ++s) later.push_back(&steps_[s].candidate);
        for (auto& one : judged(search, later, [] { return false; })) of_step.push_back(*std::move(one));
        steps_.front().on_validation = errors_after(of_step.front().validation);
        steps_.front().on_fitted = of_step.front().errors;
        std::size_t kept = 0, before_kept = 0;
        const std::size_t all = steps_.size();
        std::vector<Improvement> gains(all);
        for (std::size_t s = 1; s < all; ++s) {
            const auto before = errors_after(of_step[kept].validation), now = errors_after(of_step[s].validation);
            gains[s] = {1 - rms_of_errors(now) / rms_of_errors(before), probability_of_gain(before, now)};
            steps_[s].on_validation = now;
            steps_[s].on_fitted = of_step[s].errors;
            steps_[s].evidence = evidence(steps_[kept], steps_[s], stretches_, result_.hypotheses.size());
            const bool is_more = gains[s].share > 0 && gains[s].certainty >= sure_here;
            if (is_more && s == 1 && steps_[s].evidence < least_evidence) remember_doubtful(of_step[s], gains[s]);
            if (!is_more || steps_[s].evidence < least_evidence) continue;
            before_kept = kept;
            while (kept < s) {
                steps_[++kept].confirmed = gains[s].certainty;
                steps_[kept].evidence = steps_[s].evidence;
            }
        }
        if (kept + 1 < all) {
            const Improvement& gain = gains[kept + 1];
            refuse(steps_[kept + 1], std::isfinite(gain.share) ? std::max(gain.share, 0.0) : 0.0,
                   why_not_confirmed(gain, sure_here));
        }
        bool is_changed = false;
        while (kept > before_kept && (kept + 1 == all || is_last)) {
            const auto poor = poor_term(search, before_kept, kept, of_step[kept]);
            if (!poor) break;
            refuse(steps_[poor->step], std::max(gains[poor->step].share, 0.0), poor->why);
            // What is left of the model does as well.
            if (drop(search, poor->term, steps_[before_kept], of_step[kept], sure_here, steps_[kept])) {
                is_changed = true;
                continue;
            }
            kept = before_kept;
        }
        for (std::size_t s = kept + 1; s < all; ++s) {
            if (steps_[s].tried) std::ranges::copy(*steps_[s].tried, std::back_inserter(dropped_));
        }
        steps_.resize(kept + 1);
        conclude(search, std::move(of_step[kept]));
        const bool goes_on = is_changed && !steps_.back().candidate.is_noise && !search.late();
        return kept + 1 == all && !goes_on;
    }

    // The first step explains most of what is much on the validation records, and random forces do as well.
    void remember_doubtful(const Judged& fitted, const Improvement& gain) {
        const Gap gap = total_gap(fitted.validation);
        if (gap.before < little_left * gap.floor || gap.explained() < half) return;
        if (doubtful_ && rms_of_errors(doubtful_->step.on_validation) <= rms_of_errors(steps_[1].on_validation)) return;
        doubtful_ = Doubtful{steps_[1], fitted, between_};
        doubtful_->step.confirmed = gain.certainty;
    }

    // Its errors are those with the course that inputs had between samples then.
    bool has_doubtful() const { return doubtful_ && doubtful_->between == between_; }

    // Where nothing better was found, it is the answer, though an undecided one.
    void take_doubtful(const SystemSearch& search) {
        if (steps_.size() > 1 || !has_doubtful()) return;
        const auto names = kinds_of(doubtful_->step.candidate);
        for (auto& hypothesis : result_.hypotheses) {
            if (hypothesis.names == names) hypothesis.lost.clear();
        }
        steps_.push_back(std::move(doubtful_->step));
        conclude(search, std::move(doubtful_->fitted));
    }

    // Whether errors decrease by more than further parameters do by chance, of so many models: as for the evidence of a step.
    bool is_worth_its_price(const SystemCandidate& candidate, std::size_t parameters,
                            const std::vector<double>& without, const std::vector<double>& with,
                            std::size_t models) const {
        if (candidate.model.parameters.size() <= parameters) return true;
        const auto further = static_cast<double>(candidate.model.parameters.size() - parameters);
        return evidence(likelihood_gain(without, with, stretches_.predicted), with.size(), further, models) > 1;
    }

    // Where more than noise is left, the search judges by what the model still lacks, too; and what leaves noise and predicts
    // badly may be off in what the fitted records hardly show. So of what it found likely the simplest, no
    // richer than the last model, and the best are fitted to the whole records, and what predicts the validation records better than
    // the last model for sure takes its place.
    void compare_on_validation(const SystemSearch& search) {
        const SystemCandidate& last = steps_.back().candidate;
        const Gap& gap = result_.validation_gap;
        if (last.is_noise && gap.after < nothing_left * gap.floor) return;
        const bool is_little = result_.fitted_gap.before < little_left * result_.fitted_gap.floor;
        if (steps_.size() < 2 && (is_little || has_doubtful())) return;
        struct Contender {
            const SystemCandidate* candidate;
            std::size_t step;          // behind which it comes
            std::size_t chosen_of = 0; // so many
            bool is_foreseen = false;  // by its predictions
        };
        const auto last_kinds = kinds_from(last, 0);
        std::vector<Contender> simple, rich, unlikely, others;
        const auto add = [&](const std::vector<SystemCandidate>& tried, std::size_t step) {
            for (const auto& one : tried) {
                const bool is_possible = one.score() < possible_score * last.score() &&
                                         !one.is_chance_beside(steps_[step].candidate) && !refused(one) &&
                                         !is_too_rich(one);
                const bool is_longer = !last.terms.empty() && std::ranges::includes(kinds_from(one, 0), last_kinds);
                if (!is_possible || is_longer) continue;
                const bool is_simple = one.model.parameters.size() <= last.model.parameters.size();
                const bool is_likely = one.score() < likely_score * last.score();
                (!is_likely ? unlikely : is_simple ? simple : rich).push_back({&one, step});
            }
        };
        for (std::size_t s = 0; s < steps_.size(); ++s) {
            if (steps_[s].tried) add(*steps_[s].tried, s);
        }
        add(dropped_, 0);
        std::ranges::stable_sort(simple, {}, [](const Contender& one) {
            return std::pair(one.candidate->model.parameters.size(), one.candidate->score());
        });
        for (auto* list : {&rich, &unlikely}) {
            std::ranges::stable_sort(*list, {}, [](const Contender& one) { return one.candidate->score(); });
        }
        std::set<std::set<std::string>> known;
        std::map<std::string, std::size_t> sharing;
        std::vector<const SystemCandidate*> kept;
        for (auto* list : {&simple, &rich}) {
            std::erase_if(*list, [&](const Contender& one) {
                const auto kinds = kinds_from(*one.candidate, 0);
                if (!known.insert(kinds).second) return true;
                // The same in other words would take the place of another.
                const auto is_same = [&](const SystemCandidate* other) { return other->equals(*one.candidate); };
                if (std::ranges::any_of(kept, is_same)) return true;
                // Where the validation records refused all, models that share a term were refused together.
                const auto is_shared = [&](const auto& kind) { return sharing[kind] == max_sharing; };
                if (steps_.size() < 2 && std::ranges::any_of(kinds, is_shared)) {
                    others.push_back(one);
                    return true;
                }
                for (const auto& kind : kinds) ++sharing[kind];
                kept.push_back(one.candidate);
                return false;
            });
            if (list->size() <= max_compared) continue;
            // A curve says nothing beyond where it was fitted, and what is hidden from the search may lie there: one that was added last is
            // compared wherever it stands. So is what does better than all that have fewer parameters.
            std::vector<Contender> further;
            std::size_t curves = 0;
            double least = std::numeric_limits<double>::infinity();
            for (std::size_t i = 0; i < list->size(); ++i) {
                const Contender& one = (*list)[i];
                const bool is_curve =
                    one.candidate->terms.back().name == curve_term && i >= max_compared && curves < max_curves;
                const bool is_ahead = list == &simple && one.candidate->score() < least;
                least = std::min(least, one.candidate->score());
                if (is_curve) ++curves;
                if (i >= max_compared) (is_curve || is_ahead ? further : others).push_back(one);
            }
            list->resize(max_compared);
            std::ranges::copy(further, std::back_inserter(*list));
        }
        std::vector<Contender> list = std::move(simple);
        std::ranges::copy(rich, std::back_inserter(list));
        for (Contender& one : list) one.chosen_of = list.size();
        // Of all others those that predict best with the values of the search. They must do so more surely, as the best of many.
        std::ranges::copy_if(unlikely, std::back_inserter(others),
                             [&](const Contender& one) { return known.insert(kinds_from(*one.candidate, 0)).second; });
        const auto errors_of_last = errors_after(result_.validation);
        const std::size_t models = list.size() + others.size();
        std::vector<const SystemCandidate*> candidates;
        for (const Contender& one : others) candidates.push_back(one.candidate);
        for (const std::size_t i : best_as_searched(candidates, rms_of_errors(errors_of_last))) {
            list.push_back({others[i].candidate, others[i].step, models, true});
        }
        // What has more parameters must predict better for sure than the best that has fewer.
        std::ranges::stable_sort(list, {}, [](const Contender& one) { return one.candidate->model.parameters.size(); });
        candidates.clear();
        for (const Contender& one : list) candidates.push_back(one.candidate);
        const auto all = judged(search, candidates, ended_after(fit_share));
        std::optional<std::size_t> best;
        auto least = errors_of_last;
        std::size_t least_parameters = last.model.parameters.size();
        std::vector<std::vector<double>> on_validation(all.size()); // the errors; empty: not known
        // What the search made of it does not count any more: what predicts the validation records about as well does.
        const auto step_with = [&](std::size_t i) {
            const SystemStep& before = steps_[list[i].step];
            SystemStep step{.candidate = *list[i].candidate,
                            .before = kept_of(*list[i].candidate, before.candidate),
                            .compared_with = 1}; // the last model
            step.candidate.values = all[i]->values;
            step.on_validation = on_validation[i];
            step.on_fitted = all[i]->errors;
            step.gain = 1 - rms_of_errors(step.on_validation) / rms_of_errors(before.on_validation);
            step.certainty = probability_of_gain(before.on_validation, step.on_validation);
            step.evidence = evidence(before, step, stretches_, result_.hypotheses.size());
            return step;
        };
        for (std::size_t i = 0; i < all.size(); ++i) {
            if (!all[i] || all[i]->errors.empty()) continue;
            const auto& [candidate, at, chosen_of, is_foreseen] = list[i];
            const Judged& one = *all[i];
            const auto& errors = on_validation[i] = errors_after(one.validation);
            const double sure_here = 1 - (1 - sure_enough) / static_cast<double>(chosen_of);
            if (probability_of_gain(errors_of_last, errors) < sure_here) continue;
            // Of equals the best one counts, however little it is ahead.
            const bool is_richer = candidate->model.parameters.size() > least_parameters;
            if (is_richer ? probability_of_gain(least, errors) < sure_here
                          : rms_of_errors(errors) >= rms_of_errors(least)) {
                continue;
            }
            if (!is_worth_its_price(*candidate, least_parameters, least, errors, chosen_of)) continue;
            if (!are_sure(search, *candidate, kept_of(*candidate, steps_[at].candidate), one)) continue;
            // Random forces may do as well, the more so as the best of many.
            if (step_with(i).evidence < (is_foreseen ? convincing : least_evidence)) continue;
            best = i;
            least = errors;
            least_parameters = candidate->model.parameters.size();
        }
        if (!best) return;
        const std::size_t at = list[*best].step;
        SystemStep step = step_with(*best);
        std::vector<SystemCandidate> found = {step.candidate};
        std::vector<double> errors = {rms_of_errors(least)};
        for (std::size_t i = 0; i < all.size(); ++i) {
            if (i == *best || !all[i]) continue;
            ++step.compared_with;
            const double error = rms_of_errors(on_validation[i]);
            if (on_validation[i].empty() || !std::isfinite(error)) continue; // that cannot be simulated there
            found.push_back(*list[i].candidate);
            errors.push_back(error);
        }
        found.push_back(last);
        errors.push_back(rms_of_errors(errors_of_last));
        std::vector<std::size_t> passed(found.size());
        std::iota(passed.begin(), passed.end(), std::size_t{0});
        step.weigh(steps_[at].candidate, found, passed, 0, errors,
                   static_cast<double>(least.size()) / correlation_length(least), search.errors());
        tell_replaced(step.candidate, last, errors.back() / errors.front() - 1);
        steps_.resize(at + 1);
        steps_.push_back(std::move(step));
        conclude(search, *all[*best]);
    }

    // Places of those that predict the validation records best with the values of the search, better than with this error.
    std::vector<std::size_t> best_as_searched(const std::vector<const SystemCandidate*>& list, double error) const {
        std::vector<double> errors(list.size(), std::numeric_limits<double>::infinity());
        const auto ended = ended_after(fit_share);
        for_each_index(
            list.size(), control_, fmt::format("predicting with {} hypotheses", list.size()), [&](std::size_t i) {
                if (ended()) return;
                const SystemCandidate& one = *list[i];
                const auto judged = compared_to_first(with_validation_values({one.values, {}, {}, {}}, one), one);
                const auto own = errors_after(judged.validation);
                if (!own.empty()) errors[i] = rms_of_errors(own);
            });
        stop_if_asked();
        std::vector<std::size_t> best;
        for (std::size_t i = 0; i < list.size(); ++i) {
            if (errors[i] < error) best.push_back(i);
        }
        std::ranges::stable_sort(best, {}, [&](std::size_t i) { return errors[i]; });
        if (best.size() > max_compared) best.resize(max_compared);
        return best;
    }

    // `worse`: by which share the one whose place is taken raises the error on the validation records.
    void tell_replaced(const SystemCandidate& taken, const SystemCandidate& replaced, double worse) {
        const auto last = kinds_of(replaced);
        for (auto& hypothesis : result_.hypotheses) {
            if (hypothesis.names == kinds_of(taken)) {
                hypothesis.lost.clear();
            } else if (hypothesis.lost.empty() && hypothesis.names == last) {
                hypothesis.lost = fmt::format(
                    "raises the error on the validation record by {:.0f} %, beside the one taken", 100 * worse);
            }
        }
    }

    // What the validation records, which took no part in the search, say of the rivals of the last step. One that is likelier by
    // both takes its place. Rivals of earlier steps lack what came later, and are not compared.
    void weigh_on_validation(const SystemSearch& search) {
        if (steps_.size() < 2 || steps_.back().compared_with > 0 || steps_.back().contenders.size() < 2) return;
        const SystemStep& before = steps_[steps_.size() - 2];
        SystemStep step = steps_.back();
        std::vector<SystemCandidate> found = {step.candidate};
        std::vector<Judged> fits(1);
        std::vector<std::vector<double>> errors = {errors_after(result_.validation)};
        std::vector<const SystemCandidate*> rivals;
        for (std::size_t i = 1; i < step.contenders.size(); ++i) rivals.push_back(&step.contenders[i]);
        auto all = judged(search, rivals, ended_after(fit_share));
        if (!std::ranges::all_of(all, [](const auto& one) { return one.has_value(); })) return;
        for (std::size_t i = 1; i < step.contenders.size(); ++i) {
            Judged& one = *all[i - 1];
            auto own = errors_after(one.validation);
            if (one.errors.empty() || !std::isfinite(rms_of_errors(own))) continue;
            found.push_back(step.contenders[i]);
            found.back().values = one.values;
            fits.push_back(std::move(one));
            errors.push_back(std::move(own));
        }
        const auto least = std::ranges::min_element(errors, {}, rms_of_errors);
        const auto [scores, passed, independent] = scores_of_both(found, errors);
        const std::size_t best = passed.front();
        const double certainty = probability_of_gain(before.on_validation, errors[best]);
        const bool changes = best > 0 && best == static_cast<std::size_t>(least - errors.begin()) &&
                             certainty >= sure_enough && !refused(found[best]) &&
                             is_worth_its_price(found[best], step.candidate.model.parameters.size(), errors.front(),
                                                errors[best], found.size()) &&
                             are_sure(search, found[best], kept_of(found[best], before.candidate), fits[best]);
        if (changes) {
            step = SystemStep{.candidate = found[best],
                              .before = kept_of(found[best], before.candidate),
                              .gain = 1 - rms_of_errors(errors[best]) / rms_of_errors(before.on_validation),
                              .certainty = certainty,
                              .on_validation = errors[best],
                              .on_fitted = fits[best].errors,
                              .compared_with = found.size() - 1};
            step.evidence = evidence(before, step, stretches_, result_.hypotheses.size());
            tell_replaced(step.candidate, steps_.back().candidate,
                          rms_of_errors(errors[0]) / rms_of_errors(errors[best]) - 1);
        }
        step.weighed.clear();
        step.weigh(before.candidate, found, passed, changes ? best : 0, scores, independent, search.errors());
        steps_.back() = std::move(step);
        if (changes) conclude(search, std::move(fits[best]));
    }

    struct Scores {
        std::vector<double> scores;
        std::vector<std::size_t> order; // the best first, with what names cost
        double independent;             // errors
    };

    // By the search and by the errors on the validation records, each with its independent errors. The first candidate is the one that
    // the others are compared to.
    static Scores scores_of_both(const std::vector<SystemCandidate>& found,
                                 const std::vector<std::vector<double>>& errors) {
        const auto least = std::ranges::min_element(errors, {}, rms_of_errors);
        const double in_search = independent_errors(found.front()),
                     there = static_cast<double>(least->size()) / correlation_length(*least);
        Scores made{{}, std::vector<std::size_t>(found.size()), in_search + there};
        for (std::size_t i = 0; i < found.size(); ++i) {
            made.scores.push_back(
                std::exp((in_search * std::log(found[i].score()) + there * std::log(rms_of_errors(errors[i]))) /
                         made.independent));
        }
        std::iota(made.order.begin(), made.order.end(), std::size_t{0});
        std::ranges::stable_sort(
            made.order, {}, [&](std::size_t i) { return made.scores[i] * price_of_names(found[i], made.independent); });
        return made;
    }

    // A rival of an earlier step may do better beside what came later: each takes the place of that step's terms in the last model. One
    // that is likelier stays there.
    void weigh_earlier_steps(const SystemSearch& search) {
        for (std::size_t s = 1; s + 1 < steps_.size(); ++s) weigh_earlier_step(search, s);
    }

    void weigh_earlier_step(const SystemSearch& search, std::size_t s) {
        const SystemCandidate& last = steps_.back().candidate;
        const SystemStep& step = steps_[s];
        const auto own_kinds = kinds_from(step.candidate, step.before);
        std::set<std::size_t> own; // places
        for (std::size_t t = 0; t < last.terms.size(); ++t) {
            if (own_kinds.contains(last.terms[t].kind())) own.insert(t);
        }
        if (own.size() != own_kinds.size()) return; // others took their place
        const SystemCandidate base = search.with_others(last, own, last, last.terms.size());
        const auto other_kinds = kinds_from(base, 0);
        std::vector<SystemCandidate> rivals;
        std::vector<std::size_t> contender_of;
        for (std::size_t c = 1; c < step.contenders.size(); ++c) {
            const SystemCandidate& contender = step.contenders[c];
            const std::size_t first = kept_of(contender, steps_[s - 1].candidate);
            const auto kinds = kinds_from(contender, first);
            const bool is_there =
                std::ranges::any_of(kinds, [&](const auto& kind) { return other_kinds.contains(kind); });
            if (is_there || contender.terms.size() == first) continue;
            rivals.push_back(search.with_others(last, own, contender, first));
            contender_of.push_back(c);
        }
        if (rivals.empty() || search.late()) return;
        for_each_index(rivals.size(), control_, fmt::format("fitting {} rivals beside the other terms", rivals.size()),
                       [&](std::size_t i) {
                           if (!search.fit(rivals[i])) rivals[i].predicted.clear();
                       });
        stop_if_asked();
        for (std::size_t i = rivals.size(); i-- > 0;) {
            if (!rivals[i].predicted.empty()) continue;
            rivals.erase(rivals.begin() + static_cast<std::ptrdiff_t>(i));
            contender_of.erase(contender_of.begin() + static_cast<std::ptrdiff_t>(i));
        }
        std::vector<const SystemCandidate*> list;
        for (const auto& one : rivals) list.push_back(&one);
        auto all = judged(search, list, ended_after(fit_share));
        if (!std::ranges::all_of(all, [](const auto& one) { return one.has_value(); })) return;
        std::vector<SystemCandidate> found = {last};
        // Its own terms last, as those of the rivals are.
        std::vector<SystemTerm> terms = base.terms;
        for (const std::size_t t : own) terms.push_back(last.terms[t]);
        found.front().terms = terms;
        std::vector<std::vector<double>> errors = {errors_after(result_.validation)};
        std::vector<std::size_t> place = {0}; // among the rivals
        for (std::size_t i = 0; i < rivals.size(); ++i) {
            auto those = errors_after(all[i]->validation);
            if (all[i]->errors.empty() || !std::isfinite(rms_of_errors(those))) continue;
            found.push_back(rivals[i]);
            found.back().values = all[i]->values;
            errors.push_back(std::move(those));
            place.push_back(i);
        }
        if (found.size() < 2) return;
        const auto [scores, order, independent] = scores_of_both(found, errors);
        const std::size_t best = order.front();
        const bool changes =
            best > 0 && probability_of_gain(errors.front(), errors[best]) >= sure_enough && !refused(found[best]) &&
            !is_too_rich(found[best]) &&
            is_worth_its_price(found[best], last.model.parameters.size(), errors.front(), errors[best], found.size()) &&
            are_sure(search, found[best], base.terms.size(), *all[place[best]]);
        SystemStep changed = step;
        changed.weighed.clear();
        changed.same_as.clear();
        changed.weigh(base, found, order, changes ? best : 0, scores, independent, search.errors());
        changed.contenders = step.contenders; // beside the model that the step began with
        if (changes) {
            const SystemCandidate& contender = step.contenders[contender_of[place[best]]];
            changed.candidate = contender;
            changed.before = kept_of(contender, steps_[s - 1].candidate);
            tell_replaced(found[best], steps_.back().candidate,
                          rms_of_errors(errors.front()) / rms_of_errors(errors[best]) - 1);
        }
        steps_[s] = std::move(changed);
        if (!changes) return;
        SystemStep& end = steps_.back();
        const std::size_t brought = end.candidate.terms.size() - end.before, terms_now = found[best].terms.size();
        end.candidate = found[best];
        end.before = std::min(end.before, terms_now - std::min(brought, terms_now));
        end.on_validation = errors[best];
        end.on_fitted = all[place[best]]->errors;
        conclude(search, *std::move(all[place[best]]));
    }

    Judged fitted_to_all(const SystemSearch& search, const SystemCandidate& candidate) const {
        const auto ended = ended_after(fit_share);
        const SystemFit fit = search.fit_of_all();
        const auto result = fit.generalized(candidate.model,
                                            fit.fit(candidate.model, candidate.values, final_iterations, ended), ended);
        return with_validation_values({result.errors.empty() ? candidate.values : result.values, result.errors, {}, {}},
                                      candidate);
    }

    // With start values of the validation records, fitted to their beginnings.
    Judged with_validation_values(Judged one, const SystemCandidate& candidate) const {
        const auto ended = ended_after(fit_share);
        if (divided_) one.validation_values.push_back(candidate.model.values_of(one.values, 0));
        for (const auto& record : validation_) {
            one.validation_values.push_back(with_starts(candidate.model, one.values, record, scale_, between_, ended));
        }
        return one;
    }

    // Beside the first model, which has been judged.
    Judged compared_to_first(Judged one, const SystemCandidate& candidate) const {
        if (divided_) one.validation.push_back(against_first(*divided_, divided_at_, one.values, 0, candidate));
        for (const auto& record : validation_) {
            const std::size_t place = one.validation.size();
            one.validation.push_back(compared({steps_.front().candidate.model, baseline_validation_values_[place]},
                                              {candidate.model, one.validation_values[place]}, record, 0, scale_,
                                              between_));
        }
        return one;
    }

    Judged judged_first(const SystemSearch& search) {
        const SystemCandidate& first = steps_.front().candidate;
        Judged one = fitted_to_all(search, first);
        baseline_values_ = one.values;
        baseline_validation_values_ = one.validation_values;
        return compared_to_first(std::move(one), first);
    }

    Judged judged(const SystemSearch& search, const SystemCandidate& candidate) const {
        return compared_to_first(fitted_to_all(search, candidate), candidate);
    }

    // Side by side. Nothing for those that were not begun when the time was over.
    std::vector<std::optional<Judged>> judged(const SystemSearch& search,
                                              const std::vector<const SystemCandidate*>& list,
                                              const std::function<bool()>& ended) const {
        std::vector<std::optional<Judged>> all(list.size());
        for_each_index(list.size(), control_, fmt::format("fitting {} hypotheses to whole records", list.size()),
                       [&](std::size_t i) {
                           if (!ended()) all[i] = judged(search, *list[i]);
                       });
        stop_if_asked();
        return all;
    }

    std::vector<double> errors_after(const std::vector<SystemComparison>& validation) const {
        std::vector<double> all;
        for (const auto& c : validation) {
            const auto e = c.errors(c.after, scale_);
            all.insert(all.end(), e.begin(), e.end());
        }
        return all;
    }

    // Of a search with fewer samples the answer is fitted to all.
    void count_all_samples(const SystemSearch& search) {
        if (search.every() == 1) return;
        const SystemCandidate& last = steps_.back().candidate;
        const auto ended = ended_after(1);
        SystemFit::Result result;
        // The way of the inputs between all samples is told now, beside what was missing.
        auto ways = search.ways();
        std::stable_partition(ways.begin(), ways.end(),
                              [&](Interpolation way) { return way == search.interpolation(); });
        for (const Interpolation way : ways) {
            if (!result.errors.empty() && ended()) break;
            auto other = search.fit_of_all_samples(way).fit(last.model, final_values_, final_iterations, ended);
            if (other.errors.empty() || !(other.sum < result.sum)) continue;
            result = std::move(other);
            between_ = result_.interpolation = way;
        }
        result = search.fit_of_all_samples(between_).generalized(last.model, std::move(result), ended);
        are_all_counted_ = !result.errors.empty();
        result_.remarks.push_back(fmt::format(
            "The search counted one of {} samples: between these nothing happens that counts beside what is missing.{}",
            search.every(), are_all_counted_ ? " What it found was fitted to all." : ""));
        if (!are_all_counted_) return;
        const Judged one = with_validation_values({result.values, result.errors, {}, {}}, last);
        conclude(search, compared_to_first(one, last));
    }

    // Of the whole records, the samples that count in the fit of the last model.
    SystemFit fit_of_last(const SystemSearch& search) const {
        return are_all_counted_ ? search.fit_of_all_samples(between_) : search.fit_of_all();
    }

    // The last model is the answer.
    void conclude(const SystemSearch& search, Judged current) {
        final_values_ = current.values;
        final_errors_ = current.errors;
        result_.validation = std::move(current.validation);
        result_.prediction_uncertainty =
            uncertainty_of(steps_.back().candidate.model, fit_of_last(search), current.validation_values);
        const auto& first = steps_.front().candidate;
        const auto& last = steps_.back().candidate;
        const auto as_the_first_record = [&](SystemModel model, const std::vector<double>& values) {
            model.equations = model.begun(values, 0, records_[0]);
            return shown(std::move(model));
        };
        result_.before = as_the_first_record(first.model, baseline_values_);
        result_.after = as_the_first_record(last.model, final_values_);
        result_.fitted.clear();
        for (std::size_t r = 0; r < records_.size(); ++r) {
            result_.fitted.push_back(against_first(records_[r], 0, final_values_, r, last));
        }
        result_.fitted_gap = total_gap(result_.fitted);
        result_.validation_gap = total_gap(result_.validation);
        result_.explained = result_.validation_gap.explained();
    }

    // Without the outputs that only the search needs.
    static SystemModel shown(SystemModel model) {
        model.equations = without_inner_signals(model);
        model.inner.clear();
        return model;
    }

    double uncertainty_of(const SystemModel& model, const SystemFit& whole,
                          const std::vector<std::vector<double>>& validation_values) const {
        if (final_errors_.empty() || final_values_.empty()) return 0;
        const double noise = whole.noise_in(final_errors_);
        const Eigen::MatrixXd all = whole.covariance(model, final_values_, final_errors_, noise);
        const auto parameters = static_cast<Eigen::Index>(model.parameters.size()),
                   first = parameters + static_cast<Eigen::Index>(model.starts.size());
        double sum = 0, samples = 0;
        for (std::size_t v = 0; v < validation_values.size(); ++v) {
            const auto& comparison = result_.validation[v];
            const auto size = divided_ ? first : parameters; // a divided record has start values among the fitted
            const double own = prediction_uncertainty(model, validation_values[v], comparison.record, comparison.first,
                                                      scale_, between_, all.topLeftCorner(size, size), noise);
            sum += own * own * static_cast<double>(comparison.samples());
            samples += static_cast<double>(comparison.samples());
        }
        return std::sqrt(sum / std::max(samples, 1.0));
    }

    SystemComparison against_first(const SystemRecord& record, std::size_t from, const std::vector<double>& values,
                                   std::size_t r, const SystemCandidate& candidate) const {
        const auto& first = steps_.front().candidate.model;
        return compared({first, first.values_of(baseline_values_, r)},
                        {candidate.model, candidate.model.values_of(values, r)}, record, from, scale_, between_);
    }

    void name_effects(const SystemSearch& search) {
        const auto& last = steps_.back().candidate;
        const auto deviation = fit_of_last(search).standard_errors(last.model, final_values_, final_errors_);
        const auto& parameters = last.model.equations.parameters;
        const std::size_t own = model_.parameters.size();
        const auto fitted_value = [&](std::size_t i) {
            const auto& parameter = parameters[last.model.parameters[i].place];
            return FittedValue{parameter.name, parameter.unit, final_values_[i], deviation[i]};
        };
        for (std::size_t i = 0; i < own; ++i) result_.free.push_back(fitted_value(i));
        std::size_t place = own;
        for (std::size_t t = 0; t < last.terms.size(); ++t) {
            const SystemStep& step = step_of(last.terms[t].kind());
            WeighedTerm weighed = step.weighed.at(last.terms[t].kind());
            // Where much is left, only rivals make doubtful what is a part of what is missing.
            const bool has_likelier_rivals = !weighed.rivals.empty() && weighed.probability * step.confirmed < 0.5;
            // Of some term at all.
            const double certain = step.confirmed / (1 + std::pow(convincing / step.evidence, 2));
            weighed.probability *= certain;
            for (auto& [name, probability] : weighed.rivals) probability *= certain;
            SystemEffect effect{.name = last.terms[t].name,
                                .equation = last.terms[t].equation,
                                .expression = last.texts[t],
                                .probability = weighed.probability,
                                .rivals = weighed.rivals,
                                .same_as = step.same_as};
            effect.is_open =
                step.evidence < least_evidence || (is_much_left() ? has_likelier_rivals : effect.probability < 0.5);
            for (std::size_t p = 0; p < last.terms[t].parameters.size(); ++p, ++place) {
                const auto value = fitted_value(place);
                effect.parameters.push_back(value.name);
                effect.units.push_back(value.unit);
                effect.values.push_back(value.value);
                effect.standard_errors.push_back(value.standard_error);
            }
            const std::size_t brought = step.candidate.terms.size() - step.before;
            const std::string added = fmt::format("{}: {} is added{}", last.terms[t].kind(), effect.expression,
                                                  brought > 1 ? fmt::format(", with {} more", brought - 1) : "");
            effect.evidence = fmt::format(
                "{}. With {} the error of prediction, over the part of the records that was not fitted in the search, "
                "decreases by {:.1f} %, with a probability of {:.3f} by resampled blocks.",
                added, brought > 1 ? "them" : "it", 100 * step.gain, step.certainty);
            if (step.compared_with > 0) {
                effect.evidence = fmt::format(
                    "{}. Of {} models that the search found likely this one predicts the validation "
                    "record best. Its error there decreases by {:.1f} %, with a probability of {:.3f} by resampled "
                    "blocks.",
                    added, step.compared_with + 1, 100 * step.gain, step.certainty);
            }
            result_.effects.push_back(std::move(effect));
        }
        result_.open_rest = without_open_effects(search);
        strongest_first(fit_of_last(search), last);
    }

    // That uncertain values may explain what is left does not show that the model is right.
    bool is_much_left() const {
        const Gap &validation = result_.validation_gap, &fitted = result_.fitted_gap;
        return validation.is_left() || fitted.is_left();
    }

    // Of the effects, in the order of the terms: what is left without those that are open.
    OpenRest without_open_effects(const SystemSearch& search) {
        SystemCandidate less = steps_.back().candidate;
        for (std::size_t t = result_.effects.size(); t-- > 0;) {
            if (result_.effects[t].is_open) less = search.without(less, t);
        }
        if (less.terms.size() == result_.effects.size()) return OpenRest::none;
        if (less.terms.empty()) return OpenRest::most;
        const Judged one = judged(search, less);
        if (one.errors.empty()) return OpenRest::most;
        const Gap validation = total_gap(one.validation), &fitted = result_.fitted_gap;
        const double fitted_after = fitted.after * rms_of_errors(one.errors) / rms_of_errors(final_errors_);
        if (validation.after <= little_left * validation.floor && fitted_after <= little_left * fitted.floor) {
            return OpenRest::little;
        }
        return 1 - std::pow(validation.after / validation.before, 2) >= half ? OpenRest::less_than_half
                                                                             : OpenRest::most;
    }

    // The first name is that of the effect without which the error is largest, of those that are decided if these explain most.
    void strongest_first(const SystemFit& fit, const SystemCandidate& last) {
        if (last.terms.size() < 2) return;
        std::vector<std::pair<double, SystemEffect>> effects; // with the squared errors without each
        std::size_t place = model_.parameters.size();
        for (std::size_t t = 0; t < last.terms.size(); ++t) {
            std::vector<double> without = final_values_;
            std::copy(last.terms[t].neutral.begin(), last.terms[t].neutral.end(),
                      without.begin() + static_cast<std::ptrdiff_t>(place));
            const auto errors = fit.errors(last.model, without);
            effects.emplace_back(errors.empty() ? std::numeric_limits<double>::infinity()
                                                : SystemFit::sum_of_squares(errors),
                                 std::move(result_.effects[t]));
            place += last.terms[t].parameters.size();
        }
        std::ranges::stable_sort(effects, std::greater{}, &std::pair<double, SystemEffect>::first);
        if (result_.open_rest != OpenRest::most) {
            std::stable_partition(effects.begin(), effects.end(), [](const auto& one) { return !one.second.is_open; });
        }
        result_.effects.clear();
        for (auto& [squares, effect] : effects) result_.effects.push_back(std::move(effect));
    }

    // The step that brought a term in.
    const SystemStep& step_of(const std::string& kind) const {
        for (const SystemStep& step : steps_) {
            for (const auto& term : step.candidate.terms) {
                if (term.kind() == kind) return step;
            }
        }
        return steps_.back();
    }

    // A validation record may hardly show what the fitted ones do. Where little more than noise is all that these leave, the values that
    // were fitted may be off. A random force, of which they show more, moves values farther than their uncertainty says.
    bool nothing_is_left() const {
        const Gap &validation = result_.validation_gap, &fitted = result_.fitted_gap;
        const double deviations = fitted.after < noise_alone * fitted.floor    ? off_by_chance
                                  : fitted.after < nothing_left * fitted.floor ? told_from_nothing
                                                                               : 0;
        return fitted.after < little_left * fitted.floor &&
               validation.after <
                   std::hypot(nothing_left * validation.floor, deviations * result_.prediction_uncertainty);
    }

    void decide() {
        auto& d = result_;
        const Gap& gap = d.validation_gap;
        const bool is_left = is_much_left();
        if (d.effects.empty()) {
            d.verdict = nothing_is_left() ? "nothing_missing" : "unknown_effect";
        } else if (d.open_rest == OpenRest::most ||
                   (d.open_rest == OpenRest::less_than_half && d.effects.front().is_open)) {
            d.verdict = "undecided";
        } else if (!is_left) {
            d.verdict = "effect_found";
        } else if (d.explained >= half) {
            d.verdict = "partial";
        } else {
            d.verdict = "unknown_effect";
            d.nearest = {steps_.back().candidate.names_from(0), 1 - gap.after / gap.before};
        }
        if (d.verdict == "unknown_effect" && d.out_of_time)
            d.verdict = "undecided"; // what was not tried may explain it
        if (!d.effects.empty() && d.verdict != "unknown_effect") d.nearest.reset();
        // The probabilities compare the terms of the library. Where much is left, the right one may not be among them, and a name
        // is no surer than the share that it explains.
        const double share = is_left ? most_certain_of_a_part * std::clamp(d.explained, 0.0, 1.0) : most_certain;
        for (auto& effect : d.effects) {
            effect.probability *= share;
            for (auto& [name, probability] : effect.rivals) probability *= share;
        }
    }

    const SystemModel model_;
    std::vector<SystemRecord> records_, validation_;
    std::optional<SystemRecord> divided_; // the first record with its last third
    std::size_t divided_at_ = 0;
    Stretches stretches_; // of the whole records and of the validation records
    const SystemDiagnosisOptions options_;
    const RunControl& control_;
    ProcessorTime time_{control_.workers};
    std::optional<SystemSearch> search_;
    std::vector<Refusal> refused_;
    std::size_t most_new_ = max_terms;     // that a step may bring
    std::vector<SystemStep> steps_;        // the first one is the model as it was given
    std::vector<SystemCandidate> dropped_; // tried beside steps that were dropped
    struct Doubtful {
        SystemStep step;
        Judged fitted;
        Interpolation between;
    };
    std::optional<Doubtful> doubtful_;
    std::vector<double> scale_;
    Interpolation between_ = Interpolation::hold;
    std::vector<double> baseline_values_, final_values_, final_errors_;
    bool are_all_counted_ = false; // in the fit of the last model, see count_all_samples()
    std::vector<std::vector<double>> baseline_validation_values_; // of each comparison
    SystemDiagnosis result_;
    bool is_in_validation_only_ = false, values_explain_it_ = false; // of what is left on the validation records
    std::size_t middle_of_what_is_left_ = 0;
};

double mean_from(const std::vector<double>& all, std::size_t first) {
    return std::accumulate(all.begin() + static_cast<std::ptrdiff_t>(first), all.end(), 0.0) /
           static_cast<double>(all.size() - first);
}

} // namespace

SystemDiagnosis diagnose_system(const SystemModel& model, std::vector<SystemRecord> records,
                                std::vector<SystemRecord> validation, const SystemDiagnosisOptions& options,
                                const RunControl& control) {
    const ProcessorTime time(control.workers);
    Diagnoser first(model, records, validation, options, control);
    first.begin();
    if (validation.empty()) return first.run();
    const SystemRecord whole = validation.front();
    // What fits a part of a validation record, too.
    const auto with_part = [&](std::size_t fitted) {
        auto longer = records;
        longer.push_back(whole.head(fitted));
        auto rest = validation;
        rest.front() = whole.part(fitted, whole.size());
        SystemDiagnosisOptions limits = options;
        limits.budget = std::max(options.budget - time.seconds(), 0.1 * options.budget);
        auto made = std::make_unique<Diagnoser>(model, std::move(longer), std::move(rest), limits, control);
        made->begin();
        return made;
    };
    const auto told = [&](SystemDiagnosis d, const char* why, std::size_t fitted) {
        d.where += fmt::format(" {}: {} up to t = {} is fitted, too, and the rest of it is what is compared.", why,
                               whole.source, format_quantity(whole.t[fitted], "s", 3));
        return d;
    };
    // What is missing may be made up for by values that are far off, and the search would begin with them.
    if (!first.leaves_noise()) {
        const Diagnoser::Left left = first.left_at_first(records.size(), first.scale());
        const std::size_t fitted = Diagnoser::middle_of(left.on_validation);
        if (mean_from(left.on_validation, 0) > far_more * far_more * left.fitted) {
            const auto longer = with_part(fitted);
            const Diagnoser::Left now = longer->left_at_first(records.size(), first.scale());
            const double gain = mean_from(left.on_validation, fitted) / mean_from(now.on_validation, 0);
            if (gain > far_more * far_more && now.fitted < more * more * left.fitted) {
                return told(longer->run(), "The values that suit the other records best are far off here", fitted);
            }
        }
    }
    SystemDiagnosis d = first.run();
    if (!first.is_seen_in_validation_only()) return d;
    // What is missing hides in the values that were fitted.
    const std::size_t fitted = first.middle_of_what_is_left();
    SystemDiagnosis more_told = with_part(fitted)->run();
    // What was found may be all: then the longer records know its values better, or say nothing new.
    const auto names_of = [](const SystemDiagnosis& one) {
        std::set<std::pair<std::string, std::string>> names;
        for (const auto& effect : one.effects) names.emplace(effect.name, effect.equation);
        return names;
    };
    if (first.values_explain_it() && names_of(more_told) != names_of(d)) return d;
    const bool had_something = !d.effects.empty() || d.fitted_gap.is_left();
    if (more_told.effects.empty() && had_something) return d;
    const auto left = [](const SystemDiagnosis& one) { return one.validation_gap.after / one.validation_gap.floor; };
    if (more_told.out_of_time && left(more_told) > left(d)) return d; // it came less far
    return told(std::move(more_told), "The other records show nothing of it, or little", fitted);
}

} // namespace tribode
