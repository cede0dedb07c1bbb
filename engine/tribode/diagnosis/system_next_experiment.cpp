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
#include <optional>

namespace tribode {

namespace {

constexpr std::size_t max_record_samples = 2000; // of a record on the list
constexpr double worth_measuring = 1.2;          // times what the present record tells
constexpr double min_apart = 0.1;                // of the error that is left: below it the two say the same
constexpr double clearly_apart = 1;              // of it: below this longer records are listed too
constexpr std::size_t longer = 3;                // times as long
// Of the outputs' range, that they may leave it by: farther off no model can be trusted. Where nothing tells within that, farther; but a
// machine that would run away is not proposed.
constexpr double range_beyond = 0.5, farther_beyond[] = {2, 10};

struct ListedRecord {
    std::string text;
    SystemRecord record;
    std::vector<double> starts; // of the states whose start values may move; empty: those of the first record
};

class Menu {
  public:
    Menu(const SystemModel& model, const std::vector<SystemRecord>& records) : model_(model), first_(records.front()) {
        step_ = first_.t.back() / static_cast<double>(first_.size() - 1);
        add_waves(1);
    }

    // `times` as long as the first record.
    void add_waves(std::size_t times) {
        const std::size_t n = std::min(times * first_.size(), max_record_samples);
        if (n == t_.size()) return;
        t_.clear();
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

// On a record: by how much two models differ there, over scale, and what each value of the first one changes, its parameters before
// the start values of the record.
struct Difference {
    Eigen::VectorXd gap;
    Eigen::MatrixXd slopes;
    SystemRecord foretold = {}; // with the outputs of the second model
};

std::optional<Difference> difference(const SystemModel& first, const std::vector<double>& first_values,
                                     const SystemModel& second, const std::vector<double>& second_values,
                                     const SystemRecord& record, const std::vector<double>& scale,
                                     Interpolation between) {
    std::vector<SystemRecord> records = {record};
    const SystemFit fit(records, scale, between, {record.size()});
    const auto trace = fit.simulate(second, second_values, 0, record.size());
    if (!trace) return std::nullopt;
    records[0].outputs = trace->outputs;
    const auto errors = fit.errors(first, first_values);
    if (errors.empty()) return std::nullopt;
    Difference result{Eigen::Map<const Eigen::VectorXd>(errors.data(), static_cast<Eigen::Index>(errors.size())),
                      fit.jacobian(first, first_values, errors)};
    result.foretold = std::move(records[0]);
    return result;
}

// Squares of what no values of the first model make up of its differences on these records together, each of which has start
// values of its own.
double squares_left(const std::vector<const Difference*>& on, std::size_t parameters) {
    const auto shared = static_cast<Eigen::Index>(parameters);
    Eigen::Index rows = 0, columns = shared;
    for (const Difference* one : on) {
        rows += one->gap.size();
        columns += one->slopes.cols() - shared;
    }
    Eigen::VectorXd gap(rows);
    Eigen::MatrixXd slopes = Eigen::MatrixXd::Zero(rows, columns);
    rows = 0, columns = shared;
    for (const Difference* one : on) {
        const Eigen::Index own = one->slopes.cols() - shared;
        gap.segment(rows, one->gap.size()) = one->gap;
        slopes.block(rows, 0, one->gap.size(), shared) = one->slopes.leftCols(shared);
        slopes.block(rows, columns, one->gap.size(), own) = one->slopes.rightCols(own);
        rows += one->gap.size();
        columns += own;
    }
    const Eigen::MatrixXd basis = basis_of(std::move(slopes));
    const double squares = (gap - basis * (basis.transpose() * gap)).squaredNorm();
    return std::isfinite(squares) ? squares : 0;
}

// Where an output is.
struct Range {
    double low = std::numeric_limits<double>::infinity(), high = -std::numeric_limits<double>::infinity();

    // By how many of its widths a value is outside; `least_width`: of what hardly moved.
    double beyond(double y, double least_width) const {
        if (std::isnan(y)) return std::numeric_limits<double>::infinity();
        return low <= high ? std::max({low - y, y - high, 0.0}) / std::max(high - low, least_width) : 0;
    }
};

std::vector<Range> measured_ranges(const std::vector<SystemRecord>& records) {
    std::vector<Range> all(records.front().outputs.size());
    for (std::size_t o = 0; o < all.size(); ++o) {
        auto& [low, high] = all[o];
        for (const auto& record : records) {
            for (const double y : record.outputs[o]) {
                if (std::isnan(y)) continue;
                low = std::min(low, y);
                high = std::max(high, y);
            }
        }
    }
    return all;
}

// Two models of which the first one, fitted to all records, would have to do what the second one does.
class Pair {
  public:
    Pair(const SystemCandidate& first, const SystemCandidate& second, const std::vector<SystemRecord>& records,
         const std::vector<double>& scale, Interpolation between)
        : first_(first),
          second_(second),
          scale_(scale),
          between_(between) {
        std::size_t samples = 0;
        for (std::size_t r = 0; r < records.size(); ++r) {
            auto one = difference(first.model, first.model.values_of(first.values, r), second.model,
                                  second.model.values_of(second.values, r), records[r], scale, between);
            if (!one) continue;
            samples += static_cast<std::size_t>(one->gap.size());
            measured_.push_back(*std::move(one));
        }
        squares_now_ = squares_left(with(nullptr), first.model.parameters.size());
        now_ = samples > 0 ? std::sqrt(squares_now_ / static_cast<double>(samples)) : 0;
    }

    // rms of what is left on the records that are there.
    double now() const { return now_; }

    struct Apart {
        double rms = 0;
        double beyond = 0; // of the ranges measured: how far the outputs of either leave them
    };
    // What another record leaves beside these.
    Apart on(const ListedRecord& one, const std::vector<Range>& measured) const {
        const auto further = on_record(one);
        if (!further) return {.beyond = std::numeric_limits<double>::infinity()};
        const double squares = squares_left(with(&*further), first_.model.parameters.size()) - squares_now_;
        Apart apart{std::sqrt(std::max(squares, 0.0) / static_cast<double>(further->gap.size()))};
        const auto& outputs = further->foretold.outputs;
        Eigen::Index row = 0;
        for (std::size_t o = 0; o < outputs.size(); ++o) {
            const Range range = o < measured.size() ? measured[o] : Range{};
            for (const double second : outputs[o]) {
                const double first = second - scale_[o] * further->gap[row++];
                for (const double y : {first, second}) {
                    apart.beyond = std::max(apart.beyond, range.beyond(y, scale_[o]));
                }
            }
        }
        return apart;
    }

    SystemRecord foretold(const ListedRecord& one) const {
        const auto further = on_record(one);
        return further ? further->foretold : one.record;
    }

  private:
    std::optional<Difference> on_record(const ListedRecord& one) const {
        const auto own = [&](const SystemCandidate& candidate) {
            auto values = candidate.model.values_of(candidate.values, 0);
            std::ranges::copy(one.starts,
                              values.begin() + static_cast<std::ptrdiff_t>(candidate.model.parameters.size()));
            return values;
        };
        return difference(first_.model, own(first_), second_.model, own(second_), one.record, scale_, between_);
    }

    std::vector<const Difference*> with(const Difference* further) const {
        std::vector<const Difference*> all;
        for (const auto& one : measured_) all.push_back(&one);
        if (further) all.push_back(further);
        return all;
    }

    const SystemCandidate &first_, &second_;
    const std::vector<double>& scale_;
    Interpolation between_;
    std::vector<Difference> measured_;
    double squares_now_ = 0, now_ = 0;
};

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
    std::vector<Pair> pairs;
    for (const auto& rival : rivals) {
        const std::size_t own = model.parameters.size(), others = rival.model.parameters.size();
        if (own <= others) pairs.emplace_back(first, rival, records, scale, between);
        if (others <= own) pairs.emplace_back(rival, first, records, scale, between);
    }
    const auto measured = measured_ranges(records);
    std::vector<double> apart, told; // told: grows with the samples
    std::vector<double> beyond;      // of all models
    const auto compare = [&] {
        const std::size_t begin = apart.size();
        apart.resize(menu.list.size());
        beyond.resize(menu.list.size());
        for_each_index(apart.size() - begin, control, "next experiment", [&](std::size_t i) {
            double least = std::numeric_limits<double>::infinity();
            for (const Pair& pair : pairs) {
                const auto one = pair.on(menu.list[begin + i], measured);
                least = std::min(least, one.rms / left);
                beyond[begin + i] = std::max(beyond[begin + i], one.beyond);
            }
            apart[begin + i] = least;
        });
        for (std::size_t i = begin; i < apart.size(); ++i) {
            told.push_back(apart[i] * std::sqrt(static_cast<double>(menu.list[i].record.size())));
        }
    };
    // Of those whose outputs go no farther.
    const auto best_of = [&](double farthest) -> std::optional<std::size_t> {
        std::optional<std::size_t> best;
        for (std::size_t i = 0; i < told.size(); ++i) {
            if (beyond[i] <= farthest && (!best || told[i] > told[*best])) best = i;
        }
        return best;
    };
    double here = std::numeric_limits<double>::infinity();
    for (const Pair& pair : pairs) here = std::min(here, pair.now() / left);
    const auto tells = [&](std::optional<std::size_t> i) {
        return i && apart[*i] > worth_measuring * here && apart[*i] >= min_apart;
    };
    // Records on which the machine stays where it was, where one of them tells anything.
    compare();
    auto best = best_of(range_beyond);
    if (!best || apart[*best] < clearly_apart) {
        menu.add_waves(longer);
        compare();
        best = best_of(range_beyond);
    }
    for (const double farther : farther_beyond) {
        if (!tells(best)) best = best_of(farther);
    }
    if (!tells(best)) return std::nullopt;
    const ListedRecord& chosen = menu.list[*best];
    SystemExperiment result{.apart = apart[*best]};
    result.record = Pair(first, rivals.front(), records, scale, between).foretold(chosen);
    result.text = fmt::format(
        "{}: there they differ by {:.3g} times the error that is left now or more, rms, whatever values "
        "the free parameters take; on {} by {:.3g}.",
        chosen.text, apart[*best], records.size() == 1 ? records.front().source : "the present records", here);
    if (beyond[*best] > range_beyond) {
        result.text += fmt::format(
            " An output may leave what was measured by {:.2g} times its range: see first that the machine allows it.",
            beyond[*best]);
    }
    return result;
}

} // namespace tribode
