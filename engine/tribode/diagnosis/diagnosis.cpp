#include "tribode/diagnosis/diagnosis.hpp"
#include "tribode/base/error.hpp"
#include "tribode/base/text.hpp"
#include "tribode/diagnosis/disagreement.hpp"
#include "tribode/diagnosis/next_experiment.hpp"
#include "tribode/diagnosis/response.hpp"

#include <algorithm>
#include <chrono>
#include <cmath>
#include <fmt/format.h>
#include <fmt/ranges.h>
#include <functional>

namespace tribode {

namespace {

// Of the difference of two scores, in units of which e^-1/2 counts: simulators and filters are not exact, and the
// noise's shape is estimated.
constexpr double temperature = 3;
// What a right name has where noise explains the remaining error, and no rival comes near.
constexpr double certain = 0.98;
constexpr double decided = 0.6;           // probability above which an effect is told from its rivals
constexpr double of_a_part = 0.75;        // where more than noise is left
constexpr double near = 1.5;              // chi square of a rival by that of the best, where more than noise is left
constexpr double clearly_less = 0.9;      // of chi square
constexpr double least_of_an_effect = 10; // of chi square
constexpr double apart_from_alike = 4;    // ratio of chi square of two laws of one behavior

double rms_difference(const std::vector<double>& a, const std::vector<double>& b, std::size_t first) {
    double sum = 0;
    for (std::size_t k = first; k < a.size(); ++k) sum += (a[k] - b[k]) * (a[k] - b[k]);
    return std::sqrt(sum / static_cast<double>(a.size() - first));
}

Compared compared(const Evidence& record, const MachineModel& before, const MachineModel& after) {
    Compared c;
    c.measurement = record.measurement;
    c.first = record.first;
    const auto signals = [&](const MachineModel& machine) {
        auto s = simulated_signals(machine, record.measurement);
        // A model that runs away has no position to compare: it stands still.
        const std::size_t n = record.measurement.size();
        return s ? *s : SimulatedSignals{std::vector<double>(n, 0.0), std::vector<double>(n, 0.0)};
    };
    const auto was = signals(before), is = signals(after);
    c.y_before = was.position;
    c.u_before = was.thrust;
    c.y_after = is.position;
    c.u_after = is.thrust;
    c.gap = {rms_difference(record.measurement.position(), c.y_before, c.first),
             rms_difference(record.measurement.position(), c.y_after, c.first), record.floor.rms};
    c.described_floor = c.gap.floor;
    return c;
}

// Record and machine in different units: the responses differ by a factor that no effect makes.
void check_size(const MachineModel& machine, const Measurement& m) {
    const auto simulated = simulated_position(machine, m);
    if (!simulated) return;
    const auto range = [](const std::vector<double>& y) {
        const auto [low, high] = std::minmax_element(y.begin(), y.end());
        return *high - *low;
    };
    const double ratio = range(m.position()) / std::max(range(*simulated), 1e-300);
    if (ratio > 100 || ratio < 0.005) {
        throw InputError(
            fmt::format("{}: y moves over {:.3g} m, in the simulation over {:.3g} m: y or u seems to be in "
                        "another unit, or in the other's place",
                        m.source, range(m.position()), range(*simulated)));
    }
}

class Verdict {
  public:
    Verdict(const MachineModel& machine, Diagnosis& d, const RunControl& control)
        : machine_(machine),
          d_(d),
          control_(control),
          fit_(machine, d.search.fitted) {}

    void decide() {
        const SearchResult& s = d_.search;
        d_.false_alarm_limit = SearchResult::limit(s.fitted);
        without_ = s.baseline;
        d_.before = fit_.machine(without_.hypothesis);
        d_.after = d_.before;
        const bool has_steps = !s.steps.empty();
        if (has_steps) {
            Hypothesis best = s.ranking.front().hypothesis;
            ModelFit::Options last;
            last.iterations = 10;
            last.standard_errors = true;
            last.workers = control_.workers;
            last.stop = control_.stop;
            if (s.shared) {
                best.standard_errors = s.ranking.front().hypothesis.standard_errors;
            } else {
                fit_.fit(best, last);
            }
            best_ = best;
            if (s.explained_by_noise(s.ranking.front()) && fields_do_alone(best)) {
                best_.reset();
            } else if (s.explained_by_noise(s.ranking.front())) {
                name_all(1);
            } else if (const double trust = trust_in_part(); trust > 0) {
                name_all(trust);
            } else {
                unknown();
            }
        }
        if (!d_.verdict.empty()) return;
        // Without a step the budget may have ended the search before it began.
        const bool is_noise = has_steps || s.explained_by_noise(s.baseline);
        d_.verdict = is_noise ? "nothing_missing" : s.out_of_time ? "undecided" : "unknown_effect";
    }

  private:
    // Whether the fields do as well without the one effect, from where they are beside it: their own fit had not come there.
    // They are then the machine's.
    bool fields_do_alone(const Hypothesis& best) {
        if (best.effects.size() != 1 || best.nominal.empty()) return false;
        Hypothesis without = best;
        without.remove(0);
        ModelFit::Options options;
        options.iterations = 10;
        options.workers = control_.workers;
        options.stop = control_.stop;
        fit_.fit(without, options);
        if (without.chi_square > best.chi_square + least_of_an_effect || !without.within_tolerance()) return false;
        // They must explain all records together: on the fitted ones alone another value of a field may do what the effect does.
        const std::vector<Evidence>&fitted = d_.search.fitted, &validation = d_.search.validation;
        if (!validation.empty()) {
            std::vector<Evidence> all = fitted;
            all.insert(all.end(), validation.begin(), validation.end());
            Hypothesis together = without;
            ModelFit(machine_, all).fit(together, options);
            const auto leaves_more = [&](const std::vector<Evidence>& records) {
                const ModelFit there(machine_, records);
                return there.chi_square_per_sample(together) >
                       std::max(SearchResult::limit(records), there.chi_square_per_sample(best));
            };
            if (!together.within_tolerance() || leaves_more(fitted) || leaves_more(validation)) return false;
        }
        d_.before = d_.after = fit_.machine(without);
        return true;
    }

    // How far a name may be trusted although more than noise remains, as on real machines: the effect must remove most
    // of the gap, on the validation records too, have the same parameters on both, and none but rivals of one effect may do
    // nearly as well.
    double trust_in_part() {
        const SearchResult& s = d_.search;
        const Scored& best = s.ranking.front();
        if (s.validation.empty()) return 0;
        hold_fields(best);
        // Records that show the gap must show it removed; a poor one may show none.
        const double fitted = without_.together_fitted, validation = without_.together_validation;
        const bool poor_fit = fitted < 2 * SearchResult::limit(s.fitted);
        const bool poor_validation = validation < 2 * SearchResult::limit(s.validation);
        const auto removed = [](double before, double after) { return 1 - std::sqrt(after / before) >= 0.5; };
        if ((poor_fit && poor_validation) || (!poor_fit && !removed(fitted, best.together_fitted)) ||
            (!poor_validation && !removed(validation, poor_fit ? best.together_validation : best.validation))) {
            return 0;
        }
        // One set of parameters that leaves little of the errors of all records agrees with each of them.
        const auto is_little = [](double before, double after) {
            constexpr double little = 3, share = 0.05 * 0.05; // of chi square per sample
            return after < std::max(little, share * before);
        };
        const bool leaves_little =
            is_little(fitted, best.together_fitted) && is_little(validation, best.together_validation);
        if (!poor_fit && !poor_validation && !leaves_little && !sizes_agree(best)) return 0;
        // A record that shows no gap tells nothing of rivals, and what has all that the best one has says the same with more.
        for (const auto& rival : s.ranking) {
            if (rival.names() != best.names() && !rival.contains(best) &&
                is_near(rival, best, !poor_fit, !poor_validation) && is_allowed_beside(rival, best) &&
                !other_name(rival, best)) {
                return 0;
            }
        }
        return of_a_part;
    }

    // Whether the effects have the same sizes where they are fitted to the validation records alone.
    bool sizes_agree(const Scored& best) const {
        Hypothesis other = best.hypothesis;
        const ModelFit check(machine_, d_.search.validation);
        ModelFit::Options options;
        options.iterations = 8;
        options.workers = control_.workers;
        options.stop = control_.stop;
        options.move_fields = false;
        check.fit(other, options);
        std::size_t index = 0;
        for (const auto& effect : best.hypothesis.effects) {
            // The first parameter; of several harmonics all amplitudes, each beside the largest one.
            const FitParameter& size = effect->parameters.front();
            const auto field = [](const std::string& name) { return name.substr(name.rfind('.') + 1); };
            double largest = 0, apart = 0;
            for (const FitParameter& p : effect->parameters) {
                const double a = best.hypothesis.values[index], b = other.values[index];
                ++index;
                if (field(p.name) != field(size.name)) continue;
                largest = std::max({largest, std::abs(a), std::abs(b)});
                apart = std::max(apart, std::abs(a - b));
            }
            if (apart > 0.2 * largest + size.step) return false;
        }
        return true;
    }

    // Fields farther off than their tolerances let them be may do all that an effect would. Where with the effect they are not, what
    // the machine leaves without it is that of fields as far off as they may be.
    void hold_fields(const Scored& best) {
        const SearchResult& s = d_.search;
        if (s.baseline.together.within_tolerance() || !best.together.within_tolerance()) return;
        without_.hypothesis = s.baseline.together;
        without_.hypothesis.hold_within_tolerance();
        without_.fitted = without_.together_fitted = fit_.chi_square_per_sample(without_.hypothesis);
        without_.validation = without_.together_validation =
            ModelFit(machine_, s.validation).chi_square_per_sample(without_.hypothesis);
    }

    static bool is_allowed_beside(const Scored& other, const Scored& best) {
        return other.together.within_tolerance() || !best.together.within_tolerance();
    }

    // Where more than noise remains, on one of these records.
    static bool is_near(const Scored& other, const Scored& best, bool on_fitted = true, bool on_validation = true) {
        return (on_fitted && other.together_fitted < near * best.together_fitted) ||
               (on_validation && other.together_validation < near * best.together_validation);
    }

    // Where two hypotheses differ in one effect: the name of the effect of the best one, and of that in its place.
    static std::optional<std::pair<std::string, std::string>> other_name(const Scored& other, const Scored& best) {
        const auto a = best.names(), b = other.names();
        std::vector<std::string> gone, come;
        std::set_difference(a.begin(), a.end(), b.begin(), b.end(), std::back_inserter(gone));
        std::set_difference(b.begin(), b.end(), a.begin(), a.end(), std::back_inserter(come));
        if (gone.size() != 1 || come.size() != 1) return std::nullopt;
        return std::pair{gone[0], come[0]};
    }

    void name_all(double trust) {
        const SearchResult& s = d_.search;
        const Scored& best = s.ranking.front();
        d_.before = fit_.machine(without_.hypothesis);
        d_.after = fit_.machine(*best_);
        const auto errors = errors_of(*best_);
        if (trust < 1) list_fields_off(best);
        for (std::size_t i = 0; i < best_->effects.size(); ++i) {
            NamedEffect one;
            one.name = best_->effects[i]->kind().name;
            one.parameters = within_a_turn(best_->effects[i]->at(best_->values_of(i))).to_json()["parameters"];
            one.standard_errors = errors[i];
            // Alternatives: hypotheses that differ from the best one in this effect only.
            double weight = 1;
            const Scored* next = nullptr;
            std::string next_name;
            for (const auto& other : s.ranking) {
                const auto exchanged = other_name(other, best);
                if (!exchanged || exchanged->first != one.name) continue;
                if (trust < 1 && !is_allowed_beside(other, best)) continue;
                const std::string& name = exchanged->second;
                // A richer one that does no better says the same, and more than these records need. But of two laws of one
                // behavior either may be the one, unless several records to fit and the validation record tell.
                const auto& simpler = effect_kind(name).simpler;
                const bool alike = best_->effects[i]->kind().only_in_place &&
                                   std::ranges::find(simpler, one.name) != simpler.end() &&
                                   !are_told_apart(best, other);
                const bool does_better = trust < 1 && is_near(other, best) &&
                                         other.together_validation < clearly_less * best.together_validation;
                if (!alike && !does_better && other.contains(best)) continue;
                if (!next) {
                    next = &other;
                    next_name = name;
                }
                // Where more than noise remains, differences of scores are those of what both lack.
                const bool is_open = alike || (trust < 1 && is_near(other, best));
                const double by_prediction = std::exp(-0.5 * std::pow(std::max(other.behind, 0.0), 2));
                const double w =
                    is_open ? 1 : std::max(by_prediction, std::exp(-(other.score - best.score) / (2 * temperature)));
                if (w < 1e-4) continue;
                weight += w;
                one.rivals.push_back({name, w});
            }
            one.probability = certain * trust / weight;
            for (auto& rival : one.rivals) rival.probability *= certain * trust / weight;
            one.is_open = one.probability <= decided;
            one.evidence = evidence(one, best, next, next_name, trust < 1);
            d_.effects.push_back(std::move(one));
        }
        // The strongest first: the one without which the error is largest. What is missing besides need not be decided.
        order_by_strength();
        d_.verdict = d_.effects.front().is_open ? "undecided" : "effect_found";
    }

    bool are_told_apart(const Scored& best, const Scored& other) const {
        return d_.search.fitted.size() > 1 && other.together_fitted > apart_from_alike * best.together_fitted &&
               other.together_validation > apart_from_alike * best.together_validation;
    }

    void order_by_strength() {
        if (best_->effects.size() < 2) return;
        std::vector<std::pair<double, std::size_t>> strength;
        for (std::size_t i = 0; i < best_->effects.size(); ++i) {
            Hypothesis without = *best_;
            without.remove(i);
            strength.push_back({-fit_.chi_square(without), i});
        }
        std::sort(strength.begin(), strength.end());
        std::vector<NamedEffect> ordered;
        for (const auto& [chi, i] : strength) ordered.push_back(std::move(d_.effects[i]));
        d_.effects = std::move(ordered);
    }

    std::string evidence(const NamedEffect& one, const Scored& best, const Scored* next, const std::string& next_name,
                         bool part) const {
        const SearchResult& s = d_.search;
        std::string text = fmt::format(
            "With {} the errors on the fitted records decrease from {:.3g} to {:.3g} times those of noise alone",
            one.name, std::sqrt(without_.fitted), std::sqrt(best.fitted));
        if (!s.validation.empty()) {
            text += fmt::format(", on the validation record from {:.3g} to {:.3g}", std::sqrt(without_.validation),
                                std::sqrt(best.validation));
        }
        text += ".";
        if (s.shared) {
            text += " The fitted records alone leave its parameters uncertain: the first half of the validation record "
                    "is fitted too, and the second half is used for validation.";
        }
        if (next) {
            text += fmt::format(" The nearest other effect, {}, leaves {:.3g} and {:.3g}.", next_name,
                                std::sqrt(next->together_fitted), std::sqrt(next->together_validation));
        } else {
            text += " No other effect comes near.";
        }
        if (!one.rivals.empty()) {
            text += " These records cannot tell the two apart with certainty.";
        }
        if (part && !d_.fields_off.empty()) {
            text +=
                " Only noise remains, but with fields of the machine farther off than their tolerances let them be: "
                "they may do the work of another effect.";
        } else if (part) {
            text +=
                " More than noise remains, so the name rests on the share that it explains and on the agreement of the "
                "records, not on a complete explanation.";
        }
        return text;
    }

    // Standard errors in the form of the parameters: what was fixed has none.
    std::vector<Json> errors_of(const Hypothesis& h) const {
        std::vector<Json> list;
        std::size_t begin = 0;
        for (std::size_t i = 0; i < h.effects.size(); ++i) {
            const auto values = h.values_of(i);
            const Effect effect = h.effects[i]->at(values);
            const auto base = effect.numbers();
            // A parameter of the effect may depend on several fitted ones: errors add up as squares of what each moves.
            std::vector<double> errors(base.size(), 0.0);
            for (std::size_t j = 0; j < values.size(); ++j) {
                std::vector<double> moved(values.begin(), values.end());
                moved[j] += h.standard_errors[begin + j];
                const auto there = h.effects[i]->numbers_at(moved);
                for (std::size_t k = 0; k < errors.size(); ++k)
                    errors[k] += (there[k] - base[k]) * (there[k] - base[k]);
            }
            for (double& error : errors) error = std::sqrt(error);
            Json parameters = effect.with_numbers(errors).to_json()["parameters"];
            for (const auto& p : effect.kind().parameters) {
                if (p.type != EffectParameter::Type::number && p.type != EffectParameter::Type::records) {
                    parameters.erase(p.name);
                }
            }
            list.push_back(std::move(parameters));
            begin += values.size();
        }
        return list;
    }

    // Angles between zero and one turn.
    static Effect within_a_turn(const Effect& effect) {
        constexpr double turn = 2 * 3.141592653589793;
        auto numbers = effect.numbers();
        const auto names = effect.number_names();
        for (std::size_t i = 0; i < numbers.size(); ++i) {
            if (effect.kind().unit_of(names[i]) == "rad") numbers[i] -= turn * std::floor(numbers[i] / turn);
        }
        return effect.with_numbers(numbers);
    }

    void unknown() {
        const SearchResult& s = d_.search;
        d_.verdict = s.out_of_time ? "undecided" : "unknown_effect"; // what was not tried may explain it
        // The one effect that comes nearest on the validation record.
        const Scored& first = s.steps.front();
        const double before = s.validation.empty() ? s.baseline.fitted : s.baseline.validation;
        const double after = s.validation.empty() ? first.fitted : first.validation;
        d_.nearest = Diagnosis::Nearest{fmt::format("{}", fmt::join(first.names(), "+")),
                                        std::clamp(1 - std::sqrt(after / before), 0.0, 1.0)};
        best_.reset();
        list_fields_off(s.baseline);
        if (!d_.fields_off.empty()) d_.before = machine_;
    }

    // Fields beyond their tolerances may explain all that an effect would: the answer says which.
    void list_fields_off(const Scored& one) {
        const SearchResult& s = d_.search;
        if (one.together.within_tolerance() || one.together_fitted > SearchResult::limit(s.fitted) ||
            (!s.validation.empty() && one.together_validation > SearchResult::limit(s.validation))) {
            return;
        }
        constexpr double far = 2; // standard deviations
        const auto& moved = one.hypothesis.nominal;
        for (std::size_t i = 0; i < moved.size(); ++i) {
            if (std::abs(moved[i]) > far) d_.fields_off.push_back({fit_.fields()[i].name, moved[i]});
        }
        std::ranges::stable_sort(d_.fields_off, std::greater{}, [](const auto& f) { return std::abs(f.deviations); });
    }

    const MachineModel& machine_;
    Diagnosis& d_;
    const RunControl& control_;
    ModelFit fit_;
    std::optional<Hypothesis> best_;
    Scored without_; // an effect
};

// A resolution read from the values. It is no gap of positions, which are simulated without rounding; it raises the
// floor of noise and rounding above that of the machine as described.
void add_encoder(Diagnosis& d, const Effect& encoder, double described, const RunControl& control) {
    for (auto* list : {&d.fitted, &d.validation}) {
        for (auto& c : *list) {
            if (const auto floor = noise_floor(d.before, c.measurement, control)) c.described_floor = floor->rms;
        }
    }
    const Compared& record = d.validation.front();
    NamedEffect one;
    one.name = encoder.kind().name;
    one.parameters = encoder.to_json()["parameters"];
    one.standard_errors = Json{{"resolution_m", 0.0}};
    one.probability = 0.99;
    one.evidence = fmt::format(
        "All measured positions are multiples of {} m, not of {} m as described. On the validation record noise and "
        "rounding of the machine as described would leave {:.3g} um, with this resolution they leave {:.3g} um; "
        "measured minus simulated position is {:.3g} um.",
        to_text(encoder.number("resolution_m")), to_text(described), 1e6 * record.described_floor,
        1e6 * record.gap.floor, 1e6 * record.gap.after);
    d.effects.insert(d.effects.begin(), one);
    if (d.verdict == "nothing_missing") d.verdict = "effect_found";
}

} // namespace

Diagnosis diagnose(const MachineModel& machine, std::vector<Measurement> fitted, std::optional<Measurement> validation,
                   const DiagnosisOptions& options, const RunControl& control) {
    for (const auto& m : fitted) check_size(machine, m);
    std::vector<Evidence> fit_records, validation_records;
    if (validation) {
        check_size(machine, *validation);
        validation_records.push_back({std::move(*validation)});
    } else {
        // The last third validates what is fitted to the first two.
        Evidence rest{fitted.front()};
        rest.first = 2 * rest.measurement.size() / 3;
        validation_records.push_back(rest);
        fitted.front().cut(rest.first);
    }
    // A resolution coarser than described shows in the values themselves.
    MachineModel coarse = machine;
    std::optional<Effect> encoder;
    const double described = machine.axis().encoder_resolution;
    double step = std::numeric_limits<double>::infinity();
    for (const auto& m : fitted) step = std::min(step, lattice_step(m.position(), described));
    if (described > 0 && step > 1.4 * described) {
        encoder = Effect(effect_kind("encoder_quantization"), {{.number = step}});
        std::vector<Effect> effects = machine.effects;
        effects.push_back(*encoder);
        coarse = machine.with_effects(std::move(effects));
    }
    for (auto& m : fitted) fit_records.push_back({std::move(m)});
    Diagnosis d{.verdict = {}, .before = machine, .after = machine};
    // The rest of the budget is for the verdict and the comparison.
    constexpr double search_share = 0.8, longest = 1e9;
    const std::chrono::duration<double> patience(search_share * std::min(options.budget.value_or(longest), longest));
    const auto deadline =
        std::chrono::steady_clock::now() + std::chrono::duration_cast<std::chrono::steady_clock::duration>(patience);
    d.search = search_effects(coarse, std::move(fit_records), std::move(validation_records), options.max_effects,
                              deadline, control);
    Verdict verdict(coarse, d, control);
    try {
        verdict.decide();
    } catch (const EndedEarly&) {
        throw EndedEarly(fmt::format("interrupted, nothing is written; so far {}", d.search.found_so_far()));
    }
    if (encoder) {
        d.before =
            d.fields_off.empty() ? ModelFit(machine, d.search.fitted).machine(d.search.baseline.hypothesis) : machine;
    }
    for (const auto& record : d.search.fitted) d.fitted.push_back(compared(record, d.before, d.after));
    for (const auto& record : d.search.validation) d.validation.push_back(compared(record, d.before, d.after));
    if (encoder) add_encoder(d, *encoder, described, control);
    d.fitted_gap = total_gap(d.fitted);
    d.validation_gap = total_gap(d.validation);
    // A resolution is no gap of positions.
    d.explained = d.validation_gap.explained();
    // Slow errors weigh little in chi square, and are what is seen.
    const bool shown_left = d.validation_gap.is_left(), fitted_left = d.fitted_gap.is_left();
    if (d.verdict == "effect_found" && (shown_left || fitted_left)) {
        d.verdict = "partial";
        // What is left may be what a force of no name leaves, of which the effect takes up a part.
        double explained = 1;
        if (shown_left) explained = d.explained;
        if (fitted_left) explained = std::min(explained, d.fitted_gap.explained());
        if (const auto& ranking = d.search.ranking; !ranking.empty() && ranking.front().together.settled) {
            // Noise decides how the motion goes on, so that the gap stays: errors of prediction show what is explained.
            explained = std::max(explained, 1 - ranking.front().validation / d.search.baseline.validation);
        }
        for (auto& effect : d.effects) {
            const double share = std::min(1.0, of_a_part * std::clamp(explained, 0.0, 1.0) / effect.probability);
            effect.probability *= share;
            for (auto& rival : effect.rivals) rival.probability *= share;
        }
    }
    d.where = where_they_disagree(d);
    RunControl whole = control; // with the verdict made, the rest takes moments
    whole.stop = nullptr;
    d.next_experiment = next_experiment(coarse, d, whole);
    return d;
}

} // namespace tribode
