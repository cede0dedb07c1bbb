#pragma once
#include <cstddef>
#include <string>
#include <string_view>
#include <vector>

namespace tribode {

struct Column {
    std::string name; // carries the unit where it competes with another: frequency_hz
    std::string unit; // "m", "" for none or unknown
    std::vector<double> values;
};

// Columns of equal length, in order.
struct Table {
    std::vector<Column> columns;
    std::string source;         // the file it was read from, "" for none
    std::size_t first_line = 0; // of row 0 in that file, from 1; 0 where there are no lines

    // Throws InputError where the name is taken or the length differs from the other columns.
    void add(std::string name, std::string unit, std::vector<double> values);

    const Column* find(std::string_view name) const; // null where there is none
    // Throws InputError with the nearest known name.
    const Column& operator[](std::string_view name) const;

    std::size_t rows() const { return columns.empty() ? 0 : columns.front().values.size(); }
    std::vector<std::string> names() const;

    // Where a row (from 0) stands, the beginning of a message: `run.csv:17`, or `run.h5: row 16`, or `row 16`.
    std::string place(std::size_t row) const;
};

// Checks that the instants of a column are t0 + k Ts with integer k = row, each within Ts/1000.
// Throws InputError at the first that is not, e.g. `run.csv:103: t = 0.0525 s, expected 0.051 s (sample time 0.0005 s):
// the record has a gap in time`.
void require_uniform_time(const Table& table, double sample_time, std::string_view column = "t");

} // namespace tribode
