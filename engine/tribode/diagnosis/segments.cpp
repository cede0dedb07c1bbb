#include "tribode/diagnosis/segments.hpp"
#include "tribode/diagnosis/prediction_statistics.hpp"

#include <algorithm>
#include <cmath>

namespace tribode {

namespace {

constexpr std::size_t min_segment_samples = 20, samples_per_state = 6; // of a segment
constexpr double near_noise = 1.5, near_output = 0.01; // rms, over the noise and over the outputs' deviation
constexpr int start_iterations = 6, all_iterations = 6;
constexpr double least_gain = 1e-3; // of the squared errors, by an iteration

class Cutter {
  public:
    Cutter(const SystemModel& model, const std::vector<double>& values, const SystemFit& fit,
           const std::function<bool()>& ended)
        : model_(model),
          values_(values),
          fit_(fit),
          ended_(ended) {}

    std::optional<Segments> cut(std::size_t length) const {
        Segments made;
        made.model = model_;
        made.model.starts.clear();
        const auto& states = model_.equations.states;
        for (std::size_t i = 0; i < states.size(); ++i) {
            if (!states[i].is_algebraic()) made.model.starts.push_back(i);
        }
        std::vector<double> starts;
        for (std::size_t r = 0; r < fit_.records().size(); ++r) {
            made.first_of.push_back(made.records.size());
            const auto bounds = bounds_of(r, length);
            // Where the first segment begins the whole record does.
            SystemModel one = model_;
            one.equations = model_.begun(values_, r, fit_.records()[r]);
            std::vector<double> from;
            for (const std::size_t i : made.model.starts) from.push_back(one.equations.states[i].start);
            for (std::size_t s = 0; s < bounds.size(); ++s) {
                const auto [begin, end] = bounds[s];
                made.records.push_back(fit_.records()[r].part(begin, end - begin));
                // Each begins where the one before it ends, or what was not measured behind that, moved until it fits.
                const std::size_t following = s + 1 < bounds.size() ? bounds[s + 1].begin : end;
                const auto next = followed(made.model, one, made.records.back(),
                                           fit_.records()[r].part(begin, following - begin + 1), from);
                if (!next) return std::nullopt;
                starts.insert(starts.end(), from.begin(), from.end());
                from = *next;
            }
        }
        made.values.assign(values_.begin(), values_.begin() + static_cast<std::ptrdiff_t>(model_.parameters.size()));
        made.values.insert(made.values.end(), starts.begin(), starts.end());
        const auto result =
            made.fit(fit_.scale(), fit_.interpolation(), 0).fit(made.model, made.values, all_iterations, ended_);
        if (result.errors.empty()) return std::nullopt;
        made.values = result.values;
        made.errors = result.errors;
        made.substeps = result.substeps;
        return made;
    }

  private:
    struct Bounds {
        std::size_t begin, end;
    };
    // Segments of about this length of each stretch of a record that was measured.
    std::vector<Bounds> bounds_of(std::size_t r, std::size_t length) const {
        const auto is_measured = [&](std::size_t k) {
            const auto is_there = [k](const std::vector<double>& values) { return !std::isnan(values[k]); };
            return std::ranges::any_of(fit_.records()[r].outputs, is_there);
        };
        std::vector<Bounds> found;
        for (std::size_t begin = 0; begin < fit_.used()[r]; ++begin) {
            std::size_t end = begin;
            while (end < fit_.used()[r] && is_measured(end)) ++end;
            if (end == begin) continue;
            const std::size_t samples = end - begin, count = std::max<std::size_t>(1, samples / length);
            for (std::size_t s = 0; s < count; ++s) {
                found.push_back({begin + samples * s / count, begin + samples * (s + 1) / count});
            }
            begin = end;
        }
        return found;
    }

    // Fits the start values of a segment, and gives the states where the next one begins. `longer`: up to that sample.
    std::optional<std::vector<double>> followed(const SystemModel& with_starts, const SystemModel& at,
                                                const SystemRecord& segment, const SystemRecord& longer,
                                                std::vector<double>& start) const {
        SystemModel one = with_starts;
        for (std::size_t p = 0; p < one.equations.parameters.size(); ++p) {
            one.equations.parameters[p].value = at.equations.parameters[p].value;
        }
        one.parameters.clear();
        const std::vector<SystemRecord> records = {segment}, more = {longer};
        SystemFit fit(records, fit_.scale(), fit_.interpolation(), {segment.size()});
        fit.begin_search();
        const auto result = fit.fit(one, start, start_iterations, ended_);
        if (result.errors.empty()) return std::nullopt;
        start = result.values;
        const auto trace =
            SystemFit(more, fit_.scale(), fit_.interpolation(), {longer.size()}).simulate(one, start, 0, longer.size());
        if (!trace) return std::nullopt;
        std::vector<double> end;
        for (const std::size_t i : one.starts) end.push_back(trace->states[i].back());
        return end;
    }

    const SystemModel& model_;
    const std::vector<double>& values_;
    const SystemFit& fit_;
    const std::function<bool()>& ended_;
};

} // namespace

SystemFit Segments::fit(const std::vector<double>& scale, Interpolation between, std::size_t of_sample) const {
    std::vector<std::size_t> all;
    for (const auto& record : records) all.push_back(record.size());
    SystemFit made{records, scale, between, all};
    made.begin_search(of_sample, least_gain);
    return made;
}

std::vector<double> Segments::whole(const SystemModel& of, const std::vector<double>& all) const {
    const auto& starts = model.starts;
    const std::size_t parameters = all.size() - records.size() * starts.size();
    std::vector<double> some(all.begin(), all.begin() + static_cast<std::ptrdiff_t>(parameters));
    for (const std::size_t first : first_of) {
        for (const std::size_t state : of.starts) {
            const auto place =
                static_cast<std::size_t>(std::find(starts.begin(), starts.end(), state) - starts.begin());
            some.push_back(all[parameters + first * starts.size() + place]);
        }
    }
    return some;
}

std::optional<Segments> segmented(const SystemModel& model, const std::vector<double>& values, const SystemFit& fit,
                                  const std::function<bool()>& ended) {
    const auto& e = model.equations;
    // Modes of dry friction follow from the velocity.
    if (e.states.empty() || e.discrete.size() > e.contacts.size() || !e.whens.empty() || !e.clocks.empty()) {
        return std::nullopt;
    }
    const double near = std::max(near_noise * fit.noise(), near_output);
    const Cutter cutter(model, values, fit, ended);
    const std::size_t shortest = std::max(min_segment_samples, samples_per_state * e.states.size());
    std::size_t longest = 0; // samples that were measured, of a record
    for (std::size_t r = 0; r < fit.records().size(); ++r) {
        const auto& record = fit.records()[r];
        longest = std::max(longest, record.measured(fit.used()[r]) / std::max<std::size_t>(1, record.outputs.size()));
    }
    std::optional<Segments> found;
    for (std::size_t length = longest / 4; length >= shortest && !ended(); length /= 2) {
        auto made = cutter.cut(length);
        if (!made) continue;
        found = std::move(made);
        if (rms_of_errors(found->errors) < near) break;
    }
    return found;
}

} // namespace tribode
