#include "tribode/base/text.hpp"
#include "tribode/experiment/measured_fra.hpp"
#include "tribode/record/json_file.hpp"
#include "tribode/record/report.hpp"

#include <algorithm>
#include <cmath>
#include <fmt/format.h>
#include <fmt/ranges.h>
#include <functional>
#include <limits>
#include <numbers>

namespace tribode {

namespace {

constexpr double nan = std::numeric_limits<double>::quiet_NaN();
// By method: the paper's three, then the others.
const std::vector<std::string> colors = {"#c0392b", "#b8860b", "#1f5f9e", "#2e7d32", "#6a3d9a"};

std::string color_of(const std::string& method) {
    return colors.at(static_cast<std::size_t>(std::ranges::find(fra_methods, method) - fra_methods.begin()));
}

double decibel(double amplitude) { return 20 * std::log10(amplitude); }

// Gain and phase of each point; NaN where there is no value.
struct Bode {
    std::vector<double> frequency, gain, phase;

    explicit Bode(const std::vector<MeasuredPoint>& points) {
        const FrequencyResponse response = response_of(points);
        const std::vector<double> gains = response.gain_db(),
                                  phases = response.size() > 0 ? response.phase_deg() : std::vector<double>();
        std::size_t next = 0;
        for (const auto& point : points) {
            const bool has_value = point.missing.empty();
            frequency.push_back(point.frequency_hz);
            gain.push_back(has_value ? gains[next] : nan);
            phase.push_back(has_value ? phases[next] : nan);
            if (has_value) ++next;
        }
    }
};

Plot bode_plot(const MeasuredFra& fra) {
    Panel gain, phase;
    gain.y_label = "Gain [dB re 1 m/N]";
    phase.x_label = "Frequency [Hz]";
    phase.y_label = "Phase [deg]";
    gain.x_log = phase.x_log = true;
    phase.legend = "none";
    for (const auto& analysis : fra.analyses) {
        const Bode bode(analysis.points);
        const std::string color = color_of(analysis.method), name = title_of_method(analysis.method);
        gain.series.push_back({name + ", 95 % bounds", bode.frequency, bode.gain, SeriesStyle::band, color, 1.2});
        phase.series.push_back({name, bode.frequency, bode.phase, SeriesStyle::band, color, 1.2});
        for (std::size_t i = 0; i < bode.frequency.size(); ++i) {
            const auto& point = analysis.points[i];
            const bool known = std::isfinite(point.variance);
            const double gain_error = known ? 1.96 * point.standard_gain_db() : 0;
            const double phase_error = known ? 1.96 * point.standard_phase_deg() : 0;
            gain.series.back().low.push_back(bode.gain[i] - gain_error);
            gain.series.back().high.push_back(bode.gain[i] + gain_error);
            phase.series.back().low.push_back(bode.phase[i] - phase_error);
            phase.series.back().high.push_back(bode.phase[i] + phase_error);
        }
    }
    Plot plot;
    plot.title = "Measured frequency response, thrust to position";
    plot.height = 1000;
    plot.panels = {gain, phase};
    return plot;
}

Plot fit_plot(const MeasuredFra& fra) {
    Panel gain;
    gain.y_label = "abs(H/P - 1) [-]";
    gain.x_label = "Frequency [Hz]";
    gain.x_log = gain.y_log = true;
    for (const auto& analysis : fra.analyses) {
        if (!analysis.fit) continue;
        Series distance{title_of_method(analysis.method), {}, {}, SeriesStyle::line, color_of(analysis.method), 1.4};
        Series expected{distance.name + ", standard deviation", {}, {}, SeriesStyle::dashed, distance.color, 0.8};
        for (const auto& point : analysis.points) {
            const double f = point.frequency_hz;
            const auto model =
                analysis.fit->model.response(f) * std::polar(1.0, -2 * std::numbers::pi * f * analysis.fit->delay);
            distance.x.push_back(f);
            distance.y.push_back(std::abs(point.value / model - 1.0));
            expected.x.push_back(f);
            expected.y.push_back(std::sqrt(point.variance));
        }
        gain.series.push_back(std::move(distance));
        gain.series.push_back(std::move(expected));
    }
    Plot plot;
    plot.title = "Distance of the response from the fitted model";
    plot.panels = {gain};
    return plot;
}

// A curve per method, where there is anything to show.
void add_curves(Panel& panel, const MeasuredFra& fra, bool named, SeriesStyle style, auto value) {
    for (const auto& analysis : fra.analyses) {
        const std::string name = named ? title_of_method(analysis.method) : "";
        Series series{name, {}, {}, style, color_of(analysis.method), 1.2};
        bool any = false;
        for (const auto& point : analysis.points) {
            const double y = point.missing.empty() ? value(point) : nan;
            series.x.push_back(point.frequency_hz);
            series.y.push_back(y);
            any = any || std::isfinite(y);
        }
        if (any) panel.series.push_back(std::move(series));
    }
}

Plot uncertainty_plot(const MeasuredFra& fra) {
    Panel error, coherence;
    error.y_label = "Relative error [-]";
    error.x_log = error.y_log = coherence.x_log = true;
    coherence.x_label = "Frequency [Hz]";
    coherence.y_label = "Coherence [-]";
    coherence.legend = "none";
    add_curves(error, fra, true, SeriesStyle::line, [](const MeasuredPoint& p) { return std::sqrt(p.variance / 2); });
    add_curves(error, fra, false, SeriesStyle::points,
               [](const MeasuredPoint& p) { return p.bias > 0 ? p.bias : nan; });
    add_curves(coherence, fra, true, SeriesStyle::line, [](const MeasuredPoint& p) { return p.coherence; });
    Plot plot;
    plot.title = "Standard deviation of gain (neper) and phase (rad), transients left (points), coherence";
    plot.height = 1000;
    plot.panels = {error, coherence};
    return plot;
}

std::optional<Plot> distortion_plot(const MeasuredFra& fra) {
    Panel odd, even;
    odd.y_label = "Odd distortion [dB]";
    even.y_label = "Even distortion [dB]";
    even.x_label = "Frequency [Hz]";
    even.legend = "none";
    odd.x_log = even.x_log = true;
    add_curves(odd, fra, true, SeriesStyle::line, [](const MeasuredPoint& p) { return decibel(p.odd_distortion); });
    add_curves(even, fra, true, SeriesStyle::line, [](const MeasuredPoint& p) { return decibel(p.even_distortion); });
    if (odd.series.empty() && even.series.empty()) return std::nullopt;
    Plot plot;
    plot.title = "Distortion: what the position has besides the response to the input, relative to it";
    plot.height = 1000;
    for (auto* panel : {&odd, &even}) {
        if (!panel->series.empty()) plot.panels.push_back(*panel);
    }
    plot.panels.back().x_label = "Frequency [Hz]";
    return plot;
}

// Single sines only: of other excitations transients are no part of the analysis.
std::optional<Plot> settling_plot(const MeasuredFra& fra) {
    const auto& points = fra.analyses.front().points;
    if (std::ranges::none_of(points, [](const MeasuredPoint& p) { return p.transient > 0 || p.bias > 0; }))
        return std::nullopt;
    Panel panel;
    panel.x_label = "Frequency [Hz]";
    panel.y_label = "Share of the response [-]";
    panel.x_log = panel.y_log = true;
    Series found{"transient in the window", {}, {}, SeriesStyle::line, colors[0], 1.2};
    Series left{"estimated to be left", {}, {}, SeriesStyle::points, colors[2]};
    Series noise{"standard deviation", {}, {}, SeriesStyle::dashed, colors[1], 1};
    for (const auto& point : points) {
        const bool known = point.missing.empty();
        for (auto* series : {&found, &left, &noise}) series->x.push_back(point.frequency_hz);
        found.y.push_back(known && point.transient > 0 ? point.transient : nan);
        left.y.push_back(known && point.bias > 0 ? point.bias : nan);
        noise.y.push_back(known ? std::sqrt(point.variance) : nan);
    }
    panel.series = {found, left, noise};
    Plot plot;
    plot.title = "Transients of " + title_of_method(fra.analyses.front().method);
    plot.panels = {panel};
    return plot;
}

// The frequencies at which most is left.
ReportTable settling_table(const MeasuredFra& fra) {
    std::vector<MeasuredPoint> points = fra.analyses.front().points;
    std::erase_if(points, [](const MeasuredPoint& p) { return !p.missing.empty(); });
    std::ranges::stable_sort(points, std::greater{}, &MeasuredPoint::bias);
    constexpr std::size_t most = 8;
    points.resize(std::min(most, points.size()));
    ReportTable table;
    table.caption = "The frequencies at which most of a transient is left";
    table.columns = {{"frequency", "Hz", 3},
                     {"transient in the window", "%", 3},
                     {"estimated to be left", "%", 3},
                     {"standard deviation", "%", 3},
                     {"settled"}};
    for (const auto& p : points) {
        table.rows.push_back({p.frequency_hz, 100 * p.transient, 100 * p.bias, 100 * std::sqrt(p.variance),
                              std::string(p.settled ? "yes" : "no")});
    }
    return table;
}

Plot loops_plot(const MeasuredFra& fra) {
    Plot plot;
    plot.title = "Friction over the position: measured (points) and friction model (lines)";
    plot.height = 300 + 250 * static_cast<int>(fra.loops.size());
    for (const auto& loop : fra.loops) {
        Panel panel;
        panel.title = fmt::format("{:.4g} Hz", loop.frequency_hz);
        panel.y_label = "Friction [N]";
        panel.legend = "none";
        std::vector<double> position = loop.position;
        for (auto& value : position) value *= 1e6;
        panel.series = {{"measured", position, loop.measured, SeriesStyle::points, colors[0]},
                        {"model", position, loop.modeled, SeriesStyle::line, colors[2], 1.4}};
        plot.panels.push_back(std::move(panel));
    }
    plot.panels.back().x_label = "Position [um]";
    return plot;
}

// Mean over the cells of position and velocity, of all records.
Plot residual_plot(const MeasuredFra& fra) {
    constexpr std::size_t cells = 40, most_points = 4000;
    std::vector<double> x, v, force;
    for (const auto& residual : fra.residuals) {
        for (std::size_t k = 0; k < residual.force.size(); ++k) {
            x.push_back(1e3 * residual.position[k]);
            v.push_back(1e3 * residual.velocity[k]);
            force.push_back(residual.force[k]);
        }
    }
    Panel map;
    map.x_label = "Position [mm]";
    map.y_label = "Velocity [mm/s]";
    map.legend = "none";
    const CellMeans means = cell_means(x, v, force, cells);
    map.map = {"Mean residual force [N]", means.x_edges, means.y_edges, means.values, 0};
    const auto over = [&](const std::vector<double>& axis, const std::string& label) {
        Panel panel;
        panel.x_label = label;
        panel.y_label = "Residual force [N]";
        panel.legend = "none";
        Series points{"", {}, {}, SeriesStyle::points, "#9db7d5"};
        const std::size_t every = std::max<std::size_t>(1, axis.size() / most_points);
        for (std::size_t k = 0; k < axis.size(); k += every) {
            points.x.push_back(axis[k]);
            points.y.push_back(force[k]);
        }
        panel.series = {points};
        return panel;
    };
    Plot plot;
    plot.title = "Force that neither the linear model nor the friction model explains";
    plot.height = 1400;
    plot.panels = {map, over(x, "Position [mm]"), over(v, "Velocity [mm/s]")};
    return plot;
}

ReportTable residual_table(const MeasuredFra& fra) {
    ReportTable table;
    table.caption = "Force that is left, below the upper end of the fit";
    table.columns = {
        {"record"}, {"friction, rms", "N"}, {"left, rms", "N"}, {"of it a function of position and velocity", "%", 0}};
    for (const auto& r : fra.residuals) table.rows.push_back({r.record, r.friction_rms, r.rms, 100 * r.explained});
    return table;
}

double median(std::vector<double> values) {
    std::erase_if(values, [](double value) { return !std::isfinite(value); });
    if (values.empty()) return nan;
    const auto middle = values.begin() + static_cast<std::ptrdiff_t>(values.size() / 2);
    std::nth_element(values.begin(), middle, values.end());
    return *middle;
}

// Medians over the frequencies, of one analysis.
struct Medians {
    double gain_db, phase_deg, odd_db, even_db;
    std::size_t values = 0, settled = 0;

    explicit Medians(const MeasuredAnalysis& analysis) {
        std::vector<double> gains, phases, odds, evens;
        for (const auto& point : analysis.points) {
            if (!point.missing.empty()) continue;
            ++values;
            settled += point.settled;
            gains.push_back(point.standard_gain_db());
            phases.push_back(point.standard_phase_deg());
            odds.push_back(decibel(point.odd_distortion));
            evens.push_back(decibel(point.even_distortion));
        }
        gain_db = median(gains);
        phase_deg = median(phases);
        odd_db = median(odds);
        even_db = median(evens);
    }
};

ReportTable overview(const MeasuredFra& fra) {
    ReportTable table;
    table.caption = "Medians over the frequencies";
    table.columns = {
        {"analysis"},          {"frequencies", "", 0},  {"with a value", "", 0},     {"settled", "", 0},
        {"std of gain", "dB"}, {"std of phase", "deg"}, {"odd distortion", "dB", 1}, {"even distortion", "dB", 1}};
    for (const auto& analysis : fra.analyses) {
        const Medians m(analysis);
        table.rows.push_back({title_of_method(analysis.method), static_cast<double>(analysis.points.size()),
                              static_cast<double>(m.values), static_cast<double>(m.settled), m.gain_db, m.phase_deg,
                              m.odd_db, m.even_db});
    }
    return table;
}

struct FittedValue {
    std::string name, unit;
    double value, error;
};

std::vector<FittedValue> values_of(const WeightedFit& fit) {
    std::vector<FittedValue> list = {{"k0", "m/(N s2)", fit.model.rigid_gain, fit.standard_errors.rigid_gain}};
    for (std::size_t j = 0; j < fit.model.modes.size(); ++j) {
        const auto &mode = fit.model.modes[j], &error = fit.standard_errors.modes[j];
        list.push_back({fmt::format("k{}", j + 1), "m/(N s2)", mode.gain, error.gain});
        list.push_back({fmt::format("f{}", j + 1), "Hz", mode.freq_hz, error.freq_hz});
        list.push_back({fmt::format("zeta{}", j + 1), "", mode.zeta, error.zeta});
    }
    if (fit.parameters.back() == "delay_s") list.push_back({"delay", "s", fit.delay, fit.delay_error});
    return list;
}

ReportTable fit_table(const MeasuredAnalysis& analysis) {
    ReportTable table;
    table.caption = fmt::format("{}: modal model of {} frequencies; misfit {:.2g} %", title_of_method(analysis.method),
                                analysis.fit->points, 100 * analysis.fit->misfit);
    table.columns = {{"parameter"}, {"unit"}, {"value"}, {"standard error"}, {"in percent", "%", 2}};
    for (const auto& v : values_of(*analysis.fit)) {
        table.rows.push_back(
            {v.name, v.unit, fmt::format("{:.6g}", v.value), fmt::format("{:.2g}", v.error), 100 * v.error / v.value});
    }
    return table;
}

std::string verdict_on_friction(const MeasuredFra& fra) {
    const auto *plain = fra.find("fra1"), *proposed = fra.find("proposed");
    if (!plain || !proposed) return "";
    const double before = Medians(*plain).odd_db, after = Medians(*proposed).odd_db;
    if (!std::isfinite(before) || !std::isfinite(after)) return "";
    return fmt::format(
        "The friction model changes the odd distortion from {:.1f} dB (FRA-1) to {:.1f} dB (Proposed): the "
        "more it lowers it, the better it describes the friction.",
        before, after);
}

} // namespace

std::string MeasuredFra::csv() const {
    std::string text = "frequency_hz,method,gain_db,phase_deg,std_gain_db,std_phase_deg,coherence,odd_distortion_db,"
                       "even_distortion_db,settled,missing\n";
    for (const auto& analysis : analyses) {
        const Bode bode(analysis.points);
        for (std::size_t i = 0; i < analysis.points.size(); ++i) {
            const auto& p = analysis.points[i];
            const bool has_value = p.missing.empty();
            const auto cell = [&](double value) {
                text += ',';
                append_text(text, has_value ? value : nan);
            };
            append_text(text, p.frequency_hz);
            text += ',' + analysis.method;
            for (const double value : {bode.gain[i], bode.phase[i], p.standard_gain_db(), p.standard_phase_deg(),
                                       p.coherence, decibel(p.odd_distortion), decibel(p.even_distortion)}) {
                cell(value);
            }
            std::string reason = p.missing;
            std::ranges::replace(reason, ',', ';');
            text += fmt::format(",{},{}\n", has_value && p.settled ? 1 : 0, reason);
        }
    }
    return text;
}

Json MeasuredFra::fits() const {
    Json json = Json::object();
    for (const auto& analysis : analyses) {
        if (analysis.fit) json[analysis.method] = to_json(*analysis.fit);
    }
    return json;
}

std::string MeasuredFra::text() const {
    std::string text;
    constexpr std::size_t most = 5;
    for (std::size_t i = 0; i < std::min(most, records.size()); ++i) text += records[i] + "\n";
    if (records.size() > most) text += fmt::format("and {} more records\n", records.size() - most);
    for (const auto& analysis : analyses) {
        const Medians m(analysis);
        text += fmt::format("{:9} {} of {} frequencies, median std {:.3g} dB, {:.3g} deg",
                            title_of_method(analysis.method), m.values, analysis.points.size(), m.gain_db, m.phase_deg);
        if (std::isfinite(m.odd_db)) text += fmt::format(", odd distortion {:.1f} dB", m.odd_db);
        text += "\n";
        if (!analysis.fit) continue;
        for (const auto& v : values_of(*analysis.fit)) {
            text += fmt::format("    {:6} {:.6g} +- {:.2g} {}\n", v.name, v.value, v.error, v.unit);
        }
    }
    for (const auto& note : notes) text += note + "\n";
    return text;
}

void write_measured_fra(const MeasuredFra& fra, RunFolder& folder, const RunControl& control) {
    folder.write("response.csv", fra.csv());
    folder.write_json("fit.json", fra.fits());

    Report report;
    report.title = "Measured frequency response";
    report.summary =
        fmt::format("{} record{}, {} frequencies, delay model {:.4g} ms.", fra.records.size(),
                    fra.records.size() == 1 ? "" : "s", fra.analyses.front().points.size(), 1e3 * fra.delay);
    report.sections.push_back({"Records", {BulletList{fra.records}}});
    if (!fra.notes.empty()) report.sections.push_back({"Notes", {BulletList{fra.notes}}});
    report.sections.push_back(
        {"Response", {Figure{"bode", "Gain and phase with 95 % bounds", bode_plot(fra)}, overview(fra)}});
    ReportSection fits{"Modal models", {}};
    for (const auto& analysis : fra.analyses) {
        if (analysis.fit) fits.blocks.push_back(fit_table(analysis));
    }
    if (!fits.blocks.empty()) {
        fits.blocks.push_back(Figure{
            "fit", "Distance from the fitted model, beside the standard deviation of the points", fit_plot(fra)});
        report.sections.push_back(std::move(fits));
    }
    report.sections.push_back(
        {"Uncertainty",
         {Figure{"uncertainty", "Standard deviation, transients and coherence", uncertainty_plot(fra)}}});
    if (const auto plot = settling_plot(fra)) {
        report.sections.push_back(
            {"Settling",
             {Figure{"settling", "Transients in the windows, what is left of them, and the noise", *plot},
              settling_table(fra)}});
    }
    if (!fra.residuals.empty()) {
        ReportSection section{"Friction", {}};
        if (!fra.loops.empty()) section.blocks.push_back(Figure{"loops", "Friction over one period", loops_plot(fra)});
        section.blocks.push_back(Figure{"residual", "Residual force over position and velocity", residual_plot(fra)});
        section.blocks.push_back(residual_table(fra));
        report.sections.push_back(std::move(section));
    }
    if (const auto plot = distortion_plot(fra)) {
        ReportSection section{"Distortion", {Figure{"distortion", "Odd and even distortion", *plot}}};
        if (const std::string verdict = verdict_on_friction(fra); !verdict.empty()) {
            section.blocks.insert(section.blocks.begin(), Paragraph{verdict});
        }
        report.sections.push_back(std::move(section));
    }
    for (const auto& image : write_report(folder.path("report.html"), report, control)) folder.add(image);
    folder.add("report.html");
}

} // namespace tribode
