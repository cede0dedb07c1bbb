#include "structure/tree.hpp"

#include <algorithm>
#include <fstream>
#include <iterator>
#include <stdexcept>

namespace tribode::structure {

namespace fs = std::filesystem;

fs::path project() { return TRIBODE_SOURCE_DIR; }

std::string read(const fs::path& file) {
    std::ifstream stream(file, std::ios::binary);
    if (!stream) throw std::runtime_error(file.string() + ": cannot be read");
    return {std::istreambuf_iterator<char>(stream), {}};
}

std::vector<fs::path> files_below(const fs::path& folder, const std::set<std::string>& extensions) {
    std::vector<fs::path> files;
    if (!fs::exists(project() / folder)) return files;
    for (const auto& entry : fs::recursive_directory_iterator(project() / folder)) {
        if (entry.is_regular_file() && extensions.contains(entry.path().extension().string())) {
            files.push_back(entry.path());
        }
    }
    std::sort(files.begin(), files.end());
    return files;
}

std::vector<fs::path> pages() {
    std::vector<fs::path> all;
    for (const auto& entry : fs::directory_iterator(project())) {
        if (entry.path().extension() == ".md") all.push_back(entry.path());
    }
    for (const auto* folder : {"docs", "tests", "benchmarks", "models", "scripts"}) {
        const auto more = files_below(folder, {".md"});
        all.insert(all.end(), more.begin(), more.end());
    }
    return all;
}

} // namespace tribode::structure
