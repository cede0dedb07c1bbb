#pragma once
#include "tribode/base/json.hpp"
#include "tribode/base/run_control.hpp"
#include "tribode/record/plot.hpp"

#include <filesystem>
#include <string>
#include <variant>
#include <vector>

namespace tribode {

// What a report is made of. All texts are plain: they are shown as they are.

struct Paragraph {
    std::string text;
};

struct BulletList {
    std::vector<std::string> items;
};

struct Preformatted {
    std::string text; // line breaks and blanks are kept
};

struct ReportTable {
    struct Column {
        std::string name;
        std::string unit; // in brackets below the name; "" for none
        int decimals =
            -1; // of its numbers, 0 to 15; -1: four significant digits, in a unit with a prefix if they need one
    };
    // A number that is not finite is shown as a dash. Columns of numbers are aligned to the right.
    using Cell = std::variant<std::string, double>;

    std::string caption; // may be empty
    std::vector<Column> columns;
    std::vector<std::vector<Cell>> rows; // each as long as columns
};

struct Figure {
    std::string file;    // beside the page, without extension; empty: <name of the page>_<number from 1>
    std::string caption; // may be empty
    Plot plot;
    bool drawn = false; // <file>.png is there already
};

using ReportBlock = std::variant<Paragraph, BulletList, Preformatted, ReportTable, Figure>;

struct ReportSection {
    std::string title;
    std::vector<ReportBlock> blocks;
};

struct Report {
    std::string title;
    std::string summary; // one sentence below the title
    std::vector<ReportSection> sections;
};

// Writes the report as one HTML page that needs nothing else, and `<file>.png` beside it for each figure. Returns the
// names of the images it wrote, relative to the folder of the page. Same report, same bytes.
//
// A figure is in the page twice: as the image, and as data for an interactive plot (uPlot) that takes the place of the
// image where scripts run; printed, or without scripts, the image stands. A series of more than 8000 points is thinned
// for the page to 2000 columns (see `thinned`). Numbers have 7 digits there. A Content-Security-Policy lets run the page's own
// script alone and load nothing.
//
// `control`: images are drawn by its workers. Throws InputError where a table's row, a series or a file name does not
// fit; EndedEarly on a stop request; what draw_plot throws. The page is written last.
std::vector<std::string> write_report(const std::filesystem::path& page, const Report& report,
                                      const RunControl& control = {});

// A report as a table (docs/lua-reference.md). `folder`: where a figure that is given by its name alone was drawn, by
// tb.plot in a run that keeps plots; its `<name>.plot.json` is read. Throws InputError.
Report report_from_json(const Json& json, const std::string& where, const std::filesystem::path& folder);

} // namespace tribode
