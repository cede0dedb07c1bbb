#include "structure/modules.hpp"
#include "tribode/base/text.hpp"

#include <fmt/format.h>
#include <regex>
#include <sstream>
#include <stdexcept>

namespace tribode::structure {

namespace {

const std::string commands = "commands"; // of the program: no module, but a folder of engine/

// The cells of the rows under the header whose first cell is `first`.
std::vector<std::vector<std::string>> table_rows(std::string_view text, std::string_view first) {
    std::vector<std::vector<std::string>> rows;
    std::istringstream lines{std::string(text)};
    bool inside = false;
    for (std::string line; std::getline(lines, line);) {
        std::vector<std::string> cells;
        std::istringstream parts(line);
        std::string cell;
        std::getline(parts, cell, '|');
        while (std::getline(parts, cell, '|')) cells.emplace_back(trim(cell));
        if (cells.empty()) {
            inside = false;
        } else if (cells.front() == first) {
            inside = true;
        } else if (inside && !cells.front().starts_with("---")) {
            rows.push_back(cells);
        }
    }
    if (rows.empty()) throw std::runtime_error(fmt::format("no table with the first column \"{}\"", first));
    return rows;
}

// Names separated by commas or blanks; a dash is none.
std::set<std::string> names_in(const std::string& cell) {
    static const std::regex name(R"([A-Za-z0-9_./]+)");
    std::set<std::string> names;
    for (std::sregex_iterator it(cell.begin(), cell.end(), name), end; it != end; ++it) names.insert(it->str());
    return names;
}

} // namespace

Modules Modules::from_markdown(std::string_view text) {
    Modules modules;
    for (const auto& row : table_rows(text, "module")) modules.may_use[row.at(0)] = names_in(row.at(2));
    for (const auto& row : table_rows(text, "package")) {
        for (const auto& beginning : names_in(row.at(1))) modules.only_in[beginning] = names_in(row.at(2));
    }
    return modules;
}

std::set<std::string> Modules::reachable(const std::string& module) const {
    std::set<std::string> found;
    std::vector<std::string> open = {module};
    if (module == commands || module == "main.cpp" || module == "tribode.hpp") {
        for (const auto& [name, used] : may_use) open.push_back(name);
    }
    while (!open.empty()) {
        const std::string next = open.back();
        open.pop_back();
        if (!found.insert(next).second) continue;
        if (const auto row = may_use.find(next); row != may_use.end()) {
            open.insert(open.end(), row->second.begin(), row->second.end());
        }
    }
    return found;
}

std::vector<Include> includes_of(std::string_view source) {
    static const std::regex directive(R"(^\s*#\s*include\s*(["<])([^">]+)[">])");
    std::vector<Include> includes;
    std::istringstream lines{std::string(source)};
    std::size_t number = 0;
    for (std::string line; std::getline(lines, line);) {
        ++number;
        if (std::smatch match; std::regex_search(line, match, directive)) {
            includes.push_back({number, match[1] == "\"", match[2]});
        }
    }
    return includes;
}

// The module of a file below engine/: tribode/MODULE/..., the commands of the program with its main.cpp, or the file itself.
static std::string module_of(const std::filesystem::path& file) {
    auto part = file.begin();
    if (*part == "main.cpp") return commands;
    if (*part == "tribode" && std::next(part) != file.end()) ++part;
    return part->string();
}

std::vector<std::string> violations(const Modules& modules, const std::filesystem::path& file,
                                    std::string_view source) {
    const std::string module = module_of(file);
    const auto allowed = modules.reachable(module);
    std::vector<std::string> found;
    for (const auto& include : includes_of(source)) {
        const auto where = fmt::format("engine/{}:{} includes {}", file.generic_string(), include.line, include.path);
        const std::string target = module_of(include.path);
        if (modules.may_use.contains(target)) {
            if (!allowed.contains(target)) {
                found.push_back(fmt::format("{}, but {} may not use {}", where, module, target));
            }
        } else if (include.quoted && !(module == commands && target == commands)) {
            found.push_back(fmt::format("{}, which is in no module of docs/modules.md", where));
        }
        for (const auto& [beginning, only] : modules.only_in) {
            if (include.path.starts_with(beginning) && !only.contains(module)) {
                found.push_back(fmt::format("{}, which belongs in {} alone", where, fmt::join(only, ", ")));
            }
        }
    }
    return found;
}

std::map<std::string, std::set<std::string>> link_lines(std::string_view cmake) {
    static const std::regex call(R"((?:^|\n)\s*tribode_module\(([a-z_]+)([^)]*)\))"), library(R"(tribode_([a-z_]+))");
    std::map<std::string, std::set<std::string>> lines;
    const std::string text(cmake);
    for (std::sregex_iterator it(text.begin(), text.end(), call), end; it != end; ++it) {
        auto& used = lines[(*it)[1]];
        const std::string arguments = (*it)[2];
        for (std::sregex_iterator name(arguments.begin(), arguments.end(), library); name != end; ++name) {
            used.insert((*name)[1]);
        }
    }
    return lines;
}

} // namespace tribode::structure
