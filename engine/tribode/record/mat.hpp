#pragma once
#include "tribode/record/table.hpp"
#include "tribode/record/variable.hpp"

#include <filesystem>
#include <string>
#include <string_view>
#include <vector>

namespace tribode {

// MAT files of version 5, what `save -v6` (plain) and `save -v7` (packed) write [MathWorks 2023]. Files of version 7.3
// are HDF5 behind a head; hdf5.hpp reads them.

// Whether the bytes begin like such a file.
bool is_mat5(std::string_view bytes);

// The variables in the order of the file, of one name the last. A column is a real array of class double with one
// dimension at most that is not 1; structs, texts, matrices, complex and other numbers are named with a refusal.
// Throws InputError where the bytes are damaged or cut short, or all its parts together unpack to more than `most` bytes;
// `source` begins the message.
std::vector<Variable> mat_variables(std::string_view bytes, std::size_t most, const std::string& source);

enum class MatVersion { v5, v7_3 };

// The bytes of a MAT file: each column as an n x 1 double array, not packed, without a date, so that the same table gives
// the same bytes. Units are not kept: the format has no place for them.
// Throws InputError where a name is none of MATLAB's (a letter, then letters, digits or _, 63 at most) or stands twice,
// or a column has 2 GiB or more, which only version 7.3 can hold.
std::string to_mat(const Table& table, MatVersion version = MatVersion::v5);

// to_mat through write_file: no half-written file is ever left.
void write_mat(const std::filesystem::path& path, const Table& table);

} // namespace tribode
