#include "tribode/record/csv.hpp"
#include "tribode/base/error.hpp"
#include "tribode/base/text.hpp"
#include "tribode/record/output_file.hpp"

#include <algorithm>
#include <cmath>
#include <fmt/format.h>
#include <optional>

namespace tribode {

namespace {

// Hands out the lines of a text, without their line ends, and counts them.
class LineReader {
  public:
    LineReader(std::string name, std::string_view text) : name_(std::move(name)), rest_(text) {}

    bool at_end() const { return rest_.empty(); }
    bool only_blanks_left() const { return trim(rest_).empty(); }
    std::size_t number() const { return number_; } // of the line handed out last, from 1
    std::size_t lines_left() const {
        return static_cast<std::size_t>(std::count(rest_.begin(), rest_.end(), '\n')) + 1;
    }

    std::string_view next() {
        ++number_;
        const auto end = std::min(rest_.find('\n'), rest_.size());
        std::string_view line = rest_.substr(0, end);
        rest_.remove_prefix(std::min(end + 1, rest_.size()));
        if (line.ends_with('\r')) line.remove_suffix(1);
        return line;
    }

    [[noreturn]] void fail(const std::string& problem) const {
        throw InputError(fmt::format("{}:{}: {}", name_, number_, problem));
    }

  private:
    std::string name_;
    std::string_view rest_;
    std::size_t number_ = 0;
};

// Calls use(index, cell) for each cell; returns their number.
template <class Use>
std::size_t for_each_cell(std::string_view line, Use use) {
    std::size_t index = 0;
    for (;;) {
        const auto comma = line.find(',');
        use(index++, line.substr(0, comma));
        if (comma == std::string_view::npos) return index;
        line.remove_prefix(comma + 1);
    }
}

constexpr std::string_view byte_order_mark = "\xEF\xBB\xBF";

// Without the byte order mark that some programs put in front.
std::string_view without_mark(std::string_view text) {
    if (text.starts_with(byte_order_mark)) text.remove_prefix(byte_order_mark.size());
    return text;
}

std::string shown(std::string_view cell) {
    constexpr std::size_t longest = 40;
    if (cell.empty()) return "empty";
    return fmt::format("\"{}{}\"", cell.substr(0, longest), cell.size() > longest ? "..." : "");
}

// Names are compared with one another, which for many more of them would take minutes.
constexpr std::size_t max_columns = 10000;

std::vector<std::string> read_header(LineReader& lines) {
    std::string_view line;
    do {
        if (lines.only_blanks_left()) {
            line = lines.next();
            lines.fail("the file is empty, must have a header line and rows of numbers");
        }
        line = lines.next();
    } while (trim(line).starts_with('#'));

    std::vector<std::string> names;
    for_each_cell(line, [&](std::size_t index, std::string_view cell) {
        std::string_view name = trim(cell);
        if (name.size() >= 2 && name.starts_with('"') && name.ends_with('"')) {
            name = name.substr(1, name.size() - 2);
        }
        if (index == max_columns) lines.fail(fmt::format("there are more than {} columns, must be fewer", max_columns));
        if (name.empty()) lines.fail(fmt::format("column {} has no name in the header line", index + 1));
        if (parse_number(name)) {
            lines.fail(fmt::format("the header line has the number {}, must have column names", name));
        }
        if (std::find(names.begin(), names.end(), name) != names.end()) {
            lines.fail(fmt::format("column {} stands twice, each name must stand once", name));
        }
        names.emplace_back(name);
    });
    return names;
}

// Which column of the table each column of the file becomes; -1: none.
std::vector<int> places_of(const std::vector<std::string>& header, const std::vector<std::string>& wanted,
                           const LineReader& lines) {
    std::vector<int> places(header.size(), -1);
    for (std::size_t i = 0; i < wanted.size(); ++i) {
        const auto it = std::find(header.begin(), header.end(), wanted[i]);
        if (it == header.end()) {
            lines.fail(fmt::format("there is no column {}{}", wanted[i], suggestion(wanted[i], header)));
        }
        places[static_cast<std::size_t>(it - header.begin())] = static_cast<int>(i);
    }
    return places;
}

double read_cell(std::string_view cell, const std::string& column, bool finite, const LineReader& lines) {
    const auto value = parse_number(cell);
    if (!value) lines.fail(fmt::format("column {} is {}, must be a number", column, shown(trim(cell))));
    if (finite && !std::isfinite(*value)) {
        lines.fail(fmt::format("column {} is {}, must be a finite number", column, to_text(*value)));
    }
    return *value;
}

} // namespace

Table read_csv(const std::filesystem::path& path, const CsvOptions& options) {
    return parse_csv(read_file(path), path.string(), options);
}

std::vector<std::string> csv_names(std::string_view text, const std::string& source) {
    LineReader lines(source, without_mark(text));
    return read_header(lines);
}

Table parse_csv(std::string_view text, const std::string& source, const CsvOptions& options) {
    LineReader lines(source, without_mark(text));

    const std::vector<std::string> header = read_header(lines);
    const std::vector<std::string>& wanted = options.columns.empty() ? header : options.columns;
    const std::vector<int> places = places_of(header, wanted, lines);
    if (lines.only_blanks_left()) lines.fail("there are no rows of numbers after the header line");

    Table table;
    table.source = source;
    table.first_line = lines.number() + 1;
    for (const std::string& name : wanted) table.add(name, "", {});
    for (Column& column : table.columns) column.values.reserve(lines.lines_left());

    while (!lines.at_end()) {
        const std::string_view line = lines.next();
        if (trim(line).empty()) {
            if (lines.only_blanks_left()) break;
            lines.fail("the line is blank, must be a row of numbers (blank lines are allowed at the end)");
        }
        const std::size_t cells = for_each_cell(line, [&](std::size_t index, std::string_view cell) {
            if (index >= places.size() || places[index] < 0) return;
            auto& column = table.columns[static_cast<std::size_t>(places[index])];
            column.values.push_back(read_cell(cell, column.name, options.finite, lines));
        });
        if (cells != header.size()) {
            lines.fail(fmt::format("the line has {} values, must have {} like the header line", cells, header.size()));
        }
    }
    return table;
}

std::string to_csv(const Table& table) {
    std::string text;
    for (const Column& column : table.columns) {
        const std::string& name = column.name;
        if (name.empty() || trim(name) != name || name.starts_with('#') || name.starts_with(byte_order_mark) ||
            parse_number(name) || name.find_first_of(",\"\r\n") != std::string::npos) {
            throw InputError(
                fmt::format("\"{}\" is not a column name that CSV can hold: a comma, a quote, a line break, "
                            "a blank at an end, a # or a byte order mark in front and a number are not allowed",
                            name));
        }
        text += text.empty() ? "" : ",";
        text += name;
    }
    text += '\n';

    text.reserve(text.size() + 12 * table.rows() * table.columns.size());
    for (std::size_t row = 0; row < table.rows(); ++row) {
        for (const Column& column : table.columns) {
            append_text(text, column.values.at(row));
            text += ',';
        }
        text.back() = '\n';
    }
    return text;
}

void write_csv(const std::filesystem::path& path, const Table& table) { write_file(path, to_csv(table)); }

} // namespace tribode
