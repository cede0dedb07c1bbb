#pragma once
#include "tribode/base/json.hpp"

#include <array>
#include <filesystem>
#include <optional>
#include <string>
#include <vector>

namespace tribode {

// steps: a value holds until the next one, as of a sampled signal or a relay. band: the area between low and high, with
// the line of y over it. instants: a thin line from bottom to top of the panel at each x, as of events; y is not shown.
enum class SeriesStyle { line, dashed, points, line_points, steps, band, instants };
const std::string& name_of(SeriesStyle style);

struct Series {
    std::string name;         // in the legend; empty: not there
    std::vector<double> x, y; // equal lengths; a point that is not finite breaks the line
    SeriesStyle style = SeriesStyle::line;
    std::string color = {};                  // "#rrggbb"; empty: the next of the palette
    double width = 1.6;                      // of the line [points]
    std::vector<double> low = {}, high = {}; // empty, or as long: error bars of points, the ends of a band
};

using Range = std::array<double, 2>; // lowest and highest value shown

// A quantity over x and y as colors, cell by cell: from white, or, where it has both signs, from blue over white to red.
struct ColorMap {
    std::string label;                    // of the colors, with the unit; empty: no map
    std::vector<double> x_edges, y_edges; // ascending, of the cells
    std::vector<double> values;           // row by row from the lowest y; what is not finite leaves its cell empty
    double strongest = 0;                 // value of the full color; 0: the largest there is
};

struct Panel {
    std::string title;            // mostly empty
    std::string x_label, y_label; // with units, e.g. "Frequency [Hz]"
    bool x_log = false, y_log = false;
    std::optional<Range> x_range, y_range; // default: all points
    std::vector<std::string> y_names;      // at y = 1, 2, ... in place of numbers; y_log must be false
    std::string legend = "above";          // see legend_places
    std::vector<Series> series;
    ColorMap map; // below the series

    static const std::vector<std::string>& legend_places(); // above, the corners, none
};

// Panels below one another, sharing the width.
struct Plot {
    std::string title;
    int width = 1400; // [pixel]
    int height = 0;   // [pixel]; 0: by the number of panels
    std::vector<Panel> panels;
};

// Draws with gnuplot and writes `<path>.png` and `<path>.svg` through write_file, not through links that lead out of their
// folder. Same plot, same bytes. Throws InputError where the lengths of a series differ, or gnuplot is not installed; OutputError where a file cannot
// be written.
void draw_plot(const std::filesystem::path& path, const Plot& plot);

// What a plot that is kept as a table has behind its name, see report_from_json.
inline constexpr const char* plot_data_extension = ".plot.json";

// The bytes of the two files. In the image a curve of many points is thinned to what each column of its pixels shows.
std::string plot_png(const Plot& plot);
std::string plot_svg(const Plot& plot);
// The images of several plots, drawn by one program, which takes less time than one for each.
std::vector<std::string> plot_pngs(const std::vector<Plot>& plots);

// What a drawing shows where the plot leaves it open: the ends of an axis, the color of each series, the height
// [pixel]. Any other drawing of a plot takes them from here, so that both agree.
Range shown_range(const Panel& panel, bool of_x);
std::vector<std::string> shown_colors(const Panel& panel);
int shown_height(const Plot& plot);

// A series of more than four points for each of so many columns, thinned: where x ascends, to the first, the last, the least
// and the greatest value in each column; else a point is left out that lies nearer to the last one kept than the share of a
// column in the panel.
Series thinned(const Series& series, const Panel& panel, std::size_t columns);

// The same plot in units that need few digits: a linear axis labeled "... [m]" that shows no more than 5e-6 becomes
// "... [um]". Axes with the same label keep the same unit. Drawings show this.
Plot with_readable_units(Plot plot);

// A plot as a table with the fields above (styles: "line", "dashed", "points", "line_points", "steps", "band", "instants"); a panel
// may also have `events`, { { t =, name = } or { t =, element =, kind = }, ... }, which become instants, a series for each
// name. `where` begins the messages. Throws InputError.
Plot plot_from_json(const Json& json, const std::string& where);

} // namespace tribode
