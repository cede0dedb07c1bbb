#include "tribode/record/output_file.hpp"
#include "tribode/record/plot.hpp"
#include "unit/script/messages.hpp"
#include "unit/script/temporary_folder.hpp"

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <gtest/gtest.h>
#include <set>
#include <string>
#include <sys/wait.h>
#include <unistd.h>

namespace tribode {
namespace {

TEST(Plot, WritesPngAndSvgAndTheSamePlotGivesTheSameBytes) {
    const TemporaryFolder folder;
    Plot plot{.title = "It's a \"title\" with \\ and _",
              .panels = {{.x_label = "f [Hz]", .y_label = "g [dB]", .x_log = true}}};
    plot.panels[0].series.push_back({.name = "a_b '{x}'", .x = {1, 10, 100}, .y = {0, std::nan(""), 3}});
    draw_plot(folder / "a", plot);
    draw_plot(folder / "b", plot);
    EXPECT_TRUE(read_file(folder / "a.png").starts_with("\x89PNG"));
    EXPECT_NE(read_file(folder / "a.svg").find("<svg"), std::string::npos);
    EXPECT_EQ(read_file(folder / "a.png"), read_file(folder / "b.png"));
    EXPECT_EQ(read_file(folder / "a.svg"), read_file(folder / "b.svg"));
}

TEST(Plot, ImagesDrawnTogetherAreThoseDrawnOneByOne) {
    std::vector<Plot> plots(3);
    for (std::size_t i = 0; i < plots.size(); ++i) {
        plots[i].title = "plot " + std::to_string(i);
        plots[i].height = 300 + 100 * static_cast<int>(i);
        plots[i].panels.push_back({.x_label = "t [s]", .y_label = "y [m]", .y_log = i == 1});
        plots[i].panels[0].series.push_back({.name = "a", .x = {0, 1, 2}, .y = {1.0 + static_cast<double>(i), 3, 2}});
    }
    const auto together = plot_pngs(plots);
    ASSERT_EQ(together.size(), plots.size());
    for (std::size_t i = 0; i < plots.size(); ++i) EXPECT_EQ(together[i], plot_png(plots[i])) << i;
    EXPECT_TRUE(plot_pngs({}).empty());
}

TEST(Plot, AThinnedCurveKeepsItsEndsExtremesAndBreaks) {
    Panel panel;
    panel.series.push_back({.name = "noise"});
    Series& noise = panel.series[0];
    constexpr int n = 10000, columns = 100;
    for (int i = 0; i < n; ++i) {
        noise.x.push_back(i);
        noise.y.push_back(i == 4321 ? 9 : i == 4400 ? NAN : std::sin(1.7 * i));
    }
    const Series few = thinned(noise, panel, columns);
    EXPECT_LE(few.x.size(), 4u * columns + 2);
    EXPECT_EQ(few.x.front(), 0);
    EXPECT_EQ(few.x.back(), n - 1);
    EXPECT_EQ(std::ranges::count(few.y, 9), 1);
    EXPECT_EQ(std::ranges::count_if(few.y, [](double y) { return std::isnan(y); }), 1);
    EXPECT_TRUE(std::ranges::is_sorted(few.x));
    EXPECT_EQ(thinned(noise, panel, n / 4).x.size(), noise.x.size()) << "one that is short enough stays";
}

TEST(Plot, DataWithNothingToSeeStillGiveAxes) {
    const TemporaryFolder folder;
    Plot plot;
    plot.panels.push_back({}); // no series
    plot.panels.push_back({.series = {{.name = "none"}, {.name = "one", .x = {2}, .y = {3}}}});
    plot.panels.push_back({.series = {{.name = "constant", .x = {1, 2}, .y = {5, 5}}}});
    plot.panels.push_back({.x_log = true, .y_log = true, .series = {{.name = "negative", .x = {-1, 0}, .y = {-1, 1}}}});
    draw_plot(folder / "x", plot);
    EXPECT_TRUE(std::filesystem::exists(folder / "x.png"));
}

TEST(Plot, DigitsBehindPunctuationStay) {
    const TemporaryFolder folder;
    Plot plot{.title = "0.66 N, 10-17: FRA-1 (2)", .panels = {{.x_label = "x/100 [9.5]"}}};
    plot.panels[0].series.push_back({.name = "FRA-2", .x = {1, 2}, .y = {0, 3}});
    draw_plot(folder / "a", plot);
    const auto svg = read_file(folder / "a.svg");
    for (const auto* text : {"0.66 N, 10-17: FRA-1 (2)", "x/100 [9.5]", "FRA-2"}) {
        EXPECT_NE(svg.find(text), std::string::npos) << text;
    }
}

TEST(Plot, NamesStandAtTheYAxis) {
    const TemporaryFolder folder;
    const Json figure = {{"panels", {{{"y_names", {"friction_level", "it's"}}, {"y_range", {0.5, 2.5}}}}}};
    draw_plot(folder / "x", plot_from_json(figure, "tb.plot"));
    const std::string svg = read_file(folder / "x.svg");
    EXPECT_NE(svg.find("friction_level"), std::string::npos);
    EXPECT_EQ(problem_of([] {
                  plot_from_json({{"panels", {{{"y_names", {"a"}}, {"y_log", true}}}}}, "tb.plot");
              }),
              "input: tb.plot: panels[1].y_names do not go with a logarithmic axis");
}

TEST(Plot, EventsBecomeInstantsByName) {
    const TemporaryFolder folder;
    const Json figure = Json::parse(R"({"panels": [{"x_label": "Time [s]", "y_log": true,
        "series": [{"name": "h", "x": [0, 4e-3], "y": [1, 100]}],
        "events": [{"t": 1e-3, "name": "impact"}, {"t": 2e-3, "name": "rest"}, {"t": 9e-3, "name": "impact"},
                   {"t": 3e-3, "element": 2, "kind": "stick"}]}]})");
    const Plot plot = plot_from_json(figure, "tb.plot");
    const auto& series = plot.panels[0].series;
    ASSERT_EQ(series.size(), 4u);
    EXPECT_EQ(series[1].name, "impact");
    EXPECT_EQ(series[1].x, (std::vector<double>{1e-3, 9e-3}));
    EXPECT_EQ(series[3].name, "stick");
    EXPECT_EQ(series[1].style, SeriesStyle::instants);
    // They mark what is shown, and do not widen it; their times get the prefix of the axis.
    EXPECT_LT(shown_range(plot.panels[0], true)[1], 5e-3);
    EXPECT_LT(shown_range(plot.panels[0], false)[1], 200);
    const Plot readable = with_readable_units(plot);
    EXPECT_EQ(readable.panels[0].x_label, "Time [ms]");
    EXPECT_DOUBLE_EQ(readable.panels[0].series[1].x[0], 1);
    draw_plot(folder / "with", plot);
    Plot without = plot;
    without.panels[0].series.resize(1);
    draw_plot(folder / "without", without);
    EXPECT_NE(read_file(folder / "with.svg"), read_file(folder / "without.svg"));
    EXPECT_NE(read_file(folder / "with.svg").find("impact"), std::string::npos);
    EXPECT_NE(problem_of([] {
                  plot_from_json({{"panels", {{{"events", {{{"t", 1}}}}}}}}, "tb.plot");
              }).find("name"),
              std::string::npos);
}

TEST(Plot, AMapColoursItsCells) {
    const TemporaryFolder folder;
    const Json figure = Json::parse(R"({"panels": [{"y_log": true, "map": {"label": "Force [N]", "x_edges": [0, 1, 3],
        "y_edges": [1, 10, 100], "values": [-2, null, 0, 2]}}]})");
    const Plot plot = plot_from_json(figure, "tb.plot");
    EXPECT_EQ(shown_range(plot.panels[0], true), (Range{0, 3}));
    EXPECT_EQ(shown_range(plot.panels[0], false), (Range{1, 100}));
    draw_plot(folder / "x", plot);
    const std::string svg = read_file(folder / "x.svg");
    EXPECT_NE(svg.find("Force [N]"), std::string::npos);
    // Full blue, white and full red, each in the scale and in a cell; the empty cell has none.
    for (const std::string color : {"rgb(  8,  81, 156)", "rgb(247, 247, 247)", "rgb(165,  15,  21)"}) {
        int count = 0;
        for (auto at = svg.find(color); at != std::string::npos; at = svg.find(color, at + 1)) ++count;
        EXPECT_EQ(count, 2) << color;
    }
    EXPECT_EQ(problem_of([] {
                  Plot wrong{.title = "p", .panels = {{.map = {"F", {0, 1}, {0, 1}, {1, 2}}}}};
                  plot_png(wrong);
              }),
              "input: plot \"p\", map \"F\": has 2 values, must have one for each cell between 2 and 2 edges");
    EXPECT_EQ(problem_of([] {
                  plot_from_json({{"panels", {{{"map", {{"label", ""}}}}}}}, "tb.plot");
              }),
              "input: tb.plot: panels[1].map must have a label: what the colors show");
}

// The heights at which texts of the drawing begin.
double height_of(const std::string& svg, const std::string& text) {
    const auto at = svg.find(text);
    const auto transform = svg.rfind("translate(", at);
    if (at == svg.npos || transform == svg.npos) return NAN;
    return std::stod(svg.substr(svg.find(',', transform) + 1));
}

TEST(Plot, ALegendOfManyRowsLeavesTheTitleFree) {
    Plot plot{.title = "A title", .panels = {{.y_label = "y"}, {.y_label = "z"}}};
    for (Panel& panel : plot.panels) {
        for (int i = 0; i < 11; ++i) {
            panel.series.push_back(
                {.name = "a curve with a long name " + std::to_string(i), .x = {1, 2}, .y = {1.0 * i, 2}});
        }
    }
    const std::string svg = plot_svg(plot);
    const double title = height_of(svg, ">A title<");
    ASSERT_TRUE(std::isfinite(title));
    EXPECT_GT(height_of(svg, "long name 0<"), title + 18);
    const auto colors = shown_colors(plot.panels[0]);
    EXPECT_EQ(std::set<std::string>(colors.begin(), colors.end()).size(), colors.size());
}

TEST(Plot, SmallQuantitiesAreShownInSmallUnits) {
    Plot plot{.panels = {{.y_label = "Error [m]"}, {.x_label = "Time [s]", .y_label = "Error [m]"}}};
    plot.panels[0].series.push_back({.x = {0, 2e-3}, .y = {0, 5e-6}, .low = {0, 4e-6}, .high = {0, 8e-6}});
    plot.panels[1].series.push_back({.x = {0, 2e-3}, .y = {0, 9e-9}});
    const Plot shown = with_readable_units(plot);
    EXPECT_EQ(shown.panels[0].y_label, "Error [um]");
    EXPECT_EQ(shown.panels[1].y_label, "Error [um]") << "the same label has the same unit";
    EXPECT_EQ(shown.panels[1].x_label, "Time [ms]");
    EXPECT_DOUBLE_EQ(shown.panels[0].series[0].x[1], 2) << "x of the panel above has the label below";
    EXPECT_DOUBLE_EQ(shown.panels[0].series[0].y[1], 5);
    EXPECT_DOUBLE_EQ(shown.panels[0].series[0].high[1], 8);
    EXPECT_DOUBLE_EQ(shown.panels[1].series[0].y[1], 9e-3);
    // As they are: what needs few digits, logarithms, units without prefixes.
    Plot kept{.panels = {{.x_label = "Gain [dB]", .y_label = "Position [m]"}, {.x_label = "Time [s]", .x_log = true}}};
    kept.panels[0].series.push_back({.x = {1e-6, 2e-6}, .y = {0.02, 0.3}});
    kept.panels[1].series.push_back({.x = {1e-6, 2e-6}, .y = {1, 2}});
    const Plot same = with_readable_units(kept);
    EXPECT_EQ(same.panels[0].x_label, "Gain [dB]");
    EXPECT_EQ(same.panels[0].y_label, "Position [m]");
    EXPECT_EQ(same.panels[1].x_label, "Time [s]");
    EXPECT_EQ(same.panels[0].series[0].x, kept.panels[0].series[0].x);
    EXPECT_EQ(same.panels[1].series[0].x, kept.panels[1].series[0].x);
}

TEST(Plot, DrawsStepsBandsErrorBarsAndSegments) {
    const double none = std::nan("");
    Plot plot{.panels = {{.series = {{.name = "line", .x = {0, 1, 2}, .y = {0, 1, 0}}}}}};
    const std::string line = plot_svg(plot);
    Series& series = plot.panels[0].series[0];
    series.style = SeriesStyle::steps;
    const std::string steps = plot_svg(plot);
    series.style = SeriesStyle::band;
    series.low = {-1, 0, -1};
    series.high = {1, 2, 1};
    const std::string band = plot_svg(plot);
    EXPECT_NE(band.find("<polygon"), std::string::npos);
    EXPECT_EQ(line.find("<polygon"), std::string::npos);
    series.style = SeriesStyle::points;
    EXPECT_NE(plot_svg(plot), band);
    EXPECT_NE(steps, line);
    EXPECT_EQ(shown_range(plot.panels[0], false), (Range{-1.18, 2.18}));
    series.low.pop_back();
    EXPECT_EQ(problem_of([&] { plot_svg(plot); }),
              "input: plot \"\", series \"line\": low has 2 values, high 3 and x 3, must be equal");
    // Wide segments of one series look like those of several, without wedges between the end of one and the next.
    Panel& bars = plot.panels[0];
    bars.x_range = bars.y_range = Range{0, 4};
    bars.series = {{.x = {3, 4, none, 3, 2.9}, .y = {2, 2, none, 1, 1}, .color = "#0072b2", .width = 9}};
    const std::string together = plot_png(plot);
    bars.series = {{.x = {3, 4}, .y = {2, 2}, .color = "#0072b2", .width = 9},
                   {.x = {3, 2.9}, .y = {1, 1}, .color = "#0072b2", .width = 9}};
    EXPECT_EQ(together, plot_png(plot));
}

TEST(Plot, RefusesWhatDoesNotFit) {
    Plot plot{.title = "p"};
    plot.panels.push_back({.series = {{.name = "s", .x = {1, 2}, .y = {1}}}});
    EXPECT_EQ(problem_of([&] { draw_plot("x", plot); }),
              "input: plot \"p\", series \"s\": x has 2 values and y 1, must be equal");
    const auto refused = [](const char* json) {
        return problem_of([&] { plot_from_json(Json::parse(json), "tb.plot"); });
    };
    EXPECT_EQ(refused(R"({"panels": [{"series": [{"colour": "#000000"}]}]})"),
              "input: tb.plot: panels[1].series[1].colour is not a known field (did you mean \"color\"?)");
    EXPECT_NE(refused(R"({"panels": [{"series": [{"color": "red"}]}]})").find("must be #rrggbb"), std::string::npos);
    EXPECT_NE(refused(R"({"panels": [{"x_range": [2, 1]}]})").find("must be {lowest, highest}"), std::string::npos);
    EXPECT_NE(refused(R"({"panels": [{"legend": "left"}]})").find("must be one of above"), std::string::npos);
    EXPECT_EQ(refused(R"({"title": "t", "panels": [{"series": [{"x": [1], "y": [2], "style": "points"}]}]})"),
              "none: ");
}

TEST(Plot, SaysThatGnuplotIsMissing) {
    const pid_t child = fork();
    if (child == 0) {
        setenv("PATH", "/nowhere", 1);
        const std::string problem = problem_of([] { draw_plot("x", {.panels = {{}}}); });
        _exit(problem.find("gnuplot") != std::string::npos && problem.starts_with("input: ") ? 0 : 1);
    }
    int status = 0;
    waitpid(child, &status, 0);
    EXPECT_EQ(status, 0);
}

// Whatever a text contains, gnuplot sees a text: each of these once ended its quotes or would run a command.
TEST(Plot, NoTextBecomesACommand) {
    const TemporaryFolder folder;
    const std::string target = (folder / "made").string();
    const std::string command = "; system(\"touch " + target + "\") #";
    std::vector<std::string> ends = {"abc\\", "'", "''", "\"", "\\'", "`touch " + target + "`", "@system"};
    for (char c = 0; c < 0x20; ++c) ends.push_back("abc\\" + std::string(1, c));
    ends.emplace_back("abc\\\x7f");
    int number = 0;
    for (const auto& end : ends) {
        Plot plot{.title = end};
        plot.width = 300;
        plot.panels.push_back({.title = end, .x_label = command, .y_label = end});
        plot.panels.push_back({.title = command, .x_label = end, .y_label = command, .y_names = {end, command, end}});
        plot.panels[0].series = {{.name = end, .x = {1, 2}, .y = {1, 2}}, {.name = command, .x = {1, 2}, .y = {2, 1}}};
        plot.panels[0].map = {.label = end, .x_edges = {1, 2}, .y_edges = {1, 2}, .values = {1}, .strongest = 0};
        EXPECT_FALSE(plot_svg(plot).empty());
        EXPECT_FALSE(std::filesystem::exists(target)) << "text " << number;
        ++number;
    }
}

TEST(Plot, IsNotWrittenThroughLinks) {
    const TemporaryFolder folder;
    folder.write("precious", "kept");
    std::filesystem::create_directory(folder / "out");
    for (const char* name : {"a.png", "b.svg"}) {
        std::filesystem::create_symlink(folder / "precious", (folder / "out") / name);
    }
    std::filesystem::create_hard_link(folder / "precious", folder / "out/c.png");
    std::filesystem::create_hard_link(folder / "precious", folder / "out/c.svg.part");
    std::filesystem::create_symlink(folder / "nowhere", folder / "out/d.png");
    for (const char* name : {"a", "b", "d"}) {
        EXPECT_NE(problem_of([&] { draw_plot((folder / "out") / name, {.panels = {{}}}); }).find("through a link"),
                  std::string::npos)
            << name;
    }
    draw_plot(folder / "out/c", {.panels = {{}}}); // new files of these names
    EXPECT_EQ(read_file(folder / "precious"), "kept");
    EXPECT_FALSE(std::filesystem::exists(folder / "nowhere"));
    EXPECT_TRUE(read_file(folder / "out/c.svg").starts_with("<?xml"));
}

} // namespace
} // namespace tribode
