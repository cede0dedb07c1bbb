#include "tribode/diagnosis/search.hpp"
#include "tribode/base/error.hpp"
#include "tribode/diagnosis/prediction_statistics.hpp"
#include "tribode/diagnosis/residual_force.hpp"
#include "tribode/diagnosis/response.hpp"

#include <Eigen/QR>
#include <algorithm>
#include <cmath>
#include <fmt/format.h>
#include <fmt/ranges.h>
#include <limits>
#include <map>
#include <numeric>
#include <optional>
#include <set>
#include <tuple>
#include <utility>

namespace tribode {

namespace {

// What the search spends, in counts: the answer must not depend on the clock.
constexpr std::size_t beam_width = 3; // hypotheses on which another effect is sought
// Candidates that are fitted for a first effect, and for each further one: those that explain most in proportion.
constexpr std::size_t screened_first = 18, screened_later = 12;
constexpr std::size_t validated_count = 3;    // of the ranking at most, with parameters of the fitted records alone
constexpr std::size_t most_likely_pairs = 12; // of two effects that are sought together
constexpr double field_step = 0.05;           // of differences by an uncertain field, in its deviations
constexpr int max_enriched = 4;               // times that a form is made richer
// Samples of the record that is looked at first, where so many show the gap: to read where effects begin, and to fit them.
constexpr std::size_t clue_samples = 10000, lead_samples = 4000;
// A candidate with many local minima is found on beginnings of the record: samples from where the gap first shows, and
// of the points so many of the best, fitted there by so many steps.
struct Beginning {
    std::size_t samples, points;
    int iterations;
};
constexpr Beginning beginnings[] = {{100, 16, 4}, {100, 8, 8}, {150, 6, 6},  {200, 6, 6},  {300, 5, 6}, {400, 5, 6},
                                    {600, 4, 6},  {900, 4, 6}, {1400, 4, 6}, {2500, 4, 6}, {5000, 3, 6}};
constexpr std::size_t grown_from = 400;      // samples of the first beginning on which uncertain fields are found
constexpr double slow = 1.5;                 // times the rms of noise: errors above are looked at
constexpr double much_longer = 1.5;          // times the stroke of another record
constexpr std::size_t beginnings_from = 800; // samples of the first beginning for a form sought on beginnings
constexpr double worthwhile = 0.8;           // of chi square there without the candidate: points above are given up
constexpr double followed = 1.5;             // chi square per sample up to which a beginning is simulated as it went
// Chi square per sample up to which noise explains the remaining error of a settled hypothesis: a few seeds show only
// roughly how far noise spreads the simulated paths, and the beginning was followed.
constexpr double settled_limit = 3;
// Of the score, by which an effect more must be better.
constexpr double worth_an_effect = 10;
// Chi square by that of a hypothesis to which noise alone is left, above which another one is no rival.
constexpr double hopeless = 1.5;
// Chi square by that of the first of a ranking, up to which a hypothesis is compared with it by what both predict.
constexpr double rivaling = 1.05;
// Standard deviations of the gain in prediction from which a hypothesis is preferred to one that it contains. The gain is the
// square of what a parameter does, its deviation twice that: a parameter of four standard errors.
constexpr double sure_gain = 2;
// Chi square by that of a hypothesis for which others are sought, above which these are given up.
constexpr double out_of_reach = 10;
// Chi square on the lead by that of the best there, up to which hypotheses are followed together.
constexpr double abreast = 1.5;
constexpr int max_rounds = 8;            // of a few steps each, on all records
constexpr std::size_t most_followed = 8; // hypotheses that are fitted to all records
// Chi square of the lead after a few steps, per sample, and by that of the base.
constexpr double promising = 1000, promising_share = 0.02;
// What another effect must gain beyond the penalty of its parameters, unless it leaves noise alone: else errors are
// correlated, and chi square falls by chance.
constexpr double worth = 30;
constexpr double needed_fall = 4;         // of the score, while more than noise remains
constexpr double leads_back_within = 100; // chi square per sample up to which fields are led back
constexpr double shows = 8;               // whitened errors of noise alone are seldom half as large

std::size_t count(const std::vector<Evidence>& records) {
    std::size_t sum = 0;
    for (const auto& record : records) sum += record.samples();
    return sum;
}

Evidence beginning(const Evidence& whole, std::size_t samples) {
    Evidence part = whole;
    part.measurement.cut(samples);
    return part;
}

class Search {
  public:
    Search(const MachineModel& machine, std::vector<Evidence> fitted, std::vector<Evidence> validation,
           std::size_t max_effects, std::chrono::steady_clock::time_point deadline, const RunControl& control)
        : machine_(machine),
          max_effects_(max_effects),
          deadline_(deadline),
          control_(control) {
        result_.fitted = std::move(fitted);
        result_.validation = std::move(validation);
        std::size_t number = 0;
        for (auto* records : {&result_.fitted, &result_.validation}) {
            for (auto& record : *records) record.number = number++;
        }
    }

    SearchResult run() {
        try {
            search();
            validate();
            compare_rivals();
            Scored& last = result_.ranking.empty() ? result_.baseline : result_.ranking.front();
            if (adequate(last) && last.validation > SearchResult::limit(result_.validation) && !last.together.settled)
                share(last);
        } catch (const EndedEarly&) {
            throw EndedEarly(fmt::format("interrupted, nothing is written; so far {}", result_.found_so_far()));
        }
        result_.out_of_time = late();
        return std::move(result_);
    }

  private:
    // A candidate beside a base, and the points from which a fit of it begins, the best first.
    struct Begun {
        std::shared_ptr<const Candidate> candidate;
        std::vector<Hypothesis> points;
    };

    void search() {
        set_floors(machine_);
        Hypothesis none;
        none.nominal.assign(ModelFit(machine_, all_).fields().size(), 0.0);
        Hypothesis straight = none;
        refine(straight, all_, 30, control_.workers);
        result_.baseline = scored(std::move(straight));
        if (!adequate(result_.baseline) && !none.nominal.empty()) {
            grow(none, control_.workers);
            Scored grown = scored(std::move(none));
            if (grown.score < result_.baseline.score) result_.baseline = std::move(grown);
        }
        if (adequate(result_.baseline)) return;
        std::vector<Scored> beam{result_.baseline};
        const Hypothesis& bent = result_.baseline.together;
        std::size_t bare_place = 0;
        if (bent.sum_of_squares() > 0) {
            // The fields may be bent to do the work of the effect: it is sought beside those of the user, too, and
            // first where they left their tolerance.
            Hypothesis as_described = bent;
            std::ranges::fill(as_described.nominal, 0.0);
            as_described.converged = false;
            beam.push_back(scored(std::move(as_described)));
            if (!bent.within_tolerance()) {
                std::swap(beam[0], beam[1]);
                if (auto shown = with_farthest_as_described(result_.baseline)) {
                    beam.insert(beam.begin(), std::move(*shown));
                    bare_place = 1;
                }
            }
        }
        choose_lead(beam.front().together);
        const Scored bare = beam[bare_place];
        std::vector<Begun> beside_bare;
        std::optional<SearchResult> taken; // with the noise floors of its own machine: what is tried later sets others
        bool of_noise = false;             // it leaves noise, but slow errors for which another effect is sought
        for (std::size_t level = 1; level <= max_effects_ && !late(); ++level) {
            std::vector<Scored> pool;
            std::optional<std::set<std::string>> enough; // effects of a hypothesis to which noise alone is left
            const auto look_for_enough = [&] {
                for (const auto& one : pool) {
                    if (enough || !adequate(one)) continue;
                    const auto names = one.names();
                    enough.emplace(names.begin(), names.end());
                }
            };
            worth_following_ = std::numeric_limits<double>::infinity();
            worth_taking_ = followed * static_cast<double>(count(all_));
            if (level > 1) {
                // To be taken it must come to the noise or to a quarter of this, below.
                worth_taking_ = std::max(worth_taking_, result_.steps.back().score / needed_fall);
                const Hypothesis& before = result_.steps.back().together;
                // The record that showed most without the effects so far may show nothing of what is missing beside them.
                choose_lead(before);
                const ModelFit lead(machine_, lead_records_);
                worth_following_ =
                    std::max(0.5 * lead.chi_square(before), followed * static_cast<double>(lead.sample_count()));
            }
            if (level == 2) {
                pool = paired(bare, beside_bare);
                look_for_enough();
            }
            const std::string what = "effect " + std::to_string(level);
            const auto best_of_pool = [&] {
                double best = std::numeric_limits<double>::infinity();
                for (const auto& one : pool) best = std::min(best, one.together.chi_square);
                return best;
            };
            std::vector<Hypothesis> waiting; // fitted to the lead, of the bases so far
            const auto follow = [&](std::vector<Begun> list, const Scored& base) {
                std::ranges::move(fitted_to_lead(points_of(std::move(list), base, level), what),
                                  std::back_inserter(waiting));
                if (&base != &beam.back() && !is_promising(waiting, base.together)) return;
                for (auto& next : fitted_to_all(std::exchange(waiting, {}), what, enough.has_value(), best_of_pool())) {
                    pool.push_back(std::move(next));
                }
                look_for_enough();
            };
            for (const auto& base : beam) {
                // Another way to the same effect, by other fields, cannot gain on noise.
                if (level == 1 && std::ranges::any_of(pool, [&](const Scored& one) { return is_noise(one); })) break;
                // Another way to such a hypothesis, or a rival of it, has one of its effects.
                auto list = begun(base, what, enough);
                if (level == 1 && &base == &beam[bare_place] && !enough) beside_bare = list;
                follow(std::move(list), base);
            }
            // What leads the whole motion away does not yet do so at first.
            for (const auto& base : beam) {
                if (level > 1 || best_of_pool() < promising * static_cast<double>(count(all_))) break;
                follow(begun(base, what, enough, true), base);
            }
            rank(pool);
            if (pool.empty()) break;
            if (!adequate(pool.front())) prefer_settled(pool);
            // What is left to do would not bring it there.
            if (level > 1 && !adequate(pool.front()) && pool.front().score > 2 * worth_taking_) break;
            // The loop's noise is that of the machine as it is now known.
            if (const auto machine = machine_of(pool.front().together)) set_floors(*machine);
            reassess(pool);
            // Once more where that brings the first one to the noise: only there simpler kinds that were dropped are tried.
            for (bool again = true; again && !late();) {
                const bool left_noise = leaves_noise(pool.front());
                add_rivals(pool, level);
                again = !left_noise && leaves_noise(pool.front());
            }
            result_.baseline = scored(std::move(result_.baseline.together));
            for (auto& step : result_.steps) step = scored(std::move(step.together));
            const Scored& before = result_.steps.empty() ? result_.baseline : result_.steps.back();
            // Another effect must be worth its parameters, on the validation records too. These are judged with
            // parameters fitted to all records: those of the fitted ones alone predict little while the model still
            // lacks an effect.
            // What takes the place of a field that was bent beyond its tolerance need not do more than that.
            const bool for_fields = leaves_noise(pool.front());
            const bool better = pool.front().score < before.score - (adequate(pool.front()) ? 0 : worth) &&
                                (result_.validation.empty() ||
                                 pool.front().together_validation < 0.97 * before.together_validation || for_fields);
            // While more than noise remains it must also halve the error that the effects before it leave: what a model
            // lacks that stays imperfect is not a sum of small pieces.
            const bool halved = pool.front().score < before.score / needed_fall;
            if (level > 1 && (!better || (!halved && !for_fields))) break;
            if (of_noise && (pool.front().score > before.score - worth || leaves_slow_errors(pool.front()))) break;
            result_.ranking = pool;
            result_.steps.push_back(pool.front());
            taken = result_;
            // A part of several effects may be all that some records show, and nothing to the validation record. Nothing is sought beside
            // it, but pairs of which neither may do much alone.
            if (!better && !halved) {
                if (level > 1) break;
                beam.clear();
                continue;
            }
            of_noise = adequate(pool.front());
            if (of_noise && !leaves_slow_errors(pool.front())) break;
            beam.clear();
            if (auto shown = with_farthest_as_described(pool.front())) beam.push_back(std::move(*shown));
            std::set<std::vector<std::string>> seen;
            for (const auto& one : pool) {
                const bool close = one.together.chi_square < 20 * pool.front().together.chi_square;
                if (close && beam.size() < beam_width && seen.insert(one.names()).second) beam.push_back(one);
            }
            for (std::size_t i = 0, count = beam.size(); i < count; ++i) {
                const auto other = with_mass_for_gain(beam[i]);
                if (other && seen.insert(other->names()).second) beam.push_back(*other);
            }
        }
        if (taken) {
            result_ = *std::move(taken);
            gather_records();
        }
    }

    // Where fields do all the work of an effect, one of them may do most, as a mass that of a payload: the effect shows best
    // beside the others as they were found. Nothing where the fields are where they may be.
    std::optional<Scored> with_farthest_as_described(const Scored& one) const {
        if (one.together.within_tolerance()) return std::nullopt;
        Hypothesis without = one.together;
        *std::ranges::max_element(without.nominal, {}, [](double off) { return std::abs(off); }) = 0;
        without.converged = false;
        return scored(std::move(without));
    }

    // A mass in the place of a gain of the thrust, or the other way round. They do the same but for friction; where its level is off
    // besides, one of the two takes one more effect than the other, and may follow worse while that is not there yet.
    std::optional<Scored> with_mass_for_gain(const Scored& one) const {
        const auto names = one.names();
        const auto has = [&](const std::string& name) { return std::ranges::find(names, name) != names.end(); };
        const std::string gain = "thrust_gain", mass = "payload_mass"; // of factors that are each other's inverse
        if (has(gain) == has(mass) || late()) return std::nullopt;
        Hypothesis rest = one.together;
        const auto is_meant = [&](const auto& effect) {
            return effect->kind().name == gain || effect->kind().name == mass;
        };
        const auto place =
            static_cast<std::size_t>(std::ranges::find_if(rest.effects, is_meant) - rest.effects.begin());
        const double factor = rest.values_of(place)[0];
        rest.remove(place);
        auto h = with_kind(rest, has(gain) ? mass : gain, {1 / factor});
        if (!h) return std::nullopt;
        refine(*h, all_, 8, control_.workers);
        if (!std::isfinite(h->chi_square)) return std::nullopt;
        return scored(*std::move(h));
    }

    // A hypothesis with an effect more, of this kind, from these values of its first form.
    std::optional<Hypothesis> with_kind(const Hypothesis& rest, const std::string& kind,
                                        const std::vector<double>& values) const {
        const auto machine = machine_of(rest);
        if (!machine) return std::nullopt;
        auto found = candidates_from(clue_record_, *machine, [&](const EffectKind& one) { return one.name == kind; });
        if (found.empty()) return std::nullopt;
        auto candidate = std::make_shared<const Candidate>(std::move(found.front()));
        std::vector<double> within = values;
        for (std::size_t i = 0; i < within.size(); ++i) {
            within[i] = std::clamp(within[i], candidate->parameters[i].low, candidate->parameters[i].high);
        }
        return with(rest, candidate, within);
    }

    // Nothing where the values are those of no machine, as where fields that were fitted beside an effect leave a level of friction
    // below zero without it.
    std::optional<MachineModel> machine_of(const Hypothesis& h) const {
        try {
            return ModelFit(machine_, all_).machine(h);
        } catch (const InputError&) {
            return std::nullopt;
        }
    }

    void set_floors(const MachineModel& machine) {
        for (auto* records : {&result_.fitted, &result_.validation}) {
            for (auto& record : *records) {
                if (const auto floor = noise_floor(machine, record.measurement, control_)) {
                    record.floor = *floor;
                } else if (record.floor.rms == 0) {
                    // The model cannot follow the record at all: noise as it comes from the sensor.
                    record.floor.rms = record.floor.innovation =
                        std::max(std::hypot(machine.noise_rms, machine.encoder_resolution / std::sqrt(12.0)), 1e-12);
                }
            }
        }
        gather_records();
    }

    void gather_records() {
        all_ = result_.fitted;
        for (const auto& record : result_.validation) {
            all_.push_back(record);
            if (record.first == 0) continue;
            // The end of the first record: that as a whole, once.
            all_.erase(all_.begin());
            all_.back().first = 0;
        }
        cut_lead();
    }

    // The samples of a record after which it has shown most of its thrust and of its stroke: a limit shows only there.
    static std::size_t shown_after(const Measurement& measurement) {
        constexpr double most = 0.9;
        const auto reach = [&](const std::vector<double>& signal) {
            const auto [low, high] = std::ranges::minmax(signal);
            double least = signal.front(), largest = signal.front();
            std::size_t k = 0;
            while (k < signal.size() && largest - least < most * (high - low)) {
                least = std::min(least, signal[k]);
                largest = std::max(largest, signal[k]);
                ++k;
            }
            return k;
        };
        return std::max(reach(measurement.thrust), reach(measurement.position()));
    }

    // The record on which the gap shows most, to look at first; of a long one its beginning, if that shows as much.
    void choose_lead(const Hypothesis& none) {
        double most = -1;
        for (std::size_t i = 0; i < all_.size(); ++i) {
            const std::vector<Evidence> alone{all_[i]};
            const auto e = ModelFit(machine_, alone).errors(none);
            const std::size_t n = all_[i].samples();
            double sum = 0;
            std::vector<double> up_to{0};
            for (std::size_t k = 0; k < std::min(n, e.size()); ++k) up_to.push_back(sum += e[k] * e[k]);
            if (sum / static_cast<double>(n) <= most) continue;
            most = sum / static_cast<double>(n);
            lead_ = i;
            const auto showing = [&](std::size_t least) {
                std::size_t length = std::min(n, std::max(least, shown_after(all_[i].measurement)));
                while (length < n &&
                       up_to[std::min(length, up_to.size() - 1)] < 0.5 * most * static_cast<double>(length)) {
                    length = std::min(n, length + least / 2);
                }
                return length;
            };
            lead_length_ = showing(lead_samples);
            clue_length_ = showing(clue_samples);
        }
        cut_lead();
    }

    void cut_lead() {
        lead_records_.clear();
        if (lead_length_ == 0) return;
        lead_records_.push_back(beginning(all_[lead_], lead_length_));
        clue_record_ = beginning(all_[lead_], clue_length_);
    }

    // What was followed as far as noise allows is judged by the noise of its own machine: where it does best by that, it comes first.
    void prefer_settled(std::vector<Scored>& pool) {
        for (std::size_t i = 0; i < pool.size() && !late(); ++i) {
            if (!pool[i].together.settled) continue;
            const auto fitted = result_.fitted, validation = result_.validation;
            std::vector<Scored> again;
            try {
                set_floors(ModelFit(machine_, all_).machine(pool[i].together));
                for (const auto& one : pool) again.push_back(scored(one.together));
            } catch (const InputError&) {
                again.clear(); // no such machine
            }
            const auto best = std::ranges::min_element(again, {}, &Scored::score);
            if (best != again.end() && best - again.begin() == static_cast<std::ptrdiff_t>(i)) {
                std::rotate(again.begin(), best, best + 1);
                pool = std::move(again);
                return;
            }
            result_.fitted = fitted;
            result_.validation = validation;
            gather_records();
        }
    }

    void go_on() const {
        if (control_.stop_requested()) throw EndedEarly("a search was interrupted");
    }

    bool late() const { return std::chrono::steady_clock::now() > deadline_; }

    // Chi square is that of noise: there is nothing to gain any more.
    bool is_noise(const Scored& one) const {
        double spread = 0;
        for (const auto& record : all_) spread = std::max(spread, record.floor.spread);
        const double n = static_cast<double>(count(all_));
        return one.together.within_tolerance() && one.together.chi_square < n * (1 + 2 * std::sqrt(2 / n) + spread);
    }

    bool adequate(const Scored& one) const { return result_.explained_by_noise(one); }

    // Whitened errors are mostly fast ones. Slow ones that are larger than those of noise may be noise all the same, or what another
    // effect would take.
    bool leaves_slow_errors(const Scored& one) const {
        if (one.together.settled) return false;
        const MachineModel machine = ModelFit(machine_, all_).machine(one.together);
        return std::ranges::any_of(all_, [&](const Evidence& record) {
            const auto position = simulated_position(machine, record.measurement);
            if (!position) return false;
            std::vector<double> gap = record.measurement.position();
            for (std::size_t k = 0; k < gap.size(); ++k) gap[k] -= (*position)[k];
            return rms(gap) > slow * record.floor.rms;
        });
    }

    // With the fields wherever they are.
    bool leaves_noise(const Scored& one) const {
        return one.together_fitted < SearchResult::limit(result_.fitted) &&
               (result_.validation.empty() || one.together_validation < SearchResult::limit(result_.validation));
    }

    void refine(Hypothesis& h, const std::vector<Evidence>& records, int iterations, unsigned workers,
                bool move_fields = true) const {
        ModelFit::Options options;
        options.iterations = iterations;
        options.workers = workers;
        options.move_fields = move_fields;
        options.stop = control_.stop;
        options.deadline = deadline_;
        ModelFit(machine_, records).fit(h, options);
    }

    // The sample at which a hypothesis' gap first shows; 0 where it does not.
    std::size_t first_shown(const Hypothesis& h, const Evidence& record) const {
        const std::vector<Evidence> alone{record};
        const auto e = ModelFit(machine_, alone).errors(h);
        for (std::size_t k = 0; k < std::min(e.size(), record.samples()); ++k) {
            if (std::abs(e[k]) > shows) return k;
        }
        return 0;
    }

    // Over a whole record chi square has local minima far from the right parameters, such as one for each turn of a
    // mode's phase. On beginnings of the records that double in length, each fit ends close enough to the minimum of
    // the next.
    void grow(Hypothesis& h, unsigned workers) const {
        std::vector<std::size_t> first;
        std::size_t longest = 0;
        for (const auto& record : all_) {
            first.push_back(first_shown(h, record));
            longest = std::max(longest, record.measurement.size());
        }
        for (std::size_t samples = grown_from; samples < longest; samples *= 2) {
            std::vector<Evidence> part;
            for (std::size_t i = 0; i < all_.size(); ++i) part.push_back(beginning(all_[i], first[i] + samples));
            refine(h, part, 8, workers);
        }
        refine(h, all_, 30, workers);
    }

    double per_sample(const Hypothesis& h, const std::vector<Evidence>& records) const {
        return ModelFit(machine_, records).chi_square_per_sample(h);
    }

    Scored scored(Hypothesis h) const {
        Scored one;
        one.together_fitted = per_sample(h, result_.fitted);
        h.chi_square = h.sum_of_squares() + one.together_fitted * static_cast<double>(count(result_.fitted));
        if (!result_.validation.empty()) {
            one.together_validation = per_sample(h, result_.validation);
            h.chi_square += one.together_validation * static_cast<double>(count(result_.validation));
        }
        one.score = score(h);
        one.hypothesis = h;
        one.fitted = one.together_fitted;
        one.validation = one.together_validation;
        one.together = std::move(h);
        return one;
    }

    // The parameters of the fitted records alone, and how they predict the validation records: of what the answer shows.
    void validate() {
        if (result_.validation.empty()) return;
        const auto one_of_all = [&](Scored& one) {
            refine(one.hypothesis, result_.fitted, 10, control_.workers);
            one.fitted = per_sample(one.hypothesis, result_.fitted);
            one.validation = per_sample(one.hypothesis, result_.validation);
        };
        one_of_all(result_.baseline);
        auto& ranking = result_.ranking;
        for (std::size_t i = 0; i < std::min(ranking.size(), validated_count); ++i) {
            // The next experiment is for one that comes near.
            if (i > 0 && ranking[i].together.chi_square > hopeless * ranking.front().together.chi_square) continue;
            one_of_all(ranking[i]);
        }
        // The nearest effect is told where the answer is none.
        if (result_.steps.size() == 1) {
            result_.steps.front() = ranking.front();
        } else if (!result_.steps.empty()) {
            one_of_all(result_.steps.front());
        }
    }

    // Of two explanations that both leave noise, the better one fits better by what both lack as well: in what is left out of a fit it
    // must be better beyond what errors do that are correlated.
    void compare_rivals() {
        auto& ranking = result_.ranking;
        if (ranking.size() < 2 || !adequate(ranking.front()) || ranking.front().together.settled) return;
        const Scored& first = ranking.front();
        std::vector<std::size_t> rows;
        for (const auto& record : all_) rows.push_back(record.samples());
        std::optional<Eigen::VectorXd> best;
        for (std::size_t i = 1; i < ranking.size() && !late(); ++i) {
            Scored& other = ranking[i];
            if (other.together.chi_square > rivaling * first.together.chi_square) continue;
            if (other.names().size() != first.names().size() || !adequate(other)) continue;
            if (!best) best = predicted(first.together);
            const Eigen::VectorXd its = predicted(other.together);
            if (its.size() == best->size()) other.behind = gain_in_deviations(its, *best, rows);
        }
    }

    // The fitted records alone leave the parameters too uncertain to predict a richer one: the first half of the
    // validation records is fitted too, and the second half is used for validation.
    void share(Scored& last) {
        std::vector<Evidence> fitted = result_.fitted;
        for (auto& record : result_.validation) {
            const std::size_t half = record.first + record.samples() / 2;
            fitted.push_back(beginning(record, half));
            record.first = half;
        }
        result_.shared = true;
        for (Scored* one : {&result_.baseline, &last}) {
            one->hypothesis = one->together;
            ModelFit::Options options;
            options.iterations = 10;
            options.workers = control_.workers;
            options.stop = control_.stop;
            options.standard_errors = true;
            ModelFit(machine_, fitted).fit(one->hypothesis, options);
            one->fitted = per_sample(one->hypothesis, result_.fitted);
            one->validation = per_sample(one->hypothesis, result_.validation);
        }
    }

    // Whitened errors of each part of all records, predicted from the rest.
    Eigen::VectorXd predicted(Hypothesis h) const {
        ModelFit::Options options;
        options.iterations = 4;
        options.workers = control_.workers;
        options.stop = control_.stop;
        options.left_out_errors = true;
        ModelFit(machine_, all_).fit(h, options);
        return h.left_out_errors;
    }

    // Whether a hypothesis does no better than another one that it contains. A richer one always fits better, and errors
    // that are correlated over longer than their predictor make that look like more than it is: so it must predict better
    // what is not fitted, beyond what such errors do by chance.
    bool is_needlessly_rich(const Scored& richer, const Scored& simpler) const {
        if (richer.together.settled || simpler.together.settled) return false;
        if (simpler.together.chi_square > hopeless * richer.together.chi_square) return false;
        if (adequate(richer) && !adequate(simpler)) return false; // it leaves the fields where they may be
        std::vector<std::size_t> rows;
        for (const auto& record : all_) rows.push_back(record.samples());
        const Eigen::VectorXd with = predicted(richer.together), without = predicted(simpler.together);
        return with.size() == without.size() && gain_in_deviations(without, with, rows) < sure_gain;
    }

    // Of a ranking: the first one gives way to one that it contains and that does as well. So do several effects to one that
    // contains them all, with no more parameters: one explanation is simpler than two.
    void prefer_simpler(std::vector<Scored>& pool) const {
        const auto says_it_in_fewer = [&](const Scored& other) {
            const Scored& first = pool.front();
            return other.names().size() < first.names().size() && other.covers(first) &&
                   other.together.parameter_count() <= first.together.parameter_count() &&
                   other.score < first.score + worth_an_effect;
        };
        if (const auto one = std::find_if(pool.begin() + 1, pool.end(), says_it_in_fewer); one != pool.end()) {
            std::rotate(pool.begin(), one, one + 1);
        }
        for (std::size_t i = 1; i < pool.size();) {
            if (late()) return;
            if (pool.front().contains(pool[i]) && is_needlessly_rich(pool.front(), pool[i])) {
                std::rotate(pool.begin(), pool.begin() + static_cast<std::ptrdiff_t>(i),
                            pool.begin() + static_cast<std::ptrdiff_t>(i) + 1);
                i = 1;
            } else {
                ++i;
            }
        }
    }

    // Removes effects that others make unnecessary.
    void prune(Scored& one) const {
        for (std::size_t i = 0; one.together.effects.size() > 1 && i < one.together.effects.size();) {
            Hypothesis without = one.together;
            without.remove(i);
            refine(without, all_, 8, control_.workers);
            Scored simpler = scored(std::move(without));
            // One that leaves the fields where they may be is more than another that bends them.
            const bool as_good = adequate(simpler) || !adequate(one);
            if (as_good && (simpler.score < one.score + worth_an_effect || is_needlessly_rich(one, simpler))) {
                one = std::move(simpler);
                i = 0;
            } else {
                ++i;
            }
        }
    }

    // The fit of the baseline has moved uncertain fields to do the work of an effect that was not there yet. Beside the
    // effect they may stay there, since the way back gains little or leads over a ridge. All is fitted again from the
    // user's values.
    void straighten(Scored& one) const {
        if (one.together.sum_of_squares() == 0 || is_noise(one)) return;
        // Far from the noise fields are the least of it.
        if (one.together.chi_square > leads_back_within * static_cast<double>(count(all_))) return;
        Hypothesis again = one.together;
        std::ranges::fill(again.nominal, 0.0);
        again.converged = false;
        again.slopes.clear();
        grow(again, control_.workers);
        Scored straight = scored(std::move(again));
        if (straight.score < one.score) one = std::move(straight);
    }

    // Whether a parameter of an effect is where a simpler kind has none, as the path before friction slips at next to nothing.
    static bool is_at_bound(const Hypothesis& h, std::size_t effect) {
        const auto values = h.values_of(effect);
        const auto& parameters = h.effects[effect]->parameters;
        for (std::size_t i = 0; i < values.size(); ++i) {
            const double close = 1e-3 * std::abs(values[i]);
            if (values[i] <= parameters[i].low + close || values[i] >= parameters[i].high - close) return true;
        }
        return false;
    }

    // An effect of many parameters may have taken the place of a simpler one, which did less alone and was dropped: each of
    // those of the first hypothesis is replaced by its simpler kinds in turn, unless the ranking has that; and the best of
    // these gets another one beside it, of them or of the same kind with fewer parameters. While more than noise remains, what
    // has not been tried is not, but for kinds that are sought in this way only, and where a parameter is at its bound.
    std::vector<Scored> simplified(const std::vector<Scored>& pool, std::size_t level) const {
        const Scored& one = pool.front();
        std::vector<Scored> list;
        for (std::size_t i = 0; i < one.together.effects.size(); ++i) {
            const EffectKind& kind = one.together.effects[i]->kind();
            if (kind.simpler.empty() || late()) continue;
            auto rest = one.names();
            rest.erase(std::ranges::find(rest, kind.name));
            const auto with = [&](const std::string& name) {
                auto names = rest;
                names.push_back(name);
                std::ranges::sort(names);
                return names;
            };
            std::set<std::string> missing;
            std::vector<Hypothesis> instead;
            const bool enough = leaves_noise(one);
            const bool at_bound = is_at_bound(one.together, i);
            for (const auto& name : kind.simpler) {
                if (const auto& as_simpler = one.together.effects[i]->as_simpler) {
                    const auto values = as_simpler(one.together.values_of(i));
                    if (values.empty()) continue;
                    Hypothesis others = one.together;
                    others.remove(i);
                    auto begun = with_kind(others, name, values);
                    if (!begun) continue;
                    refine(*begun, all_, 8, control_.workers);
                    if (!std::isfinite(begun->chi_square)) continue;
                    instead.push_back(*begun);
                    list.push_back(scored(*std::move(begun)));
                    continue;
                }
                const auto known =
                    std::ranges::find_if(pool, [&](const Scored& other) { return other.names() == with(name); });
                if (known == pool.end()) {
                    if (enough || at_bound || effect_kind(name).only_in_place) missing.insert(name);
                } else if (known->together.chi_square > one.together.chi_square + worth ||
                           known->together.parameter_count() >= one.together.parameter_count()) {
                    // Its own fit may have ended early, or it has other forms of the others beside it.
                    auto again = in_place(one.together, i, known->together, name);
                    if (!again && at_bound) missing.insert(name); // begun where the others are now
                    if (!again) continue;
                    Scored better = scored(std::move(*again));
                    instead.push_back(better.together);
                    if (better.score < known->score) list.push_back(std::move(better));
                } else {
                    instead.push_back(known->together);
                }
            }
            if (!missing.empty()) {
                Hypothesis without = one.together;
                without.remove(i);
                if (!at_bound && !enough) refine(without, all_, 4, control_.workers);
                for (auto& next : fitted_beside(scored(std::move(without)), level, missing, one)) {
                    instead.push_back(next.together);
                    list.push_back(std::move(next));
                }
            }
            if (!enough || instead.empty() || one.names().size() == max_effects_) continue;
            // With the fields that the whole explanation has: alone, a part of it may have bent them to do the rest.
            for (Hypothesis& h : instead) {
                h.nominal = one.together.nominal;
                refine(h, all_, 6, control_.workers, false);
            }
            const Scored best = scored(*std::ranges::min_element(instead, {}, &Hypothesis::chi_square));
            if (!one.contains(best) || is_needlessly_rich(one, best)) continue;
            std::set<std::string> beside(kind.simpler.begin(), kind.simpler.end());
            beside.insert(kind.name);
            for (auto& next : fitted_beside(best, level, beside, one)) {
                if (one.contains(next)) list.push_back(std::move(next));
            }
        }
        return list;
    }

    // Adds to a ranking what says the same as its first one in other words.
    void add_rivals(std::vector<Scored>& pool, std::size_t level) const {
        auto rivals = simplified(pool, level);
        if (auto fewer = merged(pool, level); !fewer.empty()) {
            reassess(fewer);
            std::ranges::move(simplified(fewer, level), std::back_inserter(rivals));
            std::ranges::move(fewer, std::back_inserter(rivals));
        }
        if (const auto other = with_mass_for_gain(pool.front())) rivals.push_back(*other);
        if (rivals.empty()) return;
        std::ranges::move(rivals, std::back_inserter(pool));
        reassess(pool);
    }

    // Two effects may be what another one nearly is, as a spring and a cubic one are a ripple: of three or more each two give way
    // to one. (One for both of two was sought first.)
    std::vector<Scored> merged(const std::vector<Scored>& pool, std::size_t level) const {
        const Scored& one = pool.front();
        std::vector<Scored> list;
        const std::size_t effects = one.together.effects.size();
        if (effects < 3) return list;
        for (std::size_t i = 0; i < effects; ++i) {
            for (std::size_t j = i + 1; j < effects && !late(); ++j) {
                Hypothesis rest = one.together;
                rest.remove(j);
                rest.remove(i);
                ModelFit(machine_, all_).evaluate(rest); // as it is: alone the rest would do the work of the others
                std::ranges::move(fitted_beside(scored(std::move(rest)), level, std::nullopt, one),
                                  std::back_inserter(list));
            }
        }
        return list;
    }

    // A hypothesis with a simpler effect in the place of one of its own, fitted; begun with what another one has for it. None
    // where it does by far less.
    std::optional<Hypothesis> in_place(const Hypothesis& whole, std::size_t place, const Hypothesis& other,
                                       const std::string& simpler) const {
        const auto is_meant = [&](const auto& effect) { return effect->kind().name == simpler; };
        const auto effect = std::ranges::find_if(other.effects, is_meant);
        const auto numbers = other.values_of(static_cast<std::size_t>(effect - other.effects.begin()));
        Hypothesis rest = whole;
        rest.remove(place);
        // Alone first, in a machine that has all the rest, since together they may trade along a narrow valley.
        const auto machine = machine_of(rest);
        if (!machine) return std::nullopt;
        const ModelFit lead(*machine, lead_records_);
        Hypothesis alone;
        alone.nominal.assign(lead.fields().size(), 0.0);
        alone = with(alone, *effect, {numbers.begin(), numbers.end()});
        ModelFit::Options options;
        options.iterations = 10;
        options.move_fields = false;
        options.workers = control_.workers;
        options.stop = control_.stop;
        lead.fit(alone, options);
        const double of_whole = ModelFit(machine_, lead_records_).chi_square(whole) - whole.sum_of_squares();
        if (!(alone.chi_square < out_of_reach * of_whole)) return std::nullopt;
        Hypothesis h = with(rest, *effect, alone.values);
        refine(h, all_, 6, control_.workers, false);
        if (h.chi_square < out_of_reach * whole.chi_square) refine(h, all_, 8, control_.workers);
        return h;
    }

    // A base with one more effect, of these or of all, as a rival of what has been found.
    std::vector<Scored> fitted_beside(const Scored& base, std::size_t level,
                                      const std::optional<std::set<std::string>>& effects, const Scored& found) const {
        const std::string what = "effect " + std::to_string(level);
        auto points = points_of(begun(base, what, effects), base, level);
        return fitted_to_all(fitted_to_lead(std::move(points), what), what, true, found.together.chi_square);
    }

    void reassess(std::vector<Scored>& pool) const {
        RunControl quiet;
        quiet.workers = control_.workers;
        for (auto& one : pool) one = scored(std::move(one.together)); // by the new floors
        rank(pool);
        const double far = hopeless * pool.front().together.chi_square;
        // The first steps bring near what can come near, and none what is farther off than this.
        const double too_far = 3 * far;
        for_each_index(pool.size(), quiet, "", [&](std::size_t i) {
            for (const auto& [within, steps] : {std::pair{too_far, 2}, {far, 4}}) {
                if (pool[i].together.chi_square > within) return;
                refine(pool[i].together, all_, steps, 1);
                const bool converged = pool[i].together.converged;
                pool[i] = scored(std::move(pool[i].together));
                if (converged) return;
            }
        });
        rank(pool);
        for (std::size_t i = 0; i < std::min<std::size_t>(pool.size(), 2) && !late(); ++i) {
            if (i > 0 && pool[i].together.chi_square > far) break;
            straighten(pool[i]);
            prune(pool[i]);
        }
        rank(pool);
        prefer_simpler(pool);
    }

    static void rank(std::vector<Scored>& pool) {
        std::erase_if(pool, [](const Scored& one) { return !std::isfinite(one.together.chi_square); });
        std::stable_sort(pool.begin(), pool.end(), [](const Scored& a, const Scored& b) { return a.score < b.score; });
        // One hypothesis for each set of names: the form that does best.
        std::set<std::vector<std::string>> seen;
        std::erase_if(pool, [&](const Scored& one) { return !seen.insert(one.names()).second; });
    }

    static double stroke(const Evidence& record) { // [m]
        const auto [low, high] = std::ranges::minmax(record.measurement.position());
        return high - low;
    }

    const Evidence& longest_record() const { return *std::ranges::max_element(all_, {}, stroke); } // by its stroke

    // The forms of kinds that are wanted, with starts from how the machine and a record disagree.
    std::vector<Candidate> candidates_from(const Evidence& record, const MachineModel& machine,
                                           const std::function<bool(const EffectKind&)>& wanted) const {
        const auto signals = simulated_signals(machine, record.measurement);
        // A model that cannot follow shows nothing: the machine at rest is as good a comparison.
        const SimulatedSignals still{std::vector<double>(record.measurement.size(), 0.0),
                                     std::vector<double>(record.measurement.size(), 0.0)};
        const ResidualForce residual = residual_force(machine, record.measurement, signals ? *signals : still);
        if (residual.force.empty()) return {};
        std::vector<double> gap = record.measurement.position();
        for (std::size_t k = 0; signals && k < gap.size(); ++k) gap[k] -= signals->position[k];
        const std::vector<double> whitened = record.floor.whitened(gap);
        MachineModel described = machine;
        described.effects.clear();
        const ServoAxis axis = described.axis();
        const Clues clues(axis, machine.sample_time, residual, record.measurement.position(), whitened,
                          record.floor.innovation, stroke(longest_record()));
        return candidates(clues, wanted);
    }

    // Every effect that may be beside the base, or those of `only`; or those that were sought on whole records alone, on beginnings.
    std::vector<Begun> begun(const Scored& base, const std::string& what,
                             const std::optional<std::set<std::string>>& only, bool on_beginnings = false) const {
        const auto machine = machine_of(base.together);
        if (!machine) return {};
        const ModelFit lead(machine_, lead_records_);
        const auto present = base.names();
        const auto wanted = [&](const EffectKind& kind) {
            return std::ranges::find(present, kind.name) == present.end() &&
                   (only ? only->contains(kind.name) : !kind.only_in_place);
        };
        auto found = candidates_from(clue_record_, *machine, wanted);
        // What depends on the position is read from a record that moves much farther, too.
        if (const Evidence& longer = longest_record(); stroke(longer) > much_longer * stroke(clue_record_)) {
            std::ranges::move(candidates_from(longer, *machine,
                                              [&](const EffectKind& kind) {
                                                  return wanted(kind) && kind.drawn_against == DrawnAgainst::position;
                                              }),
                              std::back_inserter(found));
        }
        std::vector<Begun> list;
        for (auto& candidate : found) {
            if (on_beginnings && (candidate.rugged || candidate.on_beginnings)) continue;
            list.push_back({std::make_shared<const Candidate>(std::move(candidate)), {}});
        }
        if (on_beginnings) {
            race_on_beginnings(list, base.together, what);
        } else {
            for_each_index(list.size(), control_, what + ": screening", [&](std::size_t i) {
                if (late()) return;
                auto& [candidate, points] = list[i];
                points = candidate->rugged          ? grown_starts(base.together, candidate)
                         : candidate->on_beginnings ? starts_on_beginnings(base.together, candidate)
                                                    : starts_of(base.together, candidate, lead);
            });
        }
        go_on();
        std::erase_if(list, [](const Begun& one) { return one.points.empty(); });
        std::ranges::stable_sort(list, {}, [](const Begun& one) { return one.points.front().chi_square; });
        return list;
    }

    // What candidates and uncertain fields do to the errors of a base, in proportion.
    struct Responses {
        struct Response {
            std::size_t of; // candidate
            const Hypothesis* point;
        };
        std::size_t fields = 0;
        std::vector<Response> list;
        Eigen::MatrixXd products; // of all with one another: of the fields, of the list, and of the errors

        struct Solution {
            double explained = 0;          // of chi square
            std::vector<std::size_t> used; // places in the list
            Eigen::VectorXd times;         // of the fields' deviations, and of each that is used
        };
        // Those together, with the fields or with these as they are.
        Solution explained_by(std::vector<std::size_t> used, bool with_fields = true) const {
            const std::size_t moved = with_fields ? fields : 0;
            std::vector<Eigen::Index> chosen(moved);
            std::iota(chosen.begin(), chosen.end(), Eigen::Index{0});
            for (const std::size_t i : used) chosen.push_back(static_cast<Eigen::Index>(fields + i));
            const Eigen::VectorXd right = products.col(products.cols() - 1)(chosen);
            const Eigen::VectorXd times = products(chosen, chosen).completeOrthogonalDecomposition().solve(right);
            Solution found{times.dot(right), std::move(used), Eigen::VectorXd::Zero(static_cast<Eigen::Index>(fields))};
            found.times.conservativeResize(static_cast<Eigen::Index>(fields + found.used.size()));
            found.times.tail(times.size()) = times;
            return found;
        }
    };

    Responses responses(const Scored& base, const std::vector<Begun>& begun) const {
        Responses r;
        r.fields = base.together.nominal.size();
        const ModelFit lead(machine_, lead_records_);
        const std::vector<double> gap = lead.errors(base.together);
        std::vector<std::vector<double>> columns;
        const auto add = [&](const Hypothesis& there, double step) {
            std::vector<double> column = lead.errors(there);
            if (column.empty() || gap.empty()) return false;
            for (std::size_t k = 0; k < column.size(); ++k) column[k] = (gap[k] - column[k]) / step;
            columns.push_back(std::move(column));
            return true;
        };
        for (std::size_t i = 0; i < r.fields; ++i) {
            Hypothesis there = base.together;
            there.nominal[i] += field_step;
            if (!add(there, field_step)) return r;
        }
        for (std::size_t i = 0; i < begun.size(); ++i) {
            for (const auto& point : begun[i].points) {
                if (late()) return {}; // without products the others tell nothing
                if (!point.settled && add(point, 1)) r.list.push_back({i, &point});
            }
        }
        columns.push_back(gap);
        Eigen::MatrixXd all(static_cast<Eigen::Index>(gap.size()), static_cast<Eigen::Index>(columns.size()));
        for (std::size_t i = 0; i < columns.size(); ++i) {
            all.col(static_cast<Eigen::Index>(i)) =
                Eigen::Map<const Eigen::VectorXd>(columns[i].data(), static_cast<Eigen::Index>(columns[i].size()));
        }
        r.products = all.transpose() * all;
        return r;
    }

    // The base with what the solution uses, of the size and with the fields that it asks for.
    Hypothesis moved_to(const Responses::Solution& solution, const Responses& r, const Scored& base,
                        const std::vector<Begun>& begun) const {
        Hypothesis h = base.together;
        for (std::size_t i = 0; i < r.fields; ++i) h.nominal[i] += solution.times[static_cast<Eigen::Index>(i)];
        for (std::size_t i = 0; i < solution.used.size(); ++i) {
            const auto& [of, point] = r.list[solution.used[i]];
            const auto& candidate = begun[of].candidate;
            const auto own = point->values_of(base.together.effects.size());
            std::vector<double> values(own.begin(), own.end());
            if (candidate->size) {
                const FitParameter& p = candidate->parameters[*candidate->size];
                const double times = solution.times[static_cast<Eigen::Index>(r.fields + i)];
                double& value = values[*candidate->size];
                value = std::clamp(value * (p.logarithmic ? std::clamp(times, 0.1, 10.0) : times), p.low, p.high);
            }
            h = with(h, candidate, values);
        }
        ModelFit(machine_, lead_records_).evaluate(h);
        return h;
    }

    // The points from which fits of one more effect begin: of the candidates that explain most.
    std::vector<Hypothesis> points_of(std::vector<Begun> list, const Scored& base, std::size_t level) const {
        const std::size_t screened = level == 1 ? screened_first : screened_later;
        // Fields may do a part of an effect's work: it is weighed with fields that give way.
        const Responses r = list.size() > screened ? responses(base, list) : Responses{};
        if (!r.list.empty()) {
            std::vector<double> explained(list.size());
            for (std::size_t i = 0; i < r.list.size(); ++i) {
                double& most = explained[r.list[i].of];
                most = std::max(most, r.explained_by({i}).explained);
            }
            std::vector<std::size_t> order;
            for (std::size_t i = 0; i < list.size(); ++i) order.push_back(i);
            std::ranges::stable_sort(order, std::ranges::greater{}, [&](std::size_t i) {
                return list[i].points.front().settled ? std::numeric_limits<double>::infinity() : explained[i];
            });
            order.resize(screened);
            std::vector<Begun> likeliest;
            for (const std::size_t i : order) likeliest.push_back(std::move(list[i]));
            list = std::move(likeliest);
        }
        std::vector<Hypothesis> all;
        for (auto& one : list) std::ranges::move(one.points, std::back_inserter(all));
        return all;
    }

    // The base with two more effects, of which neither may do much alone: the pairs that explain most of the gap together.
    // `list`: what each of them may begin with beside the base.
    std::vector<Scored> paired(const Scored& base, const std::vector<Begun>& list) const {
        const std::string what = "pairs of effects";
        const Responses r = responses(base, list);
        const auto name = [&](std::size_t i) { return list[r.list[i].of].candidate->kind().name; };
        const auto likeliest = [&](bool with_fields) {
            std::map<std::set<std::string>, Responses::Solution> best_of; // of each two kinds
            for (std::size_t i = 0; i < r.list.size(); ++i) {
                for (std::size_t j = i + 1; j < r.list.size(); ++j) {
                    if (name(i) == name(j)) continue;
                    auto& known = best_of[{name(i), name(j)}];
                    auto found = r.explained_by({i, j}, with_fields);
                    if (found.explained > known.explained) known = std::move(found);
                }
            }
            std::vector<Responses::Solution> ranking;
            for (auto& [names, solution] : best_of) {
                if (!solution.used.empty()) ranking.push_back(std::move(solution));
            }
            std::ranges::stable_sort(ranking, std::ranges::greater{}, &Responses::Solution::explained);
            if (ranking.size() > most_likely_pairs) ranking.resize(most_likely_pairs);
            return ranking;
        };
        std::vector<Hypothesis> running;
        for (const auto& solution : likeliest(true)) running.push_back(moved_to(solution, r, base, list));
        // Far from noise the fields' deviations weigh nothing: they may take a pair to a place from where no fit leads back.
        if (r.fields > 0 && base.together.chi_square > leads_back_within * static_cast<double>(count(all_))) {
            const std::size_t begin = running.size();
            for (const auto& solution : likeliest(false)) running.push_back(moved_to(solution, r, base, list));
            for_each_index(running.size() - begin, control_, what + ": fitting", [&](std::size_t i) {
                if (!late()) refine(running[begin + i], lead_records_, 6, 1, false);
            });
        }
        return fitted_to_all(fitted_to_lead(std::move(running), what), what, false,
                             std::numeric_limits<double>::infinity());
    }

    // All are fitted a little, the better ones more.
    std::vector<Hypothesis> fitted_to_lead(std::vector<Hypothesis> running, const std::string& what) const {
        for (const auto& [iterations, keep, factor] :
             {std::tuple{1, std::size_t{30}, 100.0}, {1, 16, 30.0}, {4, most_followed, out_of_reach}}) {
            for_each_index(running.size(), control_, what + ": fitting", [&, iterations = iterations](std::size_t i) {
                // With the uncertain fields, which the baseline may have moved so far that the effect alone gains
                // little.
                if (!running[i].converged && !late()) refine(running[i], lead_records_, iterations, 1);
            });
            go_on();
            keep_best(running, keep, factor);
        }
        std::erase_if(running, [&](const Hypothesis& h) { return !h.settled && h.chi_square > worth_following_; });
        return running;
    }

    // Whether the lead leaves one of them little more than noise, or little of what the base leaves: then other bases need no look
    // before it.
    bool is_promising(const std::vector<Hypothesis>& led, const Hypothesis& base) const {
        const ModelFit lead(machine_, lead_records_);
        const double enough =
            std::max(promising * static_cast<double>(lead.sample_count()), promising_share * lead.chi_square(base));
        return std::ranges::any_of(led, [&](const Hypothesis& h) { return h.chi_square < enough; });
    }

    // Fits to all records those that do best on the lead, the best to convergence; the others where these leave more than
    // noise: a rival of what noise explains is near it on the lead already. `best`: chi square of the best that another base
    // has come to.
    std::vector<Scored> fitted_to_all(std::vector<Hypothesis> led, const std::string& what, bool beside_enough,
                                      double best) const {
        keep_best(led, most_followed, out_of_reach);
        if (led.empty()) return {};
        const double near = abreast * led.front().chi_square;
        const auto far =
            std::stable_partition(led.begin(), led.end(), [&](const Hypothesis& h) { return h.chi_square < near; });
        std::vector<Hypothesis> others(std::make_move_iterator(far), std::make_move_iterator(led.end()));
        led.erase(far, led.end());
        const double left = led.front().chi_square / static_cast<double>(count(lead_records_)); // per sample
        converge(led, what, beside_enough, best);
        for (const auto& h : led) best = std::min(best, h.chi_square);
        const bool enough = std::ranges::any_of(led, [&](const Hypothesis& h) { return adequate(scored(h)); });
        // Where all records say as much of the best as the lead does, they will of the others.
        const bool told = best < hopeless * left * static_cast<double>(count(all_));
        std::vector<Hypothesis> hopeful;
        for (auto& h : others) {
            if (enough || (told && h.chi_square > out_of_reach * left * static_cast<double>(count(lead_records_)))) {
                ModelFit(machine_, all_).evaluate(h);
                led.push_back(std::move(h));
            } else {
                hopeful.push_back(std::move(h));
            }
        }
        converge(hopeful, what, beside_enough, best);
        std::ranges::move(hopeful, std::back_inserter(led));
        keep_best(led, 6, 1e300);
        if (!led.empty() && !late() && led.front().chi_square < out_of_reach * best) enrich(led.front());
        std::vector<Scored> done;
        for (auto& h : led) done.push_back(scored(std::move(h)));
        return done;
    }

    // A hypothesis that covers less than a tenth of its distance to the best one in a round is not refined further; nor
    // one that would not come where it must in the rounds that are left, at this pace; nor one that is far from a best one
    // to which noise alone is left, or only another way to it. What falls by half in a round goes on.
    void converge(std::vector<Hypothesis>& running, const std::string& what, bool beside_enough, double best) const {
        std::vector<char> stalled(running.size(), false);
        for (int round = 0; round < 2 * max_rounds; ++round) {
            std::vector<double> before;
            for (const auto& h : running) before.push_back(h.chi_square);
            for_each_index(running.size(), control_, what + ": refining", [&](std::size_t i) {
                if (!stalled[i]) refine(running[i], all_, 4, 1);
            });
            go_on();
            if (late()) break;
            for (const auto& h : running) best = std::min(best, h.chi_square);
            const auto first = std::ranges::min_element(running, {}, &Hypothesis::chi_square);
            const bool enough = first != running.end() && adequate(scored(*first));
            bool moving = false;
            for (std::size_t i = 0; i < running.size(); ++i) {
                const double distance = running[i].chi_square - best;
                // The first round came from another set of records.
                const double fall = round > 0 ? before[i] - running[i].chi_square : 0;
                const bool steep = fall > 0.5 * before[i]; // on its way, however far it is
                if (enough && &running[i] != &*first) {
                    const bool far = !steep && running[i].chi_square > hopeless * first->chi_square;
                    const bool same =
                        same_kinds(running[i], *first) && running[i].parameter_count() >= first->parameter_count();
                    stalled[i] = stalled[i] || far || same;
                }
                // What may be taken already goes on only where it can come to the noise, if later.
                const bool taken = running[i].chi_square < worth_taking_;
                const double target = taken ? followed * static_cast<double>(count(all_)) : worth_taking_;
                const int rounds_left = (taken ? 2 : 1) * max_rounds - 1 - round;
                const bool sluggish = round > 0 && !steep &&
                                      ((distance > 100 && fall < 0.1 * distance) || round + 1 >= max_rounds ||
                                       rounds_left * fall < running[i].chi_square - target);
                const bool lost = beside_enough && running[i].chi_square > out_of_reach * best;
                stalled[i] = stalled[i] || running[i].converged || !std::isfinite(distance) || sluggish || lost;
                // Of an effect from several starts, one that stays behind is in a local minimum.
                stalled[i] = stalled[i] || (round > 0 && std::ranges::any_of(running, [&](const Hypothesis& other) {
                                                return same_kinds(other, running[i]) &&
                                                       other.parameter_count() <= running[i].parameter_count() &&
                                                       1.2 * other.chi_square < running[i].chi_square;
                                            }));
                moving = moving || !stalled[i];
            }
            if (!moving) break;
        }
    }

    // Tries richer forms of the last effect while more than noise remains and they remove a good part of it.
    void enrich(Hypothesis& h) const {
        for (int more = 0; more < max_enriched; ++more) {
            if (!h.effects.back()->richer || adequate(scored(h))) return;
            const std::size_t before = h.values.size() - h.effects.back()->parameters.size();
            const auto candidate = h.effects.back()->richer_near(std::span(h.values).subspan(before));
            std::vector<Hypothesis> points;
            for (const auto& start : candidate->starts) {
                Hypothesis next = h;
                next.effects.back() = candidate;
                next.values.resize(before);
                next.values.insert(next.values.end(), start.begin(), start.end());
                points.push_back(std::move(next));
            }
            RunControl quiet;
            quiet.workers = control_.workers;
            for_each_index(points.size(), quiet, "",
                           [&](std::size_t i) { refine(points[i], lead_records_, 4, 1, false); });
            keep_best(points, 1, 1);
            if (points.empty()) return;
            Hypothesis& next = points.front();
            refine(next, all_, 20, control_.workers);
            if (!(next.chi_square < 0.95 * h.chi_square)) return;
            h = std::move(next);
        }
    }

    static bool same_kinds(const Hypothesis& a, const Hypothesis& b) {
        return std::ranges::equal(
            a.effects, b.effects, {}, [](const auto& effect) { return &effect->kind(); },
            [](const auto& effect) { return &effect->kind(); });
    }

    // Chi square and the penalty of the parameters.
    double score(const Hypothesis& h) const {
        return h.chi_square + static_cast<double>(h.parameter_count()) * std::log(static_cast<double>(count(all_)));
    }

    // The best so many, within a factor of the best of all, three at least; and what is settled, which cannot be followed this far.
    void keep_best(std::vector<Hypothesis>& list, std::size_t most, double factor) const {
        std::erase_if(list, [](const Hypothesis& h) { return !std::isfinite(h.chi_square); });
        std::ranges::stable_sort(list, {}, [&](const Hypothesis& h) { return score(h); });
        std::size_t kept = 0;
        while (kept < std::min(list.size(), most) &&
               (kept < 3 || list[kept].chi_square < factor * list.front().chi_square)) {
            ++kept;
        }
        const auto behind = list.begin() + static_cast<std::ptrdiff_t>(kept);
        list.erase(std::remove_if(behind, list.end(), [](const Hypothesis& h) { return !h.settled; }), list.end());
    }

    static Hypothesis with(const Hypothesis& base, const std::shared_ptr<const Candidate>& candidate,
                           const std::vector<double>& values) {
        Hypothesis h = base;
        h.effects.push_back(candidate);
        h.values.insert(h.values.end(), values.begin(), values.end());
        h.converged = h.settled = false;
        return h;
    }

    // Where simulated and measured contacts drift apart, chi square over a whole record has a local minimum wherever
    // some of them coincide. Over the first few contacts it has one: the best points of a grid are fitted there, and
    // followed on beginnings of the record that grow. Where noise decides sooner or later how the machine goes on, no
    // parameters follow it to the end; those of the longest beginning that they follow are taken.
    std::vector<Hypothesis> grown_starts(const Hypothesis& base,
                                         const std::shared_ptr<const Candidate>& candidate) const {
        std::vector<Hypothesis> points;
        for (const auto& values : candidate->probes) points.push_back(with(base, candidate, values));
        const Evidence& record = clue_record_;
        const ModelFit lead(machine_, lead_records_);
        const std::size_t first = first_shown(base, record);
        std::vector<Evidence> part;
        std::optional<std::pair<Hypothesis, std::vector<Evidence>>> last; // that was followed
        std::vector<double> before;                                       // parameters of the one before
        for (const auto& [samples, count, iterations] : beginnings) {
            part = {beginning(record, first + samples)};
            const ModelFit fit(machine_, part);
            for (auto& h : points) {
                go_on();
                if (late()) return {};
                fit.evaluate(h);
            }
            keep_best(points, count, 1e300);
            for (auto& h : points) refine(h, part, iterations, 1);
            keep_best(points, count, 1e300);
            keep_distinct(points);
            const double without = fit.chi_square(base);
            std::erase_if(points, [&](const Hypothesis& h) { return !(h.chi_square < worthwhile * without); });
            if (points.empty()) return {};
            if (points.front().chi_square < followed * static_cast<double>(fit.sample_count())) {
                if (last) before = last->first.values;
                last.emplace(points.front(), part);
            } else if (last) {
                // Standard errors by the noise floor of this machine, which is higher than that of one without
                // contacts.
                auto& [h, beginning_followed] = *last;
                const MachineModel machine = lead.machine(h);
                for (auto& one : beginning_followed) {
                    if (const auto floor = noise_floor(machine, one.measurement, {})) one.floor = *floor;
                }
                ModelFit::Options options;
                options.iterations = 0;
                options.standard_errors = true;
                ModelFit(machine_, beginning_followed).fit(h, options);
                // Chi square is rugged: the parameters move more than its curvature tells as the beginning grows.
                for (std::size_t i = 0; i < before.size(); ++i) {
                    h.standard_errors[i] = std::hypot(h.standard_errors[i], h.values[i] - before[i]);
                }
                lead.evaluate(h);
                h.settled = true;
                return {h};
            }
            if (first + samples >= record.measurement.size()) break;
        }
        for (auto& h : points) lead.evaluate(h);
        keep_best(points, candidate->tried, 1e300);
        return points;
    }

    // A lightly damped mode has a local minimum for every turn of its phase, and what leads the whole motion away does not yet
    // do so at first: it is also sought on a beginning of the record, and followed on beginnings that double.
    std::vector<Hypothesis> starts_on_beginnings(const Hypothesis& base,
                                                 const std::shared_ptr<const Candidate>& candidate) const {
        const Evidence& record = clue_record_;
        const std::size_t first = first_shown(base, record);
        std::vector<Hypothesis> points;
        for (std::size_t samples = beginnings_from; first + samples < lead_length_; samples *= 2) {
            if (late()) break;
            const std::vector<Evidence> part{beginning(record, first + samples)};
            const ModelFit fit(machine_, part);
            if (samples == beginnings_from) points = starts_of(base, candidate, fit);
            const double without = fit.chi_square(base);
            for (auto& h : points) refine(h, part, 6, 1);
            std::erase_if(points, [&](const Hypothesis& h) { return !(h.chi_square < worthwhile * without); });
            if (points.empty()) break;
        }
        const ModelFit lead(machine_, lead_records_);
        for (auto& h : points) lead.evaluate(h);
        // What is excited late only shows on the whole.
        for (auto& h : starts_of(base, candidate, lead)) points.push_back(std::move(h));
        std::erase_if(points, [](const Hypothesis& h) { return !std::isfinite(h.chi_square); });
        std::ranges::stable_sort(points, {}, &Hypothesis::chi_square);
        return points;
    }

    // What is missing follows a beginning of the record nearly as far as noise allows; what falls far behind that is given up.
    void race_on_beginnings(std::vector<Begun>& list, const Hypothesis& base, const std::string& what) const {
        const Evidence& record = clue_record_;
        const std::size_t first = first_shown(base, record);
        bool begun = false;
        for (std::size_t samples = beginnings_from; first + samples < record.measurement.size(); samples *= 2) {
            const std::vector<Evidence> part{beginning(record, first + samples)};
            const ModelFit fit(machine_, part);
            for_each_index(list.size(), control_, what + ": beginnings", [&](std::size_t i) {
                auto& [candidate, points] = list[i];
                if (!begun) points = starts_of(base, candidate, fit);
                for (auto& h : points) {
                    if (!late()) refine(h, part, 6, 1);
                }
            });
            begun = true;
            go_on();
            double best = std::numeric_limits<double>::infinity();
            for (const auto& one : list) {
                for (const auto& h : one.points) best = std::min(best, h.chi_square);
            }
            const double behind = out_of_reach * std::max(best, static_cast<double>(fit.sample_count()));
            for (auto& one : list) {
                std::erase_if(one.points, [&](const Hypothesis& h) { return !(h.chi_square < behind); });
            }
        }
        const ModelFit lead(machine_, lead_records_);
        for (auto& one : list) {
            for (auto& h : one.points) lead.evaluate(h);
            std::erase_if(one.points, [](const Hypothesis& h) { return !std::isfinite(h.chi_square); });
            std::ranges::stable_sort(one.points, {}, &Hypothesis::chi_square);
        }
    }

    // Of a sorted list: fits that converged to the same parameters count once.
    static void keep_distinct(std::vector<Hypothesis>& list) {
        std::vector<Hypothesis> distinct;
        for (auto& h : list) {
            const bool known = std::any_of(distinct.begin(), distinct.end(), [&](const Hypothesis& other) {
                for (std::size_t i = 0; i < h.values.size(); ++i) {
                    if (std::abs(h.values[i] - other.values[i]) > 1e-2 * std::abs(other.values[i])) return false;
                }
                return true;
            });
            if (!known) distinct.push_back(std::move(h));
        }
        list = std::move(distinct);
    }

    std::vector<Hypothesis> starts_of(const Hypothesis& base, const std::shared_ptr<const Candidate>& candidate,
                                      const ModelFit& fit) const {
        std::vector<Hypothesis> points;
        const std::vector<double> gap = candidate->size ? fit.errors(base) : std::vector<double>{};
        for (const auto& list : {candidate->starts, candidate->probes}) {
            for (const auto& values : list) {
                go_on();
                if (late()) return points;
                Hypothesis h = with(base, candidate, values);
                if (!gap.empty()) {
                    const auto there = fit.errors(h);
                    if (there.empty()) continue;
                    // The size that fits best if the response is in proportion to it.
                    double across = 0, square = 0, whole = 0;
                    for (std::size_t k = 0; k < gap.size(); ++k) {
                        const double response = gap[k] - there[k];
                        across += response * gap[k];
                        square += response * response;
                        whole += gap[k] * gap[k];
                    }
                    if (!(square > 0) || across <= 0) continue;
                    const std::size_t index = base.values.size() + *candidate->size;
                    const FitParameter& p = candidate->parameters[*candidate->size];
                    const double start = h.values[index];
                    h.values[index] = std::clamp(start * std::clamp(across / square, 0.01, 30.0), p.low, p.high);
                    const double times = h.values[index] / start;
                    h.chi_square = whole - 2 * times * across + times * times * square;
                } else {
                    fit.evaluate(h);
                }
                if (std::isfinite(h.chi_square)) points.push_back(std::move(h));
            }
        }
        if (!gap.empty()) {
            // The best of them by that, simulated.
            keep_best(points, 2 * candidate->tried, 1e300);
            for (auto& h : points) fit.evaluate(h);
        }
        keep_best(points, candidate->tried, 1e300);
        return points;
    }

    const MachineModel& machine_;
    std::size_t max_effects_;
    std::chrono::steady_clock::time_point deadline_;
    const RunControl& control_;
    std::vector<Evidence> all_; // fitted and validation records
    std::size_t lead_ = 0, lead_length_ = 0, clue_length_ = 0;
    std::vector<Evidence> lead_records_; // of all_, so much of one; and more of it
    Evidence clue_record_;
    double worth_following_ = 0; // chi square of the lead after a few steps, above which a hypothesis is given up
    double worth_taking_ = 0;    // chi square of all records which it must come to
    SearchResult result_;
};

} // namespace

double SearchResult::limit(const std::vector<Evidence>& records) {
    double samples = 0, spread = 0;
    for (const auto& record : records) {
        samples += static_cast<double>(record.samples());
        spread = std::max(spread, record.floor.spread);
    }
    // Five deviations of a sum of so many squares, three of what the noise does beyond that, and what two ways of
    // computing the same machine may differ.
    return 1 + 5 * std::sqrt(2 / samples) + 3 * spread + 0.03;
}

bool SearchResult::explained_by_noise(const Scored& one) const {
    const double least = one.together.settled ? settled_limit : 0;
    return one.together.within_tolerance() && one.together_fitted < std::max(limit(fitted), least) &&
           (validation.empty() || one.together_validation < std::max(limit(validation), least));
}

std::string SearchResult::found_so_far() const {
    if (!std::isfinite(baseline.together.chi_square)) return "no hypothesis has been fitted";
    std::string text =
        fmt::format("without an effect the error is {:.4g} times the noise", std::sqrt(baseline.together_fitted));
    for (const auto& step : steps) {
        text +=
            fmt::format(", with {} {:.4g} times", fmt::join(step.names(), " and "), std::sqrt(step.together_fitted));
    }
    return text;
}

std::vector<std::string> Scored::names() const {
    std::vector<std::string> list;
    for (const auto& effect : together.effects) list.push_back(effect->kind().name);
    std::sort(list.begin(), list.end());
    return list;
}

bool Scored::contains(const Scored& other) const {
    return other.together.parameter_count() < together.parameter_count() && covers(other);
}

bool Scored::covers(const Scored& other) const {
    const auto mine = names(), its = other.names();
    std::vector<std::string> own, instead;
    std::ranges::set_difference(mine, its, std::back_inserter(own));
    std::ranges::set_difference(its, mine, std::back_inserter(instead));
    if (own.size() > 1) return false;
    return std::ranges::any_of(own.empty() ? mine : own, [&](const std::string& name) {
        const auto& simpler = effect_kind(name).simpler;
        return std::ranges::all_of(
            instead, [&](const std::string& kind) { return std::ranges::find(simpler, kind) != simpler.end(); });
    });
}

SearchResult search_effects(const MachineModel& machine, std::vector<Evidence> fitted, std::vector<Evidence> validation,
                            std::size_t max_effects, std::chrono::steady_clock::time_point deadline,
                            const RunControl& control) {
    return Search(machine, std::move(fitted), std::move(validation), max_effects, deadline, control).run();
}

} // namespace tribode
