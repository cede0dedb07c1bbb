#include "tribode/diagnosis/system_next_experiment.hpp"
#include "tribode/base/constants.hpp"
#include "tribode/base/quantity.hpp"
#include "tribode/diagnosis/system_record.hpp"
#include "tribode/diagnosis/system_terms.hpp"

#include <algorithm>
#include <cmath>
#include <fmt/format.h>
#include <functional>
#include <limits>
#include <numbers>

namespace tribode {

namespace {

constexpr std::size_t max_record_samples = 2000; // of a record on the list
constexpr double worth_measuring = 1.2;          // times what the present record tells
constexpr double min_apart = 0.1;                // of the error that is left: below it the two say the same

struct ListedRecord {
    std::string text;
    SystemRecord record;
    std::vector<double> starts; // of the states whose start values may move; empty: those of the first record
};

class Menu {
  public:
    Menu(const SystemModel& model, const std::vector<SystemRecord>& records) : model_(model), first_(records.front()) {
        const std::size_t n = std::min(first_.size(), max_record_samples);
        step_ = first_.t.back() / static_cast<double>(first_.size() - 1);
        for (std::size_t k = 0; k < n; ++k) t_.push_back(static_cast<double>(k) * step_);
        for (std::size_t i = 0; i < first_.inputs.size(); ++i) {
            if (!first_.inputs[i].empty() && !is_rate(i)) waves(i);
        }
    }

    // Without inputs only the start can be chosen: nearer to where the record ends, or as far on the other side.
    void add_starts(const std::vector<double>& start, const std::vector<double>& end) {
        for (const double share : {0.5, 0.25, 0.1, -1.0}) {
            ListedRecord one{"a record that begins with", record(), {}};
            for (std::size_t i = 0; i < start.size(); ++i) {
                const auto& state = model_.equations.states[model_.starts[i]];
                one.starts.push_back(end[i] + share * (start[i] - end[i]));
                one.text += fmt::format("{} {} = {}", i > 0 ? "," : "", state.name,
                                        format_quantity(one.starts.back(), state.unit, 3));
            }
            list.push_back(std::move(one));
        }
    }

    std::vector<ListedRecord> list;

  private:
    bool is_rate(std::size_t i) const {
        return std::any_of(model_.equations.inputs.begin(), model_.equations.inputs.end(), [&](const auto& other) {
            return model_.equations.inputs[i].name == rate_name_of(other.name);
        });
    }

    // The grid of the list, with all inputs in the middle of what they were.
    SystemRecord record() const {
        SystemRecord made{.source = "the next experiment", .t = t_};
        for (const auto& values : first_.inputs) {
            std::vector<double> sorted = values;
            std::nth_element(sorted.begin(), sorted.begin() + static_cast<std::ptrdiff_t>(sorted.size() / 2),
                             sorted.end());
            made.inputs.emplace_back(values.empty() ? 0 : t_.size(), values.empty() ? 0 : sorted[sorted.size() / 2]);
        }
        return made;
    }

    // Around what point of the range of an input a wave moves, and how far: shares of that range.
    struct Place {
        double share, bias;
    };

    // `shape`: from -1 to 1 over the samples.
    void add(std::size_t input, Place place, const std::string& what, const std::function<double(double)>& shape) {
        const auto& own = model_.equations.inputs[input];
        const auto [least, greatest] = std::minmax_element(first_.inputs[input].begin(), first_.inputs[input].end());
        const double range = *greatest - *least;
        const double middle = 0.5 * (*least + *greatest) + place.bias * range, reach = 0.5 * place.share * range;
        ListedRecord one{.record = record()};
        one.text = fmt::format("{} of {} between {} and {}, {} samples at {}", what, own.name,
                               format_quantity(middle - reach, own.unit, 3),
                               format_quantity(middle + reach, own.unit, 3), t_.size(), format_quantity(step_, "s", 3));
        for (std::size_t k = 0; k < t_.size(); ++k) {
            one.record.inputs[input][k] = middle + reach * shape(t_[k] / t_.back());
        }
        for (std::size_t j = 0; j < model_.equations.inputs.size(); ++j) {
            if (model_.equations.inputs[j].name == rate_name_of(own.name)) {
                one.record.inputs[j] = rate_of(one.record.inputs[input], t_);
            }
        }
        list.push_back(std::move(one));
    }

    void waves(std::size_t input) {
        const auto triangle = [](double turns) {
            return [turns](double s) { return 2 * std::abs(2 * (turns * s - std::floor(turns * s + 0.5))) - 1; };
        };
        for (const Place place : {Place{1, 0}, {0.5, 0.25}, {0.5, -0.25}, {0.3, 0}}) {
            add(input, place, "a slow triangle", triangle(2));
            add(input, place, "a triangle of ten periods", triangle(10));
            const bool moves =
                std::any_of(model_.equations.inputs.begin(), model_.equations.inputs.end(), [&](const auto& other) {
                    return other.name == rate_name_of(model_.equations.inputs[input].name);
                });
            if (moves) continue; // what moves has no steps
            add(input, place, "a staircase of eight levels", [](double s) {
                constexpr double levels[] = {-1, 0.43, -0.43, 1, -0.71, 0.14, 0.71, -0.14};
                return levels[std::min<std::size_t>(7, static_cast<std::size_t>(8 * s))];
            });
            add(input, place, "a step up and down again", [](double s) { return s > 0.25 && s < 0.75 ? 1.0 : -1.0; });
            for (const auto& [name, lowest] : {std::pair{"a slow multisine", 1}, {"a fast multisine", 20}}) {
                add(input, place, name, [lowest = lowest](double s) {
                    double sum = 0;
                    constexpr int lines = 12;
                    for (int line = 0; line < lines; ++line) {
                        sum += std::sin(two_pi * lowest * (line + 1) * s - std::numbers::pi * line * line / lines);
                    }
                    return std::clamp(sum / std::sqrt(2.0 * lines), -1.0, 1.0);
                });
            }
        }
    }

    const SystemModel& model_;
    const SystemRecord& first_;
    double step_ = 0;
    std::vector<double> t_;
};

// Of the difference of two models on a record, rms over scale, what no values of the first one make up.
double difference(const SystemCandidate& first, const SystemCandidate& second, const ListedRecord& one,
                  const std::vector<double>& scale, Interpolation between, SystemRecord* foretold) {
    const auto own = [&](const SystemCandidate& candidate) {
        auto values = candidate.model.values_of(candidate.values, 0);
        if (!one.starts.empty()) {
            std::copy(one.starts.begin(), one.starts.end(),
                      values.begin() + static_cast<std::ptrdiff_t>(candidate.model.parameters.size()));
        }
        return values;
    };
    std::vector<SystemRecord> records = {one.record};
    const std::vector<std::size_t> whole = {one.record.size()};
    const auto trace =
        SystemFit(records, scale, between, whole).simulate(second.model, own(second), 0, one.record.size());
    if (!trace) return 0;
    records[0].outputs = trace->outputs;
    const SystemFit fit(records, scale, between, whole);
    const auto values = own(first);
    const auto errors = fit.errors(first.model, values);
    if (errors.empty()) return 0;
    const Eigen::Map<const Eigen::VectorXd> gap(errors.data(), static_cast<Eigen::Index>(errors.size()));
    const Eigen::MatrixXd basis = basis_of(fit.jacobian(first.model, values, errors));
    const Eigen::VectorXd rest = gap - basis * (basis.transpose() * gap);
    if (foretold) *foretold = records[0];
    const double rms = rest.norm() / std::sqrt(static_cast<double>(errors.size()));
    return std::isfinite(rms) ? rms : 0;
}

} // namespace

std::optional<SystemExperiment> next_system_experiment(const SystemCandidate& first,
                                                       const std::vector<SystemCandidate>& rivals,
                                                       const std::vector<SystemRecord>& records,
                                                       const std::vector<double>& scale, Interpolation between,
                                                       double left, const RunControl& control) {
    const SystemModel& model = first.model;
    Menu menu(model, records);
    if (menu.list.empty() && !model.starts.empty()) {
        const SystemFit fit(records, scale, between, {records.front().size()});
        const auto trace = fit.simulate(model, first.values, 0, records.front().size());
        if (!trace) return std::nullopt;
        std::vector<double> start, end;
        for (std::size_t i = 0; i < model.starts.size(); ++i) {
            start.push_back(first.values[model.parameters.size() + i]);
            end.push_back(trace->states[model.starts[i]].back());
        }
        menu.add_starts(start, end);
    }
    if (menu.list.empty() || rivals.empty() || !(left > 0)) return std::nullopt;
    // The one with fewer values must not be able to take the place of the other: a richer one may contain it.
    const auto least_difference = [&](const ListedRecord& one) {
        double least = std::numeric_limits<double>::infinity();
        const std::size_t own = model.parameters.size();
        for (const auto& rival : rivals) {
            const std::size_t others = rival.model.parameters.size();
            if (own <= others) least = std::min(least, difference(first, rival, one, scale, between, nullptr) / left);
            if (others <= own) least = std::min(least, difference(rival, first, one, scale, between, nullptr) / left);
        }
        return least;
    };
    std::vector<double> apart(menu.list.size());
    for_each_index(apart.size(), control, "next experiment",
                   [&](std::size_t i) { apart[i] = least_difference(menu.list[i]); });
    const auto best = std::max_element(apart.begin(), apart.end());
    const double here = least_difference({.record = records.front()});
    if (!(*best > worth_measuring * here) || *best < min_apart) return std::nullopt;
    ListedRecord& chosen = menu.list[static_cast<std::size_t>(best - apart.begin())];
    SystemExperiment result{.apart = *best};
    difference(first, rivals.front(), chosen, scale, between, &result.record);
    result.text =
        fmt::format("{}: there they differ by {:.3g} times the error that is left now or more, rms, whatever values "
                    "the free parameters take; on {} by {:.3g}.",
                    chosen.text, *best, records.front().source, here);
    return result;
}

} // namespace tribode
