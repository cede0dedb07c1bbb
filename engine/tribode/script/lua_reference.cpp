#include "tribode/script/lua_reference.hpp"
#include "tribode/base/error.hpp"
#include "tribode/script/lua_function.hpp"
#include "tribode/solver/method.hpp"

#include <algorithm>
#include <fmt/format.h>
#include <sstream>

namespace tribode {

namespace {

constexpr std::string_view functions_begin = "<!-- functions:", options_begin = "<!-- options:",
                           solvers_begin = "<!-- solvers -->", end_line = "<!-- end -->";

const LuaFunction& function_named(const std::string& name) {
    static const std::vector<LuaFunction> all = all_functions();
    const auto found = std::find_if(all.begin(), all.end(), [&](const auto& one) { return "tb." + one.name == name; });
    if (found == all.end()) throw Error(fmt::format("the page names {}, which is no function", name));
    return *found;
}

// tb.a and tb.b of "<!-- functions: tb.a tb.b -->".
std::vector<std::string> names_in(const std::string& line) {
    std::vector<std::string> names;
    std::istringstream words(line);
    for (std::string word; words >> word;) {
        if (word.starts_with("tb.")) names.push_back(word);
    }
    return names;
}

std::string function_table(const std::vector<std::string>& names) {
    std::string text = "| function | result |\n|---|---|\n";
    for (const auto& name : names) {
        const LuaFunction& function = function_named(name);
        text += fmt::format("| {} | {} |\n", function.usage, function.documentation);
    }
    return text;
}

std::string option_table(const LuaFunction& function) {
    if (!function.options) throw Error(fmt::format("tb.{} has no table of options", function.name));
    std::string text = "| option | unit | allowed | default | meaning |\n|---|---|---|---|---|\n";
    for (const auto& row : function.options()) {
        // Fields of tables inside are described where these tables are.
        if (row.path.find_first_of(".[") != std::string::npos) continue;
        text += fmt::format("| `{}` | {} | {} | {} | {} |\n", row.path, row.unit, row.values, row.fallback,
                            row.about.meaning);
    }
    return text;
}

std::string solver_table() {
    std::string text = "| name | method | suited to |\n|---|---|---|\n";
    for (const auto& entry : method_list()) {
        text += fmt::format("| `{}` | {} | {} |\n", name_of(entry.method), entry.what, entry.suited_to);
    }
    return text;
}

} // namespace

std::string with_tables(const std::string& page) {
    std::string made;
    std::istringstream lines(page);
    for (std::string line; std::getline(lines, line);) {
        made += line + "\n";
        const bool functions = line.starts_with(functions_begin), solvers = line == solvers_begin;
        if (!functions && !solvers && !line.starts_with(options_begin)) continue;
        const auto names = names_in(line);
        made += "\n";
        if (functions) {
            made += function_table(names);
        } else if (solvers) {
            made += solver_table();
        } else {
            for (const auto& name : names) made += option_table(function_named(name));
        }
        const std::string begin = line;
        while (line != end_line) {
            if (!std::getline(lines, line)) throw Error(fmt::format("no line {} follows {}", end_line, begin));
        }
        made += "\n" + line + "\n";
    }
    return made;
}

std::vector<std::string> functions_on(const std::string& page) {
    std::vector<std::string> names;
    std::istringstream lines(page);
    for (std::string line; std::getline(lines, line);) {
        if (!line.starts_with(functions_begin)) continue;
        for (auto& name : names_in(line)) names.push_back(std::move(name));
    }
    return names;
}

} // namespace tribode
