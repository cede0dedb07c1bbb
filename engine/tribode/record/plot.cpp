#include "tribode/record/plot.hpp"
#include "tribode/base/error.hpp"
#include "tribode/base/field_reader.hpp"
#include "tribode/base/quantity.hpp"
#include "tribode/base/text.hpp"
#include "tribode/record/output_file.hpp"
#include "tribode/record/run_folder.hpp"

#include <algorithm>
#include <cctype>
#include <cerrno>
#include <cmath>
#include <csignal>
#include <cstring>
#include <fcntl.h>
#include <fmt/format.h>
#include <limits>
#include <map>
#include <poll.h>
#include <set>
#include <spawn.h>
#include <sys/wait.h>
#include <unistd.h>
#include <utility>

extern char** environ;

namespace tribode {

namespace {

// Okabe and Ito's colors, which color-blind readers can distinguish, then those of Tol that differ from them.
constexpr std::array palette = {"#0072b2", "#d55e00", "#009e73", "#cc79a7", "#e69f00", "#56b4e9", "#7f7f7f",
                                "#332288", "#882255", "#999933", "#000000", "#44aa99", "#ee3377", "#8c564b"};

const std::vector<std::string> style_names = {"line", "dashed", "points", "line_points", "steps", "band", "instants"};

// A text in gnuplot's double quotes: letters, digits, blanks and what is not ASCII as they are, control characters as blanks,
// everything else by its octal number. So nothing in a text ends its quotes or its line (gnuplot reads lines as C strings),
// and nothing is left to be taken for a command in backquotes or a macro. gnuplot reads all octal digits behind a backslash,
// so that a digit which follows such a number is written by its number, too. Every text of a plot goes through here; all
// else in a script is numbers and words of the engine's own.
std::string quoted(const std::string& text) {
    std::string result = "\"";
    bool after_number = false;
    for (const char c : text) {
        const auto code = static_cast<unsigned char>(c);
        const bool plain = code == ' ' || code >= 0x80 || std::isalnum(code);
        if (code < 0x20 || code == 0x7f) {
            result += ' ';
            after_number = false;
        } else if (plain && !(after_number && c >= '0' && c <= '7')) {
            result += c;
            after_number = false;
        } else {
            result += fmt::format("\\{:03o}", code);
            after_number = true;
        }
    }
    return result + "\"";
}

bool shown(const Panel& panel, double x, double y) {
    return std::isfinite(x) && std::isfinite(y) && (!panel.x_log || x > 0) && (!panel.y_log || y > 0);
}

// The y of instants, which any axis can show.
constexpr double anywhere = 1;

} // namespace

const std::string& name_of(SeriesStyle style) { return style_names[static_cast<std::size_t>(style)]; }

Range shown_range(const Panel& panel, bool of_x) {
    if (const auto& asked = of_x ? panel.x_range : panel.y_range) return *asked;
    if (!panel.map.label.empty()) {
        const auto& edges = of_x ? panel.map.x_edges : panel.map.y_edges;
        return {edges.front(), edges.back()};
    }
    double low = INFINITY, high = -INFINITY;
    for (const auto& series : panel.series) {
        if (series.style == SeriesStyle::instants) continue; // marks on what the others show
        for (std::size_t i = 0; i < series.x.size(); ++i) {
            const auto include = [&](double y) {
                if (!shown(panel, series.x[i], y)) return;
                const double value = of_x ? series.x[i] : y;
                low = std::min(low, value);
                high = std::max(high, value);
            };
            include(series.y[i]);
            if (series.low.empty()) continue;
            include(series.low[i]);
            include(series.high[i]);
        }
    }
    const bool log = of_x ? panel.x_log : panel.y_log;
    if (!(low <= high)) return log ? Range{1, 10} : Range{-1, 1};
    if (log) {
        // A little more than nothing: gnuplot leaves out a label that lies on the very end of a logarithmic axis.
        const double margin = of_x ? 1 + 1e-6 : std::max(std::pow(high / low, 0.05), 1.05);
        return low == high ? Range{low / 2, low * 2} : Range{low / margin, high * margin};
    }
    const double span =
        high - low > 1e-12 * std::max(std::abs(low), std::abs(high)) ? high - low : std::max(std::abs(low), 1.0);
    // Curves over time or frequency fill the width; loops keep off the frame.
    const bool ascending = std::all_of(panel.series.begin(), panel.series.end(), [](const Series& series) {
        return std::is_sorted(series.x.begin(), series.x.end());
    });
    const double margin = of_x && high > low && ascending ? 0 : (of_x ? 0.03 : 0.06) * span;
    return {low - margin, high + margin};
}

std::vector<std::string> shown_colors(const Panel& panel) {
    std::vector<std::string> colors;
    std::size_t next = 0;
    for (const auto& series : panel.series) {
        colors.push_back(series.color.empty() ? palette[next++ % palette.size()] : series.color);
    }
    return colors;
}

int shown_height(const Plot& plot) {
    return plot.height > 0 ? plot.height : 200 + 380 * static_cast<int>(std::max<std::size_t>(plot.panels.size(), 1));
}

Plot with_readable_units(Plot plot) {
    struct Axis {
        double largest = 0;
        bool linear = true;
    };
    // The unit in brackets at the end of a label; empty where it is not one that takes prefixes.
    const auto unit_of = [&](std::string_view label) -> std::string_view {
        const auto open = label.rfind('[');
        if (open == std::string_view::npos || !label.ends_with("]")) return {};
        const auto unit = label.substr(open + 1, label.size() - open - 2);
        return takes_prefix(unit) ? unit : std::string_view{};
    };
    std::map<std::string, Axis> axes; // by label
    for (const auto& panel : plot.panels) {
        for (const bool of_x : {true, false}) {
            const auto& label = of_x ? panel.x_label : panel.y_label;
            if (unit_of(label).empty()) continue;
            auto& axis = axes[label];
            const Range range = shown_range(panel, of_x);
            axis.largest = std::max({axis.largest, std::abs(range[0]), std::abs(range[1])});
            axis.linear = axis.linear && !(of_x ? panel.x_log : panel.y_log) && (of_x || panel.y_names.empty());
        }
    }
    // x of the panels below one another is read together, with the label under the last of them alone.
    const bool one_x = std::all_of(plot.panels.begin(), plot.panels.end(), [&](const Panel& panel) {
        return panel.x_label.empty() || panel.x_label == plot.panels.back().x_label;
    });
    for (auto& panel : plot.panels) {
        for (const bool of_x : {true, false}) {
            std::string& own = of_x ? panel.x_label : panel.y_label;
            const std::string label = of_x && one_x ? plot.panels.back().x_label : own;
            const auto found = axes.find(label);
            if (found == axes.end() || !found->second.linear) continue;
            const double largest = found->second.largest;
            if (!(largest > 0) || (largest >= 0.01 && largest < 1e5)) continue;
            const PrefixedUnit prefixed = prefixed_unit(largest, unit_of(label), 15);
            const double factor = prefixed.factor;
            if (!own.empty()) own.replace(own.rfind('[') + 1, std::string::npos, prefixed.unit + "]");
            const auto scale = [&](std::vector<double>& values) {
                for (double& value : values) value *= factor;
            };
            auto& asked = of_x ? panel.x_range : panel.y_range;
            if (asked) *asked = {(*asked)[0] * factor, (*asked)[1] * factor};
            scale(of_x ? panel.map.x_edges : panel.map.y_edges);
            for (auto& series : panel.series) {
                scale(of_x ? series.x : series.y);
                if (of_x) continue;
                scale(series.low);
                scale(series.high);
            }
        }
    }
    return plot;
}

namespace {

constexpr std::size_t a_break = static_cast<std::size_t>(-1); // among the indices of a thinned curve

// The lowest and the highest point of each column of the panel, and where the curve enters and leaves the column.
std::vector<std::size_t> thinned_over_x(const Series& series, const Range& range, bool log, std::size_t columns) {
    const auto [low, high] = range;
    const auto place = [&](double x) { return log ? std::log(x) : x; };
    const double scale = static_cast<double>(columns) / (place(high) - place(low));
    std::vector<std::size_t> kept;
    for (std::size_t begin = 0; begin < series.x.size();) {
        const auto gap = [&](std::size_t i) {
            return !std::isfinite(series.x[i]) || !std::isfinite(series.y[i]) || (log && series.x[i] <= 0);
        };
        if (gap(begin)) {
            // One break is as good as many.
            if (!kept.empty() && kept.back() != a_break) kept.push_back(a_break);
            ++begin;
            continue;
        }
        const double column = std::floor((place(series.x[begin]) - place(low)) * scale);
        std::size_t end = begin, lowest = begin, highest = begin;
        for (; end < series.x.size() && !gap(end); ++end) {
            if (std::floor((place(series.x[end]) - place(low)) * scale) != column) break;
            if (series.y[end] < series.y[lowest]) lowest = end;
            if (series.y[end] > series.y[highest]) highest = end;
        }
        for (const std::size_t i : std::set<std::size_t>{begin, lowest, highest, end - 1}) kept.push_back(i);
        begin = end;
    }
    return kept;
}

// A loop: the points that are visibly away from the last one kept.
std::vector<std::size_t> thinned_loop(const Series& series, const Panel& panel, std::size_t columns) {
    const Range xr = shown_range(panel, true), yr = shown_range(panel, false);
    const auto part = [](double v, const Range& range, bool log) {
        return log ? std::log(v / range[0]) / std::log(range[1] / range[0]) : (v - range[0]) / (range[1] - range[0]);
    };
    std::vector<std::size_t> kept;
    double px = NAN, py = NAN;
    for (std::size_t i = 0; i < series.x.size(); ++i) {
        const double x = part(series.x[i], xr, panel.x_log), y = part(series.y[i], yr, panel.y_log);
        // Never where one of them is no number.
        if (std::hypot(x - px, y - py) < 1.0 / static_cast<double>(columns)) continue;
        kept.push_back(i);
        px = x;
        py = y;
    }
    return kept;
}

} // namespace

Series thinned(const Series& series, const Panel& panel, std::size_t columns) {
    if (series.x.size() <= 4 * columns) return series;
    const bool ascends = std::is_sorted(series.x.begin(), series.x.end());
    Series curve = series;
    for (auto* values : {&curve.x, &curve.y, &curve.low, &curve.high}) values->clear();
    for (const std::size_t i : ascends ? thinned_over_x(series, shown_range(panel, true), panel.x_log, columns)
                                       : thinned_loop(series, panel, columns)) {
        const auto take = [i](std::vector<double>& to, const std::vector<double>& from) {
            if (!from.empty()) to.push_back(i == a_break ? NAN : from[i]);
        };
        curve.x.push_back(i == a_break ? curve.x.back() : series.x[i]);
        take(curve.y, series.y);
        take(curve.low, series.low);
        take(curve.high, series.high);
    }
    return curve;
}

namespace {

// Whether the pieces of the line have two points each, as bars made of lines do.
bool is_segments(const Panel& panel, const Series& series) {
    if (series.style != SeriesStyle::line) return false;
    std::size_t run = 0;
    for (std::size_t i = 0; i <= series.x.size(); ++i) {
        if (i < series.x.size() && shown(panel, series.x[i], series.y[i])) {
            if (++run > 2) return false;
        } else {
            if (run == 1) return false;
            run = 0;
        }
    }
    return true;
}

// One point to a line, an empty line where the curve breaks; segments as a point and the way to the next.
std::string datablock(const std::string& name, const Panel& panel, const Series& series) {
    std::string text = "$" + name + " << EOD\n";
    const auto append = [&](double value) {
        append_text(text, value);
        text += ' ';
    };
    if (series.style == SeriesStyle::instants) {
        const Range heights = shown_range(panel, false);
        for (const double x : series.x) {
            if (!shown(panel, x, anywhere)) continue;
            for (const double value : {x, heights[0], 0.0, heights[1] - heights[0]}) append(value);
            text += '\n';
        }
        return text + "EOD\n";
    }
    const bool segments = is_segments(panel, series);
    for (std::size_t i = 0; i < series.x.size(); ++i) {
        if (shown(panel, series.x[i], series.y[i])) {
            append(series.x[i]);
            append(series.y[i]);
            if (segments) {
                ++i;
                append(series.x[i] - series.x[i - 1]);
                append(series.y[i] - series.y[i - 1]);
            } else if (!series.low.empty()) {
                for (const double end : {series.low[i], series.high[i]}) {
                    append(shown(panel, series.x[i], end) ? end : series.y[i]);
                }
            }
        }
        text += '\n'; // an empty line breaks the curve
    }
    return text + "EOD\n";
}

std::string axis(const char* name, bool log, const Range& range) {
    std::string text = log ? fmt::format("set logscale {}\n", name) : fmt::format("unset logscale {}\n", name);
    text += fmt::format("set {}range [{}:{}]\n", name, to_text(range[0]), to_text(range[1]));
    // Within one or two decades the powers of ten alone are too few labels.
    if (log && range[1] / range[0] < 200) {
        text += fmt::format("set {}tics (", name);
        std::string separator;
        for (double decade = std::pow(10, std::floor(std::log10(range[0]))); decade <= range[1]; decade *= 10) {
            for (const double step : {1, 2, 5}) {
                text += fmt::format("{}{} {}", separator, quoted(fmt::format("{:g}", step * decade)), step * decade);
                separator = ", ";
            }
            for (const double step : {3, 4, 6, 7, 8, 9}) text += fmt::format(", '' {} 1", step * decade);
        }
        text += ")\n";
    } else {
        text += fmt::format("set {0}tics auto enhanced\nset format {0} '{1}'\n", name, log ? "10^{%T}" : "%g");
    }
    return text;
}

std::string named_ticks(const std::vector<std::string>& names) {
    std::string text = "set ytics (";
    for (std::size_t i = 0; i < names.size(); ++i) {
        text += fmt::format("{}{} {}", i > 0 ? ", " : "", quoted(names[i]), i + 1);
    }
    return text + ") noenhanced\n";
}

constexpr double legend_row = 22; // [pixel]

// Rows and columns of a legend above its panel: as many columns as the longest name lets stand beside one another.
struct LegendGrid {
    std::size_t rows = 0, columns = 1;
};
LegendGrid legend_grid(const Panel& panel, double width) {
    if (panel.legend != "above") return {};
    std::size_t names = 0, longest = 0;
    for (const auto& series : panel.series) {
        if (series.name.empty()) continue;
        ++names;
        longest = std::max(longest, series.name.size());
    }
    // About 8.5 pixels for a letter, and 90 for the sample of the line.
    const double room = width / (8.5 * static_cast<double>(longest) + 90);
    const auto columns = std::clamp<std::size_t>(static_cast<std::size_t>(room), 1, std::max<std::size_t>(names, 1));
    return {(names + columns - 1) / columns, columns};
}

std::string legend(const Panel& panel, double width) {
    if (panel.legend == "none") return "unset key\n";
    const std::string text = "noenhanced Left reverse samplen 2.5 spacing 1.15";
    if (panel.legend == "above") {
        return fmt::format("set key at graph 0, graph 1.015 left bottom horizontal maxcols {} maxrows auto {}\n",
                           legend_grid(panel, width).columns, text);
    }
    return fmt::format("set key inside {} vertical maxrows auto opaque {}\n", panel.legend, text);
}

std::string curve(const std::string& block, const Panel& panel, const Series& series, const std::string& color) {
    const std::string title = series.name.empty() ? "notitle" : "title " + quoted(series.name);
    const std::string line = fmt::format("lc rgb '{}' lw {}", color, to_text(series.width));
    const bool ends = !series.low.empty();
    const std::string bars =
        ends ? fmt::format("${} using 1:2:3:4 with yerrorbars pt 0 lc rgb '{}' lw 1 notitle, ", block, color) : "";
    switch (series.style) {
    case SeriesStyle::dashed: return fmt::format("${} with lines dt (12,6) {} {}", block, line, title);
    case SeriesStyle::points:
        return fmt::format("{}${} using 1:2 with points pt 7 ps 0.5 {} {}", bars, block, line, title);
    case SeriesStyle::line_points:
        return fmt::format("{}${} using 1:2 with linespoints pt 7 ps 0.5 {} {}", bars, block, line, title);
    case SeriesStyle::steps: return fmt::format("${} with steps {} {}", block, line, title);
    case SeriesStyle::band: {
        const std::string area =
            ends ? fmt::format(
                       "${} using 1:3:4 with filledcurves fc rgb '{}' fs transparent solid 0.25 noborder notitle, ",
                       block, color)
                 : "";
        return fmt::format("{}${} using 1:2 with lines {} {}", area, block, line, title);
    }
    case SeriesStyle::instants: return fmt::format("${} with vectors nohead dt (3,4) {} {}", block, line, title);
    case SeriesStyle::line: break;
    }
    // gnuplot joins the end of a wide segment with the beginning of the next one by a wedge; arrows stand alone.
    const bool segments = is_segments(panel, series);
    return fmt::format("${} with {} {} {}", block, segments ? "vectors nohead" : "lines", line, title);
}

// The cells with their colors, one to a line: center, edges, value.
std::string datablock(const std::string& name, const ColorMap& map) {
    std::string text = "$" + name + " << EOD\n";
    const std::size_t columns = map.x_edges.size() - 1;
    for (std::size_t i = 0; i < map.values.size(); ++i) {
        if (!std::isfinite(map.values[i])) continue;
        const std::size_t x = i % columns, y = i / columns;
        for (const double value : {map.x_edges[x], map.y_edges[y], map.x_edges[x], map.x_edges[x + 1], map.y_edges[y],
                                   map.y_edges[y + 1], map.values[i]}) {
            append_text(text, value);
            text += ' ';
        }
        text += '\n';
    }
    return text + "EOD\n";
}

std::string color_scale(const ColorMap& map) {
    double low = 0, high = 0;
    for (const double value : map.values) {
        if (!std::isfinite(value)) continue;
        low = std::min(low, value);
        high = std::max(high, value);
    }
    const double largest = std::max(-low, high);
    const double most = map.strongest > 0 ? map.strongest : largest > 0 ? largest : 1;
    const char* colors = low < 0 ? "-1 '#08519c', -0.4 '#9ecae1', 0 '#f7f7f7', 0.4 '#fcae91', 1 '#a50f15'"
                                 : "0 '#f7f7f7', 0.4 '#fcae91', 1 '#a50f15'";
    return fmt::format("set palette defined ({})\nset cbrange [{}:{}]\nset cblabel {} offset 1,0 noenhanced\n", colors,
                       low < 0 ? to_text(-most) : "0", to_text(most), quoted(map.label));
}

std::string script_of(const Plot& plot, double height, const std::string& terminal) {
    std::string text = terminal;
    const std::size_t panels = std::max<std::size_t>(plot.panels.size(), 1);
    for (std::size_t p = 0; p < plot.panels.size(); ++p) {
        const auto& panel = plot.panels[p];
        for (std::size_t s = 0; s < panel.series.size(); ++s) {
            text += datablock(fmt::format("d{}_{}", p, s), panel, panel.series[s]);
        }
        if (!panel.map.label.empty()) text += datablock(fmt::format("m{}", p), panel.map);
    }
    text += "set grid xtics ytics mxtics mytics lt 1 lc rgb '#cccccc' lw 0.8, lt 1 lc rgb '#e8e8e8' lw 0.6\n"
            "set border lc rgb '#404040'\nset tics nomirror\n";
    // Room for the names at the axis: about 8 pixels for a letter.
    std::size_t longest = 0;
    for (const auto& panel : plot.panels) {
        for (const auto& name : panel.y_names) longest = std::max(longest, name.size());
    }
    // A title above a panel stands clear of the label below the one before; so does a legend of several rows.
    const bool titled =
        std::any_of(plot.panels.begin(), plot.panels.end(), [](const auto& p) { return !p.title.empty(); });
    std::size_t later_rows = 1, first_rows = 1;
    for (std::size_t p = 0; p < plot.panels.size(); ++p) {
        auto& rows = p == 0 ? first_rows : later_rows;
        rows = std::max(rows, legend_grid(plot.panels[p], 0.88 * plot.width).rows);
    }
    const double above = 90 + legend_row * static_cast<double>(first_rows - 1);
    const double between = (titled ? 105 : 85) + legend_row * static_cast<double>(later_rows - 1);
    const double left = std::clamp((60 + 8 * static_cast<double>(longest)) / plot.width, 0.095, 0.5);
    const bool mapped =
        std::any_of(plot.panels.begin(), plot.panels.end(), [](const auto& p) { return !p.map.label.empty(); });
    text += fmt::format("set multiplot layout {},1 title {} noenhanced font ',15' margins {},{},{},{} "
                        "spacing 0,{}\n",
                        panels, quoted(plot.title), to_text(left), mapped ? 0.885 : 0.975, to_text(60 / height),
                        to_text(1 - above / height), to_text(panels > 1 ? between / height : 0));
    for (std::size_t p = 0; p < plot.panels.size(); ++p) {
        const auto& panel = plot.panels[p];
        text += panel.title.empty() ? "unset title\n" : fmt::format("set title {} noenhanced\n", quoted(panel.title));
        // At the same place in every panel, whatever room its numbers take.
        text += fmt::format("set xlabel {} noenhanced\nunset label 1\n", quoted(panel.x_label));
        if (!panel.y_label.empty()) {
            text +=
                fmt::format("set label 1 {} at screen {}, graph 0.5 rotate center noenhanced\n", quoted(panel.y_label),
                            to_text(longest > 0 ? 18.0 / plot.width : left - 100.0 / plot.width));
        }
        text += axis("x", panel.x_log, shown_range(panel, true));
        text += axis("y", panel.y_log, shown_range(panel, false));
        if (!panel.y_names.empty()) text += named_ticks(panel.y_names);
        text += legend(panel, 0.88 * plot.width);
        std::string curves;
        const bool any_cell = std::any_of(panel.map.values.begin(), panel.map.values.end(),
                                          [](double value) { return std::isfinite(value); });
        if (any_cell) {
            text += color_scale(panel.map);
            curves = fmt::format("$m{} using 1:2:3:4:5:6:7 with boxxyerror fs solid noborder lc palette notitle", p);
        }
        const auto colors = shown_colors(panel);
        for (std::size_t s = 0; s < panel.series.size(); ++s) {
            const auto& series = panel.series[s];
            const bool any = std::any_of(series.x.begin(), series.x.end(), [&, i = std::size_t{0}](double x) mutable {
                return shown(panel, x, series.y[i++]);
            });
            if (!any) continue; // gnuplot takes a curve without points for an error
            curves += (curves.empty() ? "" : ", ") + curve(fmt::format("d{}_{}", p, s), panel, series, colors[s]);
        }
        // An empty panel still shows its axes.
        text += "plot " + (curves.empty() ? "NaN notitle" : curves) + "\n";
    }
    return text + "unset multiplot\n";
}

struct Pipe {
    int read_end = -1, write_end = -1;
    Pipe() {
        int ends[2];
        if (pipe2(ends, O_CLOEXEC) != 0) throw Error(fmt::format("no pipe to gnuplot: {}", std::strerror(errno)));
        read_end = ends[0];
        write_end = ends[1];
    }
    ~Pipe() {
        close_end(read_end);
        close_end(write_end);
    }
    static void close_end(int& end) {
        if (end >= 0) close(end);
        end = -1;
    }
};

// What gnuplot writes to its standard output for a script.
std::string run_gnuplot(const std::string& script) {
    Pipe in, out, messages;
    posix_spawn_file_actions_t actions;
    posix_spawn_file_actions_init(&actions);
    posix_spawn_file_actions_adddup2(&actions, in.read_end, STDIN_FILENO);
    posix_spawn_file_actions_adddup2(&actions, out.write_end, STDOUT_FILENO);
    posix_spawn_file_actions_adddup2(&actions, messages.write_end, STDERR_FILENO);
    // Without the start-up files of the user or of the folder: they may hold any command.
    // The script by a name, where the system has it: what comes through "-" gnuplot reads with a call of the system for each
    // character.
    std::string program = "gnuplot", no_start_up_files = "--default-settings", standard_input = "/dev/stdin";
    if (access(standard_input.c_str(), R_OK) != 0) standard_input = "-";
    char* arguments[] = {program.data(), no_start_up_files.data(), standard_input.data(), nullptr};
    pid_t child = 0;
    const int failure = posix_spawnp(&child, "gnuplot", &actions, nullptr, arguments, environ);
    posix_spawn_file_actions_destroy(&actions);
    if (failure != 0) throw InputError("plots are drawn by gnuplot, which is not installed; install gnuplot-nox");
    Pipe::close_end(in.read_end);
    Pipe::close_end(out.write_end);
    Pipe::close_end(messages.write_end);

    // Feed and drain together, so that neither side waits for the other; a gnuplot that has ended early must not end
    // this program by SIGPIPE.
    static const auto ignored = std::signal(SIGPIPE, SIG_IGN);
    (void)ignored;
    fcntl(in.write_end, F_SETFL, O_NONBLOCK);
    std::string image, complaint;
    std::size_t sent = 0;
    char buffer[65536];
    while (out.read_end >= 0 || messages.read_end >= 0) {
        std::array<pollfd, 3> ends = {pollfd{in.write_end, POLLOUT, 0}, pollfd{out.read_end, POLLIN, 0},
                                      pollfd{messages.read_end, POLLIN, 0}};
        if (poll(ends.data(), ends.size(), -1) < 0 && errno != EINTR) break;
        if (in.write_end >= 0 && ends[0].revents) {
            const ssize_t n = write(in.write_end, script.data() + sent, script.size() - sent);
            if (n > 0) sent += static_cast<std::size_t>(n);
            if (sent == script.size() || (n < 0 && errno != EAGAIN && errno != EINTR)) Pipe::close_end(in.write_end);
        }
        for (const auto& [end, text, which] :
             {std::tuple{&out.read_end, &image, 1}, {&messages.read_end, &complaint, 2}}) {
            if (*end < 0 || !ends[static_cast<std::size_t>(which)].revents) continue;
            const ssize_t n = read(*end, buffer, sizeof buffer);
            if (n > 0) text->append(buffer, static_cast<std::size_t>(n));
            if (n == 0 || (n < 0 && errno != EINTR)) Pipe::close_end(*end);
        }
    }
    int status = 0;
    while (waitpid(child, &status, 0) < 0 && errno == EINTR) {
    }
    if (status != 0 || image.empty()) {
        throw Error(fmt::format("gnuplot could not draw the plot: {}", trim(complaint)));
    }
    return image;
}

void check(const Plot& plot) {
    for (const auto& panel : plot.panels) {
        if (const ColorMap& map = panel.map; !map.label.empty()) {
            const bool fits = map.x_edges.size() > 1 && map.y_edges.size() > 1 &&
                              map.values.size() == (map.x_edges.size() - 1) * (map.y_edges.size() - 1);
            if (!fits) {
                throw InputError(fmt::format("plot \"{}\", map \"{}\": has {} values, must have one for each cell "
                                             "between {} and {} edges",
                                             plot.title, map.label, map.values.size(), map.x_edges.size(),
                                             map.y_edges.size()));
            }
        }
        for (const auto& series : panel.series) {
            const bool ends = !series.low.empty() || !series.high.empty();
            if (ends && (series.low.size() != series.x.size() || series.high.size() != series.x.size())) {
                throw InputError(fmt::format("plot \"{}\", series \"{}\": low has {} values, high {} and x {}, must be "
                                             "equal",
                                             plot.title, series.name, series.low.size(), series.high.size(),
                                             series.x.size()));
            }
            if (series.x.size() == series.y.size()) continue;
            throw InputError(fmt::format("plot \"{}\", series \"{}\": x has {} values and y {}, must be equal",
                                         plot.title, series.name, series.x.size(), series.y.size()));
        }
    }
}

// Curves of so many points that several share each column of pixels, as a record has them, by those that show there.
Plot as_pixels_show(Plot plot) {
    for (auto& panel : plot.panels) {
        for (auto& series : panel.series) {
            const bool is_curve = series.style != SeriesStyle::instants && series.low.empty();
            if (!is_curve || is_segments(panel, series)) continue;
            series = thinned(series, panel, static_cast<std::size_t>(plot.width));
        }
    }
    return plot;
}

// The files in what gnuplot writes for several plots, one after another. Each is a signature and chunks, of which the last
// is IEND.
std::vector<std::string> images_in(const std::string& bytes, std::size_t count) {
    if (count == 1) return {bytes};
    constexpr std::size_t signature = 8, around = 12; // of a chunk, its length, name and checksum
    std::vector<std::string> images;
    for (std::size_t begin = 0; begin < bytes.size();) {
        std::size_t at = begin + signature;
        for (bool last = false; !last;) {
            if (at + around > bytes.size()) throw Error("gnuplot has drawn an image without an end");
            std::size_t length = 0;
            for (std::size_t k = 0; k < 4; ++k) length = length << 8 | static_cast<unsigned char>(bytes[at + k]);
            last = bytes.compare(at + 4, 4, "IEND") == 0;
            at += around + length;
        }
        images.push_back(bytes.substr(begin, at - begin));
        begin = at;
    }
    if (images.size() != count) {
        throw Error(fmt::format("gnuplot has drawn {} images, must be {}", images.size(), count));
    }
    return images;
}

} // namespace

const std::vector<std::string>& Panel::legend_places() {
    static const std::vector<std::string> places = {"above",        "top right",   "top left",
                                                    "bottom right", "bottom left", "none"};
    return places;
}

std::vector<std::string> plot_pngs(const std::vector<Plot>& plots) {
    std::string script;
    for (const auto& given : plots) {
        check(given);
        const Plot plot = as_pixels_show(with_readable_units(given));
        const int height = shown_height(plot);
        script += "reset session\n";
        script += script_of(
            plot, height,
            fmt::format("set terminal pngcairo size {},{} font 'DejaVu Sans,12' enhanced background '#ffffff'\n",
                        plot.width, height));
    }
    if (plots.empty()) return {};
    return images_in(run_gnuplot(script), plots.size());
}

std::string plot_png(const Plot& plot) { return plot_pngs({plot}).front(); }

std::string plot_svg(const Plot& given) {
    check(given);
    const Plot plot = with_readable_units(given);
    const int height = shown_height(plot);
    return run_gnuplot(script_of(
        plot, height,
        fmt::format("set terminal svg size {},{} dynamic font 'DejaVu Sans,14' enhanced background '#ffffff'\n",
                    plot.width, height)));
}

void draw_plot(const std::filesystem::path& path, const Plot& plot) {
    const std::string name = path.filename().string();
    write_file(path_inside(path.parent_path(), name + ".png"), plot_png(plot));
    write_file(path_inside(path.parent_path(), name + ".svg"), plot_svg(plot));
}

Plot plot_from_json(const Json& json, const std::string& where) {
    // NaN is allowed in the data: it breaks a line. A JSON file has null for it.
    const auto values = [](FieldReader& fields, const char* key) {
        std::vector<double> list;
        for (const auto& entry : fields.value(key)) {
            if (!entry.is_number() && !entry.is_null()) fields.fail(key, "must be a list of numbers");
            list.push_back(entry.is_null() ? NAN : entry.get<double>());
        }
        return list;
    };
    const auto range = [](FieldReader& fields, const char* key) -> std::optional<Range> {
        const auto ends = fields.numbers(key, "", Allowed::finite, {});
        if (ends.empty()) return std::nullopt;
        if (ends.size() != 2 || !(ends[0] < ends[1])) fields.fail(key, "must be {lowest, highest}");
        return Range{ends[0], ends[1]};
    };
    // A series for each name, in the order in which they come first.
    const auto add_events = [](FieldReader& entry, Panel& panel) {
        std::vector<Series> kinds;
        entry.each("events", [&](FieldReader& event) {
            const double t = event.number("t", "s", Allowed::finite);
            std::string name = event.text(event.has("kind") ? "kind" : "name");
            if (event.has("element")) event.integer("element", 0, std::numeric_limits<int>::max(), 0);
            auto kind = std::find_if(kinds.begin(), kinds.end(), [&](const Series& one) { return one.name == name; });
            if (kind == kinds.end()) {
                kinds.push_back({.name = std::move(name), .style = SeriesStyle::instants, .width = 1.1});
                kind = kinds.end() - 1;
            }
            kind->x.push_back(t);
            kind->y.push_back(anywhere);
        });
        for (auto& kind : kinds) panel.series.push_back(std::move(kind));
    };
    FieldReader fields(json, where);
    Plot plot;
    plot.title = fields.text("title", "");
    plot.width = static_cast<int>(fields.integer("width", 200, 10000, plot.width));
    plot.height = static_cast<int>(fields.integer("height", 0, 10000, plot.height));
    fields.each("panels", [&](FieldReader& entry) {
        Panel panel;
        panel.title = entry.text("title", "");
        panel.x_label = entry.text("x_label", "");
        panel.y_label = entry.text("y_label", "");
        panel.x_log = entry.boolean("x_log", false);
        panel.y_log = entry.boolean("y_log", false);
        panel.x_range = range(entry, "x_range");
        panel.y_range = range(entry, "y_range");
        panel.y_names = entry.texts("y_names", {});
        if (panel.y_log && !panel.y_names.empty()) entry.fail("y_names", "do not go with a logarithmic axis");
        panel.legend = entry.choice("legend", Panel::legend_places(), panel.legend);
        if (entry.has("map")) {
            FieldReader map = entry.table("map");
            panel.map.label = map.text("label");
            panel.map.x_edges = values(map, "x_edges");
            panel.map.y_edges = values(map, "y_edges");
            panel.map.values = values(map, "values");
            panel.map.strongest = map.number("strongest", "", Allowed::non_negative, 0);
            map.finish();
            if (panel.map.label.empty()) entry.fail("map", "must have a label: what the colors show");
        }
        entry.each("series", [&](FieldReader& curve_fields) {
            Series series;
            series.name = curve_fields.text("name", "");
            series.x = values(curve_fields, "x");
            const std::string style = curve_fields.choice("style", style_names, "line");
            series.style = static_cast<SeriesStyle>(std::find(style_names.begin(), style_names.end(), style) -
                                                    style_names.begin());
            if (series.style == SeriesStyle::instants) {
                series.y.assign(series.x.size(), anywhere);
                series.width = 1.1;
            } else {
                series.y = values(curve_fields, "y");
                series.low = values(curve_fields, "low");
                series.high = values(curve_fields, "high");
            }
            series.color = curve_fields.text("color", "");
            const bool hex = series.color.size() == 7 && series.color[0] == '#' &&
                             series.color.find_first_not_of("0123456789abcdefABCDEF", 1) == std::string::npos;
            if (!series.color.empty() && !hex) {
                curve_fields.fail("color", fmt::format("= \"{}\", must be #rrggbb", series.color));
            }
            series.width = curve_fields.number("width", "points", Allowed::positive, series.width);
            panel.series.push_back(std::move(series));
        });
        add_events(entry, panel);
        plot.panels.push_back(std::move(panel));
    });
    fields.finish();
    return plot;
}

} // namespace tribode
