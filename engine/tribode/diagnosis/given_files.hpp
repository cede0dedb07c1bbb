#pragma once
#include <filesystem>
#include <string>
#include <vector>

namespace tribode {

// Throws InputError where two files, given by their names and hashes, have the same content: a record that is fitted, too, predicts
// nothing, and one that counts twice makes errors look smaller than they are.
void refuse_repeated_files(const std::vector<std::filesystem::path>& files, const std::vector<std::string>& hashes);

} // namespace tribode
