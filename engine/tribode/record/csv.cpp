#include "tribode/record/csv.hpp"
#include "tribode/base/error.hpp"
#include "tribode/base/text.hpp"
#include "tribode/record/file_units.hpp"
#include "tribode/record/output_file.hpp"

#include <algorithm>
#include <cmath>
#include <fmt/format.h>
#include <optional>
#include <utility>

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

// How a text writes its cells.
struct Dialect {
    char separator = ',';
    bool has_quotes = false; // somewhere in the text
};

// Calls use(index, cell) for each cell; returns their number. A cell in double quotes is one with what it holds, and comes
// with its quotes.
template <class Use>
std::size_t for_each_cell(std::string_view line, const Dialect& dialect, Use use) {
    std::size_t index = 0;
    for (;;) {
        std::size_t from = 0;
        if (dialect.has_quotes) {
            from = std::min(line.find_first_not_of(' '), line.size());
            const bool quoted = from < line.size() && line[from] == '"';
            from = quoted ? std::min(line.find('"', from + 1), line.size()) : 0;
        }
        const auto end = line.find(dialect.separator, from);
        use(index++, line.substr(0, end));
        if (end == std::string_view::npos) return index;
        line.remove_prefix(end + 1);
    }
}

std::string_view without_quotes(std::string_view cell) {
    cell = trim(cell);
    const bool quoted = cell.size() >= 2 && cell.starts_with('"') && cell.ends_with('"');
    return quoted ? trim(cell.substr(1, cell.size() - 2)) : cell;
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

// -1,5 with one comma as a decimal point. A comma before three digits could also divide thousands, but not one behind a
// leading zero.
struct CommaNumber {
    double value;
    bool could_be_thousands;
};

std::optional<CommaNumber> comma_number(std::string_view cell) {
    cell = trim(cell);
    const auto comma = cell.find(',');
    if (comma == std::string_view::npos || cell.find_first_of(",.", comma + 1) != std::string_view::npos ||
        cell.substr(0, comma).find('.') != std::string_view::npos) {
        return std::nullopt;
    }
    std::string text(cell);
    text[comma] = '.';
    const auto value = parse_number(text);
    if (!value) return std::nullopt;
    std::string_view before = cell.substr(0, comma), behind = cell.substr(comma + 1);
    if (before.starts_with('-') || before.starts_with('+')) before.remove_prefix(1);
    const bool thousands = behind.size() == 3 && !before.empty() && before.size() <= 3 && before.front() != '0' &&
                           behind.find_first_not_of("0123456789") == std::string_view::npos;
    return CommaNumber{*value, thousands};
}

bool is_number(std::string_view cell) {
    cell = without_quotes(cell);
    return parse_number(cell) || comma_number(cell);
}

// The header, and how the text is written.
struct Head {
    Dialect dialect;
    std::vector<std::string> full;  // the names as the header line has them
    std::vector<std::string> names; // without a unit in brackets
    std::vector<std::string> units; // as the file has them; empty: none given
};

// The character that divides the columns: the only one of these in the header, or the one by which the rows below have as
// many numbers as the header names.
char separator_of(std::string_view header, const LineReader& at_header, bool has_quotes) {
    std::string found;
    for (const char mark : {';', '\t', ','}) {
        std::size_t cells = for_each_cell(header, {mark, has_quotes}, [](std::size_t, std::string_view) {});
        if (cells > 1) found += mark;
    }
    if (found.empty()) return ',';
    if (found.size() == 1) return found[0];
    for (const char mark : found) {
        const Dialect dialect{mark, has_quotes};
        const std::size_t names = for_each_cell(header, dialect, [](std::size_t, std::string_view) {});
        LineReader below = at_header;
        for (int row = 0; row < 3 && !below.only_blanks_left(); ++row) {
            bool numbers = true;
            const std::size_t cells = for_each_cell(below.next(), dialect, [&](std::size_t, std::string_view cell) {
                numbers = numbers && is_number(cell);
            });
            if (numbers && cells == names) return mark;
        }
    }
    return found.find(',') != std::string::npos ? ',' : found[0];
}

// "Position [mm]" is a name and a unit; so is "Position (mm)" where the unit is known.
std::pair<std::string_view, std::string_view> name_and_unit(std::string_view full) {
    for (const auto& [open, close] : {std::pair{'[', ']'}, {'(', ')'}}) {
        const auto begin = full.rfind(open);
        if (!full.ends_with(close) || begin == std::string_view::npos || trim(full.substr(0, begin)).empty()) continue;
        const std::string_view unit = trim(full.substr(begin + 1, full.size() - begin - 2));
        const std::string_view name = trim(full.substr(0, begin));
        // A name that would have a unit itself, and be another when it is written and read again, stays whole.
        if (file_unit(unit) && name_and_unit(name).second.empty()) return {name, unit};
    }
    return {full, {}};
}

Head read_header(LineReader& lines, bool has_quotes) {
    Head head;
    head.dialect.has_quotes = has_quotes;
    std::string_view line;
    char told = 0; // by a line "sep=;", which spreadsheets put in front
    do {
        if (lines.only_blanks_left()) {
            line = lines.next();
            lines.fail("the file is empty, must have a header line and rows of numbers");
        }
        line = lines.next();
        if (line.size() == 5 && line.starts_with("sep=")) {
            told = line[4];
            if (told != ';' && told != '\t' && told != ',') {
                lines.fail(
                    fmt::format("the separator \"{}\" cannot be read, must be a comma, a semicolon or a tab", told));
            }
            line = "#";
        }
    } while (trim(line).starts_with('#'));
    head.dialect.separator = told ? told : separator_of(line, lines, has_quotes);

    for_each_cell(line, head.dialect, [&](std::size_t index, std::string_view cell) {
        const std::string_view name = without_quotes(cell);
        if (index == max_columns) lines.fail(fmt::format("there are more than {} columns, must be fewer", max_columns));
        if (name.empty()) lines.fail(fmt::format("column {} has no name in the header line", index + 1));
        if (is_number(name)) {
            lines.fail(fmt::format("the header line has the number {}, must have column names", name));
        }
        if (std::find(head.full.begin(), head.full.end(), name) != head.full.end()) {
            lines.fail(fmt::format("column {} stands twice, each name must stand once", name));
        }
        head.full.emplace_back(name);
        const auto [plain, unit] = name_and_unit(name);
        head.names.emplace_back(plain);
        head.units.emplace_back(unit);
    });
    // Where names differ only by their units, these belong to the names.
    for (std::size_t i = 0; i < head.names.size(); ++i) {
        if (std::count(head.names.begin(), head.names.end(), head.names[i]) == 1) continue;
        for (std::size_t k = 0; k < head.names.size(); ++k) {
            if (k != i && head.names[k] == head.names[i]) head.names[k] = head.full[k];
        }
        head.names[i] = head.full[i];
    }
    return head;
}

// The line below the header where it holds units: no number in a column that is read, and a unit that is known.
void read_units(LineReader& lines, Head& head, const std::vector<int>& places) {
    LineReader ahead = lines;
    if (ahead.at_end()) return;
    std::vector<std::string> units;
    bool has_number = false, is_known = false;
    const std::size_t cells = for_each_cell(ahead.next(), head.dialect, [&](std::size_t index, std::string_view cell) {
        units.emplace_back(without_quotes(cell));
        is_known = is_known || file_unit(units.back());
        if (index < places.size() && places[index] >= 0) has_number = has_number || is_number(cell);
    });
    if (cells != head.names.size() || has_number || !is_known) return;
    lines = ahead;
    for (std::size_t i = 0; i < units.size(); ++i) {
        if (!units[i].empty()) head.units[i] = units[i];
    }
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

// Reads the cells of one text, all of them with a decimal point or all with a decimal comma.
class CellReader {
  public:
    CellReader(const Dialect& dialect, bool finite)
        : may_hold_commas_(dialect.separator != ',' || dialect.has_quotes),
          finite_(finite) {}

    double read(std::string_view cell, const std::string& column, const LineReader& lines) {
        if (may_hold_commas_) cell = without_quotes(cell);
        auto value = parse_number(cell);
        if (may_hold_commas_) {
            if (value && cell.find('.') != std::string_view::npos) note(point_line_, lines);
            if (const auto comma = value ? std::nullopt : comma_number(cell)) {
                value = comma->value;
                note(comma_line_, lines);
                has_sure_comma_ = has_sure_comma_ || !comma->could_be_thousands;
            }
        }
        if (!value) lines.fail(fmt::format("column {} is {}, must be a number", column, shown(trim(cell))));
        if (finite_ && !std::isfinite(*value)) {
            lines.fail(fmt::format("column {} is {}, must be a finite number", column, to_text(*value)));
        }
        return *value;
    }

    // At the end of the text.
    void finish(const LineReader& lines) const {
        if (comma_line_ == 0 || has_sure_comma_) return;
        lines.fail("every comma in a number stands before three digits, and could divide thousands as well as be a "
                   "decimal comma; write the numbers with decimal points");
    }

  private:
    void note(std::size_t& line, const LineReader& lines) {
        if (line == 0) line = lines.number();
        if (point_line_ == 0 || comma_line_ == 0) return;
        lines.fail(fmt::format("there are numbers with a decimal point (line {}) and with a comma (line {}); must be "
                               "one of the two",
                               point_line_, comma_line_));
    }

    const bool may_hold_commas_, finite_;
    bool has_sure_comma_ = false;
    std::size_t point_line_ = 0, comma_line_ = 0; // the first; 0: none yet
};

} // namespace

Table read_csv(const std::filesystem::path& path, const CsvOptions& options) {
    return parse_csv(read_file(path), path.string(), options);
}

std::vector<CsvName> csv_names(std::string_view text, const std::string& source) {
    LineReader lines(source, without_mark(text));
    const Head head = read_header(lines, text.find('"') != std::string_view::npos);
    std::vector<CsvName> names;
    for (std::size_t i = 0; i < head.names.size(); ++i) names.push_back({head.names[i], head.full[i]});
    return names;
}

Table parse_csv(std::string_view text, const std::string& source, const CsvOptions& options) {
    LineReader lines(source, without_mark(text));

    Head head = read_header(lines, text.find('"') != std::string_view::npos);
    const std::vector<std::string>& wanted = options.columns.empty() ? head.names : options.columns;
    const std::vector<int> places = places_of(head.names, wanted, lines);
    read_units(lines, head, places);
    if (lines.only_blanks_left()) lines.fail("there are no rows of numbers after the header line");

    Table table;
    table.source = source;
    table.first_line = lines.number() + 1;
    for (const std::string& name : wanted) {
        const auto place = std::find(head.names.begin(), head.names.end(), name) - head.names.begin();
        table.add(name, head.units[static_cast<std::size_t>(place)], {});
    }
    for (Column& column : table.columns) column.values.reserve(lines.lines_left());

    CellReader reader(head.dialect, options.finite);
    while (!lines.at_end()) {
        const std::string_view line = lines.next();
        if (trim(line).empty()) {
            if (lines.only_blanks_left()) break;
            lines.fail("the line is blank, must be a row of numbers (blank lines are allowed at the end)");
        }
        const std::size_t cells = for_each_cell(line, head.dialect, [&](std::size_t index, std::string_view cell) {
            if (index >= places.size() || places[index] < 0) return;
            auto& column = table.columns[static_cast<std::size_t>(places[index])];
            column.values.push_back(reader.read(cell, column.name, lines));
        });
        if (cells != head.names.size()) {
            lines.fail(fmt::format("the line has {} values, must have {} like the header line{}", cells,
                                   head.names.size(),
                                   cells == 2 * head.names.size()
                                       ? " (numbers with decimal commas need semicolons or tabs between the columns)"
                                       : ""));
        }
    }
    reader.finish(lines);
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
        // In quotes where it holds what could separate columns.
        const bool quoted = name.find_first_of(";\t") != std::string::npos;
        text += quoted ? '"' + name + '"' : name;
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
