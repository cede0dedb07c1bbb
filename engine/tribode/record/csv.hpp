#pragma once
#include "tribode/record/table.hpp"

#include <filesystem>
#include <string>
#include <string_view>
#include <vector>

namespace tribode {

struct CsvOptions {
    std::vector<std::string> columns; // read these alone, in this order; empty: all, in the order of the file
    bool finite = true;               // refuse nan and inf
};

// Reads numbers in columns under a header line of names (plain or in double quotes). The columns are separated by commas,
// semicolons or tabs, which is seen from the header line. Where that is no comma, or the numbers are in quotes, they may
// have decimal commas. Allowed: lines that begin with # before the header, blank lines at the end, CRLF, a UTF-8 byte order
// mark, a first line sep=;. A line of units below the header, and a known unit in brackets behind a name, become the unit
// of the column, as the file has it; the values stay as they are.
// Throws InputError with file and line, e.g. `run.csv:17: column y is nan, must be a finite number`; also where a comma
// could mean two things.
Table read_csv(const std::filesystem::path& path, const CsvOptions& options = {});

// The same of a text already read; `source` takes the place of the file's name.
Table parse_csv(std::string_view text, const std::string& source, const CsvOptions& options = {});

// A column: "Position", in the header line "Position [mm]".
struct CsvName {
    std::string name, in_header;
};

// The names in the header line alone; as above.
std::vector<CsvName> csv_names(std::string_view text, const std::string& source);

// The header line and one line per row; each number as the shortest text that reads back to the same double.
// Throws InputError where a name would not read back (comma, quote, line break, blank at an end, empty, # in front).
std::string to_csv(const Table& table);

// to_csv through write_file.
void write_csv(const std::filesystem::path& path, const Table& table);

} // namespace tribode
