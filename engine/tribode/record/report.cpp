#include "tribode/record/report.hpp"
#include "tribode/base/error.hpp"
#include "tribode/base/field_reader.hpp"
#include "tribode/base/quantity.hpp"
#include "tribode/base/text.hpp"
#include "tribode/record/json_file.hpp"
#include "tribode/record/output_file.hpp"
#include "tribode/record/report_assets.hpp"
#include "tribode/record/run_folder.hpp"

#include <algorithm>
#include <cmath>
#include <fmt/format.h>
#include <map>
#include <set>

namespace tribode {

namespace fs = std::filesystem;

namespace {

constexpr std::size_t thinned_columns = 2000;
constexpr std::size_t most_together = 8; // figures that one program draws

// ---- texts -------------------------------------------------------------------------------------------------------

// Valid UTF-8 without control characters: what a stranger's file holds must not end the page or turn it round.
std::string clean(const std::string& text) {
    const std::string valid = Json(text).dump(-1, ' ', false, Json::error_handler_t::replace);
    const std::string parsed = Json::parse(valid).get<std::string>();
    std::string result;
    for (const char c : parsed) {
        const auto byte = static_cast<unsigned char>(c);
        result +=
            (byte < 0x20 && c != '\n' && c != '\t') || byte == 0x7f ? std::string("\xef\xbf\xbd") : std::string(1, c);
    }
    return result;
}

std::string escaped(const std::string& text) {
    std::string result;
    for (const char c : clean(text)) {
        switch (c) {
        case '&': result += "&amp;"; break;
        case '<': result += "&lt;"; break;
        case '>': result += "&gt;"; break;
        case '"': result += "&quot;"; break;
        case '\'': result += "&#39;"; break;
        default: result += c;
        }
    }
    return result;
}

std::string base64(std::string_view bytes) {
    constexpr std::string_view digits = "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
    std::string result;
    result.reserve((bytes.size() + 2) / 3 * 4);
    for (std::size_t i = 0; i < bytes.size(); i += 3) {
        unsigned long three = 0;
        for (std::size_t k = 0; k < 3; ++k) {
            three = three << 8 | (i + k < bytes.size() ? static_cast<unsigned char>(bytes[i + k]) : 0u);
        }
        for (std::size_t k = 0; k < 4; ++k) {
            result += i + k <= bytes.size() ? digits[three >> (18 - 6 * k) & 63] : '=';
        }
    }
    return result;
}

// As a Content-Security-Policy names a text it allows.
std::string policy_hash(const std::string& text) {
    const std::string hex = sha256(text);
    std::string bytes;
    for (std::size_t i = 0; i < hex.size(); i += 2) {
        bytes += static_cast<char>(std::stoi(hex.substr(i, 2), nullptr, 16));
    }
    return "'sha256-" + base64(bytes) + "'";
}

// ---- figures -----------------------------------------------------------------------------------------------------

// Seven digits: more than a screen shows, and a short text.
double rounded(double value) { return std::isfinite(value) ? *parse_number(fmt::format("{:.6e}", value)) : value; }

// Whether the x axes of two panels agree, apart from a rest that nobody sees.
bool same_axis(const Panel& a, const Panel& b) {
    if (a.x_log != b.x_log) return false;
    Range ra = shown_range(a, true), rb = shown_range(b, true);
    if (a.x_log) {
        for (double* end : {&ra[0], &ra[1], &rb[0], &rb[1]}) *end = std::log(*end);
    }
    const double near = 0.02 * (ra[1] - ra[0]);
    return std::abs(ra[0] - rb[0]) <= near && std::abs(ra[1] - rb[1]) <= near;
}

// The data of the interactive plot, for a script element of the page.
std::string data_of(const Plot& given) {
    const Plot plot = with_readable_units(given);
    Json lists = Json::array();
    std::map<std::vector<double>, std::size_t> places; // curves mostly share their x
    Json panels = Json::array();
    std::size_t all = 0, kept = 0;
    for (std::size_t p = 0; p < plot.panels.size(); ++p) {
        const Panel& panel = plot.panels[p];
        const Range xr = shown_range(panel, true), yr = shown_range(panel, false);
        // Panels with the same axis below one another are read and zoomed together.
        std::size_t group = 0;
        while (group < p && !same_axis(plot.panels[group], panel)) ++group;
        std::string label; // of this panel or the next below that has one
        for (std::size_t below = p; below < plot.panels.size() && label.empty(); ++below) {
            label = plot.panels[below].x_label;
        }
        const auto colors = shown_colors(panel);
        Json curves = Json::array();
        for (std::size_t s = 0; s < panel.series.size(); ++s) {
            const Series& series = panel.series[s];
            Series curve = thinned(series, panel, thinned_columns);
            all += series.x.size();
            kept += curve.x.size();
            for (double& x : curve.x) x = rounded(x);
            for (auto* values : {&curve.y, &curve.low, &curve.high}) {
                for (double& value : *values) value = rounded(value);
            }
            // Where x is no number the curve breaks, too; a map needs numbers that can be compared.
            for (std::size_t i = 0; i < curve.x.size(); ++i) {
                if (std::isfinite(curve.x[i])) continue;
                curve.x[i] = i ? curve.x[i - 1] : 0;
                curve.y[i] = NAN;
            }
            const auto [it, is_new] = places.try_emplace(curve.x, lists.size());
            if (is_new) lists.push_back(curve.x);
            curves.push_back({{"name", clean(series.name)},
                              {"style", name_of(series.style)},
                              {"color", colors[s]},
                              {"width", series.width},
                              {"x", it->second},
                              {"y", curve.y}}); // what is not finite becomes null
            if (!curve.low.empty()) {
                curves.back()["low"] = curve.low;
                curves.back()["high"] = curve.high;
            }
        }
        panels.push_back({{"title", clean(panel.title)},
                          {"xlabel", clean(panel.x_label)},
                          {"ylabel", clean(panel.y_label)},
                          {"xname", clean(label.empty() ? "x" : label)},
                          {"xlog", panel.x_log},
                          {"ylog", panel.y_log},
                          {"xr", xr},
                          {"yr", yr},
                          {"group", group},
                          {"series", std::move(curves)}});
    }
    const double panel_height = static_cast<double>(shown_height(plot)) / static_cast<double>(plot.width) /
                                static_cast<double>(std::max<std::size_t>(plot.panels.size(), 1));
    Json json{{"title", clean(plot.title)}, {"panelHeight", rounded(panel_height)}};
    if (kept < all) {
        json["note"] = fmt::format("Thinned: of {} points the {} that {} columns show.", all, kept, thinned_columns);
    }
    json["x"] = std::move(lists);
    json["panels"] = std::move(panels);
    // Within a script element nothing but `<` can end or open anything; in JSON it is in texts only.
    std::string text;
    for (const char c : json.dump()) text += c == '<' ? std::string("\\u003c") : std::string(1, c);
    return text;
}

// What a figure shows, for those who do not see it.
std::string alternative_text(const Figure& figure) {
    std::string text = "Plot" + (figure.plot.title.empty() ? "" : ": " + figure.plot.title) + ".";
    for (const Panel& panel : figure.plot.panels) {
        std::string names;
        for (const Series& series : panel.series) {
            if (!series.name.empty()) names += (names.empty() ? "" : ", ") + series.name;
        }
        text += fmt::format(" {} against {}{}{}.", panel.y_label.empty() ? "values" : panel.y_label,
                            panel.x_label.empty() ? "the same axis" : panel.x_label, names.empty() ? "" : ": ", names);
    }
    return text;
}

// ---- the page ----------------------------------------------------------------------------------------------------

struct Page {
    const std::vector<std::string>& files;  // of the figures, in order
    const std::vector<std::string>& images; // their bytes
    std::size_t next = 0;

    std::string operator()(const Paragraph& p) const { return "<p>" + escaped(p.text) + "</p>\n"; }

    std::string operator()(const BulletList& list) const {
        std::string text = "<ul>\n";
        for (const auto& item : list.items) text += "<li>" + escaped(item) + "</li>\n";
        return text + "</ul>\n";
    }

    std::string operator()(const Preformatted& p) const {
        return "<pre tabindex=\"0\">\n" + escaped(p.text) + "</pre>\n";
    }

    std::string operator()(const ReportTable& table) const {
        std::string text = "<div class=\"wide\" tabindex=\"0\"><table>\n";
        if (!table.caption.empty()) text += "<caption>" + escaped(table.caption) + "</caption>\n";
        text += "<thead><tr>";
        std::vector<const char*> classes;
        std::vector<double> factors;
        for (std::size_t c = 0; c < table.columns.size(); ++c) {
            // A column that holds a number is one of numbers; texts in it ("never") go with them.
            const bool numbers = std::any_of(table.rows.begin(), table.rows.end(),
                                             [&](const auto& row) { return std::holds_alternative<double>(row[c]); });
            classes.push_back(numbers ? " class=\"n\"" : "");
            const auto [factor, unit] = shown_unit(table, c);
            factors.push_back(factor);
            text += fmt::format("<th scope=\"col\"{}>{}{}</th>", classes[c], escaped(table.columns[c].name),
                                unit.empty() ? "" : "<span class=\"unit\">[" + escaped(unit) + "]</span>");
        }
        text += "</tr></thead>\n<tbody>\n";
        for (const auto& row : table.rows) {
            text += "<tr>";
            for (std::size_t c = 0; c < row.size(); ++c) {
                // A short text stays in one line; a table that becomes too wide scrolls.
                const auto* words = std::get_if<std::string>(&row[c]);
                const char* kind = *classes[c] || !words || words->size() > 30 ? classes[c] : " class=\"s\"";
                text += fmt::format("<td{}>{}</td>", kind, cell(row[c], table.columns[c], factors[c]));
            }
            text += "</tr>\n";
        }
        return text + "</tbody></table></div>\n";
    }

    std::string operator()(const Figure& figure) {
        const std::size_t i = next++;
        const std::string alt = escaped(alternative_text(figure));
        // Colour maps are in the page as an image alone.
        const bool mapped = std::any_of(figure.plot.panels.begin(), figure.plot.panels.end(),
                                        [](const Panel& panel) { return !panel.map.label.empty(); });
        std::string text = mapped ? "<figure>\n" : "<figure class=\"plot\">\n";
        text += fmt::format("<img alt=\"{}\" width=\"{}\" height=\"{}\" src=\"data:image/png;base64,{}\">\n", alt,
                            figure.plot.width, shown_height(figure.plot), base64(images[i]));
        if (!mapped) text += "<script type=\"application/json\">" + data_of(figure.plot) + "</script>\n";
        text += fmt::format("<figcaption>{}{}<a href=\"{}.png\">Image</a></figcaption>\n</figure>\n",
                            escaped(figure.caption), figure.caption.empty() ? "" : " ", escaped(link_to(files[i])));
        return text;
    }

    // The unit of a column of numbers that would need many digits, or few after many zeros: that of its largest one.
    static PrefixedUnit shown_unit(const ReportTable& table, std::size_t c) {
        const auto& column = table.columns[c];
        double largest = 0;
        for (const auto& row : table.rows) {
            const auto* value = std::get_if<double>(&row[c]);
            if (value && std::isfinite(*value)) largest = std::max(largest, std::abs(*value));
        }
        const bool readable = column.decimals >= 0 || (largest >= 0.01 && largest < 1e5);
        return readable ? PrefixedUnit{1, column.unit} : prefixed_unit(largest, column.unit);
    }

    static std::string cell(const ReportTable::Cell& cell, const ReportTable::Column& column, double factor) {
        if (const auto* text = std::get_if<std::string>(&cell)) return escaped(*text);
        const double value = factor * std::get<double>(cell);
        if (!std::isfinite(value)) return "–";
        return column.decimals < 0 ? fmt::format("{:.4g}", value) : fmt::format("{:.{}f}", value, column.decimals);
    }

    // A file name as part of an address: a name like `javascript:x` must stay a file beside the page.
    static std::string link_to(const std::string& file) {
        std::string text = "./";
        for (const char c : file) {
            const bool plain =
                std::isalnum(static_cast<unsigned char>(c)) || c == '/' || c == '_' || c == '-' || c == '.';
            text += plain ? std::string(1, c) : fmt::format("%{:02X}", static_cast<unsigned char>(c));
        }
        return text;
    }
};

std::string html_of(const Report& report, const std::vector<std::string>& files,
                    const std::vector<std::string>& images) {
    const std::string style = std::string(uplot_css) + "\n" + std::string(report_css);
    const std::string script = fmt::format("/*\n{}*/\n{}\n{}", uplot_licence, uplot_js, report_js);
    std::string text = "<!DOCTYPE html>\n<html lang=\"en\">\n<head>\n<meta charset=\"utf-8\">\n";
    text += fmt::format("<meta http-equiv=\"Content-Security-Policy\" content=\"default-src 'none'; img-src data:; "
                        "style-src {}; script-src {}; base-uri 'none'; form-action 'none'\">\n",
                        policy_hash(style), policy_hash(script));
    text += "<meta name=\"viewport\" content=\"width=device-width, initial-scale=1\">\n"
            "<link rel=\"icon\" href=\"data:,\">\n"; // else a browser asks a server for one
    text += fmt::format("<meta name=\"generator\" content=\"tribode {}\">\n", escaped(version()));
    text += fmt::format("<title>{}</title>\n<style>{}</style>\n</head>\n<body>\n", escaped(report.title), style);
    text += fmt::format("<h1>{}</h1>\n", escaped(report.title));
    if (!report.summary.empty()) text += fmt::format("<p class=\"summary\">{}</p>\n", escaped(report.summary));
    if (report.sections.size() > 3) {
        text += "<nav aria-label=\"Contents\"><ol>\n";
        for (std::size_t s = 0; s < report.sections.size(); ++s) {
            text += fmt::format("<li><a href=\"#s{}\">{}</a></li>\n", s + 1, escaped(report.sections[s].title));
        }
        text += "</ol></nav>\n";
    }
    text += "<main>\n";
    Page page{files, images};
    for (std::size_t s = 0; s < report.sections.size(); ++s) {
        text += fmt::format("<section>\n<h2 id=\"s{}\">{}</h2>\n", s + 1, escaped(report.sections[s].title));
        for (const auto& block : report.sections[s].blocks) text += std::visit(page, block);
        text += "</section>\n";
    }
    return text + fmt::format("</main>\n<script>{}</script>\n</body>\n</html>\n", script);
}

std::vector<const Figure*> figures_of(const Report& report) {
    std::vector<const Figure*> figures;
    for (const auto& section : report.sections) {
        for (const auto& block : section.blocks) {
            if (const auto* figure = std::get_if<Figure>(&block)) figures.push_back(figure);
        }
    }
    return figures;
}

void check(const Report& report) {
    for (const auto& section : report.sections) {
        for (const auto& block : section.blocks) {
            const auto* table = std::get_if<ReportTable>(&block);
            if (!table) continue;
            for (std::size_t r = 0; r < table->rows.size(); ++r) {
                if (table->rows[r].size() == table->columns.size()) continue;
                throw InputError(
                    fmt::format("report, section \"{}\", table \"{}\": row {} has {} cells, must have {} like "
                                "the columns",
                                section.title, table->caption, r + 1, table->rows[r].size(), table->columns.size()));
            }
        }
    }
}

void require_beside(const std::string& file) {
    const fs::path normal = fs::path(file).lexically_normal();
    if (!normal.is_absolute() && normal.has_filename() && normal != "." && *normal.begin() != "..") return;
    throw InputError(fmt::format("report: the figure file \"{}\" must lie beside the page or in a folder there", file));
}

// The names of the figures' files: as asked for, or after the page.
std::vector<std::string> file_names(const std::vector<const Figure*>& figures, const std::string& stem) {
    std::vector<std::string> names;
    std::set<std::string> taken;
    for (const auto* figure : figures) {
        std::string name = figure->file.empty() ? fmt::format("{}_{}", stem, names.size() + 1) : figure->file;
        require_beside(name);
        if (!taken.insert(name).second && !figure->drawn) {
            throw InputError(fmt::format("report: two figures have the file \"{}\"", name));
        }
        names.push_back(std::move(name));
    }
    return names;
}

} // namespace

std::vector<std::string> write_report(const fs::path& page, const Report& report, const RunControl& control) {
    check(report);
    const auto figures = figures_of(report);
    const auto files = file_names(figures, page.stem().string());
    std::vector<std::string> images(figures.size());
    std::vector<std::size_t> to_draw;
    for (std::size_t i = 0; i < figures.size(); ++i) {
        if (figures[i]->drawn) {
            images[i] = read_file(path_inside(page.parent_path(), files[i] + ".png"));
        } else {
            to_draw.push_back(i);
        }
    }
    // Several to a program, and no more than somebody who interrupts would wait for.
    const std::size_t groups =
        std::max<std::size_t>((to_draw.size() + most_together - 1) / most_together,
                              std::min<std::size_t>(std::max(control.workers, 1u), to_draw.size()));
    const auto done = for_each_index(groups, control, "figures", [&](std::size_t group) {
        std::vector<Plot> plots;
        for (std::size_t i = group; i < to_draw.size(); i += groups) plots.push_back(figures[to_draw[i]]->plot);
        auto drawn = plot_pngs(plots);
        for (std::size_t k = 0; k < drawn.size(); ++k) {
            const std::size_t i = to_draw[group + k * groups];
            images[i] = std::move(drawn[k]);
            write_file(path_inside(page.parent_path(), files[i] + ".png"), images[i]);
        }
    });
    if (done < groups) {
        const auto missing = std::ranges::count(images, std::string{});
        throw EndedEarly(fmt::format("interrupted after {} of {} figures of {}",
                                     figures.size() - static_cast<std::size_t>(missing), figures.size(),
                                     page.string()));
    }
    write_file(page, html_of(report, files, images));
    std::vector<std::string> written;
    for (std::size_t i = 0; i < files.size(); ++i) {
        if (!figures[i]->drawn) written.push_back(files[i] + ".png");
    }
    return written;
}

// ---- from tables -------------------------------------------------------------------------------------------------

namespace {

ReportTable table_from_json(const Json& json, const std::string& where) {
    FieldReader fields(json, where, "table");
    ReportTable table;
    table.caption = fields.text("caption", "");
    fields.each("columns", [&](FieldReader& entry) {
        table.columns.push_back(
            {entry.text("name"), entry.text("unit", ""), static_cast<int>(entry.integer("decimals", -1, 15, -1))});
    });
    for (const auto& row : fields.value("rows")) {
        if (!row.is_array()) fields.fail("rows", "must be a list of lists");
        auto& cells = table.rows.emplace_back();
        for (const auto& cell : row) {
            if (cell.is_string()) {
                cells.emplace_back(cell.get<std::string>());
            } else if (cell.is_number()) {
                cells.emplace_back(cell.get<double>());
            } else {
                fields.fail("rows", "may hold texts and numbers only");
            }
        }
    }
    fields.finish();
    return table;
}

Figure figure_from_json(const Json& json, const std::string& where, const fs::path& folder) {
    Figure figure;
    if (json.is_string()) {
        figure.file = json.get<std::string>();
        figure.drawn = true;
        require_beside(figure.file);
        const fs::path file = path_inside(folder, figure.file + plot_data_extension);
        figure.plot = plot_from_json(read_json(file), file.string());
        return figure;
    }
    Json plot = json;
    if (plot.is_object() && plot.contains("file")) {
        FieldReader fields(json, where, "plot");
        figure.file = fields.text("file");
        plot.erase("file");
    }
    figure.plot = plot_from_json(plot, where + ": plot");
    return figure;
}

} // namespace

Report report_from_json(const Json& json, const std::string& where, const fs::path& folder) {
    FieldReader fields(json, where);
    Report report;
    report.title = fields.text("title");
    report.summary = fields.text("summary", "");
    fields.each("sections", [&](FieldReader& section_fields) {
        auto& section = report.sections.emplace_back();
        section.title = section_fields.text("title");
        const Json& content = section_fields.value("content");
        if (!content.is_null() && !content.is_array() && !content.empty()) {
            section_fields.fail("content", "must be a list");
        }
        std::size_t number = 0;
        for (const auto& entry : content) {
            const std::string place = fmt::format("{}[{}]", section_fields.name_of("content"), ++number);
            if (entry.is_string()) {
                section.blocks.emplace_back(Paragraph{entry.get<std::string>()});
                continue;
            }
            FieldReader block(entry, place);
            if (block.has("plot")) {
                Figure figure = figure_from_json(block.value("plot"), place, folder);
                figure.caption = block.text("caption", "");
                section.blocks.emplace_back(std::move(figure));
            } else if (block.has("table")) {
                section.blocks.emplace_back(table_from_json(block.value("table"), place));
            } else if (block.has("list")) {
                section.blocks.emplace_back(BulletList{block.texts("list", {})});
            } else {
                section.blocks.emplace_back(Preformatted{block.text("preformatted")});
            }
            block.finish();
        }
        section_fields.finish();
    });
    fields.finish();
    return report;
}

} // namespace tribode
