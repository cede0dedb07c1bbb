#pragma once
#include "tribode/base/json.hpp"
#include "tribode/record/table.hpp"
#include "tribode/record/variable.hpp"

#include <filesystem>
#include <memory>
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

// The columns as MATLAB keeps them in HDF5, n x 1 arrays of class double: what follows the head of a MAT file of version 7.3.
std::string to_matlab_hdf5(const Table& table);

// to_hdf5 through write_file: no half-written file is ever left.
void write_hdf5(const std::filesystem::path& path, const std::vector<NamedTable>& tables,
                const Json& attributes = Json::object());

// A file of many rows that is written row by row, with a few megabytes in memory. The same rows give the same bytes.
// Functions throw OutputError, after which nothing is left behind; without `commit` nothing is, either.
class Hdf5RowFile {
  public:
    struct Dataset {
        std::string name, unit;
        std::size_t width = 0; // 0: a vector (rows); else a matrix (rows x width)
    };

    Hdf5RowFile(std::filesystem::path path, std::size_t rows, std::vector<Dataset> datasets, const Json& attributes);
    ~Hdf5RowFile();
    Hdf5RowFile(const Hdf5RowFile&) = delete;
    Hdf5RowFile& operator=(const Hdf5RowFile&) = delete;

    // One number per vector and `width` per matrix, in the order of the datasets.
    void add_row(const std::vector<double>& numbers);
    // A group with a column of numbers and one of texts, of equal length.
    void add_group(const std::string& name, const Column& numbers, const std::string& texts_name,
                   const std::vector<std::string>& texts);
    // Requires that all rows were added.
    void commit();

  private:
    struct Content;
    void flush();
    void abandon();

    std::filesystem::path path_;
    std::unique_ptr<Content> content_;
};

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
