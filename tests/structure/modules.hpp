#pragma once
#include <filesystem>
#include <map>
#include <set>
#include <string>
#include <string_view>
#include <vector>

namespace tribode::structure {

// What docs/modules.md allows.
struct Modules {
    std::map<std::string, std::set<std::string>> may_use; // module -> the modules its row names
    std::map<std::string, std::set<std::string>> only_in; // beginning of a header -> the modules that may

    // Throws std::runtime_error where the text has no such tables.
    static Modules from_markdown(std::string_view text);

    // The module itself, the modules named and what those use. main.cpp: all.
    std::set<std::string> reachable(const std::string& module) const;
};

struct Include {
    std::size_t line; // from 1
    bool quoted;      // "..." and not <...>
    std::string path;
};

std::vector<Include> includes_of(std::string_view source);

// The includes of one file that the tables do not allow, one sentence each. `file`: path below engine/.
std::vector<std::string> violations(const Modules& modules, const std::filesystem::path& file, std::string_view source);

// The modules on the link lines `tribode_module(name tribode_x ...)` of engine/CMakeLists.txt.
std::map<std::string, std::set<std::string>> link_lines(std::string_view cmake);

} // namespace tribode::structure
