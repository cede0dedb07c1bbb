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

// Reads comma-separated numbers under a header line of column names (plain or in double quotes). Allowed: lines that
// begin with # before the header, blank lines at the end, CRLF, a UTF-8 byte order mark. The units are "".
// Throws InputError with file and line, e.g. `run.csv:17: column y is nan, must be a finite number`.
Table read_csv(const std::filesystem::path& path, const CsvOptions& options = {});

// The same of a text already read; `source` takes the place of the file's name.
Table parse_csv(std::string_view text, const std::string& source, const CsvOptions& options = {});

// The names in the header line alone; as above.
std::vector<std::string> csv_names(std::string_view text, const std::string& source);

// The header line and one line per row; each number as the shortest text that reads back to the same double.
// Throws InputError where a name would not read back (comma, quote, line break, blank at an end, empty, # in front).
std::string to_csv(const Table& table);

// to_csv through write_file.
void write_csv(const std::filesystem::path& path, const Table& table);

} // namespace tribode
