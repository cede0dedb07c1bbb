#pragma once
#include "base/json.hpp"
#include "record/table.hpp"
#include "record/variable.hpp"

#include <filesystem>
#include <string>
#include <string_view>
#include <vector>

namespace tribode {

struct NamedTable {
    std::string name; // of the group; "": the columns stand at the root of the file
    Table table;
};

// The bytes of an HDF5 file: one group per table, in it one one-dimensional dataset of doubles per column, in order,
// with the attribute `unit`. The fields of `attributes` become attributes of the root: text, whole numbers and
// doubles as such, everything else as its JSON text. The same data gives the same bytes.
// Throws InputError where a name is empty, stands twice or contains a slash.
std::string to_hdf5(const std::vector<NamedTable>& tables, const Json& attributes = Json::object());

// to_hdf5 through write_file: no half-written file is ever left.
void write_hdf5(const std::filesystem::path& path, const std::vector<NamedTable>& tables,
                const Json& attributes = Json::object());

// Reads the layout above and files of others: the vectors of numbers (n, 1 x n or n x 1, of any numeric type) at the
// root, as the first table with the name "", and in each group of the root, as one table each. The rest (texts,
// matrices, groups in groups, single numbers beside longer vectors) is passed over; tables without columns are left
// out. Throws InputError where the file is not HDF5 or the vectors of one group differ in length.
std::vector<NamedTable> read_hdf5(const std::filesystem::path& path);

// Whether the bytes begin like an HDF5 file; the head of a MAT file of version 7.3 may stand in front.
bool is_hdf5(std::string_view bytes);

// What stands at the root and, as `group/name`, in the groups of the root, whether or not it can be a column; also of a
// MAT file of version 7.3, where only class double can. The library reads in a process of its own, because damaged bytes
// can bring it down: that, too, is an InputError. `source` begins its message.
std::vector<Variable> hdf5_variables(std::string_view bytes, const std::string& source);

} // namespace tribode
