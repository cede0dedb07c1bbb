#include "tribode/diagnosis/system_report.hpp"
#include "tribode/base/quantity.hpp"
#include "tribode/diagnosis/prediction_statistics.hpp"
#include "tribode/diagnosis/report_colors.hpp"
#include "tribode/diagnosis/system_record.hpp"
#include "tribode/diagnosis/system_terms.hpp"

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <fmt/format.h>
#include <fmt/ranges.h>
#include <map>
#include <numeric>

namespace tribode {

namespace {

constexpr double may_be_chance = 0.5; // probability that an open term is none

std::string label(const std::string& name, const std::string& unit) {
    return unit.empty() ? name : fmt::format("{} [{}]", name, unit);
}

// Means of the errors in bins of a variable, with twice their standard errors. What the means leave is no white noise: as many
// samples count as it leaves independent of one another.
Series binned(const std::string& name, const std::vector<double>& x, const std::vector<double>& errors,
              std::size_t first) {
    constexpr std::size_t bins = 40;
    const auto [low, high] = std::minmax_element(x.begin() + static_cast<std::ptrdiff_t>(first), x.end());
    const double width = (*high - *low) / bins;
    Series series{.name = name, .style = SeriesStyle::points};
    if (!(width > 0)) return series;
    struct Bin {
        double n = 0, sum = 0, squares = 0;
    };
    std::vector<Bin> all(bins);
    const auto bin_of = [&, low = *low](std::size_t k) -> Bin& {
        return all[std::min(bins - 1, static_cast<std::size_t>((x[k] - low) / width))];
    };
    for (std::size_t k = first; k < x.size(); ++k) {
        if (!std::isfinite(errors[k])) continue;
        auto& bin = bin_of(k);
        bin.n += 1;
        bin.sum += errors[k];
    }
    std::vector<double> left;
    for (std::size_t k = first; k < x.size(); ++k) {
        if (!std::isfinite(errors[k])) continue;
        auto& bin = bin_of(k);
        left.push_back(errors[k] - bin.sum / bin.n);
        bin.squares += left.back() * left.back();
    }
    const double correlated = std::max(1.0, correlation_length(left));
    for (std::size_t b = 0; b < bins; ++b) {
        if (all[b].n < 3) continue;
        const double mean = all[b].sum / all[b].n;
        const double deviation = std::sqrt(all[b].squares / all[b].n / std::max(1.0, all[b].n / correlated));
        series.x.push_back(*low + (static_cast<double>(b) + 0.5) * width);
        series.y.push_back(mean);
        series.low.push_back(mean - 2 * deviation);
        series.high.push_back(mean + 2 * deviation);
    }
    return series;
}

std::vector<double> differences(const std::vector<double>& measured, const std::vector<double>& simulated) {
    std::vector<double> errors(measured.size());
    for (std::size_t k = 0; k < errors.size(); ++k) errors[k] = measured[k] - simulated[k];
    return errors;
}

Plot responses(const SystemDiagnosis& d, const SystemComparison& one) {
    Plot plot{.title = "Measured and simulated: " + std::filesystem::path(one.record.source).filename().string()};
    for (std::size_t o = 0; o < one.record.outputs.size(); ++o) {
        const auto& output = d.before.equations.outputs[d.before.measured[o]];
        Panel panel{.y_label = label(measured_name(d.before, o), output.unit)};
        panel.series.push_back(
            {.name = "measured", .x = one.record.t, .y = one.record.outputs[o], .color = measured_color});
        panel.series.push_back(
            {.name = "the model as given, fitted", .x = one.record.t, .y = one.before[o], .color = before_color});
        if (!d.effects.empty()) {
            panel.series.push_back(
                {.name = "with what was missing", .x = one.record.t, .y = one.after[o], .color = after_color});
        }
        plot.panels.push_back(std::move(panel));
        Panel errors{.y_label = label("measured - simulated", output.unit)};
        errors.series.push_back({.name = "the model as given, fitted",
                                 .x = one.record.t,
                                 .y = differences(one.record.outputs[o], one.before[o]),
                                 .color = before_color});
        if (!d.effects.empty()) {
            errors.series.push_back({.name = "with what was missing",
                                     .x = one.record.t,
                                     .y = differences(one.record.outputs[o], one.after[o]),
                                     .color = after_color});
        }
        plot.panels.push_back(std::move(errors));
    }
    const auto& t = one.record.t;
    const bool has_time =
        !d.before.equations.states.empty() || t[1] != 1 || t.back() != static_cast<double>(t.size() - 1);
    plot.panels.back().x_label = has_time ? "Time [s]" : "Row";
    return plot;
}

Plot maps(const SystemDiagnosis& d, const SystemComparison& one) {
    constexpr std::size_t max_panels = 8;
    Plot plot{.title = "Errors over what was measured: means and twice their standard errors"};
    const auto& inputs = d.before.equations.inputs;
    for (std::size_t o = 0; o < one.record.outputs.size(); ++o) {
        const std::string name = measured_name(d.before, o);
        const std::string unit = d.before.equations.outputs[d.before.measured[o]].unit;
        const auto before = differences(one.record.outputs[o], one.before[o]);
        const auto after = differences(one.record.outputs[o], one.after[o]);
        const auto add = [&](const std::string& x_label, const std::vector<double>& x) {
            Panel panel{.x_label = x_label, .y_label = label(name + ": measured - simulated", unit)};
            for (const auto& [title, errors, color] : {std::tuple{"the model as given, fitted", &before, before_color},
                                                       {"with what was missing", &after, after_color}}) {
                Series series = binned(title, x, *errors, one.first);
                series.color = color;
                if (!series.x.empty() && (errors == &before || !d.effects.empty()))
                    panel.series.push_back(std::move(series));
            }
            if (!panel.series.empty() && plot.panels.size() < max_panels) plot.panels.push_back(std::move(panel));
        };
        add(label(name, unit), one.record.outputs[o]);
        for (std::size_t i = 0; i < one.record.inputs.size(); ++i) {
            if (!one.record.inputs[i].empty()) add(label(inputs[i].name, inputs[i].unit), one.record.inputs[i]);
        }
    }
    return plot;
}

// Name, value, standard error and unit, which has the prefix that the value needs.
std::vector<ReportTable::Cell> value_row(const std::string& name, double value, double error, const std::string& unit) {
    const PrefixedUnit prefixed = prefixed_unit(value, unit);
    return {name, prefixed.factor * value, prefixed.factor * error, prefixed.unit};
}

// "overflow in der(x1): ..., a = 0.2 +- 0.01 1/s"
std::string described(const SystemEffect& effect) {
    std::string text = fmt::format("{} in {}", effect.name, effect.equation);
    if (effect.name == curve_term) return text + fmt::format(" with {} bends", effect.values.size());
    for (std::size_t i = 0; i < effect.values.size(); ++i) {
        text += fmt::format(", {} = {}", effect.parameters[i], format_quantity(effect.values[i], effect.units[i], 3));
    }
    return text;
}

ReportSection what_is_missing(const SystemDiagnosis& d) {
    ReportSection what{"What is missing", {}};
    for (const auto& effect : d.effects) {
        what.blocks.push_back(Paragraph{effect.evidence});
        ReportTable table;
        table.caption = fmt::format("{} in {}: {}", effect.name, effect.equation, effect.expression);
        table.columns = {{"parameter"}, {"value"}, {"standard error"}, {"unit"}};
        for (std::size_t i = 0; i < effect.values.size(); ++i) {
            table.rows.push_back(
                value_row(effect.parameters[i], effect.values[i], effect.standard_errors[i], effect.units[i]));
        }
        what.blocks.push_back(table);
        if (!effect.same_as.empty()) {
            what.blocks.push_back(
                Paragraph{fmt::format("The same in other words: {}.", fmt::join(effect.same_as, "; "))});
        }
        const bool may_be_none = effect.probability_of_none() > worth_a_line;
        if (effect.rivals.empty() && !may_be_none) {
            what.blocks.push_back(
                Paragraph{fmt::format("Probability {:.2f}; nothing else comes near.", effect.probability)});
            continue;
        }
        BulletList rivals;
        for (const auto& [name, probability] : effect.rivals) {
            rivals.items.push_back(fmt::format("{} with probability {:.2f}", name, probability));
        }
        if (may_be_none) {
            rivals.items.push_back(
                fmt::format("{} with probability {:.2f}", none_of_these, effect.probability_of_none()));
        }
        what.blocks.push_back(Paragraph{fmt::format("Probability {:.2f}. It could also be:", effect.probability)});
        what.blocks.push_back(rivals);
    }
    const std::string unit = gap_unit(d);
    ReportTable gaps;
    gaps.caption = "rms of measured minus simulated; a validation record takes no part in the fit, but for its start "
                   "values";
    gaps.columns = {{"record"}, {"as given", unit}, {"with what was missing", unit}, {"noise", unit}};
    for (const auto& one : d.fitted) {
        gaps.rows.push_back({one.record.source + ", fitted", one.gap.before, one.gap.after, one.gap.floor});
    }
    for (const auto& one : d.validation) {
        gaps.rows.push_back({one.record.source + ", validation", one.gap.before, one.gap.after, one.gap.floor});
    }
    what.blocks.push_back(gaps);
    what.blocks.push_back(Figure{"responses", "A validation record.", responses(d, d.validation.front())});
    if (d.next_experiment) what.blocks.push_back(Paragraph{"What to measure next: " + d.next_experiment->text});
    return what;
}

ReportSection values(const SystemDiagnosis& d) {
    ReportSection section{"Parameters fitted along with it", {}};
    ReportTable table;
    table.caption = "Parameters of the model as it was given";
    table.columns = {{"name"}, {"value"}, {"standard error"}, {"unit"}};
    for (const auto& one : d.free) table.rows.push_back(value_row(one.name, one.value, one.standard_error, one.unit));
    section.blocks.push_back(table);
    section.blocks.push_back(Paragraph{
        fmt::format("Inputs are {}. Standard errors count as many samples as the remaining errors leave independent.",
                    interpolation_text(d.interpolation))});
    return section;
}

ReportSection what_was_tried(const SystemDiagnosis& d) {
    ReportSection section{"What was tried", {}};
    const char* hidden = d.before.equations.states.empty()
                             ? "The last 30 % of the rows were"
                             : "Two parts of each record, from 30 to 45 % and from 85 to 100 %, were";
    section.blocks.push_back(Paragraph{fmt::format(
        "Terms of the library were screened by their effect on the simulated outputs, one by one and in pairs. {} "
        "hidden "
        "from the search: the likeliest models were fitted with all free values to the rest and predicted what was "
        "hidden. "
        "The errors are relative to the standard deviation of the outputs; the score is the error that the model "
        "promises on other records of this kind.",
        hidden)});
    // Of several fits of the same terms beside the same model the one that was taken, or the best.
    using Key = std::pair<std::string, std::string>;
    std::map<Key, const SystemHypothesis*> best;
    std::vector<Key> order;
    for (const auto& one : d.hypotheses) {
        const auto begin = one.names.begin(), middle = begin + static_cast<std::ptrdiff_t>(one.before);
        Key key{one.before == 0 ? "the model as given" : fmt::format("{}", fmt::join(begin, middle, "; ")),
                fmt::format("{}", fmt::join(middle, one.names.end(), "; "))};
        const auto [place, is_new] = best.try_emplace(key, &one);
        if (is_new) {
            order.push_back(std::move(key));
        } else if (!place->second->lost.empty() && (one.lost.empty() || one.score < place->second->score)) {
            place->second = &one;
        }
    }
    ReportTable table;
    table.columns = {{"beside"}, {"terms"}, {"score"}, {"fitted"}, {"predicted"}, {"outcome"}};
    for (const Key& key : order) {
        const SystemHypothesis& one = *best.at(key);
        table.rows.push_back(
            {key.first, key.second, one.score, one.fitted, one.predicted, one.lost.empty() ? "taken" : one.lost});
    }
    section.blocks.push_back(table);
    if (d.out_of_time) section.blocks.push_back(Paragraph{"The budget of time ended the search."});
    return section;
}

// A plant that its controller holds drifts away from a record where it is simulated by itself.
std::string drift_sentence(const SystemDiagnosis& d) {
    constexpr double away = 3; // times what the record varies by
    double variation = 1;      // where the gap is in standard deviations
    if (d.before.measured.size() == 1) {
        auto values = d.validation.front().record.outputs.front();
        std::erase_if(values, [](double y) { return !std::isfinite(y); });
        const double mean = std::accumulate(values.begin(), values.end(), 0.0) / static_cast<double>(values.size());
        for (double& y : values) y -= mean;
        variation = rms_of_errors(values);
    }
    if (!(d.validation_gap.before > away * variation)) return "";
    return fmt::format(
        " The model drifts away from the record, whose values vary by {} rms: if it is of a closed loop, put the "
        "controller into the system, with the reference as an input.",
        format_quantity(variation, gap_unit(d), 3));
}

// Parameters that may have any value: a term that takes over what one of them did leaves it free. Nothing where there are
// none. One that is nothing in the model as given has no size to compare its standard error with.
std::string undetermined_sentence(const SystemDiagnosis& d) {
    std::vector<std::string> names;
    for (const auto& one : d.free) {
        const auto& given = d.before.equations.parameters;
        const auto own = std::ranges::find(given, one.name, &Equations::Parameter::name);
        const double before = own != given.end() ? std::abs(own->value) : 0;
        const bool is_larger = before > 0 && one.standard_error > std::max(std::abs(one.value), before);
        if (is_larger || !std::isfinite(one.standard_error)) names.push_back(one.name);
    }
    for (const auto& effect : d.effects) {
        for (std::size_t i = 0; i < effect.values.size(); ++i) {
            if (!(effect.standard_errors[i] <= std::abs(effect.values[i]))) names.push_back(effect.parameters[i]);
        }
    }
    if (names.empty()) return "";
    return fmt::format(" These records do not determine {}.", fmt::join(names, ", "));
}

} // namespace

std::string gap_unit(const SystemDiagnosis& d) {
    return d.before.measured.size() > 1 ? "standard deviations of the outputs"
                                        : d.before.equations.outputs[d.before.measured[0]].unit;
}

std::string interpolation_text(Interpolation between) {
    switch (between) {
    case Interpolation::hold: return "held between samples";
    case Interpolation::linear: return "linear between samples";
    case Interpolation::band_limited: return "band-limited between samples";
    }
    return "";
}

// Where more than noise is left, and uncertain values may be why.
std::string uncertainty_sentence(const SystemDiagnosis& d) {
    const auto& gap = d.validation_gap;
    if (d.prediction_uncertainty < gap.floor || gap.after < 1.5 * gap.floor) return "";
    return fmt::format(" Through the uncertainty of the fitted values the prediction may be off by {}.",
                       format_quantity(d.prediction_uncertainty, gap_unit(d), 3));
}

std::string verdict_sentence(const SystemDiagnosis& d) {
    const std::string unit = gap_unit(d);
    const auto& gap = d.validation_gap;
    if (d.verdict == "nothing_missing") {
        return fmt::format("Nothing is missing that these records can show: the model as given leaves {} rms, noise "
                           "{}.{}",
                           format_quantity(gap.before, unit, 3), format_quantity(gap.floor, unit, 3),
                           uncertainty_sentence(d));
    }
    if (d.effects.empty()) {
        std::string text = d.out_of_time ? "Nothing was found before the budget of time ended the search: the model "
                                         : "Something is missing that is none of the terms in the library: the model ";
        if (!std::isfinite(gap.before)) return text + "cannot be simulated on the validation record.";
        text += fmt::format("differs from the validation record by {} rms, noise would leave {}.",
                            format_quantity(gap.before, unit, 3), format_quantity(gap.floor, unit, 3));
        if (d.nearest && d.nearest->second > 0) {
            text += fmt::format(" Nearest is {}, which explains {:.0f} % of the gap.", d.nearest->first,
                                100 * d.nearest->second);
        }
        text += drift_sentence(d);
        return text;
    }
    // An answer that is found may have a rest that is not decided.
    std::vector<std::string> names, rest;
    for (const auto& effect : d.effects) {
        const bool is_rest = effect.is_open && d.verdict != "undecided" && d.open_rest != OpenRest::most;
        (is_rest ? rest : names).push_back(described(effect));
    }
    const std::string sizes = fmt::format(
        "The gap on the validation record decreases from {} to {} rms, noise leaves {}.",
        format_quantity(gap.before, unit, 3), format_quantity(gap.after, unit, 3), format_quantity(gap.floor, unit, 3));
    const auto& first = d.effects.front();
    const bool is_chance = d.verdict == "undecided" && first.probability_of_none() > may_be_chance;
    const bool is_likeliest = first.rivals.empty() || first.probability >= first.rivals.front().second;
    const char* begin = d.verdict == "effect_found" ? "What is missing is"
                        : is_chance                 ? "What suits the records best, though it may be chance, is"
                        : d.verdict == "undecided" && is_likeliest ? "Likeliest, but not decided by these records, is"
                        : d.verdict == "undecided" ? "One of several that these records do not tell apart is"
                        : d.verdict == "partial"   ? "A part of what is missing is"
                                                   : "Most of what is missing has not been found; a part is";
    const std::string open = rest.empty() ? ""
                                          : fmt::format(" {}, not decided by these records, may be {}.",
                                                        d.open_rest == OpenRest::little ? "A small rest" : "The rest",
                                                        fmt::join(rest, "; "));
    return fmt::format("{} {}.{} {}{}{}", begin, fmt::join(names, "; "), open, sizes, uncertainty_sentence(d),
                       undetermined_sentence(d));
}

Report system_report(const SystemDiagnosis& d) {
    Report report;
    report.title = "Diagnosis of " + d.before.equations.name;
    report.summary = verdict_sentence(d);
    report.sections.push_back(what_is_missing(d));
    report.sections.push_back(
        {"Where model and measurement disagree",
         {Paragraph{d.where}, Figure{"errors", "The gap over what was measured.", maps(d, d.validation.front())}}});
    report.sections.push_back(values(d));
    if (!d.remarks.empty()) {
        report.sections.push_back({"The records", {}});
        for (const auto& remark : d.remarks) report.sections.back().blocks.push_back(Paragraph{remark});
    }
    report.sections.push_back(what_was_tried(d));
    return report;
}

} // namespace tribode
