#pragma once
#include "tribode/record/table.hpp"
#include "tribode/record/variable.hpp"

#include <string>
#include <string_view>
#include <vector>

namespace tribode {

// MAT files of version 4: `save -v4`, and the results of Dymola and OpenModelica, which are such files with a layout of their
// own [Modelica 2013].

// Whether the bytes begin like such a file, which has no mark of its own: a header with allowed numbers, and a name.
bool is_mat4(std::string_view bytes);

// The variables in the order of the file, of one name the last. A vector of any type of number is a column; texts, matrices,
// sparse and complex ones are named with a refusal.
// Of a trajectory of Dymola or OpenModelica (both "binTrans" and "binNormal"): its variables, with the units that their
// descriptions end with, the time and aliases among them. What is constant is a column of equal numbers. `asked`: only these
// get values, the others a refusal; empty: all that vary.
// Throws InputError where the bytes are damaged or cut short, or the columns take more than `most` bytes.
std::vector<Variable> mat4_variables(std::string_view bytes, const std::vector<std::string>& asked, std::size_t most,
                                     const std::string& source);

// The bytes of such a trajectory, in the layout "binTrans": the first column is the time, which must not decrease, under the
// name Time; units stand in the descriptions. Throws InputError where there are no rows.
std::string to_trajectory(const Table& table);

} // namespace tribode
