#pragma once
#include "tribode/base/field_reader.hpp"
#include "tribode/record/table.hpp"
#include "tribode/record/time_grid.hpp"

#include <filesystem>
#include <map>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

namespace tribode {

// What a user says of a record whose names and units are not ours, and in which units it is wanted.
struct RecordOptions {
    std::map<std::string, std::string> columns; // our name -> name in the file; other columns keep theirs
    std::map<std::string, double> scale;        // our name -> factor to the unit below
    // our name -> the unit in which a wanted column is to be, any that the file's unit can be converted to; those without one
    // are brought to SI. Without the map the units are those of machines: u in N, y in m.
    std::optional<std::map<std::string, std::string>> units;

    // From the command line: `t=t_s,u=u_V` and `u=35.15`. Throws InputError beginning with --columns or --scale.
    static RecordOptions parse(std::string_view columns, std::string_view scale);
    // From the keys `columns` and `scale` of a table: {t = "t_s"}, {u = 35.15}. Throws InputError.
    static RecordOptions read(FieldReader& fields);
};

struct Record {
    Table table;
    std::optional<TimeGrid> time; // where there is a column t
};

// Reads a measured record: CSV, MAT of version 5 or 7.3, HDF5, each also packed by gzip; told apart by the content.
// The columns are those that options.columns names and those of a wanted name; without either, all. `wanted`: the names
// the caller can use, t among them, which then must be there.
// A column asked for in either way must be a vector of finite real numbers, and as long as the others. What else a MAT
// or HDF5 file holds is passed over; a CSV file is kept whole unless options.columns names some of it. In HDF5 the name
// of a vector in a group is `group/name`, or `name` alone where one group holds all.
// Throws InputError: a column that is missing (with the nearest name), not a vector of doubles (with those there are),
// of another length, not finite, in a unit that is not known or does not fit (with the option that gives its factor), a
// time that does not increase, damaged bytes.
Record read_record(const std::filesystem::path& path, const RecordOptions& options = {},
                   const std::vector<std::string>& wanted = {});

// The same of bytes already read; `source` begins the messages.
Record record_from_bytes(std::string_view bytes, const std::string& source, const RecordOptions& options = {},
                         const std::vector<std::string>& wanted = {});

// The names of the columns of a record, of a MAT or HDF5 file those of its vectors of numbers, whatever their units. Throws
// InputError: damaged bytes.
std::vector<std::string> column_names(const std::filesystem::path& path);

// Writes a table in the format of the extension: .mat, .h5 or .hdf5, .csv.gz; everything else is CSV.
// No half-written file is ever left.
void write_record(const std::filesystem::path& path, const Table& table);

} // namespace tribode
