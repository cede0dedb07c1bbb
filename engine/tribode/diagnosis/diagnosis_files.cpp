#include "tribode/diagnosis/diagnosis_files.hpp"
#include "tribode/analysis/spectrum.hpp"
#include "tribode/base/quantity.hpp"
#include "tribode/base/text.hpp"
#include "tribode/diagnosis/disagreement.hpp"
#include "tribode/diagnosis/report_colors.hpp"
#include "tribode/effect/effect.hpp"
#include "tribode/record/csv.hpp"
#include "tribode/record/json_file.hpp"
#include "tribode/record/report.hpp"

#include <algorithm>
#include <cmath>
#include <fmt/format.h>
#include <fmt/ranges.h>
#include <limits>

namespace tribode {

namespace {

std::string sentence(const Diagnosis& d) {
    // Where the strongest effect is decided, what is not is told as what may be missing besides.
    std::vector<std::string> names, open;
    for (const auto& effect : d.effects) {
        if (!effect.is_open || d.verdict == "undecided") {
            names.push_back(effect.name);
            continue;
        }
        std::string either = effect.name;
        for (const auto& rival : effect.rivals) either += " or " + rival.name;
        open.push_back(std::move(either));
    }
    const std::string besides =
        open.empty() ? "" : fmt::format(", and besides, not decided by these records, {}", fmt::join(open, "; "));
    const Gap& gap = d.validation_gap;
    const auto size = [](double value) { return format_quantity(value, "m", 3); };
    const std::string shrink =
        fmt::format("on the validation record the gap decreases from {} to {} rms, where noise and rounding leave {}",
                    size(gap.before), size(gap.after), size(gap.floor));
    if (d.verdict == "nothing_missing") {
        return fmt::format("Nothing is missing that these records can show: measured and simulated position differ by "
                           "{} rms, noise and rounding leave {}.",
                           size(gap.before), size(gap.floor));
    }
    if (!d.fields_off.empty()) {
        std::vector<std::string> fields;
        for (const auto& field : d.fields_off)
            fields.push_back(fmt::format("{} {:.1f}", field.name, std::abs(field.deviations)));
        const std::string found =
            names.empty() ? "" : fmt::format("What is missing is {}{}. ", fmt::join(names, " and "), besides);
        return fmt::format(
            "{}Fields are farther off than their tolerances let them be, in standard deviations {}, or an "
            "effect is missing that they make up for; with them {}.",
            found, fmt::join(fields, ", "), shrink);
    }
    if (names.empty()) {
        const std::string nearest =
            d.nearest ? fmt::format("; the nearest, {}, explains {:.0f} % of the gap", d.nearest->name,
                                    100 * d.nearest->share)
                      : fmt::format("; measured and simulated position differ by {} rms, noise and rounding leave {}",
                                    size(gap.before), size(gap.floor));
        return d.verdict == "unknown_effect"
                   ? fmt::format("Something is missing that is none of the known effects{}.", nearest)
                   : fmt::format("Something is missing, and the budget of time ended the search before it was found{}.",
                                 nearest);
    }
    if (d.verdict == "undecided") {
        std::vector<std::string> rivals;
        for (const auto& effect : d.effects) {
            for (const auto& rival : effect.rivals) rivals.push_back(rival.name);
        }
        return fmt::format("What is missing is {} or {}, which these records cannot tell apart; {}.",
                           fmt::join(names, " and "), fmt::join(rivals, " or "), shrink);
    }
    if (d.verdict == "partial")
        return fmt::format("A part of what is missing is {}{}; {}.", fmt::join(names, " and "), besides, shrink);
    if (d.effects.size() == 1 && effect_kind(names.front()).is_rounding) {
        // Positions are simulated without rounding: it is the floor that differs.
        return fmt::format(
            "What is missing is {}: with it noise and rounding leave {} rms on the validation record, as "
            "described {}, and measured minus simulated position is {}.",
            names.front(), size(gap.floor), size(d.validation.front().described_floor), size(gap.after));
    }
    return fmt::format("What is missing is {}{}; {}.", fmt::join(names, " and "), besides, shrink);
}

// A name and a value for every number in a table of parameters: "harmonics[1].F".
void flatten(const Json& value, const std::string& path, std::vector<std::pair<std::string, double>>& list) {
    if (value.is_number()) {
        list.push_back({path, value.get<double>()});
    } else if (value.is_object()) {
        for (const auto& [key, entry] : value.items()) flatten(entry, path.empty() ? key : path + "." + key, list);
    } else if (value.is_array()) {
        for (std::size_t i = 0; i < value.size(); ++i) flatten(value[i], fmt::format("{}[{}]", path, i + 1), list);
    }
}

std::vector<double> times(const Compared& c) {
    std::vector<double> t = c.measurement.drive.t;
    const double start = t.front();
    for (double& value : t) value -= start;
    return t;
}

std::vector<double> difference(const std::vector<double>& a, const std::vector<double>& b, double scale) {
    std::vector<double> d(a.size());
    for (std::size_t k = 0; k < a.size(); ++k) d[k] = scale * (a[k] - b[k]);
    return d;
}

std::vector<double> scaled(std::vector<double> values, double scale) {
    for (double& value : values) value *= scale;
    return values;
}

Plot response_plot(const Compared& c, bool changed) {
    const auto t = times(c);
    Plot plot;
    Panel response, gap;
    response.x_label = gap.x_label = "Time [s]";
    response.y_label = "Position [mm]";
    response.series = {{"measured", t, scaled(c.measurement.position(), 1e3), SeriesStyle::line, measured_color, 2.6},
                       {"before", t, scaled(c.y_before, 1e3), SeriesStyle::line, before_color, 1.0}};
    gap.y_label = "Measured - simulated [um]";
    gap.series = {
        {"before", t, difference(c.measurement.position(), c.y_before, 1e6), SeriesStyle::line, before_color, 1.0}};
    if (changed) {
        response.series.push_back({"after", t, scaled(c.y_after, 1e3), SeriesStyle::dashed, after_color, 1.2});
        gap.series.push_back(
            {"after", t, difference(c.measurement.position(), c.y_after, 1e6), SeriesStyle::line, after_color, 1.0});
    }
    plot.panels = {response, gap};
    return plot;
}

// What is left over as a force, without and with the effects found.
struct Residuals {
    ResidualForce before, after;
    bool changed; // whether there are effects or fields that explain it

    Residuals(const Diagnosis& d, const Compared& c)
        : before(residual_force(d.before, c.measurement, {c.y_before, c.u_before})),
          after(residual_force(d.after, c.measurement, {c.y_after, c.u_after}, before.bandwidth)),
          changed(!d.effects.empty() || !d.fields_off.empty()) {}
};

// Thrust over position, and what it does besides moving the mass: friction, with its loop at every reversal.
Plot loop_plot(const Compared& c, const Residuals& residuals) {
    Plot plot;
    Panel loop, friction;
    loop.x_label = friction.x_label = "Position [mm]";
    loop.y_label = "Thrust reference [N]";
    loop.series = {{"measured", scaled(c.measurement.position(), 1e3), c.measurement.thrust, SeriesStyle::line,
                    measured_color, 2.2},
                   {"before", scaled(c.y_before, 1e3), c.u_before, SeriesStyle::line, before_color, 0.9}};
    const auto& [before, after, changed] = residuals;
    friction.y_label = "Thrust less inertia [N]";
    const auto position = scaled(before.position, 1e3);
    // Measured, and with the force that the model lacks simulated.
    const auto shown = [](const ResidualForce& r, double simulated) {
        std::vector<double> f(r.force.size());
        for (std::size_t k = 0; k < f.size(); ++k) f[k] = r.thrust[k] - r.inertial[k] + simulated * r.force[k];
        return f;
    };
    friction.series = {{"measured", position, shown(before, 0), SeriesStyle::line, measured_color, 2.2},
                       {"before", position, shown(before, 1), SeriesStyle::line, before_color, 0.9}};
    if (changed) {
        loop.series.push_back({"after", scaled(c.y_after, 1e3), c.u_after, SeriesStyle::line, after_color, 0.9});
        friction.series.push_back(
            {"after", scaled(after.position, 1e3), shown(after, 1), SeriesStyle::line, after_color, 0.9});
    }
    plot.panels = {loop, friction};
    return plot;
}

Plot spectrum_plot(const Compared& c, bool changed, double sample_time) {
    std::vector<double> frequency;
    for (int i = 0; i < 300; ++i) frequency.push_back(0.5 * std::pow(0.45 / sample_time / 0.5, i / 299.0));
    const auto& y = c.measurement.position();
    Plot plot;
    Panel panel;
    panel.x_label = "Frequency [Hz]";
    panel.y_label = "Amplitude of measured - simulated [um]";
    panel.x_log = panel.y_log = true;
    const auto add = [&](const char* name, const std::vector<double>& simulated, const char* color) {
        panel.series.push_back({name, frequency,
                                amplitude_spectrum(difference(y, simulated, 1e6), sample_time, frequency),
                                SeriesStyle::line, color});
    };
    add("before", c.y_before, before_color);
    if (changed) add("after", c.y_after, after_color);
    plot.panels = {panel};
    return plot;
}

Plot force_plot(const Residuals& residuals) {
    const auto& [before, after, changed] = residuals;
    Plot plot;
    plot.title =
        fmt::format("Force that the model lacks, below {:g} Hz, and twice its standard errors; noise leaves {} rms "
                    "of it",
                    before.bandwidth, format_quantity(before.noise, "N", 2));
    const auto add_curves = [](Panel& panel, const std::string& name, const ForceCurve& curve, double scale,
                               const char* color) {
        const auto add = [&](const char* direction, const std::vector<double>& mean, const std::vector<double>& error,
                             SeriesStyle style) {
            Series series{
                .name = name + direction, .x = scaled(curve.at, scale), .y = mean, .style = style, .color = color};
            for (std::size_t i = 0; i < mean.size(); ++i) {
                series.low.push_back(mean[i] - 2 * error[i]);
                series.high.push_back(mean[i] + 2 * error[i]);
            }
            panel.series.push_back(std::move(series));
        };
        add(", forward", curve.forward, curve.forward_error, SeriesStyle::line_points);
        add(", backward", curve.backward, curve.backward_error, SeriesStyle::points);
    };
    struct Axis {
        Coordinate coordinate;
        const char* label;
        double scale;
    };
    for (const auto& [coordinate, label, scale] :
         {Axis{Coordinate::position, "Position [mm]", 1e3},
          {Coordinate::velocity, "Velocity [mm/s]", 1e3},
          {Coordinate::since_reversal, "Distance since the last reversal [mm]", 1e3},
          {Coordinate::thrust, "Thrust [N]", 1},
          {Coordinate::time, "Time [s]", 1}}) {
        Panel panel;
        panel.x_label = label;
        panel.y_label = "Force [N]";
        add_curves(panel, "before", force_curve(before, coordinate, 80), scale, before_color);
        if (changed) add_curves(panel, "after", force_curve(after, coordinate, 80), scale, after_color);
        plot.panels.push_back(std::move(panel));
    }
    Panel spectrum;
    spectrum.x_label = "Frequency [Hz]";
    spectrum.y_label = "Amplitude of the force [N]";
    spectrum.x_log = spectrum.y_log = true;
    std::vector<double> frequency;
    for (int i = 0; i < 200; ++i) frequency.push_back(0.3 * std::pow(before.bandwidth / 0.3, i / 199.0));
    const auto add = [&](const char* name, const ResidualForce& r, const char* color) {
        spectrum.series.push_back(
            {name, frequency, amplitude_spectrum(r.force, r.sample_time, frequency), SeriesStyle::line, color});
    };
    add("before", before, before_color);
    if (changed) add("after", after, after_color);
    plot.panels.push_back(std::move(spectrum));
    plot.height = 2400;
    return plot;
}

// The same over two coordinates at once: what no effect of the list explains may still have a place, a speed or a time.
Plot map_plot(const Residuals& residuals) {
    Plot plot;
    plot.title = "Force that the model lacks, in two coordinates";
    plot.height = residuals.changed ? 1800 : 1000;
    double strongest_of_motion = 0, strongest_of_time = 0; // colours alike before and after
    const auto strongest = [](std::vector<double> values) {
        std::erase_if(values, [](double value) { return !std::isfinite(value); });
        if (values.empty()) return 0.0;
        for (double& value : values) value = std::abs(value);
        std::sort(values.begin(), values.end());
        return values[values.size() * 99 / 100];
    };
    const auto add = [&](const ResidualForce& r, const char* when) {
        Panel motion, time;
        const ForceMap over_motion = force_over_motion(r), over_time = force_over_time_and_frequency(r);
        if (strongest_of_motion == 0) strongest_of_motion = strongest(over_motion.values);
        if (strongest_of_time == 0) strongest_of_time = strongest(over_time.values);
        motion.title = fmt::format("{}: mean force where the machine was, forward above, backward below", when);
        motion.x_label = "Position [mm]";
        motion.y_label = "Velocity [mm/s]";
        time.title = fmt::format("{}: when and at which frequencies", when);
        time.x_label = "Time [s]";
        time.y_label = "Frequency [Hz]";
        time.y_log = true;
        if (!over_motion.values.empty()) {
            motion.map = {"Force [N]", scaled(over_motion.x_edges, 1e3), scaled(over_motion.y_edges, 1e3),
                          over_motion.values, strongest_of_motion};
        }
        if (!over_time.values.empty()) {
            time.map = {"Amplitude [N]", over_time.x_edges, over_time.y_edges, over_time.values, strongest_of_time};
        }
        plot.panels.push_back(std::move(motion));
        plot.panels.push_back(std::move(time));
    };
    add(residuals.before, "before");
    if (residuals.changed) add(residuals.after, "after");
    return plot;
}

// The force itself, as it is drawn.
Table force_table(const Residuals& residuals) {
    const ResidualForce& r = residuals.before;
    Table table;
    table.add("t", "s", r.time);
    table.add("position", "m", r.position);
    table.add("velocity", "m/s", r.velocity);
    table.add("thrust", "N", r.thrust);
    table.add("force_before", "N", r.force);
    return table;
}

ReportTable gap_table(const Diagnosis& d) {
    ReportTable table;
    table.caption = "rms of measured less simulated position";
    table.columns = {{"record"},         {"before", "um"}, {"after", "um"}, {"noise and rounding", "um"},
                     {"before / floor"}, {"after / floor"}};
    const auto row = [&](const std::string& name, const Gap& gap) {
        table.rows.push_back(
            {name, 1e6 * gap.before, 1e6 * gap.after, 1e6 * gap.floor, gap.before / gap.floor, gap.after / gap.floor});
    };
    row("fitted", d.fitted_gap);
    row("validation record", d.validation_gap);
    if (const Compared& validation = d.validation.front(); validation.described_floor != validation.gap.floor) {
        Gap described = d.validation_gap;
        described.floor = validation.described_floor;
        row("the same, with the encoder as described", described);
    }
    return table;
}

ReportTable share_table(const Compared& c) {
    ReportTable table;
    table.caption = "Shares of the squared error before, beside the shares of the time";
    table.columns = {{"coordinate"}, {"part"}, {"error", "%", 1}, {"time", "%", 1}, {"error / time", "", 2}};
    for (const auto& part : gap_shares(c)) {
        table.rows.push_back({part.axis, part.part, 100 * part.error, 100 * part.time, part.lift()});
    }
    return table;
}

ReportTable ranking_table(const Diagnosis& d) {
    ReportTable table;
    table.caption = "Remaining error of each hypothesis, in units of the errors of noise alone; the score is chi "
                    "square of all records plus the penalty of the free parameters, minus that of the best";
    table.columns = {
        {"effects"}, {"free parameters", "", 0}, {"fitted records"}, {"validation"}, {"score above the best"}};
    const auto row = [&](const std::string& name, const Scored& one) {
        table.rows.push_back({name, static_cast<double>(one.hypothesis.parameter_count()), std::sqrt(one.fitted),
                              std::sqrt(one.validation),
                              d.search.ranking.empty() ? 0 : one.score - d.search.ranking.front().score});
    };
    row("none", d.search.baseline);
    for (const auto& one : d.search.ranking) row(fmt::format("{}", fmt::join(one.names(), " + ")), one);
    return table;
}

ReportTable parameter_table(const NamedEffect& effect) {
    ReportTable table;
    table.columns = {{"parameter"}, {"value"}, {"standard error"}, {"unit"}};
    std::vector<std::pair<std::string, double>> values, errors;
    flatten(effect.parameters, "", values);
    flatten(effect.standard_errors, "", errors);
    for (const auto& [path, value] : values) {
        double error = std::numeric_limits<double>::quiet_NaN();
        for (const auto& [name, number] : errors) {
            if (name == path && number > 0) error = number;
        }
        const auto [factor, unit] = prefixed_unit(value, effect_kind(effect.name).unit_of(path));
        table.rows.push_back({path, factor * value, factor * error, unit});
    }
    return table;
}

Report report_of(const Diagnosis& d, const Residuals& residuals, const Json& summary) {
    const Compared& validation = d.validation.front();
    const double Ts = d.before.sample_time;
    Report report;
    report.title = "Where model and measurement disagree";
    report.summary = sentence(d);
    report.sections.push_back(
        {"The gap",
         {gap_table(d), Figure{"response", "The validation record.", response_plot(validation, residuals.changed)}}});
    report.sections.push_back(
        {"Where they disagree",
         {Paragraph{d.where}, share_table(validation),
          Figure{"residual_force",
                 "Delayed thrust less modelled friction and inertia, measured less "
                 "simulated: what pushes the machine and not the model.",
                 force_plot(residuals)},
          Figure{"residual_maps", "The same over position and velocity, and over time and frequency.",
                 map_plot(residuals)}}});
    ReportSection names{"The name", {}};
    if (d.verdict == "unknown_effect") {
        names.blocks.push_back(Paragraph{"No known effect leaves only noise, or removes half of the gap, alike on all "
                                         "records and more than the others: none is named."});
    }
    names.blocks.push_back(ranking_table(d));
    for (const auto& effect : d.effects) {
        const EffectKind& kind = effect_kind(effect.name);
        names.blocks.push_back(Paragraph{fmt::format("{} with probability {:.2f}. {} Equation: {}.", effect.name,
                                                     effect.probability, kind.summary, kind.equation)});
        names.blocks.push_back(parameter_table(effect));
        names.blocks.push_back(Paragraph{effect.evidence});
        if (!effect.rivals.empty()) {
            BulletList rivals;
            for (const auto& rival : effect.rivals) {
                rivals.items.push_back(fmt::format("{} with probability {:.2g}", rival.name, rival.probability));
            }
            names.blocks.push_back(Paragraph{"It could also be:"});
            names.blocks.push_back(rivals);
        }
    }
    if (d.next_experiment)
        names.blocks.push_back(Paragraph{"The experiment that would decide: " + d.next_experiment->text});
    report.sections.push_back(std::move(names));
    report.sections.push_back(
        {"Before and after",
         {Figure{"loop",
                 "Thrust over position, and what of it does not move the mass: friction and the "
                 "forces on the axis.",
                 loop_plot(validation, residuals)},
          Figure{"spectrum", "Remaining error over frequency.", spectrum_plot(validation, residuals.changed, Ts)}}});
    BulletList unseen;
    unseen.items = untested(d);
    report.sections.push_back({"What these records cannot show", {unseen}});
    ReportSection how{"How it was found", {}};
    how.blocks.push_back(Paragraph{fmt::format(
        "Every effect was put into the machine, fitted to the records by simulation of the whole "
        "loop and judged on a validation record. Something counts as missing where the whitened errors exceed "
        "{:.3f} times the variance that noise and rounding explain: five standard deviations, and 3 % for what two "
        "simulators may differ.",
        d.false_alarm_limit)});
    if (!d.search.baseline.hypothesis.nominal.empty()) {
        ReportTable moved;
        moved.caption = "Fields within their tolerance, as fitted, in standard deviations";
        moved.columns = {{"field"}, {"before", "", 2}, {"after", "", 2}};
        const ModelFit fit(d.before, d.search.fitted);
        const auto& best = d.search.ranking.empty() ? d.search.baseline : d.search.ranking.front();
        for (std::size_t i = 0; i < fit.fields().size(); ++i) {
            moved.rows.push_back(
                {fit.fields()[i].name, d.search.baseline.hypothesis.nominal[i], best.hypothesis.nominal[i]});
        }
        how.blocks.push_back(moved);
    }
    how.blocks.push_back(Paragraph{fmt::format("Program version {}, machine {}.", summary["version"].get<std::string>(),
                                               summary["machine"].get<std::string>().substr(0, 16))});
    report.sections.push_back(std::move(how));
    return report;
}

// A value as Lua writes it.
void append_lua(std::string& text, const Json& value, std::size_t depth) {
    const std::string indent(2 * depth + 2, ' ');
    if (value.is_object() || value.is_array()) {
        text += "{\n";
        for (const auto& [key, entry] : value.items()) {
            if (entry.is_null()) continue;
            text += indent;
            if (value.is_object()) {
                const bool plain = !key.empty() && std::all_of(key.begin(), key.end(), [](unsigned char c) {
                    return std::isalnum(c) || c == '_';
                }) && !std::isdigit(static_cast<unsigned char>(key[0]));
                text += plain ? key + " = " : "[" + Json(key).dump() + "] = ";
            }
            append_lua(text, entry, depth + 1);
            text += ",\n";
        }
        text += std::string(2 * depth, ' ') + "}";
    } else if (value.is_number_float()) {
        append_text(text, value.get<double>());
    } else {
        text += value.dump();
    }
}

} // namespace

// Every hypothesis of the last ranking, and why it lost.
static Json hypotheses_json(const Diagnosis& d) {
    Json list = Json::array();
    const Scored* taken = d.effects.empty() || d.search.ranking.empty() ? nullptr : &d.search.ranking.front();
    const auto add = [&](const Scored& one) {
        const double left = std::sqrt(one.together_validation), fitted = std::sqrt(one.together_fitted);
        Json lost = nullptr;
        if (taken && &one != taken) {
            lost =
                fmt::format("its errors are {:.3g} times those of noise on the fitted records and {:.3g} times on the "
                            "validation record, those of the one taken {:.3g} and {:.3g} times",
                            fitted, left, std::sqrt(taken->together_fitted), std::sqrt(taken->together_validation));
        } else if (!taken && d.verdict != "nothing_missing") {
            lost =
                fmt::format("its errors are {:.3g} times those of noise on the fitted records and {:.3g} times on the "
                            "validation record",
                            fitted, left);
        }
        list.push_back({{"names", one.names()},
                        {"score", one.score},
                        {"gap", {{"fitted", fitted}, {"predicted", left}}},
                        {"lost", lost}});
    };
    add(d.search.baseline);
    for (const auto& one : d.search.ranking) add(one);
    return list;
}

Json diagnosis_json(const Diagnosis& d, const std::vector<std::string>& data, const std::string& machine_hash,
                    double seconds) {
    Json effects = Json::array();
    for (const auto& effect : d.effects) {
        Json rivals = Json::array();
        for (const auto& rival : effect.rivals)
            rivals.push_back({{"name", rival.name}, {"probability", rival.probability}});
        effects.push_back({{"name", effect.name},
                           {"parameters", effect.parameters},
                           {"standard_errors", effect.standard_errors},
                           {"probability", effect.probability},
                           {"rivals", rivals},
                           {"evidence", effect.evidence}});
    }
    Json nearest = nullptr, next = nullptr, fields = Json::array();
    for (const auto& field : d.fields_off) fields.push_back({{"name", field.name}, {"deviations", field.deviations}});
    if (d.nearest) nearest = {{"name", d.nearest->name}, {"share", d.nearest->share}};
    if (d.next_experiment) next = d.next_experiment->text;
    return {{"verdict", d.verdict},
            {"effects", effects},
            {"where", d.where},
            {"gap", {{"ident", d.fitted_gap.json()}, {"validate", d.validation_gap.json()}}},
            {"gap_unit", "m"},
            {"explained", d.explained},
            {"nearest", nearest},
            {"fields_off", fields},
            {"next_experiment", next},
            {"hypotheses", hypotheses_json(d)},
            {"out_of_time", d.search.out_of_time},
            {"data", data},
            {"machine", machine_hash},
            {"version", version()},
            {"seconds", seconds}};
}

std::string machine_lua(const Json& description) {
    std::string text = "-- A machine description; see docs/machine-description.md.\nreturn ";
    append_lua(text, description, 0);
    return text + "\n";
}

void write_diagnosis(const Diagnosis& d, const Json& summary, RunFolder& folder, const RunControl& control) {
    const Json machine = d.after.description();
    folder.write_json("machine.json", machine);
    folder.write("machine.lua", machine_lua(machine));
    const Compared& validation = d.validation.front();
    Table table;
    table.add("t", "s", validation.measurement.drive.t);
    const bool closed = validation.measurement.drive.closed_loop();
    table.add("r", "m",
              closed ? validation.measurement.drive.reference
                     : std::vector<double>(validation.measurement.size(), 0.0));
    table.add("u_measured", "N", validation.measurement.thrust);
    table.add("y_measured", "m", validation.measurement.position());
    table.add("u_before", "N", validation.u_before);
    table.add("y_before", "m", validation.y_before);
    table.add("u_after", "N", validation.u_after);
    table.add("y_after", "m", validation.y_after);
    folder.write("validate.csv", to_csv(table));
    const Residuals residuals(d, validation);
    folder.write("residual_force.csv", to_csv(force_table(residuals)));
    if (d.next_experiment && !d.next_experiment->drive.t.empty()) {
        const DriveRecord& drive = d.next_experiment->drive;
        Table inputs;
        inputs.add("t", "s", drive.t);
        if (drive.closed_loop()) {
            inputs.add("r", "m", drive.reference);
            inputs.add("exc", "N", drive.excitation);
        } else {
            inputs.add("u", "N", drive.u);
        }
        folder.write("next_experiment.csv", to_csv(inputs));
    }
    RunControl whole = control;
    whole.stop = nullptr;
    for (const auto& image : write_report(folder.path("report.html"), report_of(d, residuals, summary), whole))
        folder.add(image);
    folder.add("report.html");
    folder.write_json("diagnosis.json", summary);
}

std::string diagnosis_text(const Json& summary) {
    std::string text = fmt::format("{}\n", summary["verdict"].get<std::string>());
    for (const auto& effect : summary["effects"]) {
        const std::string name = effect["name"];
        text += fmt::format("  {}  probability {:.2f}\n", name, effect["probability"].get<double>());
        std::vector<std::pair<std::string, double>> values;
        flatten(effect["parameters"], "", values);
        for (const auto& [path, value] : values) {
            text += fmt::format("    {} = {}\n", path, format_quantity(value, effect_kind(name).unit_of(path)));
        }
        for (const auto& rival : effect["rivals"]) {
            text += fmt::format("    or {}  probability {:.2g}\n", rival["name"].get<std::string>(),
                                rival["probability"].get<double>());
        }
    }
    for (const auto& field : summary["fields_off"]) {
        text += fmt::format("  {} off by {:.1f} standard deviations\n", field["name"].get<std::string>(),
                            field["deviations"].get<double>());
    }
    for (const char* record : {"ident", "validate"}) {
        const Json& gap = summary["gap"][record];
        const auto size = [&](const char* which) { return format_quantity(gap[which].get<double>(), "m", 3); };
        text += fmt::format("  gap on {}: {} before, {} after, {} floor\n", record, size("before"), size("after"),
                            size("floor"));
    }
    if (summary["out_of_time"].get<bool>()) text += "  the budget of time ended the search\n";
    return text;
}

} // namespace tribode
