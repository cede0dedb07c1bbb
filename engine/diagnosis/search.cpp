#include "diagnosis/search.hpp"
#include "base/error.hpp"
#include "diagnosis/residual_force.hpp"
#include "diagnosis/response.hpp"

#include <algorithm>
#include <cmath>
#include <set>
#include <tuple>

namespace tribode {

namespace {

constexpr std::size_t beam_width = 3;
constexpr std::size_t screened_later = 12; // candidates that are fitted for a second effect and more

class Search {
  public:
    Search(const MachineModel& machine, std::vector<Evidence> fitted, std::vector<Evidence> kept_out,
           std::size_t max_effects, const RunControl& control)
        : machine_(machine),
          max_effects_(max_effects),
          control_(control) {
        result_.fitted = std::move(fitted);
        result_.kept_out = std::move(kept_out);
    }

    SearchResult run() {
        set_floors(machine_);
        Hypothesis none;
        none.nominal.assign(ModelFit(machine_, result_.fitted).fields().size(), 0.0);
        refine(none, 30, control_.workers);
        result_.baseline = scored(none);
        std::vector<Scored> beam{result_.baseline};
        if (adequate(result_.baseline)) return std::move(result_);
        for (std::size_t level = 1; level <= max_effects_; ++level) {
            std::vector<Scored> pool;
            for (const auto& base : beam) {
                if (adequate(base)) continue;
                for (auto& next : extended(base, level)) pool.push_back(std::move(next));
            }
            rank(pool);
            if (pool.empty()) break;
            // The loop's noise is that of the machine as it is now known.
            try {
                set_floors(ModelFit(machine_, result_.fitted).machine(pool.front().hypothesis));
            } catch (const InputError&) {
            }
            reassess(pool);
            result_.baseline = scored(result_.baseline.hypothesis);
            for (auto& step : result_.steps) step = scored(step.hypothesis);
            const Scored& before = result_.steps.empty() ? result_.baseline : result_.steps.back();
            // Another effect must be worth its numbers, on the records kept out too.
            const bool better = pool.front().score < before.score - 30 &&
                                (result_.kept_out.empty() || pool.front().kept_out < 0.97 * before.kept_out);
            if (!better && level > 1) break;
            result_.ranking = pool;
            result_.steps.push_back(pool.front());
            if (!better || adequate(pool.front())) break;
            beam.clear();
            std::set<std::vector<std::string>> seen;
            for (const auto& one : pool) {
                const bool close = one.hypothesis.chi_square < 20 * pool.front().hypothesis.chi_square;
                if (close && beam.size() < beam_width && seen.insert(one.names()).second) beam.push_back(one);
            }
        }
        return std::move(result_);
    }

  private:
    static std::size_t count(const std::vector<Evidence>& records) {
        std::size_t sum = 0;
        for (const auto& record : records) sum += record.samples();
        return sum;
    }

    void set_floors(const MachineModel& machine) {
        for (auto* records : {&result_.fitted, &result_.kept_out}) {
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
        all_records_ = result_.fitted;
        all_records_.insert(all_records_.end(), result_.kept_out.begin(), result_.kept_out.end());
    }

    bool adequate(const Scored& one) const { return result_.explained_by_noise(one); }

    void refine(Hypothesis& h, int iterations, unsigned workers, bool move_fields = true) const {
        ModelFit::Options options;
        options.iterations = iterations;
        options.workers = workers;
        options.move_fields = move_fields;
        ModelFit(machine_, result_.fitted).fit(h, options);
    }

    // Score at the hypothesis' numbers and, where that is worth the work, at those that suit all records.
    Scored scored(Hypothesis h, bool together = true) const {
        const ModelFit fit(machine_, result_.fitted);
        const double fitted_samples = static_cast<double>(fit.sample_count());
        Scored one;
        h.chi_square = fit.chi_square(h);
        one.fitted = one.together_fitted = h.chi_square / fitted_samples;
        one.score = h.chi_square;
        if (!result_.kept_out.empty()) {
            const ModelFit check(machine_, result_.kept_out);
            const double samples = static_cast<double>(check.sample_count());
            double chi = check.chi_square(h);
            one.kept_out = one.together_kept_out = chi / samples;
            if (together && one.fitted < 3 * SearchResult::limit(result_.fitted) &&
                one.kept_out > SearchResult::limit(result_.kept_out) && !h.values.empty()) {
                Hypothesis both = h;
                const ModelFit all(machine_, all_records_);
                ModelFit::Options options;
                options.iterations = 8;
                all.fit(both, options);
                one.together_fitted = fit.chi_square(both) / fitted_samples;
                one.together_kept_out = check.chi_square(both) / samples;
            }
            one.score = one.together_fitted * fitted_samples + one.together_kept_out * samples;
        }
        const double samples = static_cast<double>(count(result_.fitted) + count(result_.kept_out));
        one.score += static_cast<double>(h.parameter_count()) * std::log(samples);
        one.hypothesis = std::move(h);
        return one;
    }

    // An effect that another one makes needless goes.
    void prune(Scored& one) const {
        for (std::size_t i = 0; one.hypothesis.effects.size() > 1 && i < one.hypothesis.effects.size();) {
            Hypothesis without = one.hypothesis;
            without.remove(i);
            refine(without, 8, control_.workers);
            Scored simpler = scored(std::move(without));
            if (simpler.score < one.score + 10) {
                one = std::move(simpler);
                i = 0;
            } else {
                ++i;
            }
        }
    }

    void reassess(std::vector<Scored>& pool) const {
        RunControl quiet;
        quiet.workers = control_.workers;
        for_each_index(pool.size(), quiet, "", [&](std::size_t i) {
            refine(pool[i].hypothesis, 6, 1);
            pool[i] = scored(std::move(pool[i].hypothesis));
        });
        rank(pool);
        for (std::size_t i = 0; i < std::min<std::size_t>(pool.size(), 2); ++i) prune(pool[i]);
        rank(pool);
    }

    static void rank(std::vector<Scored>& pool) {
        std::erase_if(pool, [](const Scored& one) { return !std::isfinite(one.hypothesis.chi_square); });
        std::stable_sort(pool.begin(), pool.end(), [](const Scored& a, const Scored& b) { return a.score < b.score; });
        // One hypothesis for each set of names: the form that does best.
        std::set<std::vector<std::string>> seen;
        std::erase_if(pool, [&](const Scored& one) { return !seen.insert(one.names()).second; });
    }

    // The base with one more effect, every one that may be.
    std::vector<Scored> extended(const Scored& base, std::size_t level) const {
        const ModelFit fit(machine_, result_.fitted);
        const MachineModel machine = fit.machine(base.hypothesis);
        const Evidence& record = result_.fitted.front();
        const auto signals = simulated_signals(machine, record.measurement);
        // A model that cannot follow shows nothing: the machine at rest is as good a comparison.
        const SimulatedSignals still{std::vector<double>(record.measurement.size(), 0.0),
                                     std::vector<double>(record.measurement.size(), 0.0)};
        const ResidualForce residual = residual_force(machine, record.measurement, signals ? *signals : still);
        if (residual.force.empty()) return {};
        std::vector<double> gap = record.measurement.position();
        for (std::size_t k = 0; signals && k < gap.size(); ++k) gap[k] -= signals->position[k];
        const std::vector<double> whitened = record.floor.whitened(gap);
        const auto present = base.names();
        std::vector<std::shared_ptr<const Candidate>> list;
        for (auto& candidate : candidates({machine, record.measurement, residual, whitened, record.floor.innovation})) {
            if (std::find(present.begin(), present.end(), candidate.effect) != present.end()) continue;
            list.push_back(std::make_shared<const Candidate>(std::move(candidate)));
        }
        // Where each begins.
        std::vector<std::vector<Hypothesis>> begun(list.size());
        const std::string what = "effect " + std::to_string(level);
        for_each_index(list.size(), control_, what + ": screening",
                       [&](std::size_t i) { begun[i] = starts_of(base.hypothesis, list[i], fit); });
        std::vector<std::size_t> order;
        for (std::size_t i = 0; i < list.size(); ++i) {
            if (!begun[i].empty()) order.push_back(i);
        }
        std::stable_sort(order.begin(), order.end(), [&](std::size_t a, std::size_t b) {
            return begun[a].front().chi_square < begun[b].front().chi_square;
        });
        if (level > 1 && order.size() > screened_later) order.resize(screened_later);
        // All are fitted a little, the better ones more, the best to the end: none is judged before it has come down as
        // far as others were let. A form that fell much in the last round may go on falling.
        std::vector<Hypothesis> running;
        for (const std::size_t i : order) running.insert(running.end(), begun[i].begin(), begun[i].end());
        for (const auto& [iterations, keep, factor] :
             {std::tuple{2, std::size_t{16}, 30.0}, {4, std::size_t{8}, 10.0}, {25, std::size_t{6}, 3.0}}) {
            const bool last = iterations == 25;
            std::vector<Hypothesis> next = running;
            for_each_index(next.size(), control_, what + (last ? ": refining" : ": fitting"), [&](std::size_t i) {
                if (!next[i].converged) refine(next[i], iterations, 1, last);
            });
            std::erase_if(next, [](const Hypothesis& h) { return !std::isfinite(h.chi_square); });
            std::stable_sort(next.begin(), next.end(),
                             [](const Hypothesis& a, const Hypothesis& b) { return a.chi_square < b.chi_square; });
            if (next.empty()) return {};
            std::size_t kept = 0;
            while (kept < next.size() && (kept < 3 || next[kept].chi_square < factor * next.front().chi_square) &&
                   kept < keep)
                ++kept;
            next.resize(kept);
            running = std::move(next);
        }
        std::vector<Scored> done;
        for (auto& h : running) done.push_back(scored(std::move(h)));
        return done;
    }

    std::vector<Hypothesis> starts_of(const Hypothesis& base, const std::shared_ptr<const Candidate>& candidate,
                                      const ModelFit& fit) const {
        std::vector<Hypothesis> points;
        const auto at = [&](const std::vector<double>& values) {
            Hypothesis h = base;
            h.effects.push_back(candidate);
            h.values.insert(h.values.end(), values.begin(), values.end());
            return h;
        };
        const std::vector<double> gap = candidate->size ? fit.errors(base) : std::vector<double>{};
        for (const auto& list : {candidate->starts, candidate->probes}) {
            for (const auto& values : list) {
                Hypothesis h = at(values);
                if (!gap.empty()) {
                    const auto there = fit.errors(h);
                    if (there.empty()) continue;
                    // The size that fits best if the response is in proportion to it.
                    double across = 0, square = 0;
                    for (std::size_t k = 0; k < gap.size(); ++k) {
                        const double response = gap[k] - there[k];
                        across += response * gap[k];
                        square += response * response;
                    }
                    if (!(square > 0) || across <= 0) continue;
                    const std::size_t index = base.values.size() + *candidate->size;
                    const FitParameter& p = candidate->parameters[*candidate->size];
                    h.values[index] =
                        std::clamp(h.values[index] * std::clamp(across / square, 0.01, 30.0), p.low, p.high);
                }
                h.chi_square = fit.chi_square(h);
                if (std::isfinite(h.chi_square)) points.push_back(std::move(h));
            }
        }
        std::stable_sort(points.begin(), points.end(),
                         [](const Hypothesis& a, const Hypothesis& b) { return a.chi_square < b.chi_square; });
        if (points.size() > candidate->tried) points.resize(candidate->tried);
        return points;
    }

    const MachineModel& machine_;
    std::size_t max_effects_;
    const RunControl& control_;
    std::vector<Evidence> all_records_;
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
    return one.together_fitted < limit(fitted) && (kept_out.empty() || one.together_kept_out < limit(kept_out));
}

std::vector<std::string> Scored::names() const {
    std::vector<std::string> list;
    for (const auto& effect : hypothesis.effects) list.push_back(effect->effect);
    std::sort(list.begin(), list.end());
    return list;
}

SearchResult search_effects(const MachineModel& machine, std::vector<Evidence> fitted, std::vector<Evidence> kept_out,
                            std::size_t max_effects, const RunControl& control) {
    return Search(machine, std::move(fitted), std::move(kept_out), max_effects, control).run();
}

} // namespace tribode
