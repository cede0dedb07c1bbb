#pragma once
#include <filesystem>
#include <set>
#include <string>
#include <vector>

namespace tribode::structure {

// The project's own folder.
std::filesystem::path project();

std::string read(const std::filesystem::path& file);

// Files below a folder of the project whose extension is one of these, sorted; a folder that is absent has
// none.
std::vector<std::filesystem::path> files_below(const std::filesystem::path& folder,
                                               const std::set<std::string>& extensions);

// README.md and its neighbors, and every page below docs/ and tests/.
std::vector<std::filesystem::path> pages();

} // namespace tribode::structure
